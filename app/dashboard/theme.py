"""Colours of the page: one place, so that a quantity has the same colour in the scene, the plots and the text."""

from __future__ import annotations

Rgb = tuple[int, int, int]

ACCENT: Rgb = (66, 135, 245)
MEASURED: Rgb = (255, 153, 51)
DESIRED: Rgb = (64, 200, 110)
SURFACE: Rgb = (70, 140, 220)
SURFACE_LINES: Rgb = (110, 165, 225)
TOOL_PATH: Rgb = (255, 205, 90)
PUSH: Rgb = (204, 90, 190)
GHOST: Rgb = (120, 165, 240)
BOUND: Rgb = (235, 80, 80)
GRID: Rgb = (70, 74, 80)
GRID_SECTION: Rgb = (105, 110, 118)

# From no error to the largest: of middling lightness, seen on dark and on light, by the colour-blind too.
ERROR_COLORS: tuple[Rgb, ...] = ((60, 140, 235), (235, 165, 45), (215, 45, 75))

# One per task coordinate or joint, told apart by people with the common colour deficiencies too (Okabe and Ito).
SERIES: tuple[Rgb, ...] = (
    (86, 180, 233),
    (230, 159, 0),
    (0, 190, 140),
    (240, 228, 66),
    (213, 94, 0),
    (204, 121, 167),
    (170, 170, 170),
)


def css(color: Rgb, alpha: float = 1.0) -> str:
    """The colour as CSS writes it."""
    return f"rgba({color[0]}, {color[1]}, {color[2]}, {alpha:g})"
