"""Export jobs: files are made in another process, since the loop's thread must not share its interpreter with them.

A job describes a file; `ExportJobs.made` starts `app.workers.export` for it and waits.
"""

from __future__ import annotations

import contextlib
import hashlib
import re
import subprocess
import tempfile
import threading
import unicodedata
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from app.export.figures import Figure, FigureOptions
from app.export.formats import DataFormat, Format
from app.export.playback_frames import PlaybackFrames
from app.process import launcher
from app.storage.recording_files import ProgressCallback, RecordingTable

NICENESS = 5  # of the process; at 10, on a busy machine, it got next to no time
PATIENCE = 2.0  # s in which the process may end by itself
LONGEST_NAME, LONGEST_CONTENT = 60, 150  # letters of a part of a file's name
PLAYBACK_LIMIT = 25e6  # bytes
_DIGEST = 9  # letters, with a dash, that stand for the rest of a name that is cut


class ExportError(RuntimeError):
    """Error of a file that could not be made: one sentence with the reason."""


@dataclass(frozen=True)
class FigureJob:
    """Job for a file of a figure."""

    figure: Figure
    form: Format
    options: FigureOptions = field(default_factory=FigureOptions)


@dataclass(frozen=True)
class DataJob:
    """Job for a file of a recording's stretch, whose rows are sent after the job. limit: largest file, bytes."""

    data: RecordingTable
    form: DataFormat
    limit: float


@dataclass(frozen=True)
class PlaybackJob:
    """Job for an HTML page that plays frames. limit: largest page, bytes. figure: beside the scene, None for none."""

    frames: PlaybackFrames
    limit: float
    figure: Figure | None = None


@dataclass(frozen=True)
class MadeJob:
    """Job for a file that a function makes of some arguments. make: function of a module, which is sent by its name."""

    make: Callable[..., bytes]
    arguments: tuple[Any, ...]


Job = FigureJob | DataJob | PlaybackJob | MadeJob


@dataclass(frozen=True)
class ExportProgress:
    """Message with the fraction that is done, 0 to 1."""

    fraction: float


@dataclass(frozen=True)
class ExportDone:
    """Message that the file is complete."""


@dataclass(frozen=True)
class Failure:
    """Message with the reason why there is no file."""

    reason: str


def file_name(scenario_name: str, t: float, extension: str, content: str = "", start: float = 0.0) -> str:
    """File name such as "vsmrc-ur5-hybrid-torques-12.34s.svg", with letters, digits, dots and dashes only. t: instant,
    s; content: what is in it, where that is not all of the run; start: s, of the stretch that ends at t."""
    times = f"{_seconds(start)}-{t:.2f}s" if start > 0.0 else f"{t:.2f}s"
    parts = ("vsmrc", plain_name(scenario_name) or "run", plain_name(content, LONGEST_CONTENT), times)
    return f"{'-'.join(filter(None, parts))}.{extension}"


def _seconds(t: float) -> str:
    """Number of seconds with at least two decimals, and as many as a control period may need."""
    whole, _, decimals = f"{t:.6f}".partition(".")
    return f"{whole}.{decimals.rstrip('0').ljust(2, '0')}"


def plain_name(text: str, longest: int = LONGEST_NAME) -> str:
    """Part of a file name from a text: letters, digits and dashes only, and not too long. Symbols are spelled, as they
    can be typed: of ψ₁ and τ₁ nothing but dashes would be left. Where letters are lost, digits follow that tell the
    name from others."""
    spelled = "".join(map(_spelled, re.sub(r"(?:‖|\|\|)(.+?)(?:‖|\|\|)", r" norm \1 ", text)))
    name = re.sub(r"[^A-Za-z0-9_-]+", "-", spelled).strip("-")
    lost = any(letter.isalnum() and not letter.isascii() for letter in spelled)
    if len(name) <= longest and not lost:
        return name
    # what is cut off or lost may be all that tells two names apart
    digest = hashlib.sha256((spelled if lost else name).encode(errors="surrogatepass")).hexdigest()[: _DIGEST - 1]
    return f"{name[: longest - _DIGEST].strip('-')}-{digest}".strip("-")


def _spelled(letter: str) -> str:
    """Greek letter in letters, an index with its underscore, another symbol as the letter that it is like (ℓ, ᵀ)."""
    name = unicodedata.name(letter, "")
    if greek := re.fullmatch(r"GREEK (SMALL|CAPITAL) LETTER (\w+)", name):
        word = greek[2].replace("LAMDA", "LAMBDA")  # Unicode's spelling
        return word.lower() if greek[1] == "SMALL" else word.capitalize()
    if name.startswith("SUBSCRIPT") and letter.isdigit():
        return f"_{unicodedata.digit(letter)}"
    plain = "".join(each for each in unicodedata.normalize("NFKD", letter) if not unicodedata.combining(each))
    return plain if plain.isascii() else unicodedata.normalize("NFKC", letter)


class ExportJobs:
    """Maker of files: does each export job in a process of its own. Safe to use from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._working: set[subprocess.Popen[bytes]] = set()
        self._closed = False

    def made(self, job: Job, on_progress: ProgressCallback) -> bytes:
        """Content of the file of a job, made in another process. Raises ExportError, and OSError where no process or
        file can be created.

        on_progress: called with the progress, 0 to 1.
        """
        with tempfile.TemporaryFile() as file:  # it has no name: nothing is left of it, however this process ends
            ours, theirs = Pipe()
            with ours:
                with theirs:
                    process = self._started(theirs.fileno(), file.fileno())
                try:
                    _converse(ours, job, on_progress)
                    file.seek(0)
                    return file.read()
                except (EOFError, ConnectionError) as error:
                    status = _ended(process)
                    raise ExportError(f"the process that makes it has ended (exit status {status})") from error
                finally:
                    process.terminate()
                    _ended(process)
                    with self._lock:
                        self._working.discard(process)

    def close(self) -> None:
        """End the jobs in progress, and start no others. A caller that waits for a job gets an ExportError."""
        with self._lock:
            self._closed = True
            for process in self._working:
                process.terminate()

    def _started(self, connection: int, file: int) -> subprocess.Popen[bytes]:
        with self._lock:
            if self._closed:
                raise ExportError("the program is ending")
            given = (connection, file)
            process = launcher.start(
                "app.workers.export", *map(str, given), niceness=NICENESS, stdin=subprocess.DEVNULL, pass_fds=given
            )
            self._working.add(process)
            return process


def _converse(worker: Connection, job: Job, on_progress: ProgressCallback) -> None:
    rows: Iterable[np.ndarray] = ()
    if isinstance(job, DataJob):
        rows, job = job.data.pieces, replace(job, data=replace(job.data, pieces=()))
    worker.send(job)
    with contextlib.suppress(BrokenPipeError, ConnectionResetError):  # it takes no more rows; the reason is read below
        for piece in rows:
            worker.send_bytes(piece.data.cast("B"))
            if worker.poll() and not _going_on(worker.recv(), on_progress):
                return
    while _going_on(worker.recv(), on_progress):
        pass


def _going_on(message: ExportProgress | ExportDone | Failure, on_progress: ProgressCallback) -> bool:
    match message:
        case ExportProgress(fraction):
            on_progress(fraction)
            return True
        case Failure(reason):
            raise ExportError(reason)
        case ExportDone():
            return False


def _ended(process: subprocess.Popen[bytes]) -> int:
    try:
        return process.wait(PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
        return process.wait()
