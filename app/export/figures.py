"""Figures on paper: charts on white ground, with type that is readable at a column's width, vectors and text kept as
such.

`Figure` says what to draw in numbers and words alone; nothing here depends on the page. The same figure always makes
the same bytes.
"""

from __future__ import annotations

import io
import textwrap
from dataclasses import dataclass
from itertools import zip_longest
from typing import TYPE_CHECKING, Any

import numpy as np

from app.export.formats import Format

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure as Canvas

Rgb = tuple[int, int, int]
TIME, FREQUENCY = "t [s]", "frequency [Hz]"
SINGLE, DOUBLE = 3.5, 7.16  # in, a journal's column and its page
ONE_COLUMN = 4  # charts, more of which stand in two columns on paper
AXES_HEIGHT, LEFT, RIGHT, BELOW, GAP, MARGIN = 0.95, 0.52, 0.08, 0.2, 0.05, 0.06  # in
X_LABEL = 0.16  # in
ROW = 0.125  # in, of a title, of a row of the legend, of a line of the caption
LETTERS = 20.0  # per inch in the smallest type, in words of a legend
CAPTION_LETTERS = 20.5  # and in sentences
HANDLE = 0.235  # in, of an entry of the legend beside its name
BINS = 600  # of a curve, each with its smallest and its largest value
CONTRAST = 3.0  # with white, at least: WCAG 2, for graphics
PNG_DPI = 300
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",  # text stays text
    "svg.hashsalt": "vsmrc",
    "pdf.fonttype": 42,
    "font.family": "DejaVu Sans",
    "font.size": 7.0,
    "text.parse_math": False,  # a title with dollars in it is text, too
    "axes.linewidth": 0.5,
    "axes.edgecolor": "0.35",
    "axes.grid": True,
    "grid.color": "0.88",
    "grid.linewidth": 0.4,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.labelsize": 6.5,
    "ytick.labelsize": 6.5,
    "xtick.major.width": 0.5,
    "ytick.major.width": 0.5,
    "ytick.minor.width": 0.3,
    "path.simplify": False,
}


@dataclass(frozen=True)
class Curve:
    """One line. color as on the dark page; x, y (N,) in the units of the chart's labels; width in points, 0 for dots
    alone; dotted: a dot at each point; listed: in the legend."""

    name: str
    color: Rgb
    x: np.ndarray
    y: np.ndarray
    dashed: bool = False
    width: float = 1.0
    listed: bool = True
    dotted: bool = False


@dataclass(frozen=True)
class Area:
    """Filled area between two of a chart's curves, counted from 0, which have the same x."""

    upper: int
    lower: int
    color: Rgb


@dataclass(frozen=True)
class Chart:
    """Axes with curves, the legend naming those that are listed. logarithmic: the vertical axis, logarithmic_x: the
    horizontal one; at_least: this range of y is in view whatever the curves do."""

    title: str
    unit: str
    curves: tuple[Curve, ...]
    areas: tuple[Area, ...] = ()
    x_label: str = TIME
    logarithmic: bool = False
    at_least: tuple[float, float] | None = None
    logarithmic_x: bool = False


@dataclass(frozen=True)
class Figure:
    """Charts one below the other, in two columns when there are more of them than `one_column`, and the caption under
    them."""

    charts: tuple[Chart, ...]
    caption: str
    one_column: int = ONE_COLUMN


def render(figure: Figure, form: Format) -> bytes:
    """File of the figure in this form. Raises ValueError when it has no chart.

    It takes a second, and matplotlib is not made for threads: to be called in a process that has nothing else to do.
    """
    from matplotlib import rc_context  # here: it takes 0.3 s to import, which starting the dashboard need not wait for

    if not figure.charts:
        raise ValueError("figure: no chart to draw")
    metadata = {"svg": {"Date": None, "Creator": "VSMRC Lab"}, "pdf": {"CreationDate": None}, "png": {}}
    file = io.BytesIO()
    with rc_context(STYLE):
        _drawn(figure).savefig(file, format=form, dpi=PNG_DPI, metadata=metadata[form])
    return file.getvalue()


def printed(color: Rgb) -> tuple[float, float, float]:
    """A colour of the dark page, darkened until it has `CONTRAST` with white paper; each part within 0 to 1."""
    parts = np.array(color) / 255
    while 1.05 / (_luminance(parts) + 0.05) < CONTRAST:
        parts = parts * 0.98
    r, g, b = parts
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


def _luminance(parts: np.ndarray) -> float:
    """Relative luminance of sRGB, as WCAG 2 has it."""
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return float(linear @ (0.2126, 0.7152, 0.0722))


def _drawn(figure: Figure) -> Canvas:
    from matplotlib.figure import Figure as Canvas

    count = len(figure.charts)
    columns = 1 if count <= figure.one_column else 2
    width = (SINGLE, DOUBLE)[columns - 1]
    rows = -(-count // columns)
    stacks = [figure.charts[rows * c : rows * (c + 1)] for c in range(columns)]
    column_width = width / columns
    inside = column_width - LEFT - RIGHT
    caption = textwrap.wrap(figure.caption, int((width - 2 * MARGIN) * CAPTION_LETTERS))
    top = MARGIN + max(sum(_height(chart, following, inside) for chart, following in _pairs(s)) for s in stacks)
    height = top + ROW * (len(caption) + 1) + MARGIN

    canvas = Canvas(figsize=(width, height))
    for column, stack in enumerate(stacks):
        y = height - MARGIN
        for chart, following in _pairs(stack):
            y -= _header(chart, inside) + AXES_HEIGHT
            place = ((column * column_width + LEFT) / width, y / height, inside / width, AXES_HEIGHT / height)
            _draw(canvas.add_axes(place), chart, inside, labelled=_labelled(chart, following))
            y -= _footer(chart, following)
    start = height - top - 0.4 * ROW
    for number, line in enumerate(caption):
        canvas.text(MARGIN / width, (start - number * ROW) / height, line, va="top", fontsize=6.5, color="0.2")
    return canvas


def _pairs(stack: tuple[Chart, ...]) -> list[tuple[Chart, Chart | None]]:
    """Pairs of each chart with the one below it."""
    return list(zip_longest(stack, stack[1:]))


def _labelled(chart: Chart, following: Chart | None) -> bool:
    return following is None or following.x_label != chart.x_label


def _height(chart: Chart, following: Chart | None, width: float) -> float:
    return _header(chart, width) + AXES_HEIGHT + _footer(chart, following)


def _header(chart: Chart, width: float) -> float:
    """Height in inches of the title and the legend."""
    return ROW * (1 + _legend_rows(chart, width)) + 0.06


def _footer(chart: Chart, following: Chart | None) -> float:
    return BELOW + (X_LABEL if _labelled(chart, following) else 0.0) + GAP


def _legend_rows(chart: Chart, width: float) -> int:
    names = [curve.name for curve in chart.curves if curve.listed]
    beside = max(int(width / (max(map(len, names), default=1) / LETTERS + HANDLE)), 1)
    return -(-len(names) // beside)


def _draw(axes: Axes, chart: Chart, width: float, *, labelled: bool) -> None:
    for area in chart.areas:
        upper, lower = chart.curves[area.upper], chart.curves[area.lower]
        few = slice(None, None, max(len(upper.x) // BINS, 1))
        axes.fill_between(
            upper.x[few], lower.y[few], upper.y[few], color=printed(area.color), alpha=0.35, linewidth=0.0
        )
    for curve in chart.curves:
        x, y = thinned(np.asarray(curve.x, dtype=float), np.asarray(curve.y, dtype=float), BINS)
        style = (0, (4.0, 2.0)) if curve.dashed else "-"
        axes.plot(
            x,
            y,
            color=printed(curve.color),
            linewidth=curve.width,
            linestyle=style,
            marker="o" if curve.dotted else "",
            markersize=2.4,
            markeredgewidth=0.0,
            clip_on=not curve.dotted,
            zorder=3 if curve.dotted else 2,
            label=curve.name if curve.listed else "_",
        )
    ends = [end for curve in chart.curves if len(curve.x) for end in (np.min(curve.x), np.max(curve.x))]
    if ends and min(ends) < max(ends):
        axes.set_xlim(min(ends), max(ends))
    _scale(axes, chart)
    axes.set_axisbelow(True)
    axes.tick_params(pad=2, length=2)
    axes.set_ylabel(chart.unit)
    axes.yaxis.set_label_coords((0.15 - LEFT) / width, 0.5)
    if labelled:
        axes.set_xlabel(chart.x_label, labelpad=1)
    rows = _legend_rows(chart, width)
    axes.set_title(chart.title, loc="left", fontsize=7.5, fontweight="bold", pad=72 * ROW * rows + 1)
    if rows:
        listed = sum(curve.listed for curve in chart.curves)
        axes.legend(
            loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=-(-listed // rows), frameon=False,
            fontsize=6.5, borderpad=0.0, borderaxespad=0.1, handlelength=1.3, handletextpad=0.4, columnspacing=0.8,
            labelspacing=0.15,
        )  # fmt: skip


def _scale(axes: Axes, chart: Chart) -> None:
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

        axes.yaxis.set_major_locator(MaxNLocator(4))
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
    """Number of a tick without markup, such as 2·10⁻³."""
    mantissa, _, exponent = f"{value:.6g}".partition("e")
    power = "10" + str(int(exponent)).translate(RAISED) if exponent else ""
    return "·".join(part for part in (mantissa, power) if part and (part, bool(power)) != ("1", True)).replace("-", "−")
