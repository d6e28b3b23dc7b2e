"""Headless run: a run without a screen, and its files."""

from __future__ import annotations

import time
from pathlib import Path

import msgspec
from tqdm import tqdm

from app.analysis.metrics import Metrics, measure
from app.process.atomic_write import write_whole
from app.scenario.data import to_toml
from app.scenario.schema import Scenario
from app.simulation.closed_loop import ClosedLoop
from app.simulation.search_memory import Memory
from app.simulation.system import System
from app.storage.recording_files import table, write_npz


def simulate(
    scenario: Scenario, *, show_progress: bool = False, previous: System | None = None, memory: Memory | None = None
) -> tuple[ClosedLoop, Metrics]:
    """Run of the whole duration of a scenario, or until it stops; equal parts of `previous` are used again, and the
    results that `memory` has.

    Raises ScenarioError.
    """
    steps = max(1, round(scenario.simulation.duration / scenario.controller.period))
    loop = ClosedLoop(scenario, steps + 1, previous, memory)
    batch = max(1, steps // 200)
    started = time.perf_counter()
    with tqdm(total=steps, unit=" steps", disable=not show_progress, desc=scenario.name) as bar:
        for step in range(1, steps + 1):
            loop.advance()
            if step % batch == 0:
                bar.update(batch)
            if loop.stopped:
                break
    return loop, measure(loop, loop.t / (time.perf_counter() - started))


def write(loop: ClosedLoop, metrics: Metrics, out: Path) -> None:
    """Write recording.npz, metrics.json and scenario.toml, as at the run's beginning, to the folder `out`, which is
    made.

    Raises OSError.
    """
    scenario = loop.recording.epochs[0].scenario
    out.mkdir(parents=True, exist_ok=True)
    figures, text = msgspec.json.format(msgspec.json.encode(metrics)) + b"\n", to_toml(scenario).encode()
    write_whole(out / "recording.npz", lambda file: write_npz(table(scenario, loop.recording), file))
    write_whole(out / "metrics.json", lambda file: file.write(figures))
    write_whole(out / "scenario.toml", lambda file: file.write(text))
