"""What a measured admittance is told of: the properties of a run that its linear prediction leaves out."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.scenario.data import edited, shipped
from app.scenario.own_code import use
from app.scenario.schema import Scenario
from app.session.push_measurement import not_linear
from app.simulation.closed_loop import ClosedLoop

CLEAR = "that the tool touches nothing there (the lines are those of the contact)"


def running(scenario: Scenario, periods: int) -> ClosedLoop:
    loop = ClosedLoop.from_scenario(scenario)
    for _ in range(periods):
        loop.step()
    return loop


def still() -> Scenario:
    return edited(shipped()["ur5-impedance"], "motion", "hold")


@pytest.mark.slow  # it compiles what is of no use to another process
def test_a_law_of_a_file_is_known() -> None:
    use([Path(__file__).parents[2] / "docs" / "examples" / "pid_gravity.py"])
    scenario = edited(edited(shipped()["ur5-motion"], "controller.law", "pid-gravity"), "contact.kind", "free")
    assert not_linear(running(scenario, 1).state) == ()


@pytest.mark.parametrize("periods", [0, 50])
def test_an_impedance_above_the_surface_is_told_of_where_the_lines_have_the_contact(periods: int) -> None:
    above, (x, y, z) = still(), still().surface.origin
    assert CLEAR in not_linear(running(above, periods).state)
    assert CLEAR not in not_linear(running(edited(above, "contact.kind", "free"), periods).state)
    if periods:
        assert CLEAR not in not_linear(running(edited(above, "surface.origin", [x, y, z + 0.02]), periods).state)
