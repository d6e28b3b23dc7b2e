"""Drives with torque limits: what they give moves the arm, and what they withhold is a perturbation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from app.analysis.metrics import metrics_of
from app.analysis.perturbation import PerturbationAnalysis
from app.dashboard.widgets.page.status import status_html
from app.scenario.data import edited, shipped, with_values
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.session.runner import Runner
from app.session.timeline import Timeline
from app.simulation.assembly import assemble
from app.simulation.closed_loop import ClosedLoop

pytestmark = pytest.mark.slow  # many simulations

SPEEDY = {"motion.period": 0.8, "motion.ramp": 0.5, "truth.torque_limit": 0.3}  # asks for 40 % of what the drives have

AT_THE_STATE = {"simulation.integrator": "semi-implicit-euler"}  # the acceleration is that at the recorded state


def run(scenario: Scenario, seconds: float) -> ClosedLoop:
    loop = ClosedLoop.from_scenario(scenario)
    for _ in range(round(seconds / loop.period)):
        loop.advance()
    return loop


def test_the_arm_moves_by_the_torque_that_the_drives_give() -> None:
    loop = run(with_values(shipped()["ur5-motion"], SPEEDY | AT_THE_STATE), 0.7)
    record = loop.recording.signals(("q", "q_dot", "tau", "tau_applied", "t"))
    limit = 0.3 * loop.system.robot.model.effortLimit
    tau, applied = record["tau"], record["tau_applied"]
    np.testing.assert_array_equal(applied, np.clip(tau, -limit, limit))
    first = int(np.flatnonzero((tau != applied).any(axis=1))[0])
    true = loop.system.plant.model
    for k in (first - 1, first, first + 5):
        q_ddot = pin.aba(true, true.createData(), record["q"][k], record["q_dot"][k], applied[k])
        np.testing.assert_allclose(np.diff(record["q_dot"], axis=0)[k] / loop.period, q_ddot, rtol=1e-6, atol=1e-8)
    joint = int(np.abs(tau[first] / applied[first]).argmax()) + 1
    asked, t = tau[first, joint - 1], record["t"][first]
    message = f"t = {t:.3f} s: the drive of joint {joint} saturates: the law asks for {asked:.4g} N·m"
    assert (loop.warning or "").startswith(message)
    assert metrics_of(loop).saturated_share == pytest.approx((tau != applied).any(axis=1).mean())


def test_torque_cut_by_drive_limits_counts_as_perturbation() -> None:
    """H s_dot + C s + K_s s + d sigma = perturbation, (23): its norm from the run against that of the analysis."""
    loop = run(with_values(shipped()["ur5-motion"], SPEEDY | AT_THE_STATE), 0.7)
    recording = loop.recording
    rows = recording.signals(tuple(recording.columns))
    k = int(np.flatnonzero((rows["tau"] != rows["tau_applied"]).any(axis=1))[3])
    one = {name: values[k : k + 1] for name, values in rows.items()}
    perturbation = PerturbationAnalysis(loop.system).recorded(one, recording.epochs, np.array([0]))["perturbation"][0]
    q, q_dot, true = rows["q"][k], rows["q_dot"][k], loop.system.plant.model
    _, task = loop.system.observe(q, q_dot, rows["t"][k])
    M, C = pin.crba(true, true.createData(), q), pin.computeCoriolisMatrix(true, true.createData(), q, q_dot)
    q_ddot = (rows["q_dot"][k + 1] - q_dot) / loop.period
    behind = task.J_q_inv @ rows["s"][k]
    left = M @ (q_ddot - rows["q_eq_ddot"][k]) + C @ behind - rows["tau_linear"][k] - rows["tau_switching"][k]
    assert perturbation == pytest.approx(np.linalg.norm(task.J_q_inv.T @ left), rel=1e-4)


def test_limits_by_factor_and_in_newton_metres_are_the_same_and_none_is_none() -> None:
    by_factor = run(with_values(shipped()["ur5-motion"], SPEEDY), 0.7)
    torques = (0.3 * by_factor.system.robot.model.effortLimit).tolist()
    by_torque = run(with_values(shipped()["ur5-motion"], SPEEDY | {"truth.torque_limit": torques}), 0.7)
    np.testing.assert_array_equal(by_factor.recording.rows(), by_torque.recording.rows())
    free = run(with_values(shipped()["ur5-motion"], SPEEDY | {"truth.torque_limit": 0.0}), 0.7)
    assert free.warning is None
    assert metrics_of(free).saturated_share == 0.0


def test_a_saturated_past_comes_back_to_the_last_bit() -> None:
    line = Timeline(ClosedLoop.from_scenario(with_values(shipped()["ur5-motion"], SPEEDY)))
    for _ in range(700):
        line.step()
    rows = line.recording.rows()
    assert (rows[:, line.recording.columns["tau"]] != rows[:, line.recording.columns["tau_applied"]]).any()
    line.seek(0.3)
    for k in range(300, 700):
        np.testing.assert_array_equal(line.loop.view().q, rows[k, line.recording.columns["q"]])
        line.step()


def test_the_multiplier_is_solved_for_what_the_drives_give() -> None:
    """Rigid surface, ideal reading: the law reads the force that the cut torque causes."""
    weak = {"sensor.ideal": True, "truth.torque_limit": [150.0, 150.0, 9.9, 28.0, 28.0, 28.0], "force.value": 60.0}
    loop = ClosedLoop.from_scenario(with_values(shipped()["ur5-constrained"], weak))
    for _ in range(300):
        loop.advance()
    record = loop.recording.signals(("F", "F_true", "tau", "tau_applied"))
    assert (record["tau"] != record["tau_applied"]).any()
    np.testing.assert_allclose(record["F"], record["F_true"], atol=1e-6)


@pytest.mark.parametrize(
    ("limit", "message"),
    [
        (-0.5, r"truth\.torque_limit: -0\.5; allowed: 0 for no limit, or numbers > 0"),
        ([50.0] * 5, r"truth\.torque_limit: 5 values; allowed: one factor, or 6 torques, one per joint"),
        ([50.0, 50.0, 0.0, 50.0, 50.0, 50.0], r"truth\.torque_limit: 0\.0; allowed: 0 for no limit"),
    ],
)
def test_a_limit_that_cannot_be_is_refused(limit: object, message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        assemble(edited(shipped()["ur5-motion"], "truth.torque_limit", limit))


def test_the_status_line_names_the_joints_at_their_limits() -> None:
    runner = Runner(with_values(shipped()["ur5-motion"], SPEEDY))
    try:
        loop = run(with_values(shipped()["ur5-motion"], SPEEDY), 0.7)
        html = status_html(replace(runner.snapshot, recording=loop.recording, t=loop.t), "")
    finally:
        runner.close()
    assert "torque at its limit: joint " in html
