"""Benchmark of the page's traffic and drawing: frames, messages and bytes per second."""

from __future__ import annotations

import time
from collections import Counter

from app.process.markdown import Table
from benchmarks.browser import VIEWPORT, chromium, opened
from benchmarks.effort import Effort
from benchmarks.served import served
from drivers.viser_protocol import messages

SCENARIO = "ur5-hybrid"
SETTLE = 10.0  # s, in which the plots' window fills and the page loads everything

_COUNT_FRAMES = """
(milliseconds) => new Promise((resolve) => {
  let frames = 0;
  const began = performance.now();
  const count = (now) => {
    frames += 1;
    if (now - began < milliseconds) requestAnimationFrame(count); else resolve(1000 * frames / (now - began));
  };
  requestAnimationFrame(count);
})
"""


def measure(effort: Effort) -> Table:
    """Table of the page's traffic."""
    frames: list[bytes | str] = []
    with served(SCENARIO) as dashboard, chromium() as browser:
        page = opened(browser, dashboard.url, frames)
        page.wait_for_timeout(SETTLE * 1e3)
        frames.clear()
        before, began = dashboard.state(), time.perf_counter()
        drawn = page.evaluate(_COUNT_FRAMES, effort.traffic * 1e3)
        received, after, seconds = (
            [f for f in frames if isinstance(f, bytes)],
            dashboard.state(),
            time.perf_counter() - began,
        )
    kinds = Counter(_kind(message) for frame in received for message in messages(frame))
    rows = [
        ("frames drawn by the browser (software WebGL)", f"{drawn:.0f}"),
        ("web socket frames", f"{len(received) / seconds:.0f}"),
        *((f"messages: {kind}", f"{kinds[kind] / seconds:.0f}") for kind in ("scene", "plots", "other")),
        ("kB received", f"{sum(map(len, received)) / seconds / 1e3:.0f}"),
        ("server's processor time, s", f"{(after.processor - before.processor) / seconds:.2f}"),
    ]
    return Table((f"page of {VIEWPORT['width']} × {VIEWPORT['height']}, {SCENARIO}", "per second"), rows)


def _kind(message: dict) -> str:
    if message["type"] == "GuiUpdateMessage":
        # whole data of a plot, or its new points (app/dashboard/transport/plot_feed.py)
        points = isinstance(message["updates"].get("value"), dict)
        return "plots" if points or "data" in message["updates"] else "other"
    return "scene"
