"""Figures on paper: their content in numbers and words, and their look. Nothing here depends on the page.

`app.export.printing` makes files of them, `sheet` lays them out, `inks` has their colours.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

Rgb = tuple[int, int, int]
TIME, FREQUENCY = "t [s]", "frequency [Hz]"
MM = 1.0 / 25.4  # in
SINGLE, DOUBLE = 85.0 * MM, 180.0 * MM  # in, widths of a journal's column and of its page
ONE_COLUMN = 4  # number of charts up to which they stand in one column
TYPE = 7.0  # pt, size of the running text; the lengths of `app.export.sheet` are for this size


@dataclass(frozen=True)
class Curve:
    """Curve of a chart.
    color: of the dark page.
    x, y: (N,) in the units of the chart's labels.
    width: of the line, pt; 0 for dots alone.
    listed: whether the curve is in the legend.
    dotted: whether each point has a dot.
    dashes: widths of the line, of line and gap in turn, in place of those of a dashed curve.
    repeats: of a curve of another run, the names of the legend's other entries that it belongs to."""

    name: str
    color: Rgb
    x: np.ndarray
    y: np.ndarray
    dashed: bool = False
    width: float = 1.0
    listed: bool = True
    dotted: bool = False
    dashes: tuple[float, ...] = ()
    repeats: tuple[str, ...] = ()


@dataclass(frozen=True)
class FilledArea:
    """Filled area between two of a chart's curves, counted from 0, over every x that both of them have."""

    upper: int
    lower: int
    color: Rgb


@dataclass(frozen=True)
class FigureChart:
    """Chart: axes with curves and a legend.
    logarithmic: whether the vertical axis is logarithmic.
    at_least: range of y that is always in view.
    logarithmic_x: whether the horizontal axis is logarithmic.
    x_range: ends of the horizontal axis, None for those of the curves."""

    title: str
    unit: str
    curves: tuple[Curve, ...]
    areas: tuple[FilledArea, ...] = ()
    x_label: str = TIME
    logarithmic: bool = False
    at_least: tuple[float, float] | None = None
    logarithmic_x: bool = False
    x_range: tuple[float, float] | None = None


@dataclass(frozen=True)
class Figure:
    """Figure: charts, and the caption below them.
    one_column: number of charts up to which they stand in one column.
    decimal: mark before the decimals of the axes' numbers."""

    charts: tuple[FigureChart, ...]
    caption: str
    one_column: int = ONE_COLUMN
    decimal: str = "."


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
