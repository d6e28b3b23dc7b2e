"""Chips: short words on a coloured ground, and those of the verdicts."""

from __future__ import annotations

import math
from html import escape
from typing import Literal

from app.simulation.promise.verdict import Outcome, Standing

ChipClass = Literal["vs-good", "vs-bad", "vs-warn", "vs-mode", "vs-neutral"]

CHIP_OF: dict[Outcome, ChipClass] = {"holds": "vs-good", "broken": "vs-bad", "nothing promised": "vs-warn"}
NOT_JUDGED = "not judged yet"


def chip(text: str, chip_class: ChipClass) -> str:
    """A chip as HTML."""
    return f'<span class="vs-chip {chip_class}">{escape(text)}</span>'


def verdict_now(standing: Standing) -> tuple[str, ChipClass]:
    """Words and colour of the verdict on this instant. As long as only the next control period can judge, which is so
    after a change in a paused run, nothing is wrong with the promise: it is not judged yet."""
    if _undecided(standing):
        return NOT_JUDGED, "vs-neutral"
    return standing.now.verdict, CHIP_OF[standing.now.verdict]


def verdict_of_run(standing: Standing) -> tuple[str, ChipClass]:
    """Words and colour of the verdict on the run as a whole, which is not judged before its first control period."""
    if _undecided(standing) and not standing.promise_record.periods:
        return NOT_JUDGED, "vs-neutral"
    return standing.run.verdict, CHIP_OF[standing.run.verdict]


def _undecided(standing: Standing) -> bool:
    """Whether the next control period decides, and nothing before it."""
    decided = (
        standing.stopped is not None or not math.isnan(standing.promise_record.broken) or standing.table.failing.any()
    )
    return standing.waiting and not decided
