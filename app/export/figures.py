"""Figures on paper: charts on white ground, with type that is readable at a column's width, as vectors and text.

`Figure` is the content in numbers and words, `FigureOptions` the look; nothing here depends on the page. The same
figure always makes the same bytes.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import cycle, zip_longest
from typing import TYPE_CHECKING, Any

import numpy as np

from app.export.formats import Format
from app.export.lettering import width_of, wrapped, write

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure as Canvas

Rgb = tuple[int, int, int]
Ink = tuple[float, float, float]  # a colour on paper, each part within 0 to 1
TIME, FREQUENCY = "t [s]", "frequency [Hz]"
MM = 1.0 / 25.4  # in
SINGLE, DOUBLE = 85.0 * MM, 180.0 * MM  # in, widths of a journal's column and of its page
TWO_COLUMNS = 130.0 * MM  # in, width from which on charts may stand in two columns
ONE_COLUMN = 4  # number of charts up to which they stand in one column
TYPE = 7.0  # pt, size of the running text; the lengths below are for this size
AXES_HEIGHT, LOWEST_AXES = 0.95, 0.35  # in
LEFT, RIGHT, BELOW, GAP, MARGIN = 0.6, 0.12, 0.2, 0.05, 0.06  # in
UNIT = 0.12  # in, from the left edge to the middle of a unit's upright text
X_LABEL = 0.16  # in
ROW = 0.125  # in, of a title, of a row of the legend, of a line of the caption
HANDLE, APART = 0.2, 0.1  # in, of an entry of the legend: its line, and the space to the next entry
SMALL, TITLE = 6.5 / TYPE, 7.5 / TYPE  # factors of the type's size
BINS = 600  # of a curve, of which each keeps its smallest and its largest value
CONTRAST = 3.0  # least contrast with white, by WCAG 2 for graphics
DARKEST, LIGHTEST, STEP = 15.0, 60.7, 14.0  # lightness of a chart's lines; LIGHTEST has CONTRAST with white
FEW = 3  # lines that differ in grey well enough without different dashes
DASHES: tuple[Any, ...] = (
    "-",
    (0, (1.2, 1.2)),
    (0, (6.0, 1.5, 1.2, 1.5)),
    (0, (9.0, 2.5)),
    (0, (2.8, 1.0)),
)
FALLBACKS = {
    "DejaVu Sans": "'Bitstream Vera Sans', Verdana, sans-serif",
}
PNG_DPI = 300
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",  # text stays text, not outlines
    "svg.hashsalt": "vsmrc",
    "pdf.fonttype": 42,
    "font.family": "DejaVu Sans",
    "font.size": TYPE,
    "text.parse_math": False,  # a text with dollars is no mathematics
    "axes.linewidth": 0.5,
    "axes.edgecolor": "0.35",
    "axes.grid": True,
    "grid.color": "0.88",
    "grid.linewidth": 0.4,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.labelsize": SMALL * TYPE,
    "ytick.labelsize": SMALL * TYPE,
    "xtick.major.width": 0.5,
    "ytick.major.width": 0.5,
    "ytick.minor.width": 0.3,
    "path.simplify": False,
}


@dataclass(frozen=True)
class Curve:
    """Curve of a chart.
    color: of the dark page.
    x, y: (N,) in the units of the chart's labels.
    width: of the line, pt; 0 for dots alone.
    listed: whether the curve is in the legend.
    dotted: whether each point has a dot."""

    name: str
    color: Rgb
    x: np.ndarray
    y: np.ndarray
    dashed: bool = False
    width: float = 1.0
    listed: bool = True
    dotted: bool = False


@dataclass(frozen=True)
class FilledArea:
    """Filled area between two of a chart's curves, counted from 0, which have the same x."""

    upper: int
    lower: int
    color: Rgb


@dataclass(frozen=True)
class FigureChart:
    """Chart: axes with curves and a legend.
    logarithmic: whether the vertical axis is logarithmic.
    at_least: range of y that is always in view.
    logarithmic_x: whether the horizontal axis is logarithmic."""

    title: str
    unit: str
    curves: tuple[Curve, ...]
    areas: tuple[FilledArea, ...] = ()
    x_label: str = TIME
    logarithmic: bool = False
    at_least: tuple[float, float] | None = None
    logarithmic_x: bool = False


@dataclass(frozen=True)
class Figure:
    """Figure: charts, and the caption below them. one_column: number of charts up to which they stand in one column."""

    charts: tuple[FigureChart, ...]
    caption: str
    one_column: int = ONE_COLUMN


@dataclass(frozen=True)
class FigureOptions:
    """Look of a figure on paper.
    width, height: in; None for a journal's column or page, and for the height that the charts need.
    type_size: of the running text, pt.
    letters: whether (a), (b), … stand before the titles.
    caption: whether the figure's caption stands below."""

    width: float | None = None
    height: float | None = None
    type_size: float = TYPE
    letters: bool = False
    caption: bool = True

    def __post_init__(self) -> None:
        for name, value, low, high in (
            ("width", self.width, 40 * MM, 600 * MM),
            ("height", self.height, 20 * MM, 2000 * MM),
        ):
            if value is not None and not low <= value <= high:
                raise ValueError(f"{name}: {value / MM:.4g} mm; allowed: {low / MM:.0f} to {high / MM:.0f} mm")
        if not 4.0 <= self.type_size <= 24.0:
            raise ValueError(f"type size: {self.type_size:g} pt; allowed: 4 to 24 pt")


def inches_of(text: str) -> float:
    """Length in inches of a text such as "85", "85mm", "8.5 cm", "3.35in", "single" or "double". Raises ValueError."""
    if text in ("single", "double"):
        return SINGLE if text == "single" else DOUBLE
    found = re.fullmatch(r"\s*(\d+(?:\.\d*)?|\.\d+)\s*(mm|cm|in|)\s*", text)
    if not found:
        raise ValueError(f"{text!r:.60}; allowed: a length such as 85mm, 8.5cm or 3.35in, or single, or double")
    return float(found[1]) * {"mm": MM, "": MM, "cm": 10 * MM, "in": 1.0}[found[2]]


def render(figure: Figure, form: Format, options: FigureOptions | None = None) -> bytes:
    """File of a figure. Raises ValueError where the figure has no chart, or no room for its charts.

    To be called in a process without other tasks, as drawing takes a second and matplotlib is not made for threads.
    """
    if not figure.charts:
        raise ValueError("figure: no chart to draw")
    options = options or FigureOptions()
    return file_of(lambda: drawn(figure, options), form, options.type_size)


def file_of(draw: Callable[[], Canvas], form: Format, type_size: float = TYPE) -> bytes:
    """File of a drawing, in the type and style of all figures. draw: makes the drawing with matplotlib; its exceptions
    are passed on."""
    from matplotlib import rc_context  # here: the import takes 0.3 s, for which the dashboard's start need not wait

    factor = type_size / TYPE
    sizes: dict[Any, Any] = {name: factor * STYLE[name] for name in ("font.size", "xtick.labelsize", "ytick.labelsize")}
    metadata = {"svg": {"Date": None, "Creator": "VSMRC Lab"}, "pdf": {"CreationDate": None}, "png": {}}
    file = io.BytesIO()
    with rc_context({**STYLE, **sizes}):
        draw().savefig(file, format=form, dpi=PNG_DPI, metadata=metadata[form])
    return with_fallbacks(file.getvalue()) if form == "svg" else file.getvalue()


@dataclass(frozen=True)
class ChartPlace:
    """Panel: place of a chart's axes over time in a figure.
    left, right, top, bottom: shares of the figure, from its upper left corner.
    first, last: ends of the time axis, s."""

    left: float
    right: float
    top: float
    bottom: float
    first: float
    last: float


@dataclass(frozen=True)
class DrawnFigure:
    """Drawn figure: SVG, and the panels, on which the page's script draws a cursor."""

    svg: bytes
    panels: tuple[ChartPlace, ...]


def svg_with_panels(figure: Figure, options: FigureOptions) -> DrawnFigure:
    """Figure as SVG, with the places of its charts. Raises ValueError as `render` does."""
    from matplotlib import rc_context

    svg = render(figure, "svg", options)
    with rc_context(STYLE):
        axes = drawn(figure, options).axes
    panels = []
    for each, chart in zip(axes, figure.charts, strict=True):
        if chart.x_label == TIME:
            box, (first, last) = each.get_position(), each.get_xlim()
            panels.append(ChartPlace(*map(float, (box.x0, box.x1, 1.0 - box.y1, 1.0 - box.y0, first, last))))
    return DrawnFigure(svg, tuple(panels))


def drawn(figure: Figure, options: FigureOptions) -> Canvas:
    """Figure of matplotlib, drawn with matplotlib's present settings. Raises ValueError where the charts have no
    room."""
    return _Sheet(figure, options).drawn()


def with_fallbacks(svg: bytes) -> bytes:
    """The SVG with fonts of the same widths for machines without matplotlib's fonts, and without the comments in which
    matplotlib repeats each text."""
    for name, others in FALLBACKS.items():
        svg = svg.replace(f"'{name}'".encode(), f"'{name}', {others}".encode())
    return re.sub(rb"\s*<!--.*?-->", b"", svg, flags=re.DOTALL)


def printed(color: Rgb) -> Ink:
    """Ink for a colour of the dark page, darkened until it has `CONTRAST` with white paper."""
    parts = np.array(color) / 255
    while 1.05 / (_luminance(parts) + 0.05) < CONTRAST:
        parts = parts * 0.98
    return _ink(parts)


def inks_of(chart: FigureChart) -> dict[Rgb, Ink]:
    """Inks of a chart by the colours of the page: of the same hues, and so different in lightness that they can be told
    apart in grey, too."""
    colors = list(dict.fromkeys(curve.color for curve in chart.curves if curve.width > 0 or curve.dotted))
    if len(colors) < 2:
        return {color: printed(color) for color in colors}
    own = {color: _luminance(np.array(color) / 255) for color in colors}
    steps = np.linspace(max(DARKEST, LIGHTEST - STEP * (len(colors) - 1)), LIGHTEST, len(colors))
    return {
        color: _with_luminance(color, _luminance_of(step))
        for color, step in zip(sorted(colors, key=own.__getitem__), steps, strict=True)
    }


def _luminance_of(lightness: float) -> float:
    """Luminance of CIE's lightness, 0 to 100, in which equal steps look equal."""
    return ((lightness + 16) / 116) ** 3


def _with_luminance(color: Rgb, luminance: float) -> Ink:
    """Ink of a colour that is darkened, or mixed with white, to a luminance, 0 to 1."""
    linear = _linear(np.array(color) / 255)
    scaled = linear * luminance / max(float(linear @ _WEIGHTS), 1e-9)
    clipped = scaled / max(float(scaled.max()), 1.0)
    below = float(clipped @ _WEIGHTS)
    white = (luminance - below) / (1.0 - below)
    mixed = np.clip(clipped + white * (1.0 - clipped), 0.0, 1.0)
    return _ink(np.where(mixed <= 0.0031308, 12.92 * mixed, 1.055 * mixed ** (1 / 2.4) - 0.055))


def _ink(parts: np.ndarray) -> Ink:
    r, g, b = np.clip(parts, 0.0, 1.0)
    return float(r), float(g), float(b)


def thinned(x: np.ndarray, y: np.ndarray, bins: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (N,) reduced to at most 2 bins + 2, in their order: the ends, and the extremes of each bin."""
    if len(y) <= 2 * bins:
        return x, y
    size = -(-len(y) // bins)
    padded = np.pad(y, (0, -len(y) % size), mode="edge").reshape(-1, size)
    first = size * np.arange(len(padded))
    extremes = np.concatenate([[0], first + padded.argmin(axis=1), first + padded.argmax(axis=1), [len(y) - 1]])
    kept = np.unique(np.minimum(extremes, len(y) - 1))
    return x[kept], y[kept]


_WEIGHTS = np.array([0.2126, 0.7152, 0.0722])


def _linear(parts: np.ndarray) -> np.ndarray:
    return np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)


def _luminance(parts: np.ndarray) -> float:
    """Relative luminance, 0 to 1, of a colour's sRGB parts, by WCAG 2."""
    return float(_linear(parts) @ _WEIGHTS)


@dataclass(frozen=True)
class _Entry:
    """Entry of a legend.
    number: of its curve.
    row: from the top, from 0.
    x: position from the legend's left, in."""

    number: int
    row: int
    x: float


class _Sheet:
    """Sheet of paper on which a figure is laid out; lengths are in inches, from the lower left corner."""

    def __init__(self, figure: Figure, options: FigureOptions) -> None:
        self._options = options
        self._factor = factor = options.type_size / TYPE
        count = len(figure.charts)
        width = options.width or (SINGLE if count <= figure.one_column else DOUBLE)
        columns = 2 if count > 1 and width >= TWO_COLUMNS else 1
        rows = -(-count // columns)
        charts = _lettered(figure.charts) if options.letters else figure.charts
        self._width, self._column = width, width / columns
        self._inside = self._column - factor * (LEFT + RIGHT)
        self._stacks = [charts[rows * c : rows * (c + 1)] for c in range(columns)]
        told = figure.caption if options.caption else ""
        self._caption = wrapped(told, width - 2 * MARGIN, factor * SMALL * TYPE)
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

    def _legend(self, chart: FigureChart) -> list[_Entry]:
        """Entries of a chart's legend, beside each other in as many rows as they need."""
        entries, row, x = [], 0, 0.0
        for number, curve in enumerate(chart.curves):
            if not curve.listed:
                continue
            wide = self._factor * HANDLE + width_of(curve.name, self._small)
            if x and x + wide > self._inside:
                row, x = row + 1, 0.0
            entries.append(_Entry(number, row, x))
            x += wide + self._factor * APART
        return entries

    def _draw(self, canvas: Canvas, chart: FigureChart, left: float, bottom: float, labelled: bool) -> None:
        wide, high = self._width, self._height
        box = (left / wide, bottom / high, self._inside / wide, self._axes_height / high)
        axes = canvas.add_axes(box)
        looks = looks_of(chart)
        _plot(axes, chart, looks)
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
            ends = np.array([x, x + 0.75 * self._factor * HANDLE]) / self._width
            line = np.full(2, y + 0.28 * row) / self._height
            look = looks[entry.number]
            if any(entry.number in (area.upper, area.lower) for area in chart.areas):
                look = {**look, "linewidth": 0.35 * self._small, "alpha": 0.6, "solid_capstyle": "butt"}
            canvas.add_artist(Line2D(ends, line, transform=canvas.transFigure, **look))
            write(canvas, x + self._factor * HANDLE, y, chart.curves[entry.number].name, self._small)
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
    differ on paper."""
    inks = inks_of(chart)
    solid = dict.fromkeys(curve.color for curve in chart.curves if curve.width > 0 and not curve.dashed)
    dashes = dict(zip(solid if len(solid) > FEW and not chart.areas else (), cycle(DASHES), strict=False))
    return [
        {
            "color": inks.get(curve.color, "0.5"),
            "linewidth": curve.width,
            "linestyle": (0, (4.0, 2.0)) if curve.dashed else dashes.get(curve.color, "-"),
            "marker": "o" if curve.dotted else "",
            "markersize": 2.4,
            "markeredgewidth": 0.0,
        }
        for curve in chart.curves
    ]


def _stretches(curve: Curve) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Stretches x, y of a curve between its gaps."""
    y = np.asarray(curve.y, dtype=float)
    for known in np.ma.clump_unmasked(np.ma.masked_invalid(y)) if len(y) else ():
        yield thinned(np.asarray(curve.x, dtype=float)[known], y[known], BINS)


def _plot(axes: Axes, chart: FigureChart, looks: list[dict[str, Any]]) -> None:
    for area in chart.areas:
        upper, lower = chart.curves[area.upper], chart.curves[area.lower]
        few = slice(None, None, max(len(upper.x) // BINS, 1))
        ink = inks_of(chart).get(area.color, printed(area.color))
        axes.fill_between(upper.x[few], lower.y[few], upper.y[few], color=ink, alpha=0.35, linewidth=0.0)
    for curve, look in zip(chart.curves, looks, strict=True):
        for x, y in _stretches(curve):
            axes.plot(x, y, clip_on=not curve.dotted, zorder=3 if curve.dotted else 2, **look)
    known = [curve.x[np.isfinite(curve.y)] for curve in chart.curves]
    ends = [end for x in known if len(x) for end in (np.min(x), np.max(x))]
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
        from matplotlib.ticker import MaxNLocator

        axes.yaxis.set_major_locator(MaxNLocator(4, min_n_ticks=3))
        axes.yaxis.set_major_formatter(plain_number)


def plain_decades(axis: Axis) -> None:
    """Set the ticks of a logarithmic axis."""
    from matplotlib.ticker import LogLocator, NullFormatter

    low, high = axis.get_view_interval()
    within_decades = high > 30 * low
    axis.set_major_locator(LogLocator(subs=(1.0,) if within_decades else (1.0, 2.0, 5.0), numticks=6))
    axis.set_minor_formatter(NullFormatter())
    axis.set_major_formatter(plain_number)


def plain_number(value: float, _: object) -> str:
    """Label of a tick as plain text, such as 2·10⁻³."""
    short = f"{value:.0e}"
    text = short if abs(value) >= 1e5 and float(short) == value else f"{value:.6g}"
    mantissa, _, exponent = text.partition("e")
    power = "10" + str(int(exponent)).translate(RAISED) if exponent else ""
    return "·".join(part for part in (mantissa, power) if part and (part, bool(power)) != ("1", True)).replace("-", "−")
