"""Gain d by (17) that would grow without bound, or that no declaration of the errors allows: it is refused."""

from __future__ import annotations

import numpy as np
import pytest

from app.scenario.data import edited
from app.scenario.errors import ScenarioError, UnboundedGain
from app.simulation.closed_loop import ClosedLoop
from app.simulation.promise.premise_watch import GainFeedbackShares
from controllers.bounds import inertia_spread
from controllers.premises import Premise
from tests.support.cases import short

pytestmark = pytest.mark.slow  # long or many simulations


def test_a_blend_from_a_model_whose_damping_A_takes_away_is_judged() -> None:
    """M_m^-1 B_m + A = 0: nothing of chattering comes back through r_eq_ddot."""
    still = edited(short("ur5-motion"), "controller.A", -40.0)
    loop = ClosedLoop.from_scenario(edited(still, "blend.to", {"K_m": [500.0] * 6}))
    assert loop.premise_watch.fed_back.chatter == pytest.approx(0.0, abs=1e-12)
    with pytest.raises(UnboundedGain, match=r"^blend.to: on the way to this target model"):
        ClosedLoop.from_scenario(edited(still, "blend.to", {"B_m": [60000.0] * 6}))


@pytest.mark.parametrize("name", ["ur5-constrained", "ur5-wave-constrained"])
def test_the_gain_of_7_on_a_rigid_surface_is_refused_for_its_cause(name: str) -> None:
    with pytest.raises(ScenarioError, match="raise each other"):
        ClosedLoop.from_scenario(short(name, controller__bounds="paper"))


def test_a_refused_gain_leaves_the_loop_as_it_was() -> None:
    loop = ClosedLoop.from_scenario(short("ur5-constrained"))
    for _ in range(20):
        loop.step()
    before = loop.state.copy()
    with pytest.raises(ScenarioError, match="raise each other"):
        loop.edit(edited(loop.system.scenario, "controller.bounds", "paper"))
    after = loop.state.copy()
    assert after.scenario == before.scenario
    assert after.evaluation.data.tobytes() == before.evaluation.data.tobytes()
    loop.step()
    assert loop.stopped is None


def test_where_the_declared_errors_leave_no_inertia_nothing_is_promised() -> None:
    """M_hat - E is positive definite at some postures of Omega only."""
    given = {"declared__link_centre": 0.06, "controller__gain": "constant", "controller__d": 5.0}
    system = ClosedLoop.from_scenario(short("planar3r-hybrid", **given)).system
    random, found = np.random.default_rng(0), set[bool]()
    loop = ClosedLoop.from_scenario(system.scenario)
    for _ in range(40):
        loop.state.arm.views.q[:] = system.q_0 + random.uniform(-0.1, 0.1, 3)
        evaluated = loop.controlled_arm.evaluated()
        loop.controlled_arm.check_posture(evaluated)
        estimate, u = evaluated.part("seen").estimate, system.controller.gains.uncertainty
        E = np.zeros((3, 3))
        inertia_spread.py_func(u, estimate, E)
        definite = bool(np.linalg.eigvalsh(estimate.M_hat - E)[0] > 0.0)
        found.add(definite)
        assert (evaluated.part("posture_check").H_min > 0.0) == definite
        assert (evaluated.part("table").value[Premise.LAYER] < np.inf) == definite
    assert found == {False, True}
    doubted = ClosedLoop.from_scenario(short("ur5-hybrid", declared__link_centre=0.001))
    doubted.state.evaluation.part("table").value[Premise.GAIN_BY_CHATTER] = np.inf
    with pytest.raises(
        UnboundedGain, match=r"^declared\.link_centre: .* leaves no inertia .*; allowed: a smaller value"
    ):
        doubted.premise_watch.require_bounded_gain(GainFeedbackShares(np.nan, np.nan))


@pytest.mark.parametrize(("path", "before"), [("controller.gain", "constant"), ("controller.law", "computed-torque")])
def test_a_gain_that_would_feed_itself_is_refused_also_where_nothing_followed_it_before(path: str, before: str) -> None:
    fatal = short("ur5-motion", controller__bounds="paper", controller__period=0.004, declared__link_scaling=0.3)
    with pytest.raises(UnboundedGain, match=r"runs away at this control period: chattering feeds 3\.2"):
        ClosedLoop.from_scenario(fatal)
    loop = ClosedLoop.from_scenario(edited(fatal, path, before))
    for _ in range(5):
        loop.step()
        with pytest.raises(UnboundedGain, match="runs away at this control period"):
            loop.edit(fatal)
    assert loop.system.scenario == edited(fatal, path, before)
