"""Ticks of charts on paper: enough numbers to read a scale."""

from __future__ import annotations

import pytest
from matplotlib.figure import Figure

from app.export.ticks import plain_decades, plain_steps, with_decimal_mark


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


def test_the_decimals_of_an_axis_stand_behind_a_comma_where_that_is_asked_for() -> None:
    """Also on an axis whose numbers matplotlib writes itself."""
    canvas = Figure()
    plot = canvas.add_subplot()
    plot.set(xlim=(0.0, 2.0), ylim=(-0.5, 0.5))
    plain_steps(plot.yaxis)
    for axis in (plot.xaxis, plot.yaxis):
        with_decimal_mark(axis, ",")
    canvas.draw_without_rendering()
    assert [label.get_text() for label in plot.get_xticklabels()][1:4] == ["0,25", "0,50", "0,75"]
    assert "−0,25" in [label.get_text() for label in plot.get_yticklabels()]
