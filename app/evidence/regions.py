"""Regions of a plane, in the style of `app.figures`."""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np

from app.figures import _STYLE, SINGLE, Rgb, printed


@dataclass(frozen=True)
class Region:
    """A polygon, (N, 2) corners; filled, or only its outline."""

    name: str
    color: Rgb
    corners: np.ndarray
    filled: bool = False
    dashed: bool = False


@dataclass(frozen=True)
class Spot:
    """A named point of the plane."""

    name: str
    x: float
    y: float


def render_regions(regions: tuple[Region, ...], spots: tuple[Spot, ...], x_label: str, y_label: str) -> bytes:
    """SVG of a column's width: regions one over the other, spots on top, a legend beneath."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    file = io.BytesIO()
    with rc_context(_STYLE):
        canvas = Figure(figsize=(SINGLE, 2.9))
        axes = canvas.add_axes((0.13, 0.32, 0.84, 0.65))
        for region in regions:
            corners, color = np.vstack([region.corners, region.corners[:1]]), printed(region.color)
            if region.filled:
                axes.fill(corners[:, 0], corners[:, 1], color=color, alpha=0.25, linewidth=0.0)
            style = (0, (4.0, 2.0)) if region.dashed else "-"
            axes.plot(corners[:, 0], corners[:, 1], color=color, linewidth=1.2, linestyle=style, label=region.name)
        for spot in spots:
            axes.plot([spot.x], [spot.y], "o", color="0.1", markersize=3.5)
            axes.annotate(spot.name, (spot.x, spot.y), xytext=(4, 3), textcoords="offset points")
        axes.set_axisbelow(True)
        axes.margins(0.03)
        axes.set_xlim(left=0.0)
        axes.set_ylim(bottom=0.0)
        axes.set_xlabel(x_label)
        axes.set_ylabel(y_label)
        canvas.legend(loc="lower left", bbox_to_anchor=(0.05, 0.0), ncols=1, frameon=False, fontsize=6.5)
        canvas.savefig(file, format="svg", metadata={"Date": None, "Creator": "VSMRC Lab"})
    return file.getvalue()
