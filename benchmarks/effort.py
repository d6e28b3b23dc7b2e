"""Effort of the benchmarks: full, or just enough to see that they work."""

from __future__ import annotations

from typing import NamedTuple


class Effort(NamedTuple):
    """Effort of the benchmarks.
    rounds: number of rounds.
    steps: of a round.
    traffic: seconds in which the page's traffic is measured.
    pacing: seconds in which the pace is measured.
    drag: seconds of a drag.
    runs: of a sweep, on one core and on each of several.
    messages: number of a slider's messages.
    starts: of the program.
    compilations: scenarios whose kernels are compiled.
    minutes: simulated, between two of the six readings of the memory."""

    rounds: int
    steps: int
    traffic: float
    pacing: float
    drag: float
    runs: int
    messages: int
    starts: int
    compilations: int
    minutes: float


FULL = Effort(
    rounds=15,
    steps=1000,
    traffic=10.0,
    pacing=60.0,
    drag=10.0,
    runs=200,
    messages=400,
    starts=5,
    compilations=3,
    minutes=10.0,
)
QUICK = Effort(
    rounds=3,
    steps=300,
    traffic=2.0,
    pacing=3.0,
    drag=2.0,
    runs=40,
    messages=30,
    starts=1,
    compilations=1,
    minutes=0.2,
)
