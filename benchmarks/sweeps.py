"""Benchmark of sweeps: runs per second on one core and on all cores, and the bytes of a run on disk.

`python -m benchmarks.sweeps`: ur5-hybrid for 3 s each, over stiffness and link scaling.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import msgspec
import tyro

from app.process import worker_pool
from app.process.cores import usable_cores
from app.scenario.data import edited, shipped
from app.sweep.axes import axis_of
from app.sweep.fingerprint import fingerprint
from app.sweep.plan import Sweep, SweepPlan
from app.sweep.run_metrics import SweepRunner
from app.sweep.running import run, tasks_of

DURATION = 3.0  # s, of a run
AXES = ("contact.K_e=1e3:1e5:30:log", "truth.link_scaling=0.85:1.15:30")


def main(runs: int = 200, whole: bool = False) -> None:
    """Measure sweeps.

    Args:
        runs: for the rates
        whole: play all 900 runs of the map as well, from the command to its end
    """
    workers = usable_cores()
    scenario = edited(shipped()["ur5-hybrid"], "simulation.duration", DURATION)
    sweep = Sweep(scenario, tuple(map(axis_of, AXES)), program=fingerprint())
    runner = SweepRunner(sweep)
    runner.metrics(0)
    started = time.perf_counter()
    for number in range(1, runs + 1):
        runner.metrics(number)
    alone = runs / (time.perf_counter() - started)
    shared = rate(sweep, runs * workers, workers)
    print(f"one core: {alone:.1f} runs/s, {alone * DURATION:.0f} times real time, nothing kept")
    print(f"{workers} processes: {shared:.1f} runs/s, {shared / alone:.2f} times that")
    if whole:
        from app.sweep.run_store import RunStore  # takes 0.5 s, and every worker loads this file

        with tempfile.TemporaryDirectory() as folder, RunStore(Path(folder), sweep) as store:
            started = time.perf_counter()
            run(store, sweep, workers)
            took = time.perf_counter() - started
            size = sum(file.stat().st_size for file in Path(folder).rglob("*") if file.is_file())
            print(f"{len(store.done)} runs of {DURATION:g} s: {took:.1f} s, {size / len(store.done):.0f} bytes each")


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


if __name__ == "__main__":
    tyro.cli(main)
