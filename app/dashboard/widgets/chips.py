"""Chips: short words on a coloured ground, and the colour of each verdict."""

from __future__ import annotations

from html import escape
from typing import Literal

from app.simulation.verdict import Outcome

Look = Literal["vs-good", "vs-bad", "vs-warn", "vs-mode"]

LOOK_OF: dict[Outcome, Look] = {"holds": "vs-good", "broken": "vs-bad", "nothing promised": "vs-warn"}


def chip(text: str, look: Look) -> str:
    """A chip as HTML."""
    return f'<span class="vs-chip {look}">{escape(text)}</span>'
