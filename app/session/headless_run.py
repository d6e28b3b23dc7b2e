"""Headless run: a run without a screen, and its files."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path

import msgspec
from tqdm import tqdm

from app.analysis.metrics import Metrics, metrics_of
from app.process import precompile
from app.process.atomic_write import write_whole
from app.scenario.data import to_toml
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.simulation.closed_loop import ClosedLoop
from app.simulation.compiled_run import CompiledRun, obstacle
from app.simulation.engines import Engine, in_force
from app.simulation.omega.search_memory import Memory
from app.simulation.system import System
from app.storage.recording_files import table, write_npz

BATCH = 500  # control periods between two movements of the bar


def simulate(
    scenario: Scenario,
    *,
    until: float = 0.0,
    engine: Engine | None = None,
    show_progress: bool = False,
    previous: System | None = None,
    memory: Memory | None = None,
) -> tuple[ClosedLoop, Metrics]:
    """Run of a scenario until it stops or its duration is over, and its metrics.

    until: s, another end than that of its duration; 0 for none.
    engine: None for the one in force, if it can take the scenario.
    previous: a system whose equal parts are used again; memory: results of searches.

    Raises ScenarioError, also where the engine that is asked for cannot take the scenario.
    """
    end, period = until or scenario.simulation.duration, scenario.controller.period
    if (steps := round(end / period)) < 1:
        raise ScenarioError(f"simulation.duration: {end:g} s; allowed: at least a control period, {period:g} s")
    loop = ClosedLoop.from_scenario(scenario, steps + 1, previous, memory)
    by = engine or engine_for(loop)
    advance = partial(_by_steps, loop) if by == "pinocchio" else _compiled(loop).advance
    started = time.perf_counter()
    with tqdm(total=steps, unit=" steps", disable=not show_progress, desc=scenario.name) as bar:
        for begun in range(0, steps, BATCH):
            periods = min(BATCH, steps - begun)
            advance(periods)
            bar.update(periods)
            if loop.stopped:
                break
    if len(loop.recording) == 0:
        raise ScenarioError(f"the run has stopped in its first control period: {loop.stopped}")
    return loop, metrics_of(loop, loop.t / (time.perf_counter() - started), by)


def play(loop: ClosedLoop, periods: int, engine: Engine | None = None) -> None:
    """Compute `periods` control periods of a loop, or fewer where it stops, by this engine, or the one in force, if
    that can take the loop."""
    if engine_for(loop, engine) == "compiled":
        CompiledRun(loop).advance(periods)
    else:
        _by_steps(loop, periods)


def engine_for(loop: ClosedLoop, requested: Engine | None = None) -> Engine:
    """The engine that is asked for, or the one in force, or Pinocchio where that cannot take the loop."""
    return (requested or in_force.get()) if obstacle(loop) is None else "pinocchio"


def engine_ready() -> Engine:
    """The compiled engine once its kernels are in the cache, else Pinocchio: nobody waits for a compilation."""
    return "compiled" if precompile.mark().exists() else "pinocchio"


def _by_steps(loop: ClosedLoop, periods: int) -> None:
    for _ in range(periods):
        loop.advance()


def _compiled(loop: ClosedLoop) -> CompiledRun:
    try:
        return CompiledRun(loop)
    except ValueError as error:
        raise ScenarioError(f"--engine compiled: {error}; allowed: --engine pinocchio") from error


def write(loop: ClosedLoop, metrics: Metrics, out: Path) -> None:
    """Write metrics.json, scenario.toml and recording.npz, as at the run's beginning, to the folder `out`, which is
    made.

    Raises OSError.
    """
    scenario = loop.recording.epochs[0].scenario
    out.mkdir(parents=True, exist_ok=True)
    data = table(scenario, loop.recording, stopped=loop.stopped or "")
    numbers, text = msgspec.json.format(msgspec.json.encode(metrics)) + b"\n", to_toml(scenario).encode()
    # the small ones first: on a full disk they may have room
    write_whole(out / "metrics.json", lambda file: file.write(numbers))
    write_whole(out / "scenario.toml", lambda file: file.write(text))
    write_whole(out / "recording.npz", lambda file: write_npz(data, file))
