"""Timelines of scenarios."""

from app.scenario.schema import Scenario
from app.session.timeline import Timeline
from app.simulation.closed_loop import ClosedLoop


def line_of(scenario: Scenario) -> Timeline:
    return Timeline(ClosedLoop.from_scenario(scenario))


def run(line: Timeline, steps: int) -> Timeline:
    for _ in range(steps):
        line.step()
    return line
