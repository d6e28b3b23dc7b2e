"""Benchmark of sweeps: runs per second on one core and on all cores, a whole map, and the bytes of a run on disk."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import msgspec

from app.process import worker_pool
from app.process.cores import usable_cores
from app.process.markdown import Table
from app.scenario.data import edited, shipped
from app.sweep.axes import axis_of
from app.sweep.fingerprint import fingerprint
from app.sweep.plan import Sweep, SweepPlan
from app.sweep.run_metrics import SweepRunner
from app.sweep.running import run, tasks_of
from benchmarks.effort import Effort

DURATION = 3.0  # s, of a run
AXES = ("contact.K_e=1e3:1e5:30:log", "truth.link_scaling=0.85:1.15:30")


def measure(effort: Effort) -> Table:
    """Table of runs per second, and of the whole map."""
    from app.sweep.run_store import RunStore  # takes 0.5 s, and every worker loads this file

    workers = usable_cores()
    scenario = edited(shipped()["ur5-hybrid"], "simulation.duration", DURATION)
    sweep = Sweep(scenario, tuple(map(axis_of, AXES)), program=fingerprint())
    runner = SweepRunner(sweep)
    runner.metrics(0)
    started = time.perf_counter()
    for number in range(1, effort.runs + 1):
        runner.metrics(number)
    alone = effort.runs / (time.perf_counter() - started)
    shared = rate(sweep, effort.runs * workers, workers)
    with tempfile.TemporaryDirectory() as folder, RunStore(Path(folder), sweep) as store:
        started = time.perf_counter()
        run(store, sweep, workers)
        took, computed = time.perf_counter() - started, len(store.done)
        size = sum(file.stat().st_size for file in Path(folder).rglob("*") if file.is_file())
    rows = [
        ("runs per s on one core, nothing kept", f"{alone:.1f}"),
        ("simulated time per computing time there", f"{alone * DURATION:.0f}"),
        (f"runs per s in {workers} processes", f"{shared:.1f}"),
        ("times those on one core", f"{shared / alone:.2f}"),
        (f"the whole map of {computed} runs, from the first process to the last row, s", f"{took:.1f}"),
        ("bytes of a run on disk", f"{size / computed:.0f}"),
    ]
    return Table((f"runs of {DURATION:g} s of ur5-hybrid", "value"), rows)


def rate(sweep: Sweep, runs: int, workers: int) -> float:
    """Runs per second of a sweep, from the time on at which each process has done its first runs. workers: number of
    processes."""
    plan = SweepPlan(msgspec.structs.replace(sweep))
    ends: list[tuple[float, int]] = []
    tasks = tasks_of(range(min(plan.count, runs)), workers)
    for numbers, _ in worker_pool.results(SweepRunner.computing, (sweep,), tasks, workers):
        ends.append((time.perf_counter(), len(numbers)))
    settled = 2 * workers
    (first, _), (last, _) = ends[settled], ends[-1]
    return sum(count for _, count in ends[settled + 1 :]) / (last - first)
