"""The table of control laws, and that it does not matter where a law is called."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from app.scenario.data import edited, load
from app.simulation.assembly import assemble
from app.simulation.closed_loop import ClosedLoop
from app.simulation.sampled_stability import sampled_loop
from app.simulation.system import System
from controllers.laws import KINDS
from controllers.laws.table import LAWS, WITHIN, number_of
from controllers.premises import Premise


def apart(system: System) -> System:
    """The same system, whose law the compiled period does not know."""
    law = replace(system.controller.law)
    return replace(system, controller=replace(system.controller, law=law))


def test_each_law_says_what_it_is_and_which_alone_is_robust() -> None:
    assert tuple(LAWS) == KINDS == WITHIN
    assert [law.kind for law in LAWS.values()] == [*KINDS]
    assert len({law.title for law in LAWS.values()}) == len(KINDS)
    assert [kind for kind, law in LAWS.items() if law.robust] == ["vsmrc"]
    assert [kind for kind, law in LAWS.items() if not law.feels_force] == ["pd-gravity"]


@pytest.mark.parametrize("kind", KINDS)
def test_a_law_between_the_halves_of_a_period_gives_the_same_run_to_the_last_bit(kind: str) -> None:
    system = assemble(edited(load("ur5-hybrid-moving"), "controller.law", kind))
    within, between = ClosedLoop.from_system(system), ClosedLoop.from_system(apart(system))
    assert number_of(within.system.controller.law) >= 0 > number_of(between.system.controller.law)
    for _ in range(300):
        within.step()
        between.step()
    np.testing.assert_array_equal(within.recording.rows(), between.recording.rows())
    growth, same = (
        sampled_loop(loop.system, system.q_0, 0.0).premises[Premise.SAMPLED_LOOP] for loop in (within, between)
    )
    assert growth == same
