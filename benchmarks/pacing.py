"""Benchmark of pacing at 1 kHz: rate and lateness of the control steps, with and without a page.

The lateness of a step is the wall time at which it has been computed minus the time at which it was due.
"""

from __future__ import annotations

import time

import numpy as np

from app.process.markdown import Table
from app.process.priority import RealTimePriority
from benchmarks.browser import chromium, opened
from benchmarks.effort import Effort
from benchmarks.served import Served, served

SCENARIO = "ur5-hybrid"
SETTLE = 3.0  # s


def measure(effort: Effort) -> Table:
    """Table of paces. Raises RuntimeError when the loop stopped."""
    rows: list[tuple[str, ...]] = []
    for words, priority in (("real-time priority", RealTimePriority()), ("usual priority", None)):
        with served(SCENARIO, priority=priority) as dashboard, chromium() as browser:
            if priority is None:
                rows.append(("without a page", *_pace(dashboard, effort.pacing)))
            page = opened(browser, dashboard.url)
            rows.append((f"with a page, {words}", *_pace(dashboard, effort.pacing)))
            page.close()
    titles = ("steps per s", "late p50, ms", "p99, ms", "p99.9, ms", "max, ms", "processor, %")
    return Table((f"1 kHz for {effort.pacing:.0f} s", *titles), rows)


def _pace(dashboard: Served, seconds: float) -> tuple[str, ...]:
    time.sleep(SETTLE)
    before, began = dashboard.state(), time.perf_counter()
    time.sleep(seconds)
    after, ended = dashboard.state(), time.perf_counter()
    late = dashboard.lateness(began)  # which takes processor time of its own
    rate = len(late) / (time.perf_counter() - began)
    if after.reason:
        raise RuntimeError(after.reason)
    p50, p99, p999 = np.percentile(late, (50, 99, 99.9)) * 1e3
    fraction = (after.processor - before.processor) / (ended - began)
    return (
        f"{rate:.0f}",
        f"{p50:.2f}",
        f"{p99:.2f}",
        f"{p999:.2f}",
        f"{late.max() * 1e3:.2f}",
        f"{fraction * 100:.0f}",
    )
