"""A chart of the page: what it draws for a run, and the widget that draws it.

Time runs to the right and ends at now; ahead of it stands the preview, which the page's script makes lighter. Window
and horizon are in the data, whose first and last instants they are: the script moves the axis along, so that no chart
is built anew and no zoom is lost.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import viser
from viser import uplot

from app.assembly import Coordinate
from app.chattering import amplitude_spectrum
from app.dashboard.theme import Rgb, css
from app.recording import Recording
from app.runner import Snapshot
from app.thinning import Grid

Signals = Mapping[str, np.ndarray]

BUCKETS = 170  # two points each: about what a plot has pixels for
GREY: Rgb = (140, 140, 140)
UNLISTED = "vs-unlisted"  # class of what the legend leaves out
_NOTHING = np.full(2, np.nan)
_RULE = "rgba(128, 128, 128, 0.7)"  # seen on dark and on light


@dataclass(frozen=True)
class Setup:
    """What decides which lines there are. normal: the mode controls a normal force; touching: there is something to
    touch; length: characteristic length, m; coordinate, joint: the chosen ones, counted from 0."""

    coordinates: tuple[Coordinate, ...]
    joints: tuple[str, ...]
    normal: bool
    touching: bool
    length: float
    coordinate: int
    joint: int

    @classmethod
    def of(cls, snapshot: Snapshot, coordinate: int, joint: int) -> Setup:
        """Choices beyond what the run has fall back to the first."""
        scenario = snapshot.scenario
        coordinates, joints = tuple(snapshot.coordinates), tuple(snapshot.robot.joint_names)
        return cls(
            coordinates,
            joints,
            normal=snapshot.system.m > 0,
            touching=scenario.contact.kind != "free",
            length=scenario.task_space.characteristic_length,
            coordinate=coordinate if coordinate < len(coordinates) else 0,
            joint=joint if joint < len(joints) else 0,
        )


@dataclass(frozen=True)
class Line:
    """One line: its name, its look, and its values from signals, (N,). compared: pinned runs show theirs, too;
    foreseen: it makes sense for a preview's few instants; backdrop: 0 and 1 are the plot's foot and head, and a line
    without width fills what is below; listed: in the legend."""

    name: str
    color: Rgb
    values: Callable[[Signals], np.ndarray]
    dashed: bool = False
    width: float = 1.6
    alpha: float = 1.0
    compared: bool = False
    foreseen: bool = True
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
    """Filled between two of a drawing's lines, counted from 0."""

    upper: int
    lower: int
    color: Rgb


@dataclass(frozen=True)
class Drawing:
    """Title with unit; lines from back to front; floor: what a logarithmic axis shows of an exact zero, None for a
    linear one; at_least: a range that is always in view, so that noise does not fill the plot."""

    title: str
    lines: Sequence[Line]
    areas: Sequence[Area] = ()
    floor: float | None = None
    at_least: tuple[float, float] | None = None

    def y_scale(self) -> uplot.Scale:
        if self.floor is not None:
            return uplot.Scale(distr=3)
        if self.at_least is None:
            return uplot.Scale()
        low, high = ({"pad": 0.1, "soft": soft, "mode": 1} for soft in self.at_least)
        return uplot.Scale(range={"min": low, "max": high})


@dataclass(frozen=True)
class Plot:
    """A row of the table of plots. draw: None for a run where it has no meaning; spectral: over frequency."""

    draw: Callable[[Setup], Drawing | None]
    spectral: bool = False


@dataclass(frozen=True)
class Pinned:
    """A run to compare with, drawn in grey behind the shown one. start: where on the shown run's time (s) its own zero
    is laid."""

    name: str
    recording: Recording
    start: float = 0.0


@dataclass(frozen=True)
class Frame:
    """What all charts of one refresh draw from. now s: the instant that is zero on the axis; rows: signals up to now;
    pinned: signals of each pinned run, None for one of other coordinates, its times those of the shown run; ahead (N,)
    s after now and foreseen: the preview, as far as `horizon` (s; 0 without one)."""

    now: float
    window: float
    grid: Grid
    rows: Signals
    pinned: Sequence[Signals | None] = ()
    ahead: np.ndarray = field(default_factory=lambda: np.empty(0))
    foreseen: Signals | None = None
    horizon: float = 0.0

    @property
    def x(self) -> np.ndarray:
        """(N,) s from now: begin of the window, buckets, now, and the preview with its horizon."""
        past = [[-self.window], np.clip(self.grid.times - self.now, -self.window, 0.0), [0.0]]
        future = [self.ahead, [self.horizon]] if self.foreseen is not None else []
        return np.concatenate(past + future)

    def columns(self, lines: Sequence[Line]) -> np.ndarray:
        """(len(lines), len(x)), nan where there is nothing."""
        parts = [_past(self.grid, self.rows["t"], self.rows, lines)]
        if self.foreseen is not None:
            parts += [_values(self.foreseen, lines, ahead=True), _blank(lines)]
        return np.concatenate(parts).T

    def compared(self, lines: Sequence[Line]) -> list[np.ndarray]:
        """The same of every pinned run, for the lines that are compared."""
        after = np.full((len(self.ahead) + 1, len(lines)), np.nan)[: None if self.foreseen is not None else 0]
        found = []
        for rows in self.pinned:
            past = (
                np.tile(_blank(lines), (2 * self.grid.count + 2, 1))
                if rows is None
                else _past(self.grid, rows["t"], rows, lines)
            )
            found.append(np.concatenate([past, after]).T)
        return found


def _past(grid: Grid, t: np.ndarray, rows: Signals, lines: Sequence[Line]) -> np.ndarray:
    values = _values(rows, lines, ahead=False)
    newest = values[-1:] if len(values) else _blank(lines)
    return np.concatenate([_blank(lines), grid.thin(t, values), newest])


def _values(rows: Signals, lines: Sequence[Line], *, ahead: bool) -> np.ndarray:
    count = len(rows["t"])
    columns = [line.values(rows) if line.foreseen or not ahead else np.full(count, np.nan) for line in lines]
    return np.stack(columns, axis=1) if columns else np.empty((count, 0))


def _blank(lines: Sequence[Line]) -> np.ndarray:
    return np.full((1, len(lines)), np.nan)


class Chart:
    """One plot on the page. Its widget learns of another run, or of other pinned ones, when it is drawn."""

    def __init__(self, gui: viser.GuiApi, plot: Plot) -> None:
        self._plot = plot
        self._adapted: object = None
        self._drawing: Drawing | None = None
        self._handle = gui.add_uplot(
            (_NOTHING, _NOTHING),
            (uplot.Series(label=""), uplot.Series(label="")),
            cursor=uplot.Cursor() if plot.spectral else uplot.Cursor(sync={"key": "vsmrc"}),
            height=150,
            padding=(10, 14, 0, 0),
        )

    def set_height(self, pixels: int) -> None:
        self._handle.height = pixels

    def draw(self, setup: Setup, pinned: Sequence[str], frame: Frame) -> None:
        if self._adapted != (setup, tuple(pinned)):
            self._adapted = (setup, tuple(pinned))
            self._adapt(self._plot.draw(setup), pinned)
        drawing = self._drawing
        if drawing is None:
            return
        data = _spectra(drawing, frame) if self._plot.spectral else _courses(drawing, frame)
        if data is not None:
            self._handle.data = data

    def _adapt(self, drawing: Drawing | None, pinned: Sequence[str]) -> None:
        self._drawing = drawing
        if self._handle.visible != (drawing is not None):
            self._handle.visible = drawing is not None
        if drawing is None:
            return
        compared = [line for line in drawing.lines if line.compared and not self._plot.spectral]
        grey = [
            Line(name if line is compared[0] else "", GREY, line.values, width=1.0, listed=line is compared[0]).series()
            for name in pinned
            for line in compared
        ]
        first = 1 + len(grey)
        series = (uplot.Series(label=self._axis), *grey, *(line.series() for line in drawing.lines))
        handle = self._handle
        handle.data = tuple(_NOTHING for _ in series)
        handle.series = series
        handle.title = drawing.title
        handle.bands = tuple(
            uplot.Band(series=(first + area.upper, first + area.lower), fill=css(area.color, 0.45))
            for area in drawing.areas
        )
        handle.scales = {
            "x": uplot.Scale(time=False, range=(None, None), distr=3 if self._plot.spectral else 1),
            "y": drawing.y_scale(),
            "backdrop": uplot.Scale(range=(0.0, 1.0)),
        }
        handle.axes = _axes(drawing, spectral=self._plot.spectral)

    @property
    def _axis(self) -> str:
        return "Hz" if self._plot.spectral else "s from now"


def _axes(drawing: Drawing, *, spectral: bool) -> tuple[uplot.Axis, ...]:
    x, y = uplot.Axis(size=34, space=60), uplot.Axis(size=60, space=26, ticks={"show": drawing.floor is None})
    if spectral:
        return x, y
    grid: uplot.Axis_Grid = {"show": True, "stroke": _RULE, "width": 1, "dash": (3.0, 3.0)}
    now = uplot.Axis(scale="x", side=0, size=0, splits=(0.0,), values=("",), ticks={"show": False}, grid=grid)
    return x, y, now


def _courses(drawing: Drawing, frame: Frame) -> tuple[np.ndarray, ...]:
    """Over time: x, the pinned runs' lines, the lines."""
    compared = [line for line in drawing.lines if line.compared]
    grey = [column for columns in frame.compared(compared) for column in columns]
    rows = [*grey, *frame.columns(drawing.lines)]
    return frame.x, *(_on_axis(drawing, row) for row in rows)


def _spectra(drawing: Drawing, frame: Frame) -> tuple[np.ndarray, ...] | None:
    """Over frequency, of the whole window; None while there is too little."""
    spectrum = amplitude_spectrum(frame.rows["t"], _values(frame.rows, drawing.lines, ahead=False))
    if spectrum is None:
        return None
    spectrum = spectrum.thinned(2 * BUCKETS)
    return spectrum.frequency, *(_on_axis(drawing, row) for row in spectrum.amplitude.T)


def _on_axis(drawing: Drawing, row: np.ndarray) -> np.ndarray:
    return row if drawing.floor is None else np.maximum(row, drawing.floor)
