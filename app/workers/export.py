"""Process that makes one file: `python -m app.workers.export FD FD`, started by `app.export.export_jobs`. The first FD
is the connection to the asker, the second the file, which is empty and has no name."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from multiprocessing.connection import Connection
from typing import BinaryIO

import numpy as np
import structlog

from app.export.export_jobs import DataJob, ExportDone, ExportProgress, Failure, FigureJob, Job, MadeJob, PlaybackJob
from app.export.printing import render
from app.process.log import configure_as_parent
from app.scenario.errors import ScenarioError
from app.simulation.signals import columns_of
from app.storage.recording_files import RecordingTable, TooLarge, write_csv, write_npz

log = structlog.get_logger()


class _Reporter:
    """Reporter of the progress to the asker: every whole percent, once."""

    def __init__(self, asker: Connection) -> None:
        self._asker = asker
        self._percent = -1

    def report(self, fraction: float) -> None:
        if (percent := int(100 * fraction)) > self._percent:
            self._percent = percent
            self._asker.send(ExportProgress(fraction))


def serve(asker: Connection, descriptor: int) -> None:
    """Make the one file that is asked for. Raises EOFError or ConnectionError when the asker has gone."""
    job: Job = asker.recv()
    try:
        with open(descriptor, "wb") as file:
            _make(job, asker, file)
    except (EOFError, ConnectionError):
        raise
    except OSError as error:
        asker.send(Failure(f"the file cannot be written: {error.strerror or error}"))
    except (TooLarge, ScenarioError, ArithmeticError, ValueError) as error:
        asker.send(Failure(str(error)))
    except Exception as error:  # the process's last resort: report it
        log.exception("fault", stage="a file")
        asker.send(Failure(f"internal error: {type(error).__name__}: {error}"))
    else:
        asker.send(ExportDone())


def _make(job: Job, asker: Connection, file: BinaryIO) -> None:
    on_progress = _Reporter(asker).report
    match job:
        case FigureJob(figure, form, options):
            file.write(render(figure, form, options))
        case DataJob(data, form, limit):
            write = {"csv": write_csv, "npz": write_npz}[form]
            write(replace(data, pieces=_received(data, asker)), file, limit, on_progress)
        case MadeJob(make, arguments):
            file.write(make(*arguments))
        case PlaybackJob(frames, limit, figure):
            from app.dashboard.scene.standalone import (
                standalone_html,  # here: the others need neither viser nor the law
            )

            file.write(standalone_html(frames, limit, on_progress, figure).encode())


def _received(data: RecordingTable, asker: Connection) -> Iterator[np.ndarray]:
    """The rows as they arrive."""
    width, missing = max(where.stop for where in columns_of(data.n).values()), data.length
    while missing:
        piece = np.frombuffer(asker.recv_bytes()).reshape(-1, width)
        missing -= len(piece)
        yield piece


def main() -> None:
    configure_as_parent()
    with Connection(int(sys.argv[1])) as asker:
        try:
            serve(asker, int(sys.argv[2]))
        except (EOFError, ConnectionError):
            log.debug("asker gone")


if __name__ == "__main__":
    main()
