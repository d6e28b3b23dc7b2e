"""Latency from a slider's message to the first control step that uses it.

A client without a browser sends the message, so that the time of sending is known; meanwhile a page is open in a
browser, or none. The server notes when the first step with the new value has been computed.
"""

from __future__ import annotations

import random
import time

import numpy as np
from tqdm import tqdm

from app.process.markdown import Table
from benchmarks.browser import chromium, opened
from benchmarks.effort import Effort
from benchmarks.served import Served, served
from benchmarks.visitor import Visitor, visit

SCENARIO, LABEL, SCALE = "ur5-hybrid", "F_d [N]", 60.0  # the slider's right end, N
LOWEST, STEP = 10.0, 0.1  # N: each message asks for another value, one STEP above that of the message before
PAUSES = (0.04, 0.08)  # s between two messages: about as fast as the page sends them, at no fixed phase
GRACE = 1.0  # s, after which the last message's step has been computed


def measure(effort: Effort) -> Table:
    """Table of latencies."""
    rows = []
    with served(SCENARIO) as dashboard, visit(dashboard.url) as visitor:
        visitor.tick("Preview", False)  # with previews a slider is applied only when it is let go
        rows.append(("without a page", *_shown(_latencies(dashboard, visitor, effort.messages))))
        with chromium() as browser:
            opened(browser, dashboard.url)
            rows.append(("with a page", *_shown(_latencies(dashboard, visitor, effort.messages))))
    return Table(("from a slider's message to its step", "messages", "p50, ms", "p99, ms", "max, ms"), rows)


def _latencies(dashboard: Served, visitor: Visitor, count: int) -> np.ndarray:
    """Latencies (count,) s of the messages. A message that a later one overtakes in the server's queue takes effect
    together with the later one. Raises RuntimeError where the last message had no effect."""
    slider = visitor.slider(LABEL)
    chance, began = random.Random(0), time.perf_counter()
    values, sent = LOWEST + STEP * np.arange(count), np.empty(count)
    for k in tqdm(range(count), desc="messages", leave=False, disable=None):
        sent[k] = time.perf_counter()
        visitor.move(slider, float(values[k] / SCALE))
        time.sleep(chance.uniform(*PAUSES))
    time.sleep(GRACE)
    uses = [use for use in dashboard.uses() if use.computed > began]
    first = np.searchsorted([use.value for use in uses], values - STEP / 2)
    if first[-1] == len(uses):
        raise RuntimeError(f"the slider's last value, {values[-1]:.1f} N, did not reach the loop")
    return np.array([uses[i].computed for i in first]) - sent


def _shown(latencies: np.ndarray) -> tuple[str, ...]:
    p50, p99 = np.percentile(latencies, (50, 99)) * 1e3
    return str(len(latencies)), f"{p50:.1f}", f"{p99:.1f}", f"{latencies.max() * 1e3:.1f}"
