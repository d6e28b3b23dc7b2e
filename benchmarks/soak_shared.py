"""Soak test of a shared server: visitors come and leave for hours, while the resources of its gateway and its sessions
are measured.

    python -m benchmarks.soak_shared                 an hour; writes its part of docs/reliability.md
    python -m benchmarks.soak_shared --minutes 10    as in the weekly checks; exit status 1 when something grows

The server is `vsmrc serve --shared`. Each session is watched by one page that stays; the visitors are those of
`benchmarks.soak`, and each visit is to one of the sessions.
"""

from __future__ import annotations

import contextlib
import json
import math
import sys
import time
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Annotated
from urllib.parse import urljoin
from urllib.request import urlopen

import tyro
from tqdm import tqdm

from app.process.markdown import Table
from benchmarks import machine, processes
from benchmarks.logged import failures_in_words, server_log
from benchmarks.sessions import arrived, late
from benchmarks.soak import NOTHING_GREW, PAGE, PLACE, Crowd, grown
from drivers.visitors import VisitingPage, serving, visiting

SHARED = "<!-- soak shared -->"
RESOURCES = ("gateway", "sessions", "threads", "files", "processes")


@dataclass(frozen=True)
class Reading:
    """Reading of the server's state at `minute`.
    gateway: resident memory of the gateway, bytes.
    sessions: resident memory of all processes of the sessions, bytes.
    threads, files, processes: their numbers in the whole server.
    late: median lateness of control steps, s, of the latest session, from its status line.
    visits: number of visits so far."""

    minute: float
    gateway: int
    sessions: int
    threads: int
    files: int
    processes: int
    late: float
    visits: int


def soak(
    minutes: float, sessions: int, clients: int, every: float, seed: int
) -> tuple[list[Reading], list[str], list[str]]:
    """Readings of a soak test, failures of visitors, and errors that the server logged. every: minutes between two
    readings."""
    readings = []
    asked = ("--shared", "--max-sessions", str(sessions))
    with (
        server_log() as log,
        serving(*asked, "--log-file", str(log.file), lines=2, fps=30, faultless=False) as server,
        ExitStack() as stack,
    ):
        urls, watchers = [], list[VisitingPage]()
        for _ in range(sessions):
            urls.append(url := arrived(server.port))
            watchers.append(watcher := stack.enter_context(visiting(_watched(url))))
            watcher.wait(lambda watcher=watcher: watcher.running)
        crowd = Crowd(urls, clients, seed)
        for number in tqdm(range(1, math.ceil(minutes / every) + 1), desc="readings", disable=None):
            time.sleep(60.0 * every)
            readings.append(_read(server.process.pid, watchers, number * every, crowd.visits))
        crowd.dismiss()
        return readings, crowd.failures, log.errors


def _watched(url: str) -> str:
    """Link to watch a session. url: link to steer it."""
    with urlopen(f"{url}about") as about:
        return urljoin(url, json.load(about)["links"]["watch"])


def _read(gateway: int, watchers: list[VisitingPage], minute: float, visits: int) -> Reading:
    usage = [of_one for pid in (gateway, *processes.descendants(gateway)) if (of_one := _usage(pid)) is not None]
    return Reading(
        minute,
        usage[0][0],
        sum(memory for memory, _, _ in usage[1:]),
        sum(threads for _, threads, _ in usage),
        sum(files for _, _, files in usage),
        len(usage),
        max((1e-3 * ms for ms in map(late, watchers) if not math.isnan(ms)), default=math.nan),
        visits,
    )


def _usage(pid: int) -> tuple[int, int, int] | None:
    """Memory (bytes), threads and files of a process; None for one that has just ended."""
    try:
        return processes.memory(pid), processes.threads(pid), processes.files(pid)
    except OSError:
        return None


def page(
    readings: list[Reading], failures: list[str], errors: list[str], sessions: int, clients: int, described: str
) -> str:
    """Text of this soak test's part of docs/reliability.md."""
    last = readings[-1]
    rows = [
        (
            f"{reading.minute:g}",
            f"{reading.visits}",
            f"{reading.gateway / 1e6:.0f}",
            f"{reading.sessions / 1e6:.0f}",
            f"{reading.processes}",
            f"{reading.threads}",
            f"{reading.files}",
            f"{1e3 * reading.late:.2f}",
        )
        for reading in readings[:: max(1, len(readings) // 12)]
    ]
    sizes = ("gateway, MB", "sessions, MB", "processes", "threads", "files")
    header = ("minute", "visits so far", *sizes, "late p50, ms, worst")
    growth = "; ".join(grown(readings, RESOURCES)) or NOTHING_GREW
    broken = failures_in_words(failures, errors)
    return f"""## In company, through the gateway

Written by `python -m benchmarks.soak_shared --minutes {last.minute:g} --sessions {sessions} --clients {clients}`.
{described}

{sessions} sessions of `vsmrc serve --shared` ran, each watched by a page that stayed open.
{clients} visitors at a time made {last.visits} visits in {last.minute:g} minutes.
Each visitor used one of the sessions, like the visitors in the next section.
The quietest readings of the second half show: {growth}. {broken}.
Memory is the proportional share of the processes. Previews count with their sessions.
The recording of a session grows for twenty simulated minutes and then stays constant.

{Table(header, rows).markdown()}
"""


def main(
    minutes: float = 60.0,
    sessions: int = 3,
    clients: int = 8,
    every: float = 0.5,
    seed: int = 0,
    write: Annotated[bool, tyro.conf.arg(help="docs/reliability.md")] = True,
) -> None:
    """Exit status 1 when memory, threads, files or processes grew, a visitor was thrown out, or the server logged an
    error."""
    described = machine.describe()
    readings, failures, errors = soak(minutes, sessions, clients, every, seed)
    text = page(readings, failures, errors, sessions, clients, described)
    print(text)
    if write:
        before, _, rest = PAGE.read_text(encoding="utf-8").partition(SHARED)
        PAGE.write_text(f"{before}{SHARED}\n\n{text}\n{PLACE}{rest.partition(PLACE)[2]}", encoding="utf-8")
        print(f"written to {PAGE}")
    sys.exit(1 if grown(readings, RESOURCES) or failures or errors else 0)


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        tyro.cli(main)
