"""Range of the inertia of every declared arm: nothing is outside of it, and its ends are arms."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from controllers.bounds import Equivalent, InertiaRange, Uncertainty, required_gain
from controllers.nominal_model import ON_LINE
from environments.truth import Truth
from tests.support.arms import CERTAIN, ROBOTS, charted
from tests.support.declared_plants import CHART, DECLARED, doubted, draw, draw_state, in_task_space


@pytest.mark.parametrize("robot", ROBOTS)
def test_inertia_of_every_declared_arm_is_in_its_range(robot: str) -> None:
    """H_low <= H <= H_high with an offset payload and, tighter, with one at the tool point."""
    system, random = doubted(robot), np.random.default_rng(5)
    for u in (DECLARED, DECLARED._replace(payload_offset=0.0)):
        for _ in range(40):
            state = draw_state(system, random)
            estimate, task = system.observe(*state)
            model = draw(u, random, system.robot.n).truth.model(system.robot)
            H = in_task_space(task, pin.crba(model, model.createData(), state.q))
            allowed = InertiaRange.at(u, estimate, task)
            least = -1e-10 * np.abs(H).max()
            assert np.linalg.eigvalsh(H - allowed.H_low)[0] >= least
            assert np.linalg.eigvalsh(allowed.H_high - H)[0] >= least


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("cause", ["rho_centre", "rho_shape"])
def test_inertia_of_the_worst_centres_and_shapes_is_in_its_range(robot: str, cause: str) -> None:
    """Joint by joint every link's centre farthest from its axis and nearest to it, or every inertia at its edge; drawn
    arms, with all causes at once, stay so far inside that the half of these terms would do."""
    system, rho = doubted(robot), getattr(DECLARED, cause)
    model, n = system.robot.model, system.robot.n
    state = draw_state(system, np.random.default_rng(6))
    estimate, task = system.observe(*state)
    allowed = InertiaRange.at(CERTAIN._replace(**{cause: rho}), estimate, task)
    data, used = model.createData(), []
    J_q = np.linalg.inv(task.J_q_inv)
    E = J_q.T @ (allowed.H_high - allowed.H_low) @ J_q / 2.0
    pin.computeJointJacobians(model, data, state.q)
    for joint in range(n):
        outwards = np.zeros((n, 3))
        for link in range(n):
            v, w = np.split(pin.getJointJacobian(model, data, link + 1, pin.LOCAL)[:, joint], 2)
            away = np.cross(v + np.cross(w, model.inertias[link + 1].lever), w)
            outwards[link] = away / max(np.linalg.norm(away), 1e-12)
        for sign in (1.0, -1.0):
            part = (
                {"link_centre": sign * rho * outwards}
                if cause == "rho_centre"
                else {"link_shape": sign * rho * np.eye(3)}
            )
            arm = Truth(np.ones(n), 0.0, np.zeros(3), 0.0, 0.0, 0.0, 0.0, **part).model(system.robot)
            M = pin.crba(arm, arm.createData(), state.q)
            H = in_task_space(task, M)
            least = -1e-10 * np.abs(H).max()
            assert np.linalg.eigvalsh(H - allowed.H_low)[0] >= least
            assert np.linalg.eigvalsh(allowed.H_high - H)[0] >= least
            if E[joint, joint] > 0.0:
                used.append(abs(M - estimate.M_hat)[joint, joint] / E[joint, joint])
    assert max(used) == pytest.approx(1.0) if cause == "rho_shape" else max(used) > 0.7


@pytest.mark.parametrize("robot", ["ur5", "planar2r"])
def test_extremes_of_the_range_are_arms(robot: str) -> None:
    """Without payload H_low and H_high are the arms whose links and rotors are all lightest and all heaviest."""
    system = charted(robot, CHART)
    u, state = CERTAIN._replace(rho=0.25, rho_rotor=0.4), draw_state(system, np.random.default_rng(6))
    estimate, task = system.observe(*state)
    allowed = InertiaRange.at(u, estimate, task)
    for alpha, rotors, H in ((0.75, 0.6, allowed.H_low), (1.25, 1.4, allowed.H_high)):
        truth = Truth(np.full(system.robot.n, alpha), 0.0, np.zeros(3), 0.0, 0.0, 0.0, 0.0, rotor_scaling=rotors)
        model = truth.model(system.robot)
        np.testing.assert_allclose(H, in_task_space(task, pin.crba(model, model.createData(), state.q)), rtol=1e-9)


@pytest.mark.parametrize("robot", ROBOTS)
def test_tight_bound_of_inertia_is_attained(robot: str) -> None:
    """Every link and rotor at the edge of its scaling, q_eq_ddot where E_H is largest: nothing smaller would be a
    bound."""
    system, rho, rho_rotor = charted(robot, CHART), 0.25, 0.1
    state = draw_state(system, np.random.default_rng(6))
    estimate, task = system.observe(*state)
    E = rho * estimate.M_links + rho_rotor * (estimate.M_hat - estimate.M_links)
    q_eq_ddot = task.J_q_inv @ np.linalg.eigh(in_task_space(task, E))[1][:, -1]
    truth = Truth(
        np.full(system.robot.n, 1.0 + rho), 0.0, np.zeros(3), 0.0, 0.0, 0.0, 0.0, rotor_scaling=1.0 + rho_rotor
    )
    model = truth.model(system.robot)
    Delta_M = pin.crba(model, model.createData(), state.q) - estimate.M_hat
    needed = np.linalg.norm(task.J_q_inv.T @ Delta_M @ q_eq_ddot)
    u = Uncertainty(rho, rho_rotor, *7 * (0.0,), k_C=0.0)
    equivalent = Equivalent.zeros(system.robot.n)._replace(q_ddot=q_eq_ddot)
    offered = required_gain("tight", u, ON_LINE, estimate, task, state.q_dot, equivalent).inertia
    assert needed <= offered * (1.0 + 1e-9)
    assert needed >= 0.97 * offered  # the spectral norm is taken from above
