"""Lettering of a figure: words are set as they are, symbols among them as mathematics, with matplotlib's mathtext.

A text such as "gain d against what (17) needs" is cut into runs of letters: `d` is a symbol, the others are words. A
text has no markup: dollars and backslashes in a title are set as they are.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

POINTS = 72.0  # per inch
SPACE = 0.32  # em, between words
MATHEMATICS = "dejavusans"  # the words' family, so that a machine with the one has the other
_ACCENTS = {"\u0302": "hat", "\u0307": "dot", "\u0308": "ddot"}
_LOWERED = str.maketrans("₀₁₂₃₄₅₆₇₈₉", "0123456789")
# A letter with or without accent, index and exponent. A single letter after a number or within a unit is a unit.
_SYMBOL = re.compile(
    r"(?<![A-Za-z0-9_α-ωΑ-Ω/'’\\$])"
    r"(?P<letter>[A-Za-zα-ωΑ-Ωℓ][\u0302\u0307\u0308]?)"
    r"(?P<hat>_hat)?(?P<index>_[A-Za-z0-9]{1,3}(?![A-Za-z0-9_])|[₀-₉]+)?"
    r"(?:(?P<power>ᵀ|⁻¹)|(?![A-Za-z0-9_α-ωΑ-Ω\u0302\u0307\u0308$\\]))"
)
_UNIT_BEFORE = re.compile(r"[0-9)\]] $|·$")
_BREAKS = re.compile(r"(?<![0-9)\]])\s+|\s+(?![A-Za-z]{1,2}\b)")
_PANEL = re.compile(r"\([a-z]{1,2}\) ")
_IN_BRACKETS = re.compile(r"\[[^\]]*\]")


@dataclass(frozen=True)
class LetterRun:
    """Run of letters that are set in the same way.
    text: mathematics between dollars, in the notation of mathtext.
    mathematics: whether the letters are a symbol.
    spaced: whether a space stands before the run."""

    text: str
    mathematics: bool
    spaced: bool


def runs(text: str) -> list[LetterRun]:
    """Runs of letters of a text in one line. Brackets contain a unit, and "(a) " at the beginning is a panel's
    letter."""
    if panel := _PANEL.match(text):
        first, *rest = runs(text[panel.end() :]) or [LetterRun("", False, False)]
        return [LetterRun(panel[0].strip(), False, False), replace(first, spaced=True), *rest]
    text = unicodedata.normalize("NFD", text)
    units = [found.span() for found in _IN_BRACKETS.finditer(text)]
    found: list[LetterRun] = []
    begin = 0
    for symbol in _SYMBOL.finditer(text):
        if any(low < symbol.start() < high for low, high in units) or not _is_symbol(symbol, text):
            continue
        found += _words(text[begin : symbol.start()], text[:begin])
        found.append(LetterRun(f"${_mathtext(symbol)}$", True, text[: symbol.start()].endswith(" ")))
        begin = symbol.end()
    return [*found, *_words(text[begin:], text[:begin])]


def _words(text: str, before: str) -> Iterator[LetterRun]:
    plain = unicodedata.normalize("NFC", " ".join(text.split()))
    if plain:
        yield LetterRun(plain, False, text.startswith(" ") or before.endswith(" "))


def _is_symbol(found: re.Match[str], text: str) -> bool:
    """Whether a found letter is a symbol, and not a unit or the word "a"."""
    if found["index"] or found["hat"] or found["power"] or not found["letter"].isascii():
        return True
    if found[0] == "a" or text[found.end() :].startswith(("·", "/")):
        return False
    return not _UNIT_BEFORE.search(text[: found.start()])


def _mathtext(symbol: re.Match[str]) -> str:
    letter, *accent = symbol["letter"]
    set_letter = rf"\{_ACCENTS[accent[0]]}{{{letter}}}" if accent else letter
    if symbol["hat"]:
        set_letter = rf"\hat{{{letter}}}"
    index = (symbol["index"] or "").removeprefix("_").translate(_LOWERED)
    power = {"ᵀ": r"^{\mathrm{T}}", "⁻¹": "^{-1}", None: ""}[symbol["power"]]
    return set_letter + (f"_{{{index}}}" if index else "") + power


def width_of(text: str, size: float, weight: str = "normal") -> float:
    """Width, in, of a text in type of a size (pt)."""
    return sum(_advance(run, size, weight) + _gap(run, number, size) for number, run in enumerate(runs(text)))


@cache
def _advance(run: LetterRun, size: float, weight: str) -> float:
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    font = FontProperties(size=size, weight=weight, math_fontfamily=MATHEMATICS)
    return text_to_path.get_text_width_height_descent(run.text, font, run.mathematics)[0] / POINTS


def _gap(run: LetterRun, number: int, size: float) -> float:
    return SPACE * size / POINTS if run.spaced and number else 0.0


def wrapped(text: str, width: float, size: float, weight: str = "normal") -> list[str]:
    """Lines of a text, broken between words, but not between a number and its unit. width: of a line at most, in."""
    lines: list[str] = []
    for word in _BREAKS.split(text.strip()):
        longer = f"{lines[-1]} {word}" if lines else word
        if lines and width_of(longer, size, weight) <= width:
            lines[-1] = longer
        else:
            lines.append(word)
    return lines


def write(
    canvas: Figure, x: float, y: float, text: str, size: float, weight: str = "normal", color: str = "0.0"
) -> None:
    """Write a text in one line. x, y: left end of its base line, in, from the lower left corner."""
    wide, high = canvas.get_size_inches()
    for number, run in enumerate(_single_words(text)):
        x += _gap(run, number, size)
        canvas.text(
            x / wide,
            y / high,
            run.text,
            va="baseline",
            fontsize=size,
            fontweight=weight,
            color=color,
            parse_math=run.mathematics,
            math_fontfamily=MATHEMATICS,
        )
        x += _advance(run, size, weight)


def _single_words(text: str) -> Iterator[LetterRun]:
    """Runs of letters of a text, cut into words, since a long run is set wider in the pixels of a PNG than its width
    says, and would close the gap behind it."""
    for run in runs(text):
        first, *rest = [run.text] if run.mathematics else run.text.split() or [""]
        yield replace(run, text=first)
        yield from (LetterRun(word, False, True) for word in rest)
