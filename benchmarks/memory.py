"""Benchmark of memory: resident memory of a fresh process through an hour of simulated time at full speed."""

from __future__ import annotations

import time

from tqdm import tqdm

from app.process.markdown import Table
from app.session.commanded_run import FASTEST
from benchmarks.effort import Effort
from benchmarks.served import Served, State, served

SCENARIO = "ur5-hybrid"
LOOKS = 6


def measure(effort: Effort) -> Table:
    """Table of memory. Raises RuntimeError when the loop stopped."""
    with served(SCENARIO, speed=FASTEST) as dashboard:
        began, first = time.perf_counter(), dashboard.state()
        looks = tqdm(range(1, LOOKS + 1), desc="simulated hour", leave=False, disable=None)
        states = [first, *(_at(dashboard, 60.0 * effort.minutes * k) for k in looks)]
        speed = (states[-1].t - first.t) / (time.perf_counter() - began)
    rows = [(f"{s.t / 60:.1f} min", f"{s.resident / 1e6:.0f}", f"{s.rows}") for s in states]
    return Table((f"simulated time, at {speed:.1f} × real time", "resident, MB", "rows at full rate"), rows)


def _at(dashboard: Served, t: float) -> State:
    while (state := dashboard.state()).t < t:
        if state.reason:
            raise RuntimeError(state.reason)
        time.sleep(0.2)
    return state
