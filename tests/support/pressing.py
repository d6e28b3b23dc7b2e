"""A known arm that presses on a plane, its runs, and how they grow."""

from __future__ import annotations

from typing import Any

import numpy as np

from app.scenario.data import edited, shipped
from app.scenario.schema import Scenario
from app.simulation.closed_loop import ClosedLoop
from app.simulation.sampled_loop.sampled_stability import sampled_loop
from app.simulation.system import System
from controllers.premises import Premise
from tests.support.arms import arm

H = 1e-3  # s


def changed(scenario: Scenario, **fields: Any) -> Scenario:
    """Fields by their dotted paths, with "__" for the dot."""
    for path, value in fields.items():
        scenario = edited(scenario, path.replace("__", "."), value)
    return scenario


def pressing(robot: str, K_e: float, period: float, **fields: Any) -> Scenario:
    """A known arm at rest on a plane that its tool just touches, pressing with 20 N."""
    height = float(arm(robot).nominal.evaluate(arm(robot).q_0, np.zeros(arm(robot).robot.n)).p[2])
    scenario = changed(
        shipped()[f"{robot}-hybrid"], truth__link_scaling=1.0, declared__link_scaling=0.0, motion="hold",
        contact__K_e=K_e, controller__period=period, surface__origin=[0.0, 0.0, height], simulation__duration=1.0,
    )  # fmt: skip
    return changed(scenario, **fields)


def run(scenario: Scenario, duration: float) -> ClosedLoop:
    loop = ClosedLoop.from_scenario(scenario)
    for _ in range(round(duration / scenario.controller.period)):
        loop.step()
        assert loop.stopped is None
    return loop


def growth_per_period(system: System) -> float:
    """Growth of a deviation per control period, on the surface if there is one."""
    return sampled_loop(system, system.q_0, 0.0).premises[Premise.SAMPLED_LOOP]
