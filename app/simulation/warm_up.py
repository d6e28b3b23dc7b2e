"""Warm-up: compilation of all that a run needs, before anybody waits for it, by computing one period of such a run."""

from __future__ import annotations

from dataclasses import replace

from app.scenario.schema import Scenario
from app.simulation.closed_loop import ClosedLoop
from app.simulation.system import System
from controllers.control_law import ControlLaw

SILENT = ControlLaw("silent", "silent", "It asks for no torque.", torque=lambda _given, _out: None)


def warm_up(scenario: Scenario) -> ClosedLoop:
    """Run of the scenario after one period, as the page would show it."""
    loop = ClosedLoop.from_scenario(scenario, history=1)
    loop.step()
    loop.view()
    return loop


def warm_up_for_own_laws(system: System) -> None:
    """Compile the functions between which laws of a user's own are called; the system itself does not change."""
    silent = replace(system, controller=replace(system.controller, law=SILENT, parameters={}))
    ClosedLoop.from_system(silent, history=1).step()
