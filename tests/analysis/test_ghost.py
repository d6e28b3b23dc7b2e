"""The ghost follows (8) itself: closed forms, and what parts it from the arm."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from app.analysis.ideal_response import IdealResponse
from app.scenario.data import edited, shipped
from app.scenario.schema import Scenario
from app.session.ghost import Ghost, GhostPose, NoGhost
from app.session.runner import Runner

PUSH = np.array([0.0, 12.0, -6.0])


def changed(name: str, **changes: object) -> Scenario:
    scenario = shipped()[name]
    for path, value in changes.items():
        scenario = edited(scenario, path, value)
    return scenario


def followed(runner: Runner, ghost: Ghost, seconds: float, glances: int = 10) -> np.ndarray:
    """Distances (glances,) m of arm and ghost while the run goes on."""
    loop, found = runner._loop, []
    for _ in range(glances):
        for _ in range(round(seconds / loop.system.scenario.controller.period / glances)):
            loop.step()
        assert loop.stopped is None
        pose = ghost.follow(runner._publish())
        assert isinstance(pose, GhostPose)
        assert pose.t == pytest.approx(loop.t - loop.system.scenario.controller.period)
        found.append(pose.distance)
    return np.array(found)


def test_the_response_between_samples_is_that_of_the_differential_equation() -> None:
    random = np.random.default_rng(4)
    M, B, K = (np.diag(random.uniform(1, 3, 2)) @ np.array([[2.0, 0.3], [0.2, 1.0]]) * c for c in (1.0, 8.0, 30.0))
    K_f = random.standard_normal((2, 2))
    u, x, h = random.standard_normal((6, 2)), random.standard_normal(4), 0.05
    found = IdealResponse.of({"M_m": M, "B_m": B, "K_m": K, "K_f": K_f}, h).onward(x, u)

    def slope(t: float, x: np.ndarray) -> np.ndarray:
        k = min(int(t / h), 4)
        e_Fc = u[k] + (t / h - k) * (u[k + 1] - u[k])
        return np.r_[x[2:], np.linalg.solve(M, -B @ x[2:] - K @ x[:2] - K_f @ e_Fc)]

    expected = solve_ivp(slope, (0.0, 5 * h), x, rtol=1e-10, atol=1e-12, max_step=h / 10).y[:, -1]
    np.testing.assert_allclose(found, expected, atol=1e-8)


@pytest.mark.parametrize("name", ["ur5-impedance", "ur5-hybrid", "ur5-constrained", "planar3r-hybrid"])
def test_without_modelling_errors_arm_and_ghost_coincide(name: str) -> None:
    runner = Runner(changed(name, **{"truth.link_scaling": 1.0, "truth.payload_mass": 0.0}))
    assert followed(runner, Ghost(), 1.0).max() < 1e-4


def test_pushed_the_ghost_yields_as_the_model_says_whatever_the_arm_does() -> None:
    """K_m e = K_f P at rest. The computed-torque baseline with a wrong model goes elsewhere; that is what one sees."""
    push = {"truth.push": PUSH.tolist(), "truth.push_start": 0.1, "truth.push_duration": 10.0}
    heavy = {"contact.kind": "free", "motion": "hold", "truth.link_scaling": 1.15, "controller.law": "computed-torque"}
    runner, ghost = Runner(changed("ur5-impedance", **heavy, **push)), Ghost()
    distance = followed(runner, ghost, 1.5)[-1]
    snapshot = runner._publish()
    pose = ghost.follow(snapshot)
    assert isinstance(pose, GhostPose)
    home = runner._loop.system.observer.at(snapshot.robot.posture, np.zeros(6), 0.0)[0].p
    stiffness = snapshot.matrices["K_m"][:3, :3]
    np.testing.assert_allclose(pose.tool - home, np.linalg.solve(stiffness, PUSH), atol=2e-6)
    assert distance == pytest.approx(float(np.linalg.norm(snapshot.tool - pose.tool)), abs=1e-6)
    assert distance > 3e-3


def test_the_ghost_begins_anew_where_the_scenario_changes() -> None:
    heavy = {"truth.link_scaling": 1.15, "controller.law": "computed-torque"}
    runner, ghost = Runner(changed("ur5-hybrid", **heavy)), Ghost()
    assert followed(runner, ghost, 0.5)[-1] > 1e-3
    runner._commanded._edit(edited(runner._loop.system.scenario, "controller.layer", 0.02))
    assert followed(runner, ghost, 0.001, glances=1)[-1] < 1e-6
    late = Ghost()  # switched on later, it looks back to the change
    followed(runner, ghost, 0.3)
    early, fresh = ghost.follow(runner._publish()), late.follow(runner._publish())
    assert isinstance(early, GhostPose)
    assert isinstance(fresh, GhostPose)
    np.testing.assert_allclose(fresh.q, early.q, atol=1e-9)


def test_where_there_is_no_ghost_it_says_why() -> None:
    """Before the first row and after an edit of a paused run it only begins; pushed too far, it has no posture."""
    ghost, runner = Ghost(), Runner(changed("ur5-impedance"))
    assert ghost.follow(runner._publish()) is NoGhost.NO_ROWS
    followed(runner, ghost, 0.01)
    runner._commanded._edit(edited(runner._loop.system.scenario, "controller.layer", 0.02))
    assert ghost.follow(runner._publish()) is NoGhost.NO_ROWS
    followed(runner, ghost, 0.01)
    assert ghost._run is not None
    ghost._run.x[:3] = 10.0  # m
    assert ghost.follow(runner._publish()) is NoGhost.NO_POSTURE
