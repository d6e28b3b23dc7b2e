"""Chips: short words on a coloured ground, and the colour of each verdict."""

from __future__ import annotations

from html import escape
from typing import Literal

from app.simulation.verdict import Outcome

ChipClass = Literal["vs-good", "vs-bad", "vs-warn", "vs-mode"]

CHIP_OF: dict[Outcome, ChipClass] = {"holds": "vs-good", "broken": "vs-bad", "nothing promised": "vs-warn"}


def chip(text: str, chip_class: ChipClass) -> str:
    """A chip as HTML."""
    return f'<span class="vs-chip {chip_class}">{escape(text)}</span>'
