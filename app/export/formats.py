"""Formats of files that can be exported."""

from typing import Literal

Format = Literal["svg", "pdf", "png"]  # of figures
DataFormat = Literal["csv", "npz"]
Kind = Literal["svg", "pdf", "png", "csv", "npz", "html", "toml"]
FIGURE_FORMATS: dict[str, Format] = {"SVG": "svg", "PDF": "pdf", "PNG": "png"}  # by their names on the page
ALL_PLOTS = "all plots"  # stands for the titles of all tabs of plots
