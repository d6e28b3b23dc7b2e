"""Recordings as files: CSV for any program, NPZ for numpy. Both hold units and the scenario, and where it was changed
during the run, which one held from when."""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from app.scenario.caption import stopped_at
from app.scenario.data import from_toml, to_toml
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.scenario.units import Units, kinds_of
from app.simulation.recording import Epoch, Recording
from app.simulation.signals import SIGNALS, columns_of
from app.storage.epoch_bytes import from_bytes, to_bytes
from app.storage.joint_kinds import slides_of
from app.storage.scenario_changes import ScenarioChange, changes_of
from app.storage.unreadable import UNREADABLE

LINES = 512  # of a CSV, between two looks at how far it has got
LARGEST_RECORDING = 1_200_000_000  # bytes, unpacked: 14 min at 1 kHz with six joints; the page keeps ten in full
LARGEST_TEXT = 4_000_000  # bytes of a scenario, which numpy writes with four for a character
LARGEST_CONDITIONS = 60_000_000  # bytes; as many epochs as a recording keeps, each with a blend, have 20 MB
LARGEST_HEADER = 70_000  # bytes of the header that numpy writes before an array
MOST_JOINTS = 8
# signals that files from before there were several surfaces, or moments, do not have; there they were 0
LATER = ("multiplier_2", "phi_2", "multiplier_3", "phi_3", "moment", "moment_push", "moment_true")

ProgressCallback = Callable[[float], object]  # called with the fraction that is done, 0 to 1


class TooLarge(ValueError):
    """A file over its limit: one sentence with its size, the allowed size, and how long a stretch of time would fit."""


@dataclass(frozen=True)
class RecordingTable:
    """A stretch of a recording of an arm with n joints.
    scenario: of its last row.
    units: in its task space; slides: whether each joint is prismatic.
    pieces: its `length` rows, oldest first, as `Recording.pieces` gives them.
    seconds: its duration.
    epochs: in which the rows were recorded, () where they are not known.
    stopped: why the run stopped at its last row, "" where it did not."""

    scenario: Scenario
    n: int
    length: int
    seconds: float
    units: Units
    slides: tuple[bool, ...]
    pieces: Iterable[np.ndarray]
    epochs: tuple[Epoch, ...] = ()
    stopped: str = ""

    @cached_property
    def changes(self) -> tuple[ScenarioChange, ...]:
        """Changes of the scenario between the rows, none where they are not known."""
        return changes_of(self.epochs)

    @property
    def first_scenario(self) -> Scenario:
        """Scenario of the first row."""
        return self.changes[0].before if self.changes else self.scenario


def table(
    scenario: Scenario, recording: Recording, t_from: float = -math.inf, t_to: float = math.inf, stopped: str = ""
) -> RecordingTable:
    """Table of the rows of this stretch of time, s, without copying them.

    scenario: of the last row, as far as the recording itself does not tell it: a run can have been edited since.
    stopped: why the run stopped at its end, "" where it did not.
    """
    pieces = recording.pieces(t_from, t_to)
    seconds = float(pieces[-1][-1, 0] - pieces[0][0, 0]) if pieces else 0.0
    epochs = _epochs_of(recording, float(pieces[0][0, 0]), float(pieces[-1][-1, 0])) if pieces else ()
    ran = epochs[-1].scenario if epochs else scenario
    length, slides = sum(len(piece) for piece in pieces), slides_of(ran)
    if len(slides) != recording.n:  # the arm's URDF is gone, or another one has taken its place
        slides = recording.n * (False,)
    units = Units(ran.task_space.kind, kinds_of(slides))
    ended = stopped if stopped_within(recording, t_to) else ""
    return RecordingTable(ran, recording.n, length, seconds, units, slides, pieces, epochs, ended)


def stopped_within(recording: Recording, t_to: float) -> bool:
    """Whether a stretch that ends at t_to (s) has the last row of a recording, at which a run that stopped did."""
    return not recording.pieces(np.nextafter(t_to, math.inf), math.inf)


def _epochs_of(recording: Recording, first: float, last: float) -> tuple[Epoch, ...]:
    """Epochs of the rows from `first` to `last` (s), as they were known at the end."""
    epochs = tuple(recording.epochs)
    in_force = max((epoch.t for epoch in epochs if epoch.t <= first), default=first)
    return tuple(epoch.until(last) for epoch in epochs if in_force <= epoch.t <= last)


def _silent(fraction: float) -> None:
    del fraction


def write_csv(
    data: RecordingTable, file: BinaryIO, limit: float = math.inf, on_progress: ProgressCallback = _silent
) -> None:
    """Write a recording as CSV: the scenario as comment lines, a line of names with units, a line per row. Where the
    scenario was changed on the way, the comment lines hold that of the first row, and the changes as TOML's comments,
    as is why the run stopped.

    Numbers read back to the very same bits. Raises TooLarge when the file would have more than `limit` bytes.
    """
    about = [*_stop_comments(data), *scenario_text(data).rstrip("\n").split("\n")]
    file.write("".join(f"# {line}\n" for line in about).encode())
    file.write((",".join(csv_header(data)) + "\n").encode())
    begin, done = file.tell(), 0
    for piece in data.pieces:
        for start in range(0, len(piece), LINES):
            rows = piece[start : start + LINES].tolist()
            # a list's repr has that of its numbers, the shortest text that reads back to the same number
            file.write("".join(repr(row)[1:-1].replace(" ", "") + "\n" for row in rows).encode())
            done += len(rows)
            _keep_to(limit, begin + (file.tell() - begin) * data.length / done, data.seconds)
            on_progress(done / data.length)


def scenario_text(data: RecordingTable) -> str:
    """TOML of the scenario of a recording's first row, with the changes during the run as comments before it."""
    return "\n".join((*_change_comments(data), to_toml(data.first_scenario)))


def _change_comments(data: RecordingTable) -> list[str]:
    """Lines on the changes of the scenario, which TOML takes as comments; none where there was no change."""
    if not data.changes:
        return []
    return [
        "# The scenario was changed during this run. The one below is that of the first row; of the others:",
        *(f"# {line}" for change in data.changes for line in change.lines()),
        "# To play such a run again: docs/export.md.",
        "",
    ]


def _stop_comments(data: RecordingTable) -> list[str]:
    """Line on the run's stop, which TOML takes as a comment; none where the rows do not end with one."""
    return [f"# {stopped_at(data.stopped)}", ""] if data.stopped else []


def csv_header(data: RecordingTable) -> list[str]:
    """Names of the columns: "t [s]", "q[0] [rad]", ..."""
    names = []
    for signal in SIGNALS:
        width = signal.wide(data.n)
        parts = [signal.name] if width == 1 else [f"{signal.name}[{i}]" for i in range(width)]
        units = signal.units_in(data.units, data.slides)
        names += [f"{part} [{unit}]" for part, unit in zip(parts, units, strict=True)]
    return names


def write_npz(
    data: RecordingTable,
    file: BinaryIO,
    limit: float = math.inf,
    on_progress: ProgressCallback = _silent,
    level: int = 1,
) -> None:
    """Write a recording as NPZ: named signals, (N,) or (N, width), with `units`, `docs` and `scenario` (TOML, of
    the last row) beside them; and, where they are known, `epochs` (k,), the instants (s) from which on the run had
    other conditions, and `conditions`, which `epoch_bytes` reads. Where the scenario was changed on the way, there are
    also `first_scenario` (TOML, of the first row) and `changes`, lines of text; where the run stopped, `stopped`, the
    reason.

    Needs memory for one signal, beside that of the pieces. level: of compression, 0 to 9. Raises TooLarge as
    `write_csv` does.
    """
    pieces = tuple(data.pieces)
    columns = columns_of(data.n)
    width = sum(where.stop - where.start for where in columns.values())
    about = {
        "scenario": np.array(to_toml(data.scenario)),
        "units": np.array([f"{s.name}: {_units(s.units_in(data.units, data.slides))}" for s in SIGNALS]),
        "docs": np.array([f"{s.name}: {s.doc}" for s in SIGNALS]),
    }
    if data.epochs:
        about["epochs"] = np.array([epoch.t for epoch in data.epochs])
        about["conditions"] = np.frombuffer(to_bytes(data.epochs), dtype=np.uint8)
    if data.changes:
        about["first_scenario"] = np.array(to_toml(data.first_scenario))
        about["changes"] = np.array([line for change in data.changes for line in change.lines()])
    if data.stopped:
        about["stopped"] = np.array(data.stopped)
    # level 6 takes three times as long for 1 % less
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=level) as archive:
        for name, values in about.items():
            _add(archive, name, values)
        for name, where in columns.items():
            values = np.concatenate([np.empty((0, where.stop - where.start)), *(piece[:, where] for piece in pieces)])
            _add(archive, name, values[:, 0] if values.shape[1] == 1 else values)
            done = where.stop / width
            # the first signals say little of how well the others can be compressed
            _keep_to(limit, file.tell() / done if done > 0.3 else file.tell(), data.seconds)
            on_progress(done)


def _units(units: list[str]) -> str:
    """Units of a signal's numbers: one where all have it, otherwise one for each."""
    return units[0] if len(set(units)) == 1 else ", ".join(units)


def _add(archive: zipfile.ZipFile, name: str, values: np.ndarray) -> None:
    with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
        np.lib.format.write_array(entry, values, allow_pickle=False)


def _keep_to(limit: float, size: float, seconds: float) -> None:
    if size > limit:
        raise TooLarge(
            f"the file would have about {size / 1e6:.0f} MB; allowed: {limit / 1e6:.0f} MB, which is about "
            f"{seconds * limit / size:.3g} s of this run"
        )


class RecordedRun(NamedTuple):
    """Run as a file has it. stopped: why it stopped at its last row, "" where it did not, or in files of before."""

    scenario: Scenario
    recording: Recording
    stopped: str


def read_npz(path: Path) -> RecordedRun:
    """Run of a file that `write_npz` wrote. Raises ScenarioError for any other file."""

    def refuse(what: object) -> ScenarioError:
        return ScenarioError(f"recording {str(path)!r:.200}: not a recording of this program: {what!s:.300}")

    try:
        if path.exists() and not path.is_file():  # a folder, or a pipe that would never end
            raise refuse("no file")
        with zipfile.ZipFile(path) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
            if size > LARGEST_RECORDING:
                raise refuse(f"{size / 1e6:.3g} MB when unpacked; allowed: {LARGEST_RECORDING / 1e6:g} MB")
            scenario = from_toml(str(_array(archive, "scenario", LARGEST_TEXT)))
            stopped = _array(archive, "stopped", LARGEST_TEXT) if "stopped.npy" in archive.namelist() else ""
            return RecordedRun(scenario, _recording(archive), str(stopped))
    except OSError as error:
        raise ScenarioError(f"recording {str(path)!r:.200}: cannot be read: {error.strerror or error}") from error
    except ScenarioError:
        raise
    except (*UNREADABLE, MemoryError) as error:
        raise refuse(error or type(error).__name__) from error


def _recording(archive: zipfile.ZipFile) -> Recording:
    """Recording of an archive, read signal by signal, so that memory holds the signals once. Raises ValueError and the
    exceptions of a broken archive."""
    # most instants, those of one joint: no memory is spent on instants whose other signals would be too large
    instants = LARGEST_RECORDING // max(where.stop for where in columns_of(1).values())
    times, q = _array(archive, "t", instants), _array(archive, "q", MOST_JOINTS * instants)
    rows, n = len(np.atleast_1d(times)), q.shape[-1] if q.ndim == 2 else 0
    if not 1 <= n <= MOST_JOINTS:
        raise ValueError(f"q of shape {q.shape}; allowed: 1 to {MOST_JOINTS} joints")
    del q
    columns = columns_of(n)
    claimed = 8 * rows * max(where.stop for where in columns.values())
    if claimed > LARGEST_RECORDING:
        raise ValueError(f"{rows} rows of {n} joints; allowed: {LARGEST_RECORDING / 1e6:g} MB")

    def checked(name: str, where: slice) -> np.ndarray:
        width = where.stop - where.start
        if name in LATER and f"{name}.npy" not in archive.namelist():
            return np.zeros((rows, width))
        values = _array(archive, name, 8 * rows * width + LARGEST_HEADER)
        wanted = (rows,) if width == 1 and values.ndim == 1 else (rows, width)
        if values.shape != wanted or values.dtype != float:
            raise ValueError(f"{name} holds {values.dtype} of shape {values.shape}; allowed: float64 of {wanted}")
        return values.reshape(rows, width)

    recording = Recording.of(n, rows, ((where, checked(name, where)) for name, where in columns.items()))
    if "conditions.npy" in archive.namelist():  # files of earlier versions do not have them
        recording.epochs.extend(from_bytes(_array(archive, "conditions", LARGEST_CONDITIONS).tobytes(), n))
    times = times.reshape(rows)
    if not rows or not (np.isfinite(times).all() and (np.diff(times) > 0.0).all()):
        raise ValueError("t does not grow; allowed: finite times, each later than the one before")
    return recording


def _array(archive: zipfile.ZipFile, name: str, limit: int) -> np.ndarray:
    """One array of an archive; its size is checked before it is read, and it may hold no objects. Raises ValueError and
    the exceptions of a broken archive."""
    try:
        size = archive.getinfo(f"{name}.npy").file_size
    except KeyError:
        raise ValueError(f"{name} is missing") from None
    if size > limit:
        raise ValueError(f"{name} has {size / 1e6:.3g} MB; allowed: {limit / 1e6:g} MB")
    with archive.open(f"{name}.npy") as entry:
        # all of it before numpy makes room for what its header claims
        content = entry.read(limit)
    file = io.BytesIO(content)
    major, _ = np.lib.format.read_magic(file)
    read_header = {1: np.lib.format.read_array_header_1_0, 2: np.lib.format.read_array_header_2_0}.get(major)
    if read_header is None:
        raise ValueError(f"{name} is of version {major}; allowed: 1 and 2")
    shape, _, dtype = read_header(file)
    if dtype.hasobject or math.prod(shape) * dtype.itemsize != len(content) - file.tell():
        raise ValueError(f"{name} claims {dtype} of shape {shape}; allowed: numbers or text, as many as there are")
    file.seek(0)
    return np.lib.format.read_array(file, allow_pickle=False)
