"""Ticks of charts on paper: enough numbers to read a scale."""

from __future__ import annotations

import pytest
from matplotlib.figure import Figure

from app.export.ticks import plain_decades


@pytest.mark.parametrize(
    ("low", "high", "numbers"),
    [
        (2e3, 9e4, ["2000", "5000", "10000", "20000", "50000"]),  # one power of ten lies between them
        (1e3, 9e4, ["1000", "10000"]),
        (1.1e3, 1.1e5, ["10⁴", "10⁵"]),
        (3.0, 40.0, ["5", "10", "20"]),
    ],
)
def test_a_logarithmic_axis_has_two_numbers_or_more(low: float, high: float, numbers: list[str]) -> None:
    canvas = Figure()
    plot = canvas.add_subplot()
    plot.set_xscale("log")
    plot.set_xlim(low, high)
    plain_decades(plot.xaxis)
    canvas.draw_without_rendering()
    texts = [tick.label1.get_text() for tick in plot.xaxis.get_major_ticks() if low <= tick.get_loc() <= high]
    assert texts == numbers
