"""Measurement of the tool's admittance: whole runs under sinusoidal pushes, with everything that a linear system
leaves out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from app.scenario.data import from_plain, to_plain
from app.scenario.schema import Scenario, ScenarioError
from app.simulation.closed_loop import ClosedLoop
from app.simulation.search_memory import Memory

SETTLES = 0.5  # s, before the push begins
LEAD, CYCLES = 1.5, 5  # s under the push before it counts, and whole cycles that count
SHORTEST, LONGEST = 4, 60.0  # periods of control in a cycle, and s of a cycle


class Measured(NamedTuple):
    """Measured admittance at one frequency (Hz), near the one that was asked for.
    admittance: (p, p) m/s per N, complex: of the speed along each axis by a push along each."""

    frequency: float
    admittance: np.ndarray


def measured(
    scenario: Scenario, directions: np.ndarray, frequency: float, newtons: float = 2.0, memory: Memory | None = None
) -> Measured:
    """Admittance along the unit vectors `directions` (p, 3), by a push of `newtons` N. The path is held, the
    scenario's own push is left away.

    Raises ScenarioError, also where a run stops.
    """
    h = scenario.controller.period
    if not 1.0 / LONGEST <= frequency <= 1.0 / (SHORTEST * h):
        raise ScenarioError(
            f"--measure {frequency:g}: Hz; allowed: {1.0 / LONGEST:.3g} to {1.0 / (SHORTEST * h):g} Hz with this period"
        )
    counted = round(CYCLES / (frequency * h))
    frequency = CYCLES / (counted * h)
    lead = round((SETTLES + max(LEAD, 2.0 / frequency)) / h)
    columns = []
    for along in directions:
        run = ClosedLoop(_pushed(scenario, newtons * along, frequency), lead + counted + 2, memory=memory)
        for _ in range(lead + counted + 1):
            run.step()
        if run.stopped:
            raise ScenarioError(f"--measure {frequency:g}: the run stops: {run.stopped}")
        rows = run.recording.signals(("t", "tool", "F_push"))
        last = slice(lead, lead + counted)
        wave = np.exp(-2j * np.pi * frequency * rows["t"][last])
        speeds = np.diff(rows["tool"] @ directions.T, axis=0)[last] / h
        columns.append((speeds.T @ wave) / ((rows["F_push"][last] @ along) @ wave))
    return Measured(frequency, np.column_stack(columns))


def _pushed(scenario: Scenario, push: np.ndarray, frequency: float) -> Scenario:
    data = to_plain(scenario)
    data["truth"] |= {
        "push": push.tolist(),
        "push_start": SETTLES,
        "push_duration": 36000.0,
        "push_every": 0.0,
        "push_frequency": frequency,
    }
    data["motion"], data["rotation"], data["shift"], data["blend"] = {"kind": "hold"}, {"kind": "hold"}, {}, {}
    return from_plain(data)
