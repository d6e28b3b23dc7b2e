"""Soak test: visitors come, drag, switch and leave for hours, while the resources of the server's process and the
lateness of its loop are measured.

    python -m benchmarks.soak                    an hour with eight visitors; writes docs/reliability.md's last part
    python -m benchmarks.soak --minutes 10       as in the weekly checks; exit status 1 when something grows

A visitor is a headless client that speaks viser's protocol (`benchmarks.visitor`): it stays for a while, drags sliders,
types numbers, changes mode and arm, pauses, resets, pins, and leaves, now and then in the middle of a drag without
closing the connection. Its random choices come from a seed.
"""

from __future__ import annotations

import contextlib
import math
import random
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from tqdm import tqdm
from websockets.exceptions import ConnectionClosed

from app.export.figures import Curve, Figure, FigureChart
from app.export.printing import render
from app.process.markdown import Table
from benchmarks import machine, processes
from benchmarks.logged import failures_in_words, server_log
from benchmarks.served import Served, served
from benchmarks.visitor import Visitor, visit
from controllers.modes import MODES
from environments.catalogue import CATALOGUE

PAGE = Path(__file__).parents[1] / "docs" / "reliability.md"
PICTURE = "soak.svg"  # in the same folder
PLACE = "<!-- soak -->"
SCENARIO = "ur5-hybrid"
ARMS = tuple(CATALOGUE[name].title for name in ("ur5", "panda", "planar3r"))
FORCE, STIFFNESS = "F_d [N]", "K_e [N/m]"
LONGEST_VISIT = 90.0  # s
OFTEN = {"drag": 8, "type": 4, "mode": 2, "arm": 1, "pause": 1, "reset": 2, "pin": 1}
VANISHING = 0.04  # share of the acts in which a visitor vanishes in the middle of a drag
GROWTH = 1.15  # factor of memory, threads and files over the second half, above which they count as leaks
NOTHING_GREW = f"nothing grew by more than {100 * (GROWTH - 1):.0f} %"
BLUE, ORANGE, GREEN, GREY = (66, 135, 245), (230, 159, 0), (0, 158, 115), (120, 120, 120)


@dataclass(frozen=True)
class Reading:
    """Reading of the server's state at `minute`.
    resident: memory, bytes.
    threads: number of threads.
    files: number of open files.
    rate: control steps per second, in the interval before.
    late: lateness of these steps, s: median, 99th percentile and largest.
    visits: number of visits so far.
    reason: for which the loop has stopped, "" where it runs."""

    minute: float
    resident: int
    threads: int
    files: int
    rate: float
    late: tuple[float, float, float]
    visits: int
    reason: str


class Crowd:
    """Crowd of visitors, each with a thread of its own, who come again and again until the crowd is dismissed."""

    def __init__(self, urls: Sequence[str], count: int, seed: int) -> None:
        self.visits = 0
        self.failures: list[str] = []
        self._urls, self._over = urls, threading.Event()
        self._threads = [
            threading.Thread(target=self._come_and_go, args=(random.Random(f"{seed} {number}"),), daemon=True)
            for number in range(count)
        ]
        for thread in self._threads:
            thread.start()

    def dismiss(self) -> None:
        self._over.set()
        for thread in self._threads:
            thread.join(60.0)

    def _come_and_go(self, chance: random.Random) -> None:
        while not self._over.wait(chance.uniform(0.0, 10.0)):
            self.visits += 1
            try:
                with visit(chance.choice(self._urls)) as visitor:
                    visitor.play()
                    leaving = time.monotonic() + chance.uniform(5.0, LONGEST_VISIT)
                    while time.monotonic() < leaving and not self._over.wait(chance.uniform(0.5, 6.0)):
                        if chance.random() < VANISHING:
                            visitor.move(visitor.slider(FORCE), chance.random())
                            visitor.vanish()
                            break
                        act(visitor, chance)
            except (ConnectionClosed, OSError, AssertionError) as error:
                self.failures.append(f"{type(error).__name__}: {error}")


def act(visitor: Visitor, chance: random.Random) -> None:
    """Do one random act of a visitor. chance: of the random choices."""
    match chance.choices(tuple(OFTEN), tuple(OFTEN.values()))[0]:
        case "drag":
            visitor.drag(chance.choice((FORCE, STIFFNESS)), chance)
        case "type":
            visitor.type(FORCE, f"{chance.uniform(5.0, 40.0):.3g}")
        case "mode":
            visitor.choose("Mode", chance.choice(tuple(mode.label for mode in MODES.values())))
        case "arm":
            visitor.choose("Arm", chance.choice(ARMS))
        case "pause":
            visitor.strike("space")
            time.sleep(chance.uniform(0.2, 2.0))
            visitor.play()
        case "reset":
            visitor.strike("R")
        case "pin":
            visitor.strike("P")


def soak(minutes: float, clients: int, every: float, seed: int) -> tuple[list[Reading], list[str], list[str]]:
    """Readings of a soak test, failures of visitors, and errors that the server logged. every: minutes between two
    readings."""
    readings = []
    with server_log() as log, served(SCENARIO, log_file=log.file) as dashboard:
        crowd = Crowd([dashboard.url], clients, seed)
        for number in tqdm(range(1, math.ceil(minutes / every) + 1), desc="readings", disable=None):
            began = time.perf_counter()
            time.sleep(60.0 * every)
            readings.append(_read(dashboard, number * every, began, crowd.visits))
        crowd.dismiss()
        return readings, crowd.failures, log.errors


def _read(dashboard: Served, minute: float, since: float, visits: int) -> Reading:
    state, late = dashboard.state(), dashboard.lateness(since)
    p50, p99 = np.percentile(late, (50, 99)) if len(late) else (math.nan, math.nan)
    return Reading(
        minute,
        state.resident,
        processes.threads(dashboard.pid),
        processes.files(dashboard.pid),
        len(late) / (time.perf_counter() - since),
        (float(p50), float(p99), float(late.max()) if len(late) else math.nan),
        visits,
        state.reason,
    )


def grown(readings: Sequence[object], names: Sequence[str] = ("resident", "threads", "files")) -> list[str]:
    """Quantities that have grown by more than `GROWTH` from the middle to the end, each at its smallest readings."""
    half = len(readings) // 2
    middle, end = readings[half // 2 : half + 1], readings[half + (len(readings) - half) // 2 :]
    found = []
    for name in names:
        before, after = (min(getattr(reading, name) for reading in part) for part in (middle, end))
        if after > GROWTH * before + 2:
            found.append(f"{name}: {before:g} in the middle, {after:g} at the end")
    return found


def halted(readings: Sequence[Reading]) -> list[str]:
    """What is to be said of a loop that computed no step in the second half; nothing where it did."""
    later = readings[len(readings) // 2 :]
    if any(reading.rate > 0.0 for reading in later):
        return []
    return [f"no step was computed: {later[-1].reason or 'the loop is paused'}"]


def page(readings: list[Reading], failures: list[str], errors: list[str], clients: int, described: str) -> str:
    """Text of the soak test's part of docs/reliability.md."""
    last = readings[-1]
    rows = [
        (
            f"{reading.minute:g}",
            f"{reading.visits}",
            f"{reading.resident / 1e6:.0f}",
            f"{reading.threads}",
            f"{reading.files}",
            f"{reading.rate:.0f}",
            *(f"{1e3 * late:.2f}" for late in reading.late),
        )
        for reading in readings[:: max(1, len(readings) // 12)]
    ]
    latenesses = ("late p50, ms", "p99, ms", "max, ms")
    header = ("minute", "visits so far", "resident, MB", "threads", "files", "steps per s", *latenesses)
    growth = "; ".join(grown(readings) + halted(readings)) or NOTHING_GREW
    broken = failures_in_words(failures, errors)
    return f"""## In company

Written by `python -m benchmarks.soak --minutes {last.minute:g} --clients {clients}`. {described}

{clients} visitors at a time made {last.visits} visits in {last.minute:g} minutes.
They drag, type, change mode and arm, pause, reset, pin and leave, some of them in the middle of a drag.
The quietest readings of the second half show: {growth}. {broken}.
There are fewer than 1000 steps a second while somebody has paused or a run has ended.
A change of arm or mode takes place between two steps. The steps after it are late, and the loop catches up.

{Table(header, rows).markdown()}

![Memory, threads, files and lateness over time]({PICTURE})
"""


def picture(readings: list[Reading]) -> bytes:
    """Picture of the results (SVG)."""
    minutes = np.array([reading.minute for reading in readings])

    def curve(name: str, color: tuple[int, int, int], values: list[float]) -> Curve:
        return Curve(name, color, minutes, np.array(values))

    late = [
        curve(name, color, [max(1e3 * reading.late[i], 1e-3) for reading in readings])
        for i, (name, color) in enumerate((("p50", GREEN), ("p99", ORANGE), ("largest", GREY)))
    ]
    charts = (
        FigureChart(
            "resident memory",
            "MB",
            (curve("resident", BLUE, [reading.resident / 1e6 for reading in readings]),),
            x_label="minutes",
        ),
        FigureChart(
            "threads and files",
            "1",
            (
                curve("threads", BLUE, [reading.threads for reading in readings]),
                curve("files", ORANGE, [reading.files for reading in readings]),
            ),
            x_label="minutes",
        ),
        FigureChart("lateness of the control steps", "ms", tuple(late), x_label="minutes", logarithmic=True),
    )
    return render(Figure(charts, f"{readings[-1].visits} visits."), "svg")


def main(
    minutes: float = 60.0,
    clients: int = 8,
    every: float = 0.5,
    seed: int = 0,
    write: Annotated[bool, tyro.conf.arg(help="docs/reliability.md")] = True,
) -> None:
    """Exit status 1 when memory, threads or files grew, no step was computed in the second half, a visitor was thrown
    out, or the server logged an error."""
    described = machine.describe()
    readings, failures, errors = soak(minutes, clients, every, seed)
    text = page(readings, failures, errors, clients, described)
    print(text)
    if write:
        before = PAGE.read_text(encoding="utf-8").partition(PLACE)[0]
        PAGE.write_text(f"{before}{PLACE}\n\n{text}", encoding="utf-8")
        (PAGE.parent / PICTURE).write_bytes(picture(readings))
        print(f"written to {PAGE}")
    sys.exit(1 if grown(readings) or halted(readings) or failures or errors else 0)


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        tyro.cli(main)
