"""Charts of the page: the drawing of a run, its data for each refresh, and the widget that shows them.

Time runs to the right and ends at now; right of it stands the preview, which the page's script makes lighter. The
script also sets the ends of the time axis, which it reads from the tab's marker (`visible_tabs.py`): if viser set them,
it would build the chart anew and lose the user's zoom. A line has gaps (nan) where its quantity does not exist: beyond
the end of a pinned run, or for a bound under a law without one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import viser
from viser import uplot

from app.analysis.spectrum import amplitude_spectrum
from app.analysis.thinning import BucketGrid
from app.dashboard.theme.colors import Rgb, css
from app.dashboard.transport.plot_feed import PlotFeed
from app.scenario.units import Units
from app.session.arm_band import Band
from app.session.snapshot import Snapshot
from app.simulation.controller_builder import law_of
from app.simulation.recording import Recording
from app.simulation.system import Coordinate

Signals = Mapping[str, np.ndarray]
Label = tuple[str, Rgb]  # name and colour of a pinned run

BUCKETS = 120  # two points each: one per pixel or so of a plot on the dock, and no spike is lost
GREY: Rgb = (140, 140, 140)
UNLISTED = "vs-unlisted"  # class of the lines that the legend leaves out
MEDIAN = 0.5
SPREAD = (0.0, 0.05, MEDIAN, 0.95, 1.0)  # quantiles of a band in a plot of one quantity
REACH = (0.0, 1.0)  # quantiles of a band in a plot of many
_NOTHING = np.array([0.01, 0.02])  # x of a chart without lines; positive, as an axis may be logarithmic
# Series of every chart: those of three pinned runs and the shown one with seven coordinates each, and backdrops. The
# number is fixed, since a page receives series and data in two messages, in either order, may draw between them, and
# fails at a series without an array.
MOST_SERIES = 48
_DOCK, _ENTRY, _LETTER = 366, 54, 6  # px: width of the legend, of an entry with its value, and of a letter in it
_FOOT, _HEAD = ({"pad": 0.0, "hard": end, "soft": end, "mode": 1} for end in (0.0, 1.0))
_RULE = "rgba(128, 128, 128, 0.7)"  # visible on dark and on light


@dataclass(frozen=True)
class Setup:
    """Setup of the charts: properties of a run and choices of the user that determine the lines.
    normal: number of surfaces on which the mode controls a normal force.
    surfaces: number of surfaces in the world.
    touching: whether there is something to touch.
    twisted: whether the law controls moments, or the scenario's push has one.
    tilts: numbers, from 0, of the coordinates that are tilts of a flat tool.
    robust: whether the law has a gain and a bound.
    bounded: whether some part of the run had a robust law.
    units: of the task space.
    coordinate, joint: numbers of the chosen ones, from 0."""

    coordinates: tuple[Coordinate, ...]
    joints: tuple[str, ...]
    normal: int
    surfaces: int
    touching: bool
    twisted: bool
    tilts: tuple[int, ...]
    robust: bool
    bounded: bool
    units: Units
    coordinate: int
    joint: int

    @classmethod
    def of(cls, snapshot: Snapshot, coordinate: int, joint: int) -> Setup:
        """Setup of a snapshot; a chosen coordinate or joint that the run does not have is replaced by the first."""
        coordinates, joints = tuple(snapshot.coordinates), tuple(snapshot.robot.joint_names)
        return cls(
            coordinates,
            joints,
            normal=snapshot.system.pressed,
            surfaces=len(snapshot.system.surfaces),
            touching=snapshot.scenario.contact.nature.touches,
            twisted=snapshot.system.mode.feedback == "all" or any(snapshot.scenario.truth.push_moment),
            tilts=tuple(range(snapshot.system.pressed, snapshot.system.m)),
            robust=snapshot.system.controller.law.robust,
            bounded=any(law_of(epoch.scenario).robust for epoch in snapshot.recording.epochs),
            units=snapshot.system.units,
            coordinate=coordinate if coordinate < len(coordinates) else 0,
            joint=joint if joint < len(joints) else 0,
        )


@dataclass(frozen=True)
class ChartLine:
    """Line of a chart.
    name: in the legend.
    values: (N,) of signals, nan where they are not known and infinite where they do not exist.
    compared: whether the same line of pinned runs is drawn, too.
    foreseen: whether the line has a meaning for the few instants of a preview.
    band: quantiles of true arms that are drawn around the preview, see `SPREAD` and `REACH`.
    backdrop: whether 0 and 1 are the plot's foot and head, whatever its axis; without width, the area below is filled.
    listed: whether the line is in the legend."""

    name: str
    color: Rgb
    values: Callable[[Signals], np.ndarray]
    dashed: bool = False
    width: float = 1.6
    alpha: float = 1.0
    compared: bool = False
    foreseen: bool = True
    band: tuple[float, ...] = ()
    backdrop: bool = False
    listed: bool = True

    def series(self) -> uplot.Series:
        look = uplot.Series(
            label=self.name, stroke=css(self.color, self.alpha), width=self.width, points={"show": False}
        )
        if self.dashed:
            look["dash"] = (6.0, 4.0)
        if self.backdrop:
            look["scale"] = "backdrop"
        if self.backdrop and not self.width:
            look["fill"] = css(self.color, self.alpha)
        if not self.listed:
            look["class"] = UNLISTED
        return look


@dataclass(frozen=True)
class Area:
    """Filled area between two of a drawing's lines, counted from 0."""

    upper: int
    lower: int
    color: Rgb


@dataclass(frozen=True)
class Drawing:
    """Content of a chart.
    title: with the unit.
    lines: from back to front.
    areas: between lines.
    floor: value that a logarithmic axis shows for an exact zero, None for a linear axis.
    at_least: a range that is always in view, so that noise does not fill the plot."""

    title: str
    lines: Sequence[ChartLine]
    areas: Sequence[Area] = ()
    floor: float | None = None
    at_least: tuple[float, float] | None = None

    def legend_rows(self, pinned: Sequence[Label]) -> int:
        """Estimated number of rows of the chart's legend on the dock."""
        compared = any(line.compared for line in self.lines)
        names = ["t [s]", *(line.name for line in self.lines if line.listed)]
        names += [name for name, _ in pinned] if compared else []
        return -(-sum(_ENTRY + _LETTER * len(name) for name in names) // _DOCK)

    def y_scale(self) -> uplot.Scale:
        if self.floor is not None:
            return uplot.Scale(distr=3)
        if self.at_least is None:
            return uplot.Scale()
        low, high = ({"pad": 0.1, "soft": soft, "mode": 1} for soft in self.at_least)
        return uplot.Scale(range={"min": low, "max": high})


@dataclass(frozen=True)
class Plot:
    """Plot: a row of the table of plots.
    name: by which a figure for paper chooses the plot.
    draw: returns its drawing, None for a run where the plot has no meaning.
    spectral: whether its lines go over frequency instead of time."""

    name: str
    draw: Callable[[Setup], Drawing | None]
    spectral: bool = False


@dataclass(frozen=True)
class PinnedChart:
    """Pinned run, drawn in one colour behind the shown run.
    units, coordinates: of its task space.
    start: instant (s) of the shown run at which the pinned run's zero is drawn."""

    name: str
    recording: Recording
    units: Units
    coordinates: tuple[Coordinate, ...]
    start: float = 0.0
    color: Rgb = GREY


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
        values, starts = _values(rows, lines), grid.starts(rows["t"])
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
    ahead: instants (N,) of the preview, s after now.
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
    band: Band | None = None
    band_ahead: np.ndarray = field(default_factory=lambda: np.empty(0))
    number: int = 0
    recent: Recent | None = None

    def course(self, lines: Sequence[ChartLine], before: DecimatedLines | None) -> DecimatedLines:
        """Course of these lines up to now. before: their course of the refresh before, None where they had none."""
        if before is None or self.recent is None:
            return DecimatedLines.of(self.grid, self.rows, lines)
        return before.continued(self.grid, self.recent.since, self.recent.rows, lines)

    def courses(self, lines: Sequence[ChartLine], course: DecimatedLines | None = None) -> tuple[np.ndarray, ...]:
        """Data of a chart: x (N,) s from now, then values (N,) of each compared line of each pinned run, then of each
        line, without gaps. course: of the lines up to now, None to compute it.

        The preview is included if every line has values ahead. Where a pinned run has no values, its line is nan.
        """
        known = course or self.course(lines, None)
        begins, past = known.begins, known.values
        x = [np.clip(self.grid.times[begins:] - self.now, -self.window, 0.0), [0.0]]
        columns = [past]
        if self.foreseen is not None and all(line.foreseen for line in lines):
            future = _values(self.foreseen, lines)
            if (~np.isnan(future)).any(axis=0).all():  # also where a line has a gap: it says that nothing is there
                x.append(self.ahead)
                columns.append(_bridged(future))
        shown = np.concatenate(columns)
        compared = [line for line in lines if line.compared]
        behind = [self._behind(pinned, compared, len(shown), begins) for pinned in self.pinned]
        return np.concatenate(x), *(column for block in (*behind, shown) for column in block.T)

    def spread(self, times: np.ndarray, shown: Sequence[np.ndarray], lines: Sequence[ChartLine]) -> list[np.ndarray]:
        """Quantiles (N,) of all lines' bands at times (N,) s from now. shown: values (N,) of each line, which stand in
        for the quantiles up to now and farther ahead than the band reaches, so that the area there has no width."""
        columns = [shown[k].copy() for k, line in enumerate(lines) for _ in line.band]
        if self.band is None or self.foreseen is None:
            return columns
        ahead, first = (times > 0.0) & (times <= self.band_ahead[-1]), 0
        for line in lines:
            if line.band:
                found = quantiles(line.values(self.band.signals).reshape(self.band.arms, -1), line.band)
                for column, quantile in zip(columns[first:], found, strict=False):
                    known = np.isfinite(quantile)
                    if known.any():
                        column[ahead] = np.interp(times[ahead], self.band_ahead[known], quantile[known])
                first += len(line.band)
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


def _values(rows: Signals, lines: Sequence[ChartLine]) -> np.ndarray:
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
    points, told = np.arange(len(column)), ~np.isnan(column)
    before = np.maximum.accumulate(np.where(told, points, 0))
    after = np.minimum.accumulate(np.where(told, points, len(column) - 1)[::-1])[::-1]
    return np.isinf(column) | (~told & (np.isinf(column[before]) | np.isinf(column[after])))


def quantiles(values: np.ndarray, shares: Sequence[float]) -> np.ndarray:
    """Quantiles (k, N) of values (arms, N) at each instant, over the arms that have one; nan where none has."""
    known = np.isfinite(values)
    ordered, counts = np.sort(np.where(known, values, np.nan), axis=0), known.sum(axis=0)  # nan comes last
    found = np.full((len(shares), values.shape[1]), np.nan)
    for count in np.unique(counts[counts > 0]):  # np.nanquantile takes one instant at a time, and fifteen times as long
        alike = counts == count
        found[:, alike] = np.quantile(ordered[:count, alike], shares, axis=0)
    return found


class ChartWidget:
    """Chart on the page: the widget of one plot, which `draw` adapts to another run or to other pinned runs."""

    def __init__(self, gui: viser.GuiApi, plot: Plot) -> None:
        self._plot = plot
        self._adapted: object = None
        self._drawing: Drawing | None = None
        self._legend_rows = 1
        self._lowest: list[float] = []
        self._course: tuple[int, DecimatedLines] | None = None  # number of the last refresh, and the course then
        self._handle = gui.add_uplot(
            (_NOTHING,) * MOST_SERIES,
            tuple(uplot.Series(label="") for _ in range(MOST_SERIES)),
            cursor=uplot.Cursor() if plot.spectral else uplot.Cursor(sync={"key": "vsmrc"}),
            height=150,
            padding=(10, 14, 0, 0),
        )
        self._feed = PlotFeed(self._handle, MOST_SERIES)

    @property
    def legend_rows(self) -> int:
        """Number of rows of the legend; 0 for a hidden chart."""
        return self._legend_rows

    def set_height(self, pixels: int) -> None:
        """Set the height in pixels, without title and legend."""
        self._handle.height = pixels

    def draw(self, setup: Setup, pinned: Sequence[Label], frame: Frame, *, whole: bool) -> None:
        """Draw the data of a refresh. whole: send all points, since a page may have none of them yet."""
        self._follow(setup, pinned)
        drawing = self._drawing
        if drawing is None:
            return
        if whole:
            self._feed.forget()
        if self._plot.spectral:
            x, *lines = _spectra(drawing, frame)
        else:
            number, before = self._course or (-1, None)
            course = frame.course(drawing.lines, before if number == frame.number - 1 else None)
            self._course = frame.number, course
            x, *courses = frame.courses(drawing.lines, course)
            shown = courses[len(courses) - len(drawing.lines) :]
            lines = [*courses, *frame.spread(x, shown, drawing.lines)]
        if len(x) > 1:
            raised = [np.maximum(line, low) for line, low in zip(lines, self._lowest, strict=True)]
            self._feed.send(frame.now, x, raised)

    def clear(self, setup: Setup, pinned: Sequence[Label]) -> None:
        """Remove the lines; the legend is that of the lines to come."""
        self._follow(setup, pinned)
        self._feed.clear(_NOTHING)
        self._course = None

    def _follow(self, setup: Setup, pinned: Sequence[Label]) -> None:
        if self._adapted != (setup, tuple(pinned)):
            self._adapted = (setup, tuple(pinned))
            self._adapt(self._plot.draw(setup), pinned)

    def _adapt(self, drawing: Drawing | None, pinned: Sequence[Label]) -> None:
        self._drawing, self._course = drawing, None
        self._legend_rows = 0 if drawing is None else drawing.legend_rows(pinned)
        if self._handle.visible != (drawing is not None):
            self._handle.visible = drawing is not None
        if drawing is None:
            return
        compared = [line for line in drawing.lines if line.compared and not self._plot.spectral]
        behind = [_of_pinned(line, label, listed=line is compared[0]) for label in pinned for line in compared]
        first = 1 + len(behind)
        floor = -np.inf if drawing.floor is None else drawing.floor
        banded = () if self._plot.spectral else tuple(line for line in drawing.lines if line.band)
        spread = [look for line in banded for look in _of_band(line)]
        self._lowest = [
            *([floor] * len(behind)),
            *(-np.inf if line.backdrop else floor for line in drawing.lines),
            *([floor] * len(spread)),
        ]
        series = (uplot.Series(label=self._axis), *behind, *(line.series() for line in drawing.lines), *spread)
        handle = self._handle
        self._feed.clear(_NOTHING)
        handle.series = series
        handle.title = drawing.title
        handle.bands = tuple(
            uplot.Band(series=(first + area.upper, first + area.lower), fill=css(area.color, 0.45))
            for area in drawing.areas
        ) + _band_areas(banded, first + len(drawing.lines))
        handle.scales = {
            "x": uplot.Scale(time=False, range=(None, None), distr=3 if self._plot.spectral else 1),
            "y": drawing.y_scale(),
            "backdrop": uplot.Scale(range={"min": _FOOT, "max": _HEAD}),
        }
        handle.axes = _axes(drawing, spectral=self._plot.spectral)

    @property
    def _axis(self) -> str:
        return "Hz" if self._plot.spectral else "t [s]"


def _of_pinned(line: ChartLine, label: Label, *, listed: bool) -> uplot.Series:
    """Look of a line of a pinned run: dotted; only the run's first line is in the legend."""
    name, color = label
    look = ChartLine(name if listed else "", color, line.values, width=1.3, listed=listed).series()
    look["dash"] = (2.0, 3.0)
    return look


def _of_band(line: ChartLine) -> list[uplot.Series]:
    """Looks of the quantiles of a line's band: the median dashed, the others only the edges of areas."""
    looks = []
    for share in line.band:
        width = 1.0 if share == MEDIAN else 0.0
        looks.append(ChartLine("", line.color, line.values, width=width, alpha=0.9, listed=False, dashed=True).series())
    return looks


def _band_areas(banded: Sequence[ChartLine], first: int) -> tuple[uplot.Band, ...]:
    """Areas of each band: between its lowest and its highest quantile, between the next ones, and so on.
    first: number of the series of the first quantile."""
    areas: list[uplot.Band] = []
    for line in banded:
        last = first + len(line.band) - 1
        fill = css(line.color, 0.22)
        areas += [uplot.Band(series=(last - k, first + k), fill=fill) for k in range(len(line.band) // 2)]
        first = last + 1
    return tuple(areas)


def _axes(drawing: Drawing, *, spectral: bool) -> tuple[uplot.Axis, ...]:
    x = uplot.Axis(size=29, gap=3, space=60, ticks={"size": 5})
    y = uplot.Axis(size=52, space=14, ticks={"show": drawing.floor is None, "size": 5}, gap=3)
    if spectral:
        return x, y
    grid: uplot.Axis_Grid = {"show": True, "stroke": _RULE, "width": 1, "dash": (3.0, 3.0)}
    now = uplot.Axis(scale="x", side=0, size=0, splits=(0.0,), values=("",), ticks={"show": False}, grid=grid)
    return x, y, now


def _spectra(drawing: Drawing, frame: Frame) -> tuple[np.ndarray, ...]:
    """Frequencies, Hz, then the amplitudes of each line over the whole window."""
    spectrum = amplitude_spectrum(frame.rows["t"], _values(frame.rows, drawing.lines)).thinned(2 * BUCKETS)
    return spectrum.frequency, *spectrum.amplitude.T
