"""Benchmark of sweeps on a cluster: runs per second by the size of a task, and the most that Dask's scheduler can do.

`python -m benchmarks.cluster`: a scheduler and a worker for each core, with runs of a long and of a short simulation.
"""

from __future__ import annotations

import operator
import time

import tyro

from app.process.cores import usable_cores
from app.scenario.data import edited, shipped
from app.sweep.axes import axis_of
from app.sweep.cluster import Cluster
from app.sweep.fingerprint import fingerprint
from app.sweep.plan import Sweep
from benchmarks.sweeps import rate
from drivers import cluster as dask

SCENARIOS = (("ur5-hybrid", 3.0, 240), ("planar3r-hybrid", 0.3, 2400))  # name, length of a run in s, number of runs
CHUNKS = (1, 2, 4, 8, 16, 32)
EMPTY = 4000  # tasks without work


def main() -> None:
    """Measure a cluster of this machine's cores."""
    from distributed import Client

    workers = usable_cores()
    sweeps = {name: _sweep(name, duration, runs) for name, duration, runs in SCENARIOS}
    for name, sweep in sweeps.items():
        reached = rate(sweep, len(sweep.vary[0].values), workers)
        print(f"{name}: {reached:6.1f} runs/s in {workers} processes, without Dask")
    with dask.scheduler() as scheduler, dask.worker(scheduler.address, "--nworkers", str(workers)):
        with Client(scheduler.address, set_as_default=False) as client:
            client.wait_for_workers(workers)
            started = time.perf_counter()
            client.gather(client.map(operator.neg, range(EMPTY)))
            print(f"{EMPTY / (time.perf_counter() - started):.0f} tasks/s without work, {workers} workers")
        with Cluster(scheduler.address) as cluster:
            for name, sweep in sweeps.items():
                numbers = range(len(sweep.vary[0].values))
                list(cluster.results(sweep, numbers[: 8 * workers], print))  # computes once what runs share
                for chunk in CHUNKS:
                    started = time.perf_counter()
                    list(cluster.results(sweep, numbers, print, chunk))
                    reached = len(numbers) / (time.perf_counter() - started)
                    print(f"{name}: {reached:6.1f} runs/s in tasks of at most {chunk}")


def _sweep(name: str, duration: float, runs: int) -> Sweep:
    scenario = edited(shipped()[name], "simulation.duration", duration)
    return Sweep(scenario, (axis_of(f"contact.K_e=1e3:1e5:{runs}:log"),), program=fingerprint())


if __name__ == "__main__":
    tyro.cli(main)
