"""Rounds of measured calls, interleaved, so that a machine's drifting speed affects all calls alike."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from statistics import median

from tqdm import tqdm

Call = Callable[[], None]


@dataclass(frozen=True)
class Whole:
    """Whole run, which computes several steps in one call. advance: takes the number of steps."""

    advance: Callable[[int], object]


def interleaved(calls: Mapping[str, Call | Whole], rounds: int, steps: int) -> dict[str, list[float]]:
    """Mean times of one step, us, by name and round. steps: of a round, each by a call, or all in one call of a
    `Whole`."""
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in tqdm(range(rounds), desc="rounds", leave=False, disable=None):
        for name, call in calls.items():
            times[name].append(microseconds(call, steps))
    return times


def microseconds(call: Call | Whole, steps: int) -> float:
    """Mean time of one step, us."""
    started = time.perf_counter()
    if isinstance(call, Whole):
        call.advance(steps)
    else:
        for _ in range(steps):
            call()
    return (time.perf_counter() - started) / steps * 1e6


def ratio(times: list[float], to: list[float]) -> float:
    """Median of the ratios of the rounds, in which effects on both rounds, such as the machine's speed, cancel."""
    return median(a / b for a, b in zip(times, to, strict=True))
