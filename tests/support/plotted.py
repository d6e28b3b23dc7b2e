"""Runs that are plotted, and what a plot is made for."""

from __future__ import annotations

from app.dashboard.plots.charts import Setup
from app.scenario.schema import Scenario
from app.session.snapshot import snapshot_of
from app.simulation.closed_loop import ClosedLoop


def ran(scenario: Scenario, seconds: float) -> ClosedLoop:
    """Closed loop after so many seconds of a scenario, which must not stop before."""
    loop = ClosedLoop.from_scenario(scenario)
    while loop.t < seconds - 1e-9:
        assert loop.stopped is None, loop.stopped
        loop.step()
    return loop


def setup_of(loop: ClosedLoop) -> Setup:
    return Setup.of(snapshot_of(loop), coordinate=0, joint=0)
