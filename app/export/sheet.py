"""Sheet of paper: layout of a figure's charts, titles, legends and caption, drawn by matplotlib."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import cycle, pairwise, zip_longest
from typing import TYPE_CHECKING, Any

import numpy as np

from app.export.figures import DOUBLE, MM, SINGLE, TYPE, Curve, Figure, FigureChart, FigureOptions
from app.export.inks import inks_of, printed
from app.export.lettering import width_of, wrapped, write
from app.export.ticks import plain_decades, plain_steps, with_decimal_mark

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas


TWO_COLUMNS = 130.0 * MM  # in, width from which on charts may stand in two columns
AXES_HEIGHT, LOWEST_AXES = 0.95, 0.35  # in
LEFT, RIGHT, BELOW, GAP, MARGIN = 0.6, 0.12, 0.2, 0.05, 0.06  # in
UNIT = 0.12  # in, from the left edge to the middle of a unit's upright text
X_LABEL = 0.16  # in
ROW = 0.125  # in, of a title, of a row of the legend, of a line of the caption
HANDLE, APART = 0.2, 0.1  # in, of an entry of the legend: its line, and the space to the next entry
LONGER = 1.7  # times as long is the line of an entry with dashes of its own, which show then
SMALL, TITLE = 6.5 / TYPE, 7.5 / TYPE  # factors of the type's size
BINS = 600  # of a curve, of which each keeps its smallest and its largest value
DASHED = (4.0, 2.0)  # widths of the line
FEW = 3  # lines that differ in grey well enough without different dashes
DASHES: tuple[Any, ...] = (
    "-",
    (0, (1.2, 1.2)),
    (0, (6.0, 1.5, 1.2, 1.5)),
    (0, (9.0, 2.5)),
    (0, (2.8, 1.0)),
)


def thinned(x: np.ndarray, y: np.ndarray, bins: int, *, logarithmic: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Points (N,) reduced to at most 2 bins + 2, in their order: the ends, and the extremes of each bin.
    logarithmic: whether the bins are of one width on a logarithmic axis of x, which is positive."""
    if len(y) <= 2 * bins:
        return x, y
    if logarithmic:
        inner = np.searchsorted(x, np.geomspace(x[0], x[-1], bins + 1)[1:-1])
    else:
        inner = np.linspace(0, len(y), bins + 1)[1:-1].astype(int)
    extremes = {0, len(y) - 1}
    for first, last in pairwise([*np.unique([0, *inner]).tolist(), len(y)]):
        extremes |= {first + int(y[first:last].argmin()), first + int(y[first:last].argmax())}
    indices = sorted(extremes)
    return x[indices], y[indices]


def enclosed(x: np.ndarray, upper: np.ndarray, lower: np.ndarray, bins: int) -> tuple[np.ndarray, ...]:
    """Edges x, upper, lower (N,) of a filled area reduced to at most 2 bins points, in their order: of each bin the
    largest upper and the smallest lower value, nan where it has no other, at its first x; and the last point."""
    starts = np.arange(0, len(x), max(len(x) // bins, 1))
    if len(starts) == len(x):
        return x, upper, lower
    high, low = np.fmax.reduceat(upper, starts), np.fmin.reduceat(lower, starts)
    return np.append(x[starts], x[-1]), np.append(high, upper[-1]), np.append(low, lower[-1])


@dataclass(frozen=True)
class _Entry:
    """Entry of a legend.
    number: of its curve.
    row: from the top, from 0.
    x: position from the legend's left, in."""

    number: int
    row: int
    x: float


class Sheet:
    """Sheet of paper on which a figure is laid out; lengths are in inches, from the lower left corner."""

    def __init__(self, figure: Figure, options: FigureOptions) -> None:
        self._options, self._decimal = options, figure.decimal
        self._factor = factor = options.type_size / TYPE
        count = len(figure.charts)
        width = options.width or (SINGLE if count <= figure.one_column else DOUBLE)
        columns = 2 if count > 1 and width >= TWO_COLUMNS else 1
        rows = -(-count // columns)
        charts = _lettered(figure.charts) if options.letters else figure.charts
        self._width, self._column = width, width / columns
        self._inside = self._column - factor * (LEFT + RIGHT)
        widest = max(self._widest(chart) for chart in charts) if charts else 0.0
        if widest > self._inside + factor * RIGHT:
            least = columns * (widest + factor * LEFT)
            raise ValueError(
                f"width: {width / MM:.4g} mm; allowed: at least {np.ceil(least / MM):.0f} mm for these plots with type "
                f"of {options.type_size:g} pt"
            )
        self._stacks = [charts[rows * c : rows * (c + 1)] for c in range(columns)]
        caption = figure.caption if options.caption else ""
        self._caption = wrapped(caption, width - 2 * MARGIN, factor * SMALL * TYPE)
        self._below = factor * ROW * (len(self._caption) + 1) + MARGIN if self._caption else MARGIN
        around = [sum(self._around(*pair) for pair in _pairs(stack)) for stack in self._stacks]
        if options.height is None:
            self._axes_height = AXES_HEIGHT
            self._height = MARGIN + max(around) + rows * AXES_HEIGHT + self._below
        else:
            self._height = options.height
            room = options.height - MARGIN - self._below
            self._axes_height = min((room - a) / len(s) for a, s in zip(around, self._stacks, strict=True) if s)
            if self._axes_height < LOWEST_AXES:
                least = MARGIN + max(around) + rows * LOWEST_AXES + self._below
                raise ValueError(
                    f"height: {options.height / MM:.4g} mm; allowed: at least {np.ceil(least / MM):.0f} mm "
                    "for these plots at this width and type size"
                )

    def drawn(self) -> Canvas:
        from matplotlib.figure import Figure as Canvas

        canvas = Canvas(figsize=(self._width, self._height))
        for column, stack in enumerate(self._stacks):
            y = self._height - MARGIN
            for chart, following in _pairs(stack):
                y -= self._header(chart) + self._axes_height
                self._draw(canvas, chart, column * self._column + self._factor * LEFT, y, _labelled(chart, following))
                y -= self._footer(chart, following)
        row = self._factor * ROW
        for number, line in enumerate(self._caption):
            y = self._below - (number + 1.4) * row
            write(canvas, MARGIN, y, line, self._small, color="0.2")
        return canvas

    @property
    def _small(self) -> float:
        return self._factor * SMALL * TYPE

    def _around(self, chart: FigureChart, following: FigureChart | None) -> float:
        """Height of the parts above and below a chart's axes, in."""
        return self._header(chart) + self._footer(chart, following)

    def _header(self, chart: FigureChart) -> float:
        """Height of a chart's title and legend, in."""
        rows = max((entry.row + 1 for entry in self._legend(chart)), default=0)
        return self._factor * ROW * (len(self._title(chart)) + rows) + 0.06

    def _footer(self, chart: FigureChart, following: FigureChart | None) -> float:
        return self._factor * (BELOW + (X_LABEL if _labelled(chart, following) else 0.0)) + GAP

    def _title(self, chart: FigureChart) -> list[str]:
        return wrapped(chart.title, self._inside, self._factor * TITLE * TYPE, "bold")

    def _widest(self, chart: FigureChart) -> float:
        """Width of the widest word of a chart's title, or of an entry of its legend, in."""
        words = [width_of(word, self._factor * TITLE * TYPE, "bold") for word in chart.title.split()]
        entries = [self._handle(each) + width_of(each.name, self._small) for each in chart.curves if each.listed]
        return max([*words, *entries], default=0.0)

    def _legend(self, chart: FigureChart) -> list[_Entry]:
        """Entries of a chart's legend, beside each other in as many rows as they need."""
        entries, row, x = [], 0, 0.0
        for number, curve in enumerate(chart.curves):
            if not curve.listed:
                continue
            wide = self._handle(curve) + width_of(curve.name, self._small)
            if x and x + wide > self._inside:
                row, x = row + 1, 0.0
            entries.append(_Entry(number, row, x))
            x += wide + self._factor * APART
        return entries

    def _handle(self, curve: Curve) -> float:
        """Width of a curve's line in the legend, with the space behind it, in."""
        return self._factor * HANDLE * (LONGER if curve.dashes else 1.0)

    def _draw(self, canvas: Canvas, chart: FigureChart, left: float, bottom: float, labelled: bool) -> None:
        wide, high = self._width, self._height
        box = (left / wide, bottom / high, self._inside / wide, self._axes_height / high)
        axes = canvas.add_axes(box)
        looks = looks_of(chart)
        _plot(axes, chart, looks)
        for axis in (axes.xaxis, axes.yaxis) if self._decimal != "." else ():
            with_decimal_mark(axis, self._decimal)
        axes.tick_params(pad=2, length=2)
        if chart.unit:
            axes.set_ylabel(f"[{chart.unit}]")
        axes.yaxis.set_label_coords((UNIT - LEFT) * self._factor / self._inside, 0.5)
        if labelled:
            middle = left + (self._inside - width_of(chart.x_label, self._options.type_size)) / 2
            write(canvas, middle, bottom - self._factor * (BELOW + 0.09), chart.x_label, self._options.type_size)
        self._head(canvas, chart, left, bottom + self._axes_height, looks)

    def _head(self, canvas: Canvas, chart: FigureChart, left: float, top: float, looks: list[dict[str, Any]]) -> None:
        """Write a chart's title, and its legend below."""
        from matplotlib.lines import Line2D

        row, entries = self._factor * ROW, self._legend(chart)
        rows = max((entry.row + 1 for entry in entries), default=0)
        for entry in entries:
            x, y = left + entry.x, top + (rows - entry.row - 0.7) * row
            curve, handle = chart.curves[entry.number], self._handle(chart.curves[entry.number])
            ends = np.array([x, x + handle - 0.25 * self._factor * HANDLE]) / self._width
            line = np.full(2, y + 0.28 * row) / self._height
            look = looks[entry.number]
            if any(entry.number in (area.upper, area.lower) for area in chart.areas):
                look = {**look, "linewidth": 0.35 * self._small, "alpha": 0.6, "solid_capstyle": "butt"}
            canvas.add_artist(Line2D(ends, line, transform=canvas.transFigure, **look))
            write(canvas, x + handle, y, curve.name, self._small)
        lines = self._title(chart)
        for number, line in enumerate(lines):
            y = top + (rows + len(lines) - 1 - number + 0.35) * row
            write(canvas, left, y, line, self._factor * TITLE * TYPE, "bold")


def _lettered(charts: tuple[FigureChart, ...]) -> tuple[FigureChart, ...]:
    names = [chr(ord("a") + number) for number in range(26)]
    names += [first + second for first in names for second in names]
    return tuple(replace(chart, title=f"({name}) {chart.title}") for name, chart in zip(names, charts, strict=False))


def _pairs(stack: tuple[FigureChart, ...]) -> list[tuple[FigureChart, FigureChart | None]]:
    """Pairs of each chart with the one below it."""
    return list(zip_longest(stack, stack[1:]))


def _labelled(chart: FigureChart, following: FigureChart | None) -> bool:
    return following is None or following.x_label != chart.x_label


def looks_of(chart: FigureChart) -> list[dict[str, Any]]:
    """Look of each curve, as keyword arguments of matplotlib. Where many lines are solid on the page, their dashes
    differ on paper, unless dashes tell runs apart."""
    inks = inks_of(chart)
    solid = dict.fromkeys(curve.color for curve in chart.curves if curve.width > 0 and not curve.dashed)
    alike = len(solid) > FEW and not chart.areas and not any(curve.dashes for curve in chart.curves)
    dashes = dict(zip(solid if alike else (), cycle(DASHES), strict=False))
    return [
        {
            "color": inks.get(curve.color, "0.5"),
            "linewidth": curve.width,
            "linestyle": _pattern(curve) or dashes.get(curve.color, "-"),
            "marker": "o" if curve.dotted else "",
            "markersize": 2.4,
            "markeredgewidth": 0.0,
        }
        for curve in chart.curves
    ]


def _pattern(curve: Curve) -> tuple[float, tuple[float, ...]] | None:
    """Line style of a curve with dashes of its own, None for another one."""
    return (0.0, curve.dashes or DASHED) if curve.dashes or curve.dashed else None


def _stretches(curve: Curve, *, logarithmic_x: bool) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Stretches x, y of a curve between its gaps."""
    y = np.asarray(curve.y, dtype=float)
    for known in np.ma.clump_unmasked(np.ma.masked_invalid(y)) if len(y) else ():
        yield thinned(np.asarray(curve.x, dtype=float)[known], y[known], BINS, logarithmic=logarithmic_x)


def _plot(axes: Axes, chart: FigureChart, looks: list[dict[str, Any]]) -> None:
    for area in chart.areas:
        upper, lower = chart.curves[area.upper], chart.curves[area.lower]
        # an edge has no point where its number is none, as in the last row of a run that stopped on such a torque
        shared, of_upper, of_lower = np.intersect1d(upper.x, lower.x, return_indices=True)
        x, high, low = enclosed(shared, upper.y[of_upper], lower.y[of_lower], BINS)
        ink = inks_of(chart).get(area.color, printed(area.color))
        axes.fill_between(x, low, high, color=ink, alpha=0.35, linewidth=0.0)
    for curve, look in zip(chart.curves, looks, strict=True):
        for x, y in _stretches(curve, logarithmic_x=chart.logarithmic_x):
            axes.plot(x, y, clip_on=not curve.dotted, zorder=3 if curve.dotted else 2, **look)
    known = [curve.x[np.isfinite(curve.y)] for curve in chart.curves]
    ends = chart.x_range or [end for x in known if len(x) for end in (np.min(x), np.max(x))]
    if ends and min(ends) < max(ends):
        axes.set_xlim(min(ends), max(ends))
    _scale(axes, chart)
    axes.set_axisbelow(True)


def _scale(axes: Axes, chart: FigureChart) -> None:
    """Set the axes' ranges, and few ticks with plain numbers."""
    if chart.logarithmic_x:
        axes.set_xscale("log")
        plain_decades(axes.xaxis)
    if chart.logarithmic:
        axes.set_yscale("log")
    low, high = axes.get_ylim()
    if chart.at_least is not None:
        axes.set_ylim(min(low, chart.at_least[0]), max(high, chart.at_least[1]))
    if chart.logarithmic:
        plain_decades(axes.yaxis)
    else:
        plain_steps(axes.yaxis)
