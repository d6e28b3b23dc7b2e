"""PD + gravity as a law, drives with limits, and the sections of the evidence that need them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from app.analysis.metrics import metrics_of
from app.analysis.perturbation import PerturbationAnalysis
from app.dashboard.widgets.status import status_html
from app.evidence import baselines, practice, simulators
from app.evidence.section import EvidenceSection
from app.scenario.data import edited, shipped
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.session.runner import Runner
from app.session.timeline import Timeline
from app.simulation.assembly import assemble
from app.simulation.closed_loop import ClosedLoop
from controllers.reference_estimates import FeedforwardModel
from controllers.switching import Switching
from tests.support.arms import charted, random_law, random_reference, random_state

pytestmark = pytest.mark.slow  # long or many simulations

SPEEDY = {"motion.period": 0.8, "motion.ramp": 0.5, "truth.torque_limit": 0.3}  # asks for 40 % of what the drives have

AT_THE_STATE = {"simulation.integrator": "semi-implicit-euler"}  # the acceleration is that at the recorded state


def changed(scenario: Scenario, fields: dict[str, Any]) -> Scenario:
    for path, value in fields.items():
        scenario = edited(scenario, path, value)
    return scenario


def run(scenario: Scenario, seconds: float) -> ClosedLoop:
    loop = ClosedLoop.from_scenario(scenario)
    for _ in range(round(seconds / loop.period)):
        loop.advance()
    return loop


def found(section: EvidenceSection, thin: int) -> list[Any]:
    return [job.function(*job.arguments) for job in section.jobs(thin)]


@pytest.mark.parametrize("robot", ["ur5", "panda"])
def test_pd_leaves_the_target_model_with_the_arm_s_own_inertia(robot: str) -> None:
    """H e_ddot + C r_dot + F_t + H r_d_ddot + B_m e_dot + K_m e = F_cd - F_r, by forward dynamics."""
    random = np.random.default_rng(3)
    system = charted(robot, "sphere")
    n = system.robot.n
    law = random_law(random, n, Switching.SATURATION, np.ones(n), kind="pd-gravity")
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


def test_pd_presses_as_asked_without_a_sensor() -> None:
    """At rest, with gravity as believed and K_m1 = 0, nothing but J^T F_cd is left; the reading has no part in it."""
    deaf = {"controller.law": "pd-gravity", "truth.link_scaling": 1.0, "motion": "hold", "sensor.noise": 5.0}
    record = run(changed(shipped()["ur5-hybrid"], deaf), 3.0).recording.signals(("multiplier", "F_c"))
    assert record["multiplier"][-1] == pytest.approx(20.0, abs=1e-3)
    assert record["F_c"][-500:, 0].std() > 1.0


def test_the_arm_moves_by_the_torque_that_the_drives_give() -> None:
    loop = run(changed(shipped()["ur5-motion"], SPEEDY | AT_THE_STATE), 0.7)
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
    said = f"t = {t:.3f} s: the drive of joint {joint} saturates, the law asks for {asked:.4g} N·m"
    assert (loop.warning or "").startswith(said)
    assert metrics_of(loop).saturated_share == pytest.approx((tau != applied).any(axis=1).mean())


def test_what_the_drives_withhold_is_part_of_the_perturbation() -> None:
    """H s_dot + C s + K_s s + d sigma = perturbation, (23): its norm from the run against that of the analysis."""
    loop = run(changed(shipped()["ur5-motion"], SPEEDY | AT_THE_STATE), 0.7)
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
    by_factor = run(changed(shipped()["ur5-motion"], SPEEDY), 0.7)
    torques = (0.3 * by_factor.system.robot.model.effortLimit).tolist()
    by_torque = run(changed(shipped()["ur5-motion"], SPEEDY | {"truth.torque_limit": torques}), 0.7)
    np.testing.assert_array_equal(by_factor.recording.rows(), by_torque.recording.rows())
    free = run(changed(shipped()["ur5-motion"], SPEEDY | {"truth.torque_limit": 0.0}), 0.7)
    assert free.warning is None
    assert metrics_of(free).saturated_share == 0.0


def test_a_saturated_past_comes_back_to_the_last_bit() -> None:
    line = Timeline(ClosedLoop.from_scenario(changed(shipped()["ur5-motion"], SPEEDY)))
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
    loop = ClosedLoop.from_scenario(changed(shipped()["ur5-constrained"], weak))
    for _ in range(300):
        loop.advance()
    record = loop.recording.signals(("F", "F_true", "tau", "tau_applied"))
    assert (record["tau"] != record["tau_applied"]).any()
    np.testing.assert_allclose(record["F"], record["F_true"], atol=1e-6)


@pytest.mark.parametrize(
    ("limit", "said"),
    [
        (-0.5, r"truth\.torque_limit: -0\.5; allowed: 0 for no limit, or numbers > 0"),
        ([50.0] * 5, r"truth\.torque_limit: 5 values; allowed: one factor, or 6 torques, one per joint"),
        ([50.0, 50.0, 0.0, 50.0, 50.0, 50.0], r"truth\.torque_limit: 0\.0; allowed: 0 for no limit"),
    ],
)
def test_a_limit_that_cannot_be_is_refused(limit: object, said: str) -> None:
    with pytest.raises(ScenarioError, match=said):
        assemble(edited(shipped()["ur5-motion"], "truth.torque_limit", limit))


def test_the_status_line_names_the_joints_at_their_limits() -> None:
    runner = Runner(changed(shipped()["ur5-motion"], SPEEDY))
    try:
        loop = run(changed(shipped()["ur5-motion"], SPEEDY), 0.7)
        html = status_html(replace(runner.snapshot, recording=loop.recording, t=loop.t), "")
    finally:
        runner.close()
    assert "torque at its limit: joint " in html


def test_both_simulators_agree_and_what_differs_is_what_mujoco_leaves_out() -> None:
    pytest.importorskip("mujoco")
    for result in found(simulators.SECTION, 20):
        match result:
            case simulators.Free():
                assert result.moved > 0.05
                assert max(result.euler, result.rk4) < 1e-12
                largest = np.array([rung.max() for rung in result.rungs])
                np.testing.assert_allclose(largest[:-1] / largest[1:], 2.0, rtol=0.05)
            case simulators.Steady():
                assert result.mujoco == pytest.approx(result.predicted, rel=1e-6)
                assert result.ours == pytest.approx(result.mujoco, rel=1e-6)
            case simulators.ContactCourse():
                assert result.ours.max() > 15.0
                assert result.without < 1e-9 < result.with_drift
                assert result.apart < 2.0 * result.drift
            case simulators.Constraint():
                assert result.q_ddot < 1e-11 * result.largest[0]
                assert result.multiplier < 1e-11 * result.largest[1]
                assert len(result.by_slider) == (3 if len(result.kinds) == 1 else 0)
                for (coarse, _), (fine, _) in [result.by_slider[:2]] if result.by_slider else []:
                    assert coarse / fine == pytest.approx(100.0, rel=0.1)
            case _:
                raise AssertionError(result)


def test_baselines_lose_on_uncertain_arms_and_win_where_it_is_said() -> None:
    seeds = (0, 1)
    ours, _, computed, fast, pd, _ = baselines.CONTESTANTS
    quiet = {who: baselines.on_uncertain(who, seeds, 0.0) for who in (ours, computed, pd)}
    for robust, inverse, simple in zip(*quiet.values(), strict=True):
        assert robust.stopped is None
        assert robust.promised == 1.0
        assert robust.over_bound is not None
        assert robust.over_bound <= 1e-9
        for worse in (inverse, simple):
            assert worse.account.path_rms > 5.0 * robust.account.path_rms
            assert (worse.account.force_rms or 0.0) > 20.0 * (robust.account.force_rms or np.inf)
    assert (baselines.on_exact(ours).account.force_rms or 0.0) < 1e-3  # on an exact arm nobody errs by much
    assert baselines.on_exact(fast).account.path_rms < 1e-6
    loud = {who: baselines.on_uncertain(who, seeds[:1], 1.0)[0].account for who in (ours, computed, pd)}
    assert loud[pd].variation == pytest.approx(quiet[pd][0].account.variation, rel=1e-9)
    assert loud[computed].variation < 0.7 * loud[ours].variation


def test_the_loop_fails_where_theory_says() -> None:
    section = found(practice.SECTION, 4)
    names = [name for name, sweep in practice.SWEEPS.items() for _ in sweep.ys[::4]]
    cells = [(name, cell) for name, row in zip(names, section, strict=True) for cell in row]
    delayed = [cell for name, cell in cells if name == "delay"]
    agreeing = sum((cell.growth > 1.0) == (not cell.force < 5.0 * practice.FORCE_GOOD) for cell in delayed)
    assert agreeing >= 0.8 * len(delayed)
    assert any(cell.growth > 1.0 for cell in delayed)
    assert all(cell.path < 1e-3 for name, cell in cells if name == "drives" and cell.saturated == 0.0)
    assert any(cell.saturated != 0.0 for name, cell in cells if name == "drives")
    conclusion = practice.SECTION.conclude(section)
    assert all(svg.startswith(b"<?xml") for svg in conclusion.figures.values())
    assert practice.SECTION.text(conclusion, "evidence")
