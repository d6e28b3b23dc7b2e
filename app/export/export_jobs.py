"""Export jobs, which make files in a process of their own: the loop's thread must not share its interpreter with them.

A job says what to make; `ExportJobs.made` starts `app.workers.export` for it and waits.
"""

from __future__ import annotations

import contextlib
import re
import subprocess
import tempfile
import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from app.export.figures import Figure, FigureOptions
from app.export.formats import DataFormat, Format
from app.export.playback_frames import PlaybackFrames
from app.process import launcher
from app.storage.recording_files import Table, Tell

PATIENCE = 2.0  # s that the process has to end by itself
LONGEST_NAME = 60
PLAYBACK_LIMIT = 25e6  # bytes


class ExportError(RuntimeError):
    """A file that could not be made: one sentence with the reason."""


@dataclass(frozen=True)
class FigureJob:
    """Job for a figure as a file of this form."""

    figure: Figure
    form: Format
    options: FigureOptions = field(default_factory=FigureOptions)


@dataclass(frozen=True)
class DataJob:
    """Job for a stretch of a recording, whose rows follow the job; at most `limit` bytes of file."""

    data: Table
    form: DataFormat
    limit: float


@dataclass(frozen=True)
class PlaybackJob:
    """Job for playback frames as a page of its own with this figure beside it, at most `limit` bytes."""

    frames: PlaybackFrames
    limit: float
    figure: Figure | None = None


@dataclass(frozen=True)
class MadeJob:
    """Job for a file that a function makes of these arguments; it is known by its name, in the process too."""

    make: Callable[..., bytes]
    arguments: tuple[Any, ...]


Job = FigureJob | DataJob | PlaybackJob | MadeJob


@dataclass(frozen=True)
class Progress:
    """Message with the share that is done, 0 to 1."""

    share: float


@dataclass(frozen=True)
class Done:
    """Message that the file is there."""


@dataclass(frozen=True)
class Failure:
    """Message with the reason why there is no file."""

    reason: str


def file_name(scenario_name: str, t: float, extension: str) -> str:
    """File name such as "vsmrc-ur5-hybrid-12.34s.svg": letters, digits, dots and dashes only, whatever the scenario's
    name."""
    return f"vsmrc-{plain_name(scenario_name) or 'run'}-{t:.2f}s.{extension}"


def plain_name(text: str) -> str:
    """The text with letters, digits and dashes only, not too long for the name of a file."""
    return re.sub(r"[^A-Za-z0-9_-]+", "-", text)[:LONGEST_NAME].strip("-")


class ExportJobs:
    """Export jobs, done one after the other: they make files. May be used from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._working: set[subprocess.Popen[bytes]] = set()
        self._closed = False

    def made(self, job: Job, tell: Tell) -> bytes:
        """Content of the file. Raises ExportError, and OSError when no process or folder can be had.

        tell: called with the progress. The work is done in another process.
        """
        with tempfile.TemporaryDirectory(prefix="vsmrc-") as folder:
            path = Path(folder) / "file"
            ours, theirs = Pipe()
            with ours:
                with theirs:
                    process = self._started(path, theirs.fileno())
                try:
                    _converse(ours, job, tell)
                    return path.read_bytes()
                except (EOFError, ConnectionError) as error:
                    status = _ended(process)
                    raise ExportError(f"the process that makes it has ended (exit status {status})") from error
                finally:
                    process.terminate()
                    _ended(process)
                    with self._lock:
                        self._working.discard(process)

    def close(self) -> None:
        """End the job in progress, and start no other one: a caller that waits for it is told that its process has
        ended."""
        with self._lock:
            self._closed = True
            for process in self._working:
                process.terminate()

    def _started(self, path: Path, file: int) -> subprocess.Popen[bytes]:
        with self._lock:
            if self._closed:
                raise ExportError("the program is ending")
            process = launcher.start(
                "app.workers.export", str(file), str(path), stdin=subprocess.DEVNULL, pass_fds=(file,)
            )
            self._working.add(process)
            return process


def _converse(worker: Connection, job: Job, tell: Tell) -> None:
    rows: Iterable[np.ndarray] = ()
    if isinstance(job, DataJob):
        rows, job = job.data.pieces, replace(job, data=replace(job.data, pieces=()))
    worker.send(job)
    with contextlib.suppress(BrokenPipeError, ConnectionResetError):  # it needs no more data: the reason is read below
        for piece in rows:
            worker.send_bytes(piece.data.cast("B"))
            if worker.poll() and not _going_on(worker.recv(), tell):
                return
    while _going_on(worker.recv(), tell):
        pass


def _going_on(message: Progress | Done | Failure, tell: Tell) -> bool:
    match message:
        case Progress(share):
            tell(share)
            return True
        case Failure(reason):
            raise ExportError(reason)
        case Done():
            return False


def _ended(process: subprocess.Popen[bytes]) -> int:
    try:
        return process.wait(PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
        return process.wait()
