"""Running of a sweep on all cores, or on a cluster: what it will take, and all of its runs that are not done yet."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from tqdm import tqdm

from app.process import worker_pool
from app.sweep.cluster import Cluster
from app.sweep.figures_of_run import Figures, SweepRunner
from app.sweep.question import Sweep, SweepQuestion

if TYPE_CHECKING:
    from app.sweep.run_store import RunStore  # pyarrow is large, and the page needs none

BYTES = 90  # of a run on disk, measured (docs/sweeps.md)
CHUNK = 8  # runs that a process takes at once, at most
BEGIN = 2.0  # s until the processes have their first runs, measured (docs/sweeps.md)


@dataclass(frozen=True)
class SweepEstimate:
    """Estimate of what a sweep will take: runs that are left, their simulated time and the computing time on all
    workers (s), and bytes on disk."""

    runs: int
    simulated: float
    seconds: float
    size: float

    @classmethod
    def of(cls, runs: int, simulated: float, each: float, on: int | Cluster | None) -> SweepEstimate:
        """Estimate from the computing time of one run, `each` s. on: see `run`."""
        cores = os.cpu_count() or 1
        workers = on.workers if isinstance(on, Cluster) else min(on or cores, cores)  # more processes take turns
        return cls(runs, simulated, BEGIN + runs * each / (workers or 1), runs * BYTES)

    def __str__(self) -> str:
        return (
            f"{self.runs} {'run' if self.runs == 1 else 'runs'} of {self.simulated:.4g} s simulated time in all: "
            f"about {_duration(self.seconds)}, "
            f"{self.size / 1e6:.2g} MB"
        )


def _duration(seconds: float) -> str:
    for size, unit in ((86400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.2g} s"


def estimated(sweep: Sweep, left: int, on: int | Cluster | None = None) -> SweepEstimate:
    """Estimate for `left` runs of a sweep, from the computing time of one run on this machine. Two neighbours are
    played: the first one also computes what all runs have in common, and the second what each has for itself, whose
    time is scaled where the duration is varied. on: see `run`."""
    question, runner = SweepQuestion(sweep), SweepRunner(sweep)
    each, middle, seconds = question.seconds / question.count, question.count // 2, 0.0
    for number in (middle, middle + 1) if left else ():
        seconds = _seconds(runner, number % question.count)
    lasts = question.lasting(question.row((middle + 1) % question.count).values)
    return SweepEstimate.of(left, left * each, seconds * each / lasts if lasts else seconds, on)


def _seconds(runner: SweepRunner, number: int) -> float:
    started = time.perf_counter()
    runner.figures(number)
    return time.perf_counter() - started


def run(store: RunStore, sweep: Sweep, on: int | Cluster | None = None, *, show_progress: bool = False) -> int:
    """Compute the runs that are not done. Returns how many stopped or were refused.

    on: number of processes, or a cluster, None for a process on each core. Raises OSError where runs cannot be written,
    and ScenarioError where the cluster is lost; what was written stays.
    """
    left, failed = np.flatnonzero(~store.done).tolist(), 0
    with tqdm(total=len(left), unit=" runs", desc="sweep", disable=not show_progress) as bar:
        for numbers, figures in _computed(sweep, left, on, bar.write):
            for each in rows_of(sweep, numbers, figures):
                store.add(each)
                failed += bool(each.get("stopped"))
            bar.set_postfix_str(f"{failed} stopped or refused" if failed else "")
            bar.update(len(numbers))
    store.settle()
    return failed


def _computed(
    sweep: Sweep, numbers: Sequence[int], on: int | Cluster | None, say: Callable[[str], object]
) -> Iterator[tuple[tuple[int, ...], list[Figures] | worker_pool.Fallen]]:
    if isinstance(on, Cluster):
        return on.results(sweep, numbers, say)
    workers = on or os.cpu_count() or 1
    return worker_pool.results(SweepRunner.computing, (sweep,), tasks_of(numbers, workers), workers)


def tasks_of(numbers: Sequence[int], workers: int) -> Iterator[tuple[int, ...]]:
    """Runs of these numbers, a few at a time for one process; towards the end fewer."""
    at = 0
    while at < len(numbers):
        size = max(1, min(CHUNK, (len(numbers) - at) // (4 * workers)))
        yield tuple(numbers[at : at + size])
        at += size


def rows_of(sweep: Sweep, numbers: tuple[int, ...], figures: list[Figures] | worker_pool.Fallen) -> list[Figures]:
    if not isinstance(figures, worker_pool.Fallen):
        return figures
    question = SweepQuestion(sweep)
    return [question.told(question.row(n)) | {"stopped": "the process that computed it has ended"} for n in numbers]
