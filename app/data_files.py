"""A run's data as files: CSV to be read anywhere, NPZ for numpy. Both carry units and the scenario."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from app.recording import SIGNALS, Recording, columns_of
from app.scenario import Scenario, ScenarioError, from_toml, to_toml

LINES = 512  # of a CSV, between two looks at how far it has got

Tell = Callable[[float], object]  # is told the share that is done, 0 to 1


class TooLarge(ValueError):
    """A file over its limit: one sentence with its size, what is allowed, and how long a stretch of time would fit."""


@dataclass(frozen=True)
class Table:
    """A stretch of a recording of an arm with n joints. pieces: its `length` rows, oldest first, as `Recording.pieces`
    gives them; seconds: how long it is."""

    scenario: Scenario
    n: int
    length: int
    seconds: float
    pieces: Iterable[np.ndarray]


def table(scenario: Scenario, recording: Recording, t_from: float = -math.inf, t_to: float = math.inf) -> Table:
    """The rows of this stretch of time, s, without copying them."""
    pieces = recording.pieces(t_from, t_to)
    seconds = float(pieces[-1][-1, 0] - pieces[0][0, 0]) if pieces else 0.0
    return Table(scenario, recording.n, sum(len(piece) for piece in pieces), seconds, pieces)


def _silent(share: float) -> None:
    del share


def write_csv(data: Table, file: BinaryIO, limit: float = math.inf, tell: Tell = _silent) -> None:
    """The scenario as comment lines, a line of names with units, a line per row.

    Numbers read back to the very same bits. Raises TooLarge when the file would have more than `limit` bytes.
    """
    file.write("".join(f"# {line}\n" for line in to_toml(data.scenario).rstrip("\n").split("\n")).encode())
    file.write((",".join(csv_header(data.n)) + "\n").encode())
    begin, done = file.tell(), 0
    for piece in data.pieces:
        for start in range(0, len(piece), LINES):
            rows = piece[start : start + LINES].tolist()
            # a list's repr is that of its numbers, which is the shortest text that reads back the same
            file.write("".join(repr(row)[1:-1].replace(" ", "") + "\n" for row in rows).encode())
            done += len(rows)
            _keep_to(limit, begin + (file.tell() - begin) * data.length / done, data.seconds)
            tell(done / data.length)


def csv_header(n: int) -> list[str]:
    """The names of the columns: "t [s]", "q[0] [rad]", ..."""
    names = []
    for signal in SIGNALS:
        width = n if isinstance(signal.width, str) else signal.width
        parts = [signal.name] if width == 1 else [f"{signal.name}[{i}]" for i in range(width)]
        names += [f"{part} [{signal.unit}]" for part in parts]
    return names


def write_npz(data: Table, file: BinaryIO, limit: float = math.inf, tell: Tell = _silent, level: int = 1) -> None:
    """Named signals, (N,) or (N, width), with `units`, `docs` and `scenario` (TOML) beside them.

    Needs memory for one signal, beside what the pieces need. level: of compression, 0 to 9. Raises TooLarge as
    `write_csv` does.
    """
    pieces = tuple(data.pieces)
    columns = columns_of(data.n)
    width = sum(where.stop - where.start for where in columns.values())
    about = {
        "scenario": np.array(to_toml(data.scenario)),
        "units": np.array([f"{s.name}: {s.unit}" for s in SIGNALS]),
        "docs": np.array([f"{s.name}: {s.doc}" for s in SIGNALS]),
    }
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
            tell(done)


def _add(archive: zipfile.ZipFile, name: str, values: np.ndarray) -> None:
    with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
        np.lib.format.write_array(entry, values, allow_pickle=False)


def _keep_to(limit: float, size: float, seconds: float) -> None:
    if size > limit:
        raise TooLarge(
            f"the file would have about {size / 1e6:.0f} MB; allowed: {limit / 1e6:.0f} MB, which is about "
            f"{seconds * limit / size:.3g} s of this run"
        )


def read_npz(path: Path) -> tuple[Scenario, Recording]:
    """What `write_npz` wrote. Raises ScenarioError for a file that is not of this kind."""
    try:
        with np.load(path, allow_pickle=False) as saved:
            scenario = from_toml(str(saved["scenario"]))
            columns = [saved[signal.name].reshape(len(saved["t"]), -1) for signal in SIGNALS]
            n = saved["q"].shape[1]
    except OSError as error:
        raise ScenarioError(f"recording {str(path)!r}: cannot be read: {error.strerror or error}") from error
    except (ValueError, KeyError, IndexError, zipfile.BadZipFile) as error:
        raise ScenarioError(f"recording {str(path)!r}: not a recording of this program: {error}") from error
    recording = Recording(n, history=len(columns[0]))
    for row in np.hstack(columns):
        recording.new_row()[:] = row
        recording.commit()
    return scenario, recording
