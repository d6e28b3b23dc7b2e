"""Effort of the measurements: full, or just enough to see that they work."""

from __future__ import annotations

from typing import NamedTuple


class Effort(NamedTuple):
    """Effort of the measurements.
    rounds, steps: rounds of `steps` steps.
    traffic, pacing, drag: seconds of the page's traffic, of pacing and of dragging.
    messages: of the slider.
    starts: of the program.
    minutes: simulated, between two looks at the memory, of which there are six."""

    rounds: int
    steps: int
    traffic: float
    pacing: float
    drag: float
    messages: int
    starts: int
    minutes: float


FULL = Effort(rounds=15, steps=1000, traffic=10.0, pacing=60.0, drag=10.0, messages=400, starts=5, minutes=10.0)
QUICK = Effort(rounds=3, steps=300, traffic=2.0, pacing=3.0, drag=2.0, messages=30, starts=1, minutes=0.2)
