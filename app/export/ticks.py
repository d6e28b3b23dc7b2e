"""Ticks of charts on paper: few, with plain numbers."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axis import Axis

DIGITS, MOST_DIGITS = 6, 15  # of a number: usually, and where the next tick's number would be the same otherwise
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def plain_steps(axis: Axis) -> None:
    """Set the ticks of a linear axis in its present range: three or more, whose numbers differ."""
    from matplotlib.ticker import MaxNLocator

    axis.set_major_locator(MaxNLocator(4, min_n_ticks=3))
    ticks = axis.get_majorticklocs()
    digits = _digits(ticks)
    axis.set_major_formatter(lambda value, _: _plain(value, digits))
    if digits > DIGITS:  # a longer number has no more room beside the axis
        longest = max(len(_plain(tick, digits)) for tick in ticks)
        usual = float(axis.get_ticklabels()[0].get_fontsize())
        axis.set_tick_params(labelsize=usual * (DIGITS + 1) / longest)


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
    axis.set_major_formatter(power_of_ten if high >= 1e5 or low < 1e-4 else plain_number)


def power_of_ten(value: float, _: object) -> str:
    """Label of a tick as plain text, with a power of ten also where the number is short: 2·10³."""
    return _with_power(f"{value:.5e}")


def plain_number(value: float, _: object) -> str:
    """Label of a tick as plain text, such as 2·10⁻³."""
    return _plain(value, DIGITS)


def _plain(value: float, digits: int) -> str:
    short = f"{value:.0e}"
    return _with_power(short if abs(value) >= 1e5 and float(short) == value else f"{value:.{digits}g}")


def _with_power(text: str) -> str:
    """A number as Python writes it, with its exponent as a power of ten: 10⁵ of 1e+05."""
    mantissa, _, exponent = text.partition("e")
    mantissa = f"{float(mantissa):.{MOST_DIGITS}g}"  # without zeros at its end
    power = "10" + str(int(exponent)).translate(RAISED) if exponent else ""
    return "·".join(part for part in (mantissa, power) if part and (part, bool(power)) != ("1", True)).replace("-", "−")
