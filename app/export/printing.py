"""Printing of figures by matplotlib: SVG and PDF, in which text stays text, or PNG. The same figure always makes the
same bytes."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from app.export.figures import TIME, TYPE, Figure, FigureOptions
from app.export.formats import Format
from app.export.sheet import SMALL, Sheet

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas


FALLBACKS = {
    "DejaVu Sans": "'Bitstream Vera Sans', Verdana, sans-serif",
}
PNG_DPI = 300
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


def render(figure: Figure, form: Format, options: FigureOptions | None = None) -> bytes:
    """File of a figure. Raises ValueError where the figure has no chart, or no room for its charts.

    To be called in a process without other tasks, as drawing takes a second and matplotlib is not made for threads.
    """
    require_charts(figure)
    options = options or FigureOptions()
    return file_of(lambda: drawn(figure, options), form, options.type_size)


def require_charts(figure: Figure) -> None:
    """Raise ValueError where the figure has no chart."""
    if not figure.charts:
        raise ValueError("figure: no chart to draw")


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
    """Place of a chart's axes over time in a figure.
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
    canvases: list[Canvas] = []

    def draw() -> Canvas:
        canvases.append(drawn(figure, options))
        return canvases[-1]

    require_charts(figure)
    svg = file_of(draw, "svg", options.type_size)
    panels = []
    for each, chart in zip(canvases[-1].axes, figure.charts, strict=True):
        if chart.x_label == TIME:
            box, (first, last) = each.get_position(), each.get_xlim()
            panels.append(ChartPlace(*map(float, (box.x0, box.x1, 1.0 - box.y1, 1.0 - box.y0, first, last))))
    return DrawnFigure(svg, tuple(panels))


def drawn(figure: Figure, options: FigureOptions) -> Canvas:
    """Figure of matplotlib, drawn with matplotlib's present settings. Raises ValueError where the charts have no
    room."""
    return Sheet(figure, options).drawn()


def with_fallbacks(svg: bytes) -> bytes:
    """The SVG with fonts of the same widths for machines without matplotlib's fonts, and without the comments in which
    matplotlib repeats each text."""
    for name, others in FALLBACKS.items():
        svg = svg.replace(f"'{name}'".encode(), f"'{name}', {others}".encode())
    return re.sub(rb"\s*<!--.*?-->", b"", svg, flags=re.DOTALL)
