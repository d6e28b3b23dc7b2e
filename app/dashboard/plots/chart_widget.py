"""Widget of a chart on the page: its lines, axes and areas as viser shows them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import viser
from viser import uplot

from app.analysis.spectrum import amplitude_spectrum
from app.dashboard.plots.chart_frames import DecimatedLines, Frame, values_of
from app.dashboard.plots.charts import (
    BUCKETS,
    EXTREMES,
    MEDIAN,
    ChartLine,
    Drawing,
    Plot,
    Setup,
)
from app.dashboard.plots.pinned_runs import RunLook, lines_of_run
from app.dashboard.theme.colors import css
from app.dashboard.transport.plot_feed import PlotFeed
from app.storage.session_index import PINS
from environments.robots import MOST_JOINTS

_NOTHING = np.array([0.01, 0.02])  # x of a chart without lines; positive, as an axis may be logarithmic
# Series of every chart, as many as the errors of the arm with the most joints have: the time, a legend's entry and the
# lines of each pinned run, and the lines of the shown run with the edges of their bands. The number is fixed, since a
# page receives series and data in two messages, in either order, may draw between them, and fails at a series without
# an array.
MOST_SERIES = 1 + PINS * (1 + MOST_JOINTS) + MOST_JOINTS * (1 + len(EXTREMES))
QUANTILE = "vs-unlisted-edge-quantile"  # class of quantiles: edges, too, but of areas that are no parts of a sum
_FOOT, _HEAD = ({"pad": 0.0, "hard": end, "soft": end, "mode": 1} for end in (0.0, 1.0))
_RULE = "rgba(128, 128, 128, 0.7)"  # visible on dark and on light


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

    def draw(self, setup: Setup, pinned: Sequence[RunLook], frame: Frame, *, whole: bool) -> None:
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

    def clear(self, setup: Setup, pinned: Sequence[RunLook]) -> None:
        """Remove the lines; the legend is that of the lines to come."""
        self._follow(setup, pinned)
        self._feed.clear(_NOTHING)
        self._course = None

    def _follow(self, setup: Setup, pinned: Sequence[RunLook]) -> None:
        if self._adapted != (setup, tuple(pinned)):
            self._adapted = (setup, tuple(pinned))
            self._adapt(self._plot.draw(setup), pinned)

    def _adapt(self, drawing: Drawing | None, pinned: Sequence[RunLook]) -> None:
        self._drawing, self._course = drawing, None
        self._legend_rows = 0 if drawing is None else drawing.legend_rows([run.name for run in pinned])
        if self._handle.visible != (drawing is not None):
            self._handle.visible = drawing is not None
        if drawing is None:
            return
        runs = () if self._plot.spectral else pinned
        behind = [line.series() for run in runs for line in lines_of_run(drawing.lines, run)]
        first = 1 + len(behind)
        floor = -np.inf if drawing.floor is None else drawing.floor
        banded = () if self._plot.spectral else tuple(line for line in drawing.lines if line.quantiles)
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


def _of_band(line: ChartLine) -> list[uplot.Series]:
    """Looks of the quantiles of a line's band: the median dashed, the others only the edges of areas."""
    looks = []
    for level in line.quantiles:
        edge = replace(line, width=1.0 if level == MEDIAN else 0.0, alpha=0.9, listed=False, dashed=True)
        looks.append(edge.series() | {"class": QUANTILE})
    return looks


def _band_areas(banded: Sequence[ChartLine], first: int) -> tuple[uplot.Band, ...]:
    """Areas of each band: between its lowest and its highest quantile, between the next ones, and so on.
    first: number of the series of the first quantile."""
    areas: list[uplot.Band] = []
    for line in banded:
        last = first + len(line.quantiles) - 1
        fill = css(line.color, 0.22)
        areas += [uplot.Band(series=(last - k, first + k), fill=fill) for k in range(len(line.quantiles) // 2)]
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
    spectrum = amplitude_spectrum(frame.rows["t"], values_of(frame.rows, drawing.lines)).thinned(2 * BUCKETS)
    return spectrum.frequency, *spectrum.amplitude.T
