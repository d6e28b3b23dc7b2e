"""Pictures of regions of a plane, in the style of `app.export.printing`."""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np

from app.export.figures import SINGLE, Rgb
from app.export.inks import printed
from app.export.printing import STYLE, with_fallbacks


@dataclass(frozen=True)
class Region:
    """Region: a polygon with corners (N, 2), filled, or only its outline."""

    name: str
    color: Rgb
    corners: np.ndarray
    filled: bool = False
    dashed: bool = False


@dataclass(frozen=True)
class Spot:
    """Spot: a named point of the plane."""

    name: str
    x: float
    y: float


def render_regions(regions: tuple[Region, ...], spots: tuple[Spot, ...], x_label: str, y_label: str) -> bytes:
    """Picture (SVG) of a column's width: regions over each other in their order, spots on top, a legend below."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure
    from matplotlib.patches import Polygon

    file = io.BytesIO()
    with rc_context(STYLE):
        canvas = Figure(figsize=(SINGLE, 3.2))
        axes = canvas.add_axes((0.12, 0.39, 0.84, 0.59))
        for region in regions:
            color, style = printed(region.color), (0, (4.0, 2.0)) if region.dashed else "-"
            ground = (*color, 0.25) if region.filled else "none"
            patch = Polygon(
                region.corners, facecolor=ground, edgecolor=color, linewidth=1.2, linestyle=style, label=region.name
            )
            axes.add_patch(patch)
        for spot in spots:
            axes.plot([spot.x], [spot.y], "o", color="0.1", markersize=3.5)
            axes.annotate(spot.name, (spot.x, spot.y), xytext=(4, 3), textcoords="offset points")
        axes.set_axisbelow(True)
        axes.autoscale_view()
        axes.set_xlabel(x_label)
        axes.set_ylabel(y_label)
        canvas.legend(loc="lower left", bbox_to_anchor=(0.05, 0.0), ncols=1, frameon=False, fontsize=6.5)
        canvas.savefig(file, format="svg", metadata={"Date": None, "Creator": "VSMRC Lab"})
    return with_fallbacks(file.getvalue())
