"""Running of a sweep on all cores, or on a cluster: what it will take, and all of its runs that are not done yet."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from tqdm import tqdm

from app.process import worker_pool
from app.process.cores import usable_cores
from app.scenario.number_text import counted
from app.sweep.cluster import Cluster
from app.sweep.plan import Sweep, SweepPlan, SweepT
from app.sweep.run_metrics import RunMetrics, SweepRunner, rows_of

if TYPE_CHECKING:
    from app.sweep.run_store import RunStore  # pyarrow is large, and the page needs none

# measured with sweeps of 2, 30 and 900 runs on two cores
BYTES = 80  # of a run on disk
FILES = 16_000  # bytes of sweep.toml, and of a Parquet file besides its runs
CHUNK = 8  # runs that a process takes at once, at most
BEGIN = 3.0  # s until the processes have their first runs and until they have ended: 1 where nothing else runs, to 5


@dataclass(frozen=True)
class SweepEstimate:
    """Estimate of what a sweep will take: runs that are left, their simulated time and the computing time on all
    workers (s; None where it is not known), and bytes on disk."""

    runs: int
    simulated: float
    seconds: float | None
    size: float

    @classmethod
    def of(
        cls,
        runs: int,
        simulated: float,
        computing: float | None,
        on: int | Cluster | None,
        *,
        begin: float = BEGIN,
        files: int = FILES,
    ) -> SweepEstimate:
        """Estimate from the computing time of all runs on one core, s.
        on: see `run`.
        begin: s that it takes besides its runs.
        files: bytes that it takes besides its runs."""
        cores = usable_cores()
        workers = on.workers if isinstance(on, Cluster) else min(on or cores, cores)  # more processes take turns
        if runs == 0:
            return cls(0, 0.0, 0.0, 0.0)
        seconds = None if computing is None else begin + computing / (workers or 1)
        return cls(runs, simulated, seconds, files + runs * BYTES)

    def __str__(self) -> str:
        runs = f"{counted(self.runs, 'run')} of {_duration(self.simulated)} simulated time in all"
        if self.seconds is None:
            unknown = "their computing time is not known, since a run that was tried has ended its process"
            return f"{runs}, {_size(self.size)}; {unknown}"
        return f"{runs}: about {_duration(self.seconds)}, {_size(self.size)}"


def _duration(seconds: float) -> str:
    for size, unit in ((86400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2 * size:
            return f"{_three_digits(seconds / size)} {unit}"
    return f"{_three_digits(seconds)} s"


def _size(size: float) -> str:
    return f"{_three_digits(size / 1e6)} MB" if size >= 1e6 else f"{_three_digits(size / 1e3)} kB"


def _three_digits(value: float) -> str:
    """Number with three digits, without a power of ten where it is large."""
    return f"{float(f'{value:.3g}'):,.15g}"


def estimated(sweep: Sweep, left: np.ndarray, on: int | Cluster | None = None) -> SweepEstimate:
    """Estimate for the runs of a sweep that are left, from the computing time of one run on this machine. Two
    neighbours are played: the first one also computes what all runs have in common, and the second what each has for
    itself, whose time is scaled where the duration is varied. left: their numbers. on: see `run`."""
    plan = SweepPlan(sweep)
    simulated, middle = plan.seconds_of(left), plan.count // 2
    neighbours = (middle, (middle + 1) % plan.count)
    seconds = last_wall_time(SweepRunner.computing, sweep, neighbours) if len(left) else 0.0
    lasts = plan.seconds_of(np.array(neighbours[1:]))
    computing = None if seconds is None else seconds * simulated / lasts if lasts else seconds * len(left)
    return SweepEstimate.of(len(left), simulated, computing, on)


def last_wall_time(
    make: Callable[[SweepT], Callable[[Any], list[RunMetrics]]], sweep: SweepT, runs: tuple[Any, ...]
) -> float | None:
    """Computing time (s) of the last of some runs, of the last one that goes to its end if one does. They are computed
    one after the other in a process of their own; None if that ends early. make: see `worker_pool.results`."""
    ((_, metrics),) = worker_pool.results(make, (sweep,), (runs,), 1)
    if isinstance(metrics, worker_pool.Fallen):
        return None
    return ([each for each in metrics if not each.get("stopped")] or metrics)[-1]["wall_time"]


def run(store: RunStore, sweep: Sweep, on: int | Cluster | None = None, *, show_progress: bool = False) -> int:
    """Compute the runs that are not done. Returns how many stopped or were refused.

    on: number of processes, or a cluster, None for a process on each core. Raises OSError where runs cannot be written,
    and ScenarioError where the cluster is lost; what was written stays.
    """
    plan, left, failed = SweepPlan(sweep), np.flatnonzero(~store.done).tolist(), 0
    with tqdm(total=len(left), unit=" runs", desc="sweep", disable=not show_progress) as bar:
        for numbers, metrics in _computed(sweep, left, on, bar.write):
            for each in rows_of(plan, map(plan.row, numbers), metrics):
                store.add(each)
                failed += bool(each.get("stopped"))
            bar.set_postfix_str(f"{failed} stopped or refused" if failed else "")
            bar.update(len(numbers))
    store.flush()
    return failed


def _computed(
    sweep: Sweep, numbers: Sequence[int], on: int | Cluster | None, notify: Callable[[str], object]
) -> Iterator[tuple[tuple[int, ...], list[RunMetrics] | worker_pool.Fallen]]:
    if isinstance(on, Cluster):
        return on.results(sweep, numbers, notify)
    workers = on or usable_cores()
    return worker_pool.results(SweepRunner.computing, (sweep,), tasks_of(numbers, workers), workers)


def tasks_of(numbers: Sequence[int], workers: int) -> Iterator[worker_pool.Chunk[int]]:
    """Runs of these numbers, a few at a time for one process; towards the end fewer."""
    at = 0
    while at < len(numbers):
        size = max(1, min(CHUNK, (len(numbers) - at) // (4 * workers)))
        yield worker_pool.Chunk(numbers[at : at + size])
        at += size
