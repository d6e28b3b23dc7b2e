"""Data of the page's charts for each refresh: thinned lines of the run, of pinned runs, of the preview and of its
band."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from app.analysis.thinning import BucketGrid
from app.dashboard.plots.charts import ChartLine, Signals
from app.dashboard.plots.pinned_runs import compared_lines
from app.session.arm_band import ArmBand


@dataclass(frozen=True)
class DecimatedLines:
    """Course of some lines over a grid: decimated values of the rows up to now. As rows do not change, the course of
    the next refresh continues this one.
    begins: index of the first point with rows, 2 grid.count where there are none.
    points: decimated values (2 grid.count, lines), nan where nothing is known.
    newest: values (lines,) of the newest row."""

    grid: BucketGrid
    begins: int
    points: np.ndarray
    newest: np.ndarray

    @classmethod
    def of(cls, grid: BucketGrid, rows: Signals, lines: Sequence[ChartLine]) -> DecimatedLines:
        """Course of all lines over the whole grid."""
        if not len(rows["t"]):  # a run that has not begun
            return cls(grid, 2 * grid.count, *(np.full((*n, len(lines)), np.nan) for n in ((2 * grid.count,), ())))
        values, starts = values_of(rows, lines), grid.starts(rows["t"])
        filled = np.flatnonzero(starts[:-1] < starts[1:])
        begins = 2 * int(filled[0]) if len(filled) else 2 * grid.count
        return cls(grid, begins, grid.thin(rows["t"], values), values[-1])

    def continued(self, grid: BucketGrid, since: int, rows: Signals, lines: Sequence[ChartLine]) -> DecimatedLines:
        """Course continued on a later grid of equal buckets.
        since: number of the first bucket that is decimated anew.
        rows: signals up to now that begin before this bucket."""
        new = DecimatedLines.of(grid.since(since), rows, lines)
        left, right = 2 * (grid.first - self.grid.first), 2 * (since - self.grid.first)
        begins = max(self.begins - left, 0) if self.begins < right else right - left + new.begins
        return DecimatedLines(grid, begins, np.concatenate([self.points[left:right], new.points]), new.newest)

    @property
    def values(self) -> np.ndarray:
        """Values (N, lines) from `begins` on without gaps, with the newest row as the last point."""
        return _bridged(np.concatenate([self.points[self.begins :], self.newest[None]]))


@dataclass(frozen=True)
class Recent:
    """Recent rows, which suffice to continue a course of the refresh before.
    since: number of the first bucket whose rows are all among these, and were not all drawn in the refresh before."""

    since: int
    rows: Signals


@dataclass(frozen=True)
class Frame:
    """Data of one refresh, for all charts.
    now: s, the instant that is zero on the axis.
    window: s, length of the time before now that is drawn.
    rows: signals up to now.
    pinned: signals of each pinned run at times of the shown run, None for an arm with another number of joints.
    ahead: instants (N,) of the preview, s after now; those that have passed are not drawn.
    foreseen: signals of the preview.
    band: of true arms around the preview.
    band_ahead: instants (M,) of the band, s after now.
    number: of the refresh, counted.
    recent: rows that suffice to continue the courses of the refresh before, None where it drew another run."""

    now: float
    window: float
    grid: BucketGrid
    rows: Signals
    pinned: Sequence[Signals | None] = ()
    ahead: np.ndarray = field(default_factory=lambda: np.empty(0))
    foreseen: Signals | None = None
    band: ArmBand | None = None
    band_ahead: np.ndarray = field(default_factory=lambda: np.empty(0))
    number: int = 0
    recent: Recent | None = None

    def course(self, lines: Sequence[ChartLine], before: DecimatedLines | None) -> DecimatedLines:
        """Course of these lines up to now. before: their course of the refresh before, None where they had none."""
        if before is None or self.recent is None:
            return DecimatedLines.of(self.grid, self.rows, lines)
        return before.continued(self.grid, self.recent.since, self.recent.rows, lines)

    def courses(self, lines: Sequence[ChartLine], course: DecimatedLines | None = None) -> tuple[np.ndarray, ...]:
        """Data of a chart: x (N,) s from now, then values (N,) of each of `compared_lines` of each pinned run, then of
        each line, without gaps. course: of the lines up to now, None to compute it.

        The preview is included if every line has values ahead. Where a pinned run has no values, its line is nan.
        """
        known = course or self.course(lines, None)
        begins, past = known.begins, known.values
        x = [np.clip(self.grid.times[begins:] - self.now, -self.window, 0.0), [0.0]]
        columns = [past]
        if self.foreseen is not None and all(line.foreseen for line in lines):
            future = values_of(self.foreseen, lines)
            if (~np.isnan(future)).any(axis=0).all():  # also where a line has a gap: it says that nothing is there
                x.append(self.ahead[self.ahead > 0.0])
                columns.append(_bridged(future)[self.ahead > 0.0])
        shown = np.concatenate(columns)
        compared = compared_lines(lines)
        behind = [self._behind(pinned, compared, len(shown), begins) for pinned in self.pinned]
        return np.concatenate(x), *(column for block in (*behind, shown) for column in block.T)

    def spread(self, times: np.ndarray, shown: Sequence[np.ndarray], lines: Sequence[ChartLine]) -> list[np.ndarray]:
        """Quantiles (N,) of all lines' bands at times (N,) s from now. shown: values (N,) of each line, which stand in
        for the quantiles up to now and farther ahead than the band reaches, so that the area there has no width."""
        columns = [shown[k].copy() for k, line in enumerate(lines) for _ in line.quantiles]
        if self.band is None or self.foreseen is None:
            return columns
        ahead, first = (times > 0.0) & (times <= self.band_ahead[-1]), 0
        for line in lines:
            if line.quantiles:
                found = quantiles(line.values(self.band.signals).reshape(self.band.arms, -1), line.quantiles)
                for column, quantile in zip(columns[first:], found, strict=False):
                    known = np.isfinite(quantile)
                    if known.any():
                        column[ahead] = np.interp(times[ahead], self.band_ahead[known], quantile[known])
                first += len(line.quantiles)
        return columns

    def _behind(self, rows: Signals | None, lines: Sequence[ChartLine], count: int, begins: int) -> np.ndarray:
        behind = np.full((count, len(lines)), np.nan)
        if rows is not None and len(rows["t"]):
            own = DecimatedLines.of(self.grid, rows, lines)
            own_begin, past = own.begins, own.values
            first = max(own_begin, begins)
            behind[first - begins : first - begins + len(past[first - own_begin :])] = past[first - own_begin :]
            ends = self.grid.starts(rows["t"])
            filled = int(np.flatnonzero(ends[:-1] < ends[1:])[-1]) if (ends[:-1] < ends[1:]).any() else -1
            if filled < self.grid.count - 1:
                behind[max(2 * (filled + 1) - begins, 0) :] = np.nan
        return behind


def values_of(rows: Signals, lines: Sequence[ChartLine]) -> np.ndarray:
    """Values (N, k) of k lines at N rows."""
    return np.stack([line.values(rows) for line in lines], axis=1) if lines else np.empty((len(rows["t"]), 0))


def _bridged(columns: np.ndarray) -> np.ndarray:
    """Columns (N, k) with straight lines over unknown values, as a chart would draw them; unknown ends are level.
    Values that do not exist, which are infinite, become nan."""
    points = np.arange(len(columns))
    for column in columns.T:
        known = np.isfinite(column)
        unknown, absent = np.isnan(column), _absent(column)
        if known.any() and unknown.any():
            column[unknown] = np.interp(points[unknown], points[known], column[known])
        column[absent] = np.nan
    return columns


def _absent(column: np.ndarray) -> np.ndarray:
    """Mask (N,) of the points that do not exist, which are infinite, and of unknown points beside these."""
    points, known = np.arange(len(column)), ~np.isnan(column)
    before = np.maximum.accumulate(np.where(known, points, 0))
    after = np.minimum.accumulate(np.where(known, points, len(column) - 1)[::-1])[::-1]
    return np.isinf(column) | (~known & (np.isinf(column[before]) | np.isinf(column[after])))


def quantiles(values: np.ndarray, levels: Sequence[float]) -> np.ndarray:
    """Quantiles (k, N) of values (arms, N) at each instant, over the arms that have one; nan where none has."""
    known = np.isfinite(values)
    ordered, counts = np.sort(np.where(known, values, np.nan), axis=0), known.sum(axis=0)  # nan comes last
    found = np.full((len(levels), values.shape[1]), np.nan)
    for count in np.unique(counts[counts > 0]):  # np.nanquantile takes one instant at a time, and fifteen times as long
        alike = counts == count
        found[:, alike] = np.quantile(ordered[:count, alike], levels, axis=0)
    return found
