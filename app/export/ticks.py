"""Ticks of charts on paper: few, with plain numbers."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from app.scenario.number_text import DIGITS, MOST_DIGITS, plain, power_of_ten

if TYPE_CHECKING:
    from matplotlib.axis import Axis


def plain_steps(axis: Axis) -> None:
    """Set the ticks of a linear axis in its present range: three or more, whose numbers differ."""
    from matplotlib.ticker import MaxNLocator

    axis.set_major_locator(MaxNLocator(4, min_n_ticks=3))
    ticks = axis.get_majorticklocs()
    digits = _digits(ticks)
    axis.set_major_formatter(lambda value, _: plain(value, digits))
    if digits > DIGITS:  # a longer number has no more room beside the axis
        longest = max(len(plain(tick, digits)) for tick in ticks)
        usual = float(axis.get_ticklabels()[0].get_fontsize())
        axis.set_tick_params(labelsize=usual * (DIGITS + 1) / longest)


def with_decimal_mark(axis: Axis, mark: str) -> None:
    """Write the decimals of an axis's numbers behind this mark."""
    from matplotlib.ticker import Formatter

    class Marked(Formatter):
        """Formatter of numbers as another one writes them, with this mark."""

        def __init__(self, written: Formatter) -> None:
            self._written = written

        def __call__(self, x: float, pos: int | None = None) -> str:
            return self._written(x, pos).replace(".", mark)

        def set_locs(self, locs: list[float]) -> None:
            self._written.set_locs(locs)

        def get_offset(self) -> str:
            return self._written.get_offset().replace(".", mark)

    axis.set_major_formatter(Marked(axis.get_major_formatter()))


def _digits(ticks: np.ndarray) -> int:
    """Number of digits, `DIGITS` or more, with which ticks (N,) are told to a hundredth of the step between them."""
    near = 0.01 * np.diff(ticks).min(initial=np.inf)
    enough = (d for d in range(DIGITS, MOST_DIGITS) if all(abs(float(f"{x:.{d}g}") - x) <= near for x in ticks))
    return next(enough, MOST_DIGITS)


def plain_decades(axis: Axis) -> None:
    """Set the ticks of a logarithmic axis."""
    from matplotlib.ticker import LogLocator, NullFormatter

    low, high = axis.get_view_interval()
    decades = math.floor(math.log10(high)) - math.ceil(math.log10(low))
    only_powers = high > 30 * low and decades >= 1  # one number alone tells no scale
    axis.set_major_locator(LogLocator(subs=(1.0,) if only_powers else (1.0, 2.0, 5.0), numticks=6))
    axis.set_minor_formatter(NullFormatter())
    # one form for all numbers of an axis: 10000 is not read beside 10⁵
    written = power_of_ten if high >= 1e5 or low < 1e-4 else plain
    axis.set_major_formatter(lambda value, _: written(value))
