"""Benchmark of compilation: what the first run of a scenario waits for, with an empty cache and with a full one."""

from __future__ import annotations

import os
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from importlib import import_module
from multiprocessing import get_context
from typing import NamedTuple
from unittest import mock

from app.process.kernel_cache import VARIABLE
from app.process.markdown import Table
from app.scenario.data import load
from app.simulation.closed_loop import ClosedLoop
from app.simulation.compiled_run import CompiledRun
from benchmarks.effort import Effort

SCENARIOS = ("ur5-hybrid", "ur5-constrained", "panda-hybrid")


class Begun(NamedTuple):
    """Beginning of a run, from the scenario to the first periods by both engines.
    wall, processor: s."""

    wall: float
    processor: float


def measure(effort: Effort) -> Table:
    """Table of compilations: a process with an empty cache, then one that finds what the first one has compiled."""
    rows = []
    for scenario in SCENARIOS[: effort.compilations]:
        with tempfile.TemporaryDirectory(prefix="kernels-") as folder, mock.patch.dict(os.environ, {VARIABLE: folder}):
            compiling, reading = (_in_fresh_process(scenario) for _ in range(2))
        seconds = compiling[0].processor - compiling[1].processor, reading[0].wall - reading[1].wall
        rows.append((scenario, f"{seconds[0]:.0f}", f"{seconds[1]:.2f}", f"{reading[1].wall:.2f}"))
    titles = ("compiled, s of processor time", "read from the cache, s", "begun again, s")
    return Table(("kernels of both engines", *titles), rows)


def _in_fresh_process(scenario: str) -> list[Begun]:
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
        return process.submit(_begin_twice, scenario).result()


def _begin_twice(name: str) -> list[Begun]:
    """Begin two runs of a scenario, one after the other."""
    scenario, begun = load(name), []
    for module in ("linking", "pointers", "rows", "symbols"):  # numba, which the first kernel would load
        import_module(f"kernels.{module}")
    for _ in range(2):
        wall, processor = time.perf_counter(), time.process_time()
        loop = ClosedLoop.from_scenario(scenario)
        loop.step()
        CompiledRun(loop).advance(1)
        begun.append(Begun(time.perf_counter() - wall, time.process_time() - processor))
    return begun
