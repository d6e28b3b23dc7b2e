"""Compiled runs against `ClosedLoop.step`: the same rows, and the same stop at the same period."""

from __future__ import annotations

import numpy as np
import pytest

from app.scenario.data import edited, load
from app.scenario.schema import Scenario
from app.simulation.closed_loop import ClosedLoop
from app.simulation.compiled_run import CompiledRun, obstacle

PERIODS = 1000
PRECISION = 1e-9  # of the largest number of each signal: contact and friction amplify the rounding of the terms


def scenarios() -> dict[str, Scenario]:
    """One scenario for each kind of contact and integrator that a compiled run takes."""
    base = load("ur5-hybrid")
    return {
        "elastic": base,
        "semi-implicit Euler": edited(base, "simulation.integrator", "semi-implicit-euler"),
        "substeps": edited(base, "simulation.substeps", 3),
        "mass, damper, spring": edited(base, "contact.kind", "mass-damper-spring"),
        "free": load("ur5-motion"),
        "saturated": edited(base, "truth.torque_limit", [30.0] * 6),
        "shaken until it stops": edited(base, "truth.disturbance", 200.0),
    }


def loops(scenario: Scenario) -> tuple[ClosedLoop, ClosedLoop]:
    """The run by steps, and the compiled one, of which no two share memory."""
    stepped, compiled = ClosedLoop(scenario), ClosedLoop(scenario)
    for _ in range(PERIODS):
        if stepped.stopped is None:
            stepped.advance()
    CompiledRun(compiled).advance(PERIODS)
    return stepped, compiled


@pytest.mark.parametrize("name", scenarios())
def test_compiled_run_has_the_rows_of_the_steps(name: str) -> None:
    stepped, compiled = loops(scenarios()[name])
    assert (compiled.state.steps, compiled.t, compiled.stopped) == (stepped.state.steps, stepped.t, stepped.stopped)
    assert compiled.warning == stepped.warning
    assert (stepped.stopped is not None) == (name == "shaken until it stops")
    assert (stepped.warning is not None) == (name in ("saturated", "shaken until it stops"))
    assert compiled.state.judged.station == stepped.state.judged.station
    expected, found = stepped.recording.stretch(), compiled.recording.stretch()
    for signal in expected:
        scale = np.nanmax(np.abs(expected[signal]), initial=1e-3)
        np.testing.assert_allclose(found[signal], expected[signal], rtol=0.0, atol=PRECISION * scale, err_msg=signal)


def test_obstacle_names_why_a_scenario_is_not_taken() -> None:
    noisy = ClosedLoop(edited(load("ur5-hybrid"), "sensor.noise", 0.5))
    assert obstacle(noisy) == "the force sensor has noise, bias, delay or a filter"
    with pytest.raises(ValueError, match="noise"):
        CompiledRun(noisy)
