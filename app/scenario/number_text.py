"""Numbers as people read them: without Python's exponents, with a minus sign."""

from __future__ import annotations

import re
from collections.abc import Sequence

DIGITS, MOST_DIGITS = 6, 15  # of a number: usually, and at most
_RAISED = "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"
_RAISE = str.maketrans("-0123456789", _RAISED)
_QUOTED = r"""(?<!\w)'[^'\n]*'|"[^"\n]*\""""  # what somebody has typed, or the name of a file
# a number with an exponent as Python writes it, which is no part of a name or a path
_EXPONENT = re.compile(rf"""{_QUOTED}|(?<![\w.+/-])(?P<number>-?\d+(?:\.\d+)?e[+-]\d{{2,3}})(?![\w/-]|\.\w)""")


def without_rounding(value: float, least: float = 1e-9) -> float:
    """The number, or 0 where it is smaller than `least`: its digits are those of rounding."""
    return 0.0 if abs(value) < least else value


def plain(value: float, digits: int = DIGITS) -> str:
    """Number as plain text, with a power of ten where it is long, such as 2·10⁻⁵."""
    short = f"{value:.0e}"
    return with_power(short if abs(value) >= 1e5 and float(short) == value else f"{value:.{digits}g}")


def rounded(value: float, digits: int = 3) -> str:
    """Number as plain text, rounded to so many digits: 13400, not 1.34e+04."""
    return plain(float(f"{value:.{digits}g}"))


def short(value: float, digits: int = 3) -> str:
    """Number as plain text, rounded to so many digits, but with all digits of its whole part up to a million."""
    whole = 10.0**digits <= abs(value) < 1e6
    return f"{value:.0f}".replace("-", "−") if whole else rounded(value, digits)


def power_of_ten(value: float) -> str:
    """Number as plain text, with a power of ten also where it is short: 2·10³."""
    return with_power(f"{value:.5e}") if value else "0"


def in_one_style(values: Sequence[float]) -> list[str]:
    """Numbers of an axis: all with powers of ten where one of them has one, since 10000 is not read beside 10⁵."""
    texts = [rounded(value) for value in values]
    powers = any(sign in text for text in texts for sign in _RAISED)
    return [power_of_ten(float(f"{value:.3g}")) for value in values] if powers else texts


def with_power(text: str) -> str:
    """A number as Python writes it, with its exponent as a power of ten: 10⁵ of 1e+05."""
    mantissa, _, exponent = text.partition("e")
    mantissa = f"{float(mantissa) + 0.0:.{MOST_DIGITS}g}"  # without zeros at its end, and no negative zero
    power = "10" + str(int(exponent)).translate(_RAISE) if exponent else ""
    return "·".join(part for part in (mantissa, power) if part and (part, bool(power)) != ("1", True)).replace("-", "−")


def with_powers(text: str) -> str:
    """Text in which numbers that Python has written with an exponent have a power of ten; what stands in quotes is as
    it was."""
    return _EXPONENT.sub(lambda found: with_power(found[0]) if found["number"] else found[0], text)


def counted(number: int, noun: str) -> str:
    """Number of things with their noun, which has an s unless there is one: 1 run, 2 runs."""
    return f"{number} {noun}" + ("" if number == 1 else "s")
