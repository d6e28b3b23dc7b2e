"""PD + gravity as a law: a target model with the arm's own inertia, without a force sensor."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from app.scenario.data import shipped, with_values
from app.simulation.closed_loop import ClosedLoop
from controllers.reference_estimates import FeedforwardModel
from controllers.switching import SWITCHING
from tests.support.arms import charted, random_law, random_reference, random_state


@pytest.mark.parametrize("robot", ["ur5", "panda"])
def test_pd_leaves_the_target_model_with_the_arm_s_own_inertia(robot: str) -> None:
    """H e_ddot + C r_dot + F_t + H r_d_ddot + B_m e_dot + K_m e = F_cd - F_r, by forward dynamics."""
    random = np.random.default_rng(3)
    system = charted(robot, "sphere outside")
    n = system.robot.n
    law = random_law(random, n, SWITCHING["saturation"], np.ones(n), kind="pd-gravity")
    q, q_dot, t = random_state(system, random)
    estimate, task = system.observe(q, q_dot, t)
    reference, F = random_reference(task.r, random), 10.0 * random.standard_normal(6)
    out = law.evaluate(np.zeros(n), reference, task, estimate, FeedforwardModel.at(estimate), q, q_dot, F)
    tau_F = np.vstack([estimate.J_v, estimate.J_w]).T @ F
    q_ddot = pin.aba(system.robot.model, system.robot.model.createData(), q, q_dot, out.tau - tau_F)
    moved = task.J_q_inv.T @ (estimate.M_hat @ q_ddot + estimate.C_hat @ q_dot + tau_F)
    asked = reference.F_cd - law.model.K_m @ out.e_r - law.model.B_m @ out.e_r_dot
    np.testing.assert_allclose(moved, asked, rtol=1e-9, atol=1e-8)
    assert out.d == 0.0


@pytest.mark.slow
def test_pd_presses_as_asked_without_a_sensor() -> None:
    """At rest, with gravity as believed and K_m1 = 0, nothing but J^T F_cd is left; the reading has no part in it."""
    deaf = {"controller.law": "pd-gravity", "truth.link_scaling": 1.0, "motion": "hold", "sensor.noise": 5.0}
    loop = ClosedLoop.from_scenario(with_values(shipped()["ur5-hybrid"], deaf))
    for _ in range(round(3.0 / loop.period)):
        loop.advance()
    record = loop.recording.signals(("multiplier", "F_c"))
    assert record["multiplier"][-1] == pytest.approx(20.0, abs=1e-3)
    assert record["F_c"][-500:, 0].std() > 1.0
