"""Benchmark of sessions: how many one machine can run at 1 kHz, the cost of each, and the time until a visitor has a
page.

The server is `vsmrc serve --shared`. Every session has one page with a visible tab of plots, without a browser, which
would run on another machine.
"""

from __future__ import annotations

import http.client
import os
import re
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from statistics import median
from typing import NamedTuple

from tqdm import tqdm

from app.process import precompile
from app.process.cores import usable_cores
from app.process.markdown import Table
from app.workers.fork_server import SESSION
from benchmarks.effort import Effort
from benchmarks.processes import descendants, memory
from drivers.visitors import PATIENCE, Server, VisitingPage, serving, visiting

COUNTS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)
LEAST_REALTIME = 0.995  # share of real time that the slowest session must reach
TAB = "Overview"
_TICKS = os.sysconf("SC_CLK_TCK")


class Fared(NamedTuple):
    """Result for a number of sessions.
    realtime: share of real time of the slowest session.
    late: median lateness of the latest session, ms.
    session: share of a core that a session takes, with its what-if process and its part of the fork server.
    gateway: share of a core that the gateway takes.
    unseen: share of a core that a session takes after its page has been closed, None where it was not measured.
    memory: of a session, MB, with the same parts as `session`.
    spared, started: seconds until a visitor has a page, with a spare process and without; None where not measured."""

    realtime: float
    late: float
    session: float
    gateway: float
    unseen: float | None
    memory: float
    spared: float
    started: float | None


def measure(effort: Effort) -> Table:
    """Table of sessions: for each number of cores, numbers of sessions up to the first one that the machine cannot run
    in real time."""
    if (compiling := precompile.start()) is not None:  # else every server would compile in the background
        compiling.wait()
    rows = []
    machines = sorted(number for number in {1, 2, 4, 8, usable_cores()} if number <= usable_cores())
    for number in tqdm(machines, desc="sessions", leave=False, disable=None):
        for count in COUNTS:
            fared = _fared(number, count, effort.pacing / 3)
            real_time = fared.realtime >= LEAST_REALTIME
            rows.append(
                (
                    f"{number}",
                    f"{count}",
                    f"{fared.realtime:.3f}" + ("" if real_time else " (not held)"),
                    f"{fared.late:.2f}",
                    f"{fared.session * 100:.0f}",
                    f"{fared.gateway * 100:.0f}",
                    "" if fared.unseen is None else f"{fared.unseen * 100:.1f}",
                    f"{fared.memory:.0f}",
                    f"{fared.spared:.2f}",
                    "" if fared.started is None else f"{fared.started:.1f}",
                )
            )
            if not real_time:
                break
    titles = (
        "cores of the server",
        "sessions, each looked at by a page",
        "× real time, slowest",
        "late p50, ms, worst",
        "processor per session, %",
        "gateway, %",
        "session without a page, %",
        "memory per session, MB",
        "page with the spare, s",
        "without, s",
    )
    return Table(titles, rows)


@contextmanager
def _served(number: int, places: int) -> Iterator[Server]:
    """Context with a server on `number` cores; its pages may use all cores."""
    every = os.sched_getaffinity(0)
    os.sched_setaffinity(0, sorted(every)[:number])  # child processes inherit it
    with ExitStack() as stack:
        try:
            server = stack.enter_context(serving("--shared", "--max-sessions", str(places), lines=2, fps=30))
        finally:
            os.sched_setaffinity(0, every)
        yield server


def _fared(number: int, count: int, seconds: float) -> Fared:
    with _served(number, count) as server, ExitStack() as looking:
        _at_rest(_spare(server))
        pages, waits = [], []
        for _ in range(count):
            began = time.perf_counter()
            url = arrived(server.port)
            pages.append(page := looking.enter_context(visiting(url)))
            page.wait(lambda page=page: page.running)
            page.look_at(TAB)
            waits.append(time.perf_counter() - began)
        time.sleep(5.0)
        everyone = [server.process.pid, *descendants(server.process.pid)]
        since = [page.t for page in pages]
        core_fractions, passed = _core_fractions(everyone, seconds)
        realtime = [(page.t - t) / passed for page, t in zip(pages, since, strict=True)]
        lateness, taken = max(map(late, pages)), sum(map(memory, everyone[1:]))
        unseen = None
        if count == 1:
            looking.close()
            time.sleep(5.0)
            unseen = sum(_core_fractions(everyone[1:], seconds)[0])
        return Fared(
            realtime=min(realtime),
            late=lateness,
            session=sum(core_fractions[1:]) / count,
            gateway=core_fractions[0],
            unseen=unseen,
            memory=taken / count / 1e6,
            spared=waits[0],
            started=median(waits[1:]) if count > 1 else None,
        )


def _core_fractions(processes: list[int], seconds: float) -> tuple[list[float], float]:
    """Shares of a core that the processes take over `seconds`, and the time that has passed, s."""
    before, began = [_used(pid) for pid in processes], time.perf_counter()
    time.sleep(seconds)
    passed = time.perf_counter() - began
    return [(_used(pid) - used) / passed for pid, used in zip(processes, before, strict=True)], passed


def arrived(port: int) -> str:
    """Link of a new session, once its page can be opened."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE)
    connection.request("GET", "/")
    (answer := connection.getresponse()).read()
    path = f"/{answer.headers['Location']}"
    while True:
        connection.request("GET", path)
        if b"overlay.js" in connection.getresponse().read():
            connection.close()
            return f"http://127.0.0.1:{port}{path}"
        time.sleep(0.05)


def late(page: VisitingPage) -> float:
    """Median lateness of the page's control steps, ms, as the status line shows it."""
    found = [re.search(r"late by ([\d.]+) ms", html) for html in page.html.values() if "vs-status" in html]
    return max((float(match[1]) for match in found if match), default=float("nan"))


def _spare(server: Server) -> int:
    """Number of the first session's process, once it has started."""
    while True:
        for process in server.children():
            if Path(f"/proc/{process}/comm").read_text(encoding="ascii").strip() == SESSION:
                return process
        time.sleep(0.05)


def _at_rest(pid: int) -> None:
    """Wait until the process is idle."""
    used = -1.0
    while (now := _used(pid)) - used > 0.02:
        used = now
        time.sleep(1.0)


def _used(pid: int) -> float:
    """Processor time of a process so far, s."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS
