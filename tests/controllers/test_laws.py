"""The table of control laws, and that it does not matter where a law is called."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from app.scenario.data import edited, load
from app.simulation.assembly import assemble
from app.simulation.closed_loop import ClosedLoop
from app.simulation.sampled_loop.sampled_stability import sampled_loop
from app.simulation.system import System
from controllers.control_law import TOLD, ControlOutput
from controllers.controller import Controller
from controllers.laws import KINDS
from controllers.laws.table import LAWS, WITHIN, number_of
from controllers.premises import Premise
from controllers.reference_estimates import FeedforwardModel
from controllers.switching import SWITCHING
from tests.support.arms import charted, random_law, random_reference, random_state


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


def torques_where_one_input_differs(kind: str) -> tuple[ControlOutput, dict[str, ControlOutput]]:
    """Output of a law at a random state, and its outputs where a single thing of `TOLD` is another one."""
    random = np.random.default_rng(5)
    system = charted("ur5", "sphere outside")
    n = system.robot.n
    law = replace(random_law(random, n, SWITCHING["tanh"], np.ones(n), kind=kind), d=None)
    q, q_dot, t = random_state(system, random)
    z, F, push = (random.standard_normal(size) for size in (n, 6, 6))
    reference = random_reference(system.observe(q, q_dot, t)[1].r, random)

    def output(
        law: Controller,
        rates: float = 1.0,
        model: float = 1.0,
        gravity: float = 1.0,
        F: np.ndarray = F,
        z: np.ndarray = z,
    ) -> ControlOutput:
        estimate, task = system.observe(q, rates * q_dot, t)
        believed = FeedforwardModel.at(estimate)
        believed = believed._replace(
            M_hat=model * believed.M_hat, C_hat=model * believed.C_hat, G_hat=gravity * believed.G_hat
        )
        return law.evaluate(z, reference, task, estimate, believed, q, rates * q_dot, F)

    declared = replace(law, uncertainty=law.uncertainty._replace(rho=0.3, payload_mass=2.0))
    others = {
        "model": output(law, model=1.1), "gravity": output(law, gravity=1.1), "bounds": output(declared),
        "force": output(law, F=F + push), "rates": output(law, rates=1.1), "compensator": output(law, z=z + 0.1),
    }  # fmt: skip
    return output(law), others


@pytest.mark.parametrize("kind", KINDS)
def test_a_law_states_what_its_torque_depends_on_and_which_terms_it_has(kind: str) -> None:
    out, others = torques_where_one_input_differs(kind)
    assert list(others) == list(TOLD)
    told = {name for name, other in others.items() if np.abs(other.tau - out.tau).max() > 1e-9}
    assert told == set(LAWS[kind].told)
    written = {field for field, term in out.terms._asdict().items() if term.any()}
    assert written == set(LAWS[kind].named_terms)


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
