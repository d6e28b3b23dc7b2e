"""Benchmark of the start: time from the command to the running loop on the page, with the kernels in the cache."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from statistics import median

from playwright.sync_api import Browser
from tqdm import tqdm

from app.process.markdown import Table
from benchmarks.browser import chromium, opened
from benchmarks.effort import Effort

COMMAND = (sys.executable, "-m", "app", "serve", "ur5-hybrid", "--port", "0", "--token", "never", "--stateless")


def measure(effort: Effort) -> Table:
    """Table of starts. The browser runs already; a first start, which does not count, fills the cache."""
    with chromium() as browser:
        starts = [_start(browser) for _ in tqdm(range(1 + effort.starts), desc="starts", leave=False, disable=None)][1:]
    listening, shown = zip(*starts, strict=True)
    rows = [
        ("the page's address is printed", f"{median(listening):.2f}", f"{max(listening):.2f}"),
        ("the page shows the running loop", f"{median(shown):.2f}", f"{max(shown):.2f}"),
    ]
    return Table((f"after the start, {len(starts)} times", "median, s", "longest, s"), rows)


def _start(browser: Browser) -> tuple[float, float]:
    """Seconds until the address is printed, and until the page shows the running loop."""
    began = time.perf_counter()
    with subprocess.Popen(COMMAND, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as ours:
        try:
            assert ours.stdout is not None
            line = next(line for line in ours.stdout if line.startswith("VSMRC Lab: "))
            listening = time.perf_counter() - began
            page = opened(browser, line.split()[2])
            shown = time.perf_counter() - began
            page.close()
        finally:
            ours.send_signal(signal.SIGINT)
    return listening, shown
