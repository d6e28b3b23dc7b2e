"""Recording of a run: one row per control period in blocks of a table, bounded; readable while it grows."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from app.scenario.schema import Scenario
from app.simulation.signals import Row, columns_of
from controllers.blend import ModelBlend
from controllers.reaching import ReachingCertificate
from controllers.target_model import TargetModel
from kernels.records import Record

BLOCK = 4096  # rows
THINNING = 20  # of rows older than the full-rate history, one in this many is kept
EPOCHS = 2000


def _between(rows: np.ndarray, t_from: float, t_to: float) -> np.ndarray:
    if t_from <= rows[0, 0] and rows[-1, 0] <= t_to:  # a search walks through the memory of the whole piece
        return rows
    first, last = np.searchsorted(rows[:, 0], t_from), np.searchsorted(rows[:, 0], t_to, side="right")
    return rows[first:last]


@dataclass(frozen=True)
class Epoch:
    """Epoch: the conditions of the rows from t (s) until the next epoch begins.
    scenario, model, certificate: in force; blend: instead of the model, None for no blend.
    layer_reached: s, when ||s|| was first within the boundary layer, or the band of a law without one, None while it
    was not.
    band_reached: s, when ||s|| was first within the band, None while it was not.
    layer_reached_by, band_reached_by: s, promised instants of these, None where nothing is promised."""

    t: float
    scenario: Scenario
    model: TargetModel
    certificate: ReachingCertificate
    layer_reached: float | None = None
    band_reached: float | None = None
    layer_reached_by: float | None = None
    band_reached_by: float | None = None
    blend: ModelBlend | None = None

    def model_at(self, t: float) -> TargetModel:
        """The target model in force at t (s)."""
        return self.model if self.blend is None else self.blend.at(t)

    def until(self, t: float) -> Epoch:
        """The epoch as it was known at t (s)."""
        instants = self.layer_reached, self.band_reached
        layer, band = (None if instant is None or instant > t else instant for instant in instants)
        return replace(self, layer_reached=layer, band_reached=band)


class Stretch(Mapping[str, np.ndarray]):
    """Signals of a stretch of time: (N,) for single columns, (N, width) for the others. Each is copied out of the table
    when it is first read."""

    def __init__(self, pieces: list[np.ndarray], columns: Mapping[str, slice]) -> None:
        self._pieces, self._columns = pieces, columns
        self._copied: dict[str, np.ndarray] = {}

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self._copied:
            where = self._columns[name]
            width = where.stop - where.start
            parts = [piece[:, where] for piece in self._pieces]
            columns = np.concatenate(parts) if parts else np.empty((0, width))
            self._copied[name] = columns[:, 0] if width == 1 else columns
        return self._copied[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)


@dataclass
class _Block:
    """A piece of the table.
    rows: (BLOCK, width) of numbers.
    records: (BLOCK,), the same memory by the names of `Row`.
    filled: grows only after a row is complete, so that readers never see half of a row."""

    rows: np.ndarray
    records: np.ndarray
    filled: int = 0


class Recording:
    """A bounded table of rows. One thread adds; any thread reads whole rows.

    history: number of rows that are kept at full rate. Older rows are thinned to one in `THINNING` and deleted after
    twice the history; memory is bounded, with six joints by 0.9 GB.
    epochs: the last ones, oldest first; readers take a copy.
    """

    def __init__(self, n: int, history: int = 600_000) -> None:
        self.n = n
        self.columns = columns_of(n)
        self.width = max(where.stop for where in self.columns.values())
        self.history, self._most = history, history // BLOCK + 2
        self._dtype = Record.zeros(Row, n).data.dtype
        self._blocks: deque[_Block] = deque()
        self._thinned: deque[np.ndarray] = deque(maxlen=self._most)
        self.epochs: deque[Epoch] = deque(maxlen=EPOCHS)

    @classmethod
    def of(cls, n: int, length: int, signals: Iterable[tuple[slice, np.ndarray]]) -> Recording:
        """Recording of `length` rows. signals: the columns of each signal in a row, and its values, (length, width);
        they are read one after the other."""
        recording = cls(n, history=length)
        starts = range(0, length, BLOCK)
        recording._blocks.extend(recording._new_block(min(BLOCK, length - at)) for at in starts)
        for where, values in signals:
            for at, block in zip(starts, recording._blocks, strict=True):
                block.rows[: block.filled, where] = values[at : at + BLOCK]
        return recording

    def __len__(self) -> int:
        return sum(block.filled for block in tuple(self._blocks))

    def new_row(self) -> np.ndarray:
        """The row to be filled next, the memory (1,) of a `Row`; readers see it after `commit`."""
        return self.new_rows(1)

    def new_rows(self, most: int) -> np.ndarray:
        """Rows to be filled next: memory (N,) of `Row`s in one piece, at least one and at most `most`."""
        if not self._blocks or self._blocks[-1].filled == BLOCK:
            self._blocks.append(self._new_block())
            if len(self._blocks) > self._most:
                self._thinned.append(self._blocks[0].rows[::THINNING].copy())  # first: readers never miss a row
                self._blocks.popleft()
        last = self._blocks[-1]
        return last.records[last.filled : last.filled + most]

    def _new_block(self, filled: int = 0, rows: np.ndarray | None = None) -> _Block:
        memory = np.empty((BLOCK, self.width)) if rows is None else rows.copy()
        return _Block(memory, memory.view(self._dtype)[:, 0], filled)

    def commit(self, rows: int = 1) -> None:
        """Mark the first `rows` of the new rows as complete."""
        self._blocks[-1].filled += rows

    def forget(self) -> None:
        """Forget the rows of the newest block, and use its memory again. Nobody may be reading them."""
        if self._blocks:
            self._blocks[-1].filled = 0

    @property
    def first(self) -> float:
        """Time of the oldest row, s; 0 while there is none."""
        full = next((block.rows[0, 0] for block in tuple(self._blocks) if block.filled), np.inf)
        oldest = min(full, next((piece[0, 0] for piece in tuple(self._thinned)), np.inf))
        return 0.0 if np.isinf(oldest) else float(oldest)

    def branch(self, t_from: float, t_to: float) -> Recording:
        """Copy of this recording from about t_from, to a whole block, up to t_to exactly, which can continue
        differently. Full blocks are shared, since nobody writes to them any more; the last one is copied."""
        twin = Recording(self.n, self.history)
        older = (_between(piece, t_from, t_to) for piece in tuple(self._thinned))
        twin._thinned.extend(kept for kept in older if len(kept))
        for block in tuple(self._blocks):
            rows = block.rows[: block.filled]
            filled = int(np.searchsorted(rows[:, 0], t_to, side="right"))
            if filled and rows[filled - 1, 0] >= t_from:
                twin._blocks.append(block if filled == BLOCK else self._new_block(filled, block.rows))
            if filled < block.filled:
                break
        twin.epochs.extend(epoch.until(t_to) for epoch in tuple(self.epochs) if epoch.t <= t_to)
        return twin

    def pieces(self, t_from: float = -np.inf, t_to: float = np.inf) -> list[np.ndarray]:
        """Rows with t_from <= t <= t_to, oldest first, as they lie in memory: (N_i, width), not to be written. Older
        ones are not looked at: the page asks for the last seconds many times a second."""
        found = []
        for piece in self._newest_first():
            if len(kept := _between(piece, t_from, t_to)):
                found.append(kept)
            if piece[0, 0] <= t_from:
                break
        return found[::-1]

    def _newest_first(self) -> Iterator[np.ndarray]:
        """Pieces of the table that have rows, the newest one first."""
        begin = np.inf
        for block in reversed(tuple(self._blocks)):  # before the thinned ones, see `new_rows`
            if block.filled:
                begin = block.rows[0, 0]
                yield block.rows[: block.filled]
        for piece in reversed(tuple(self._thinned)):
            if piece[0, 0] < begin:
                yield piece

    def rows(self, t_from: float = -np.inf, t_to: float = np.inf) -> np.ndarray:
        """Rows with t_from <= t <= t_to in one piece: (N, width), a copy."""
        kept = self.pieces(t_from, t_to)
        return np.concatenate(kept) if kept else np.empty((0, self.width))

    def stretch(self, t_from: float = -np.inf, t_to: float = np.inf) -> Stretch:
        """Signals of the rows with t_from <= t <= t_to, each copied only when it is first read."""
        return Stretch(self.pieces(t_from, t_to), self.columns)

    def signals(self, names: tuple[str, ...], t_from: float = -np.inf, t_to: float = np.inf) -> dict[str, np.ndarray]:
        """Named signals of a stretch of time: (N,) for single columns, (N, width) for the others."""
        stretch = self.stretch(t_from, t_to)
        return {name: stretch[name] for name in names}

    def picked(self, numbers: np.ndarray, names: Iterable[str] | None = None) -> dict[str, np.ndarray]:
        """Named signals, or every one, of the rows with these numbers (k,), which rise, counted from the oldest row
        that is kept."""
        parts, begin = [np.empty((0, self.width))], 0
        for piece in self.pieces():
            here = numbers[(numbers >= begin) & (numbers < begin + len(piece))]
            parts.append(piece[here - begin])
            begin += len(piece)
        rows = np.concatenate(parts)
        return {
            name: rows[:, where.start] if where.stop - where.start == 1 else rows[:, where]
            for name, where in ((name, self.columns[name]) for name in names or self.columns)
        }

    def at(self, t: float) -> dict[str, np.ndarray]:
        """Every signal of the last row not after t. Raises ValueError when nothing is recorded there."""
        pieces = self.pieces(t_to=t)
        if not pieces:
            raise ValueError(f"nothing recorded at t = {t:g} s")
        return {name: pieces[-1][-1, where] for name, where in self.columns.items()}
