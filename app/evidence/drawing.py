"""Drawings of the evidence: charts in two columns, and heat maps of a quantity over two parameters."""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from app.export.figures import DOUBLE, TYPE, Figure, FigureChart
from app.export.lettering import wrapped, write
from app.export.printing import STYLE, render, with_fallbacks
from app.export.sheet import MARGIN, ROW, SMALL
from app.scenario.number_text import plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TALL, LEFT, GAP, BAR, BELOW = 1.75, 0.58, 0.95, 0.09, 0.32  # in
GOOD, THEORY = "white", "0.05"  # of a map's two lines


@dataclass(frozen=True)
class HeatMap:
    """Heat map of a quantity over two parameters.
    x, y: values of the parameters, (k,) and (l,), as text.
    values: of the quantity, (l, k), nan where a run left the domain; the colours follow the logarithm.
    ends: of the scale of colours.
    good: value that a line marks.
    theory: another quantity (l, k), and its value that a second line marks, such as the limit of a loop's stability."""

    title: str
    unit: str
    x_label: str
    y_label: str
    x: Sequence[str]
    y: Sequence[str]
    values: np.ndarray
    ends: tuple[float, float]
    good: float
    theory: tuple[np.ndarray, float] | None = None


def charts_in_columns(charts: Iterable[FigureChart], caption: str) -> bytes:
    """Picture of charts in two columns, as SVG."""
    return render(Figure(tuple(charts), caption, one_column=1), "svg")


def heat_maps(maps: Sequence[HeatMap], caption: str) -> bytes:
    """Picture of maps beside each other, as SVG; the same maps always make the same bytes."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure as Canvas

    lines = wrapped(caption, DOUBLE - 2 * MARGIN, SMALL * TYPE)
    height = MARGIN + 2 * ROW + TALL + BELOW + ROW * (len(lines) + 1)
    wide = (DOUBLE - LEFT - GAP * len(maps) + 0.3) / len(maps)
    file = io.BytesIO()
    with rc_context(STYLE):
        canvas = Canvas(figsize=(DOUBLE, height))
        bottom = (height - MARGIN - 2 * ROW - TALL) / height
        for number, each in enumerate(maps):
            left = LEFT + number * (wide + GAP)
            axes = canvas.add_axes((left / DOUBLE, bottom, wide / DOUBLE, TALL / height))
            bar = canvas.add_axes(((left + wide + 0.06) / DOUBLE, bottom, BAR / DOUBLE, TALL / height))
            _draw(axes, bar, each)
        for number, line in enumerate(lines):
            write(canvas, MARGIN, ROW * (len(lines) - number - 0.5), line, SMALL * TYPE, color="0.2")
        canvas.savefig(file, format="svg", metadata={"Date": None, "Creator": "VSMRC Lab"})
    return with_fallbacks(file.getvalue())


def _draw(axes: Axes, bar: Axes, each: HeatMap) -> None:
    from matplotlib.colors import LogNorm
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    k, l = len(each.x), len(each.y)
    axes.set_facecolor("0.75")
    scale = LogNorm(*each.ends, clip=True)
    mesh = axes.pcolormesh(np.arange(k + 1), np.arange(l + 1), np.ma.masked_invalid(each.values), norm=scale)
    mesh.set_edgecolor("face")
    mesh.set_cmap("viridis_r")
    for j, i in np.argwhere(np.isnan(each.values)):
        axes.text(i + 0.5, j + 0.5, "×", ha="center", va="center", color="0.3", fontsize=6.5)
    beyond = np.where(np.isnan(each.values), 1e3 * each.ends[1], each.values)
    _edge(axes, beyond > each.good, GOOD, "-")
    if each.theory is not None:
        _edge(axes, each.theory[0] > each.theory[1], THEORY, ":")
    axes.grid(visible=False)
    axes.set_xticks(np.arange(k) + 0.5, each.x)
    axes.set_yticks(np.arange(l) + 0.5, each.y)
    axes.tick_params(pad=2, length=0)
    axes.set_xlabel(each.x_label, labelpad=2)
    axes.set_ylabel(each.y_label, labelpad=2)
    axes.set_title(f"{each.title} [{each.unit}]", loc="left", fontsize=7.5, fontweight="bold", pad=4)
    axes.figure.colorbar(
        mesh, cax=bar, ticks=LogLocator(subs=(1.0,), numticks=6), format=FuncFormatter(lambda value, _: plain(value))
    )
    bar.yaxis.set_minor_formatter(NullFormatter())
    bar.tick_params(pad=1, length=2)
    bar.axhline(each.good, color=GOOD, linewidth=1.5)


def _edge(axes: Axes, beyond: np.ndarray, color: str, style: str) -> None:
    """Draw a line along the cells' sides between the cells in `beyond` and the others."""
    for j, i in np.argwhere(beyond[:, 1:] != beyond[:, :-1]):
        axes.plot([i + 1, i + 1], [j, j + 1], color=color, linestyle=style, linewidth=1.6, solid_capstyle="butt")
    for j, i in np.argwhere(beyond[1:] != beyond[:-1]):
        axes.plot([i, i + 1], [j + 1, j + 1], color=color, linestyle=style, linewidth=1.6, solid_capstyle="butt")
