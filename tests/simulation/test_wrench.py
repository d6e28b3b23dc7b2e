"""The wrench, F in R^6: its torque, its power in task coordinates, the sensor's moments, and an impedance that is
pushed and twisted."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from app.scenario.data import edited, shipped
from app.scenario.declared_bounds import outside
from app.scenario.schema import Scenario
from app.scenario.units import CARTESIAN
from app.session.changes import on_robot
from app.simulation.assembly import assemble
from app.simulation.closed_loop import ClosedLoop
from app.simulation.system import System
from controllers.reference_estimates import FeedforwardModel
from environments.push import Grip, TimedPush
from environments.sensors import ForceReader, ForceSensor, Sensor

TWISTED = "ur5-impedance-6d"
NONE = (0.0, 0.0, 0.0)


def changed(scenario: Scenario, **changes: object) -> Scenario:
    for path, value in changes.items():
        scenario = edited(scenario, path.replace("__", "."), value)
    return scenario


def still(**changes: object) -> Scenario:
    """The shipped impedance, which holds its place and is not pushed, on an arm that is the believed one."""
    quiet = {"motion": "hold", "truth__push": NONE, "truth__push_moment": NONE, "truth__link_scaling": 1.0}
    return changed(shipped()[TWISTED], **(quiet | changes))


def jacobian(system: System, q: np.ndarray) -> np.ndarray:
    """Pinocchio's own Jacobian (6, n) of the tool's frame along the world's axes: linear, then angular."""
    model, robot = system.robot.model.copy(), system.robot
    frame = model.addFrame(
        pin.Frame("tool of this test", robot.tool_joint, 0, robot.tool_placement, pin.FrameType.OP_FRAME)
    )
    return pin.computeFrameJacobian(model, model.createData(), q, frame, pin.LOCAL_WORLD_ALIGNED)


@pytest.mark.parametrize("robot", ["ur5", "panda", "planar3r", "planar2r"])
def test_torque_of_a_wrench_and_its_power_in_task_coordinates(robot: str) -> None:
    """(2), (25): J^T F with the Jacobian of the whole frame; (5): F_r^T (r_dot - v_t) is F's power, whatever the
    angles."""
    system, random = assemble(on_robot(still(), robot)), np.random.default_rng(3)
    n = system.robot.n
    for _ in range(5):
        q, q_dot = system.q_0 + random.uniform(-0.3, 0.3, n), random.standard_normal(n)
        estimate, task = system.observe(q, q_dot, 0.0)
        F, J = 10.0 * random.standard_normal(6), jacobian(system, q)
        zero = np.zeros(n)
        out = system.controller.evaluate(
            zero, system.reference(0.0), task, estimate, FeedforwardModel.at(estimate), q, q_dot, F
        )
        np.testing.assert_allclose(out.terms.force, J.T @ F, atol=1e-10)
        assert out.F_c @ task.r_dot == pytest.approx(F @ (J @ q_dot), rel=1e-10, abs=1e-10)
        state = system.plant.start(q, q_dot, 0.0)
        np.testing.assert_allclose(system.plant.torque_of_push(state, F), J.T @ F, atol=1e-10)


def test_torque_of_a_wrench_is_mujocos() -> None:
    """Force and moment applied to MuJoCo's body of the same URDF, at the same point along the world's axes."""
    mujoco = pytest.importorskip("mujoco")
    from app.evidence.mujoco_arm import arm_spec

    system, random = assemble(still()), np.random.default_rng(5)
    model = arm_spec(system).compile()
    data, site = mujoco.MjData(model), 0
    assert model.nsite == 1
    for _ in range(5):
        q, F = system.q_0 + random.uniform(-0.5, 0.5, 6), random.standard_normal(6)
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        torque = np.zeros(6)
        mujoco.mj_applyFT(model, data, F[:3], F[3:], data.site_xpos[site], model.site_bodyid[site], torque)
        state = system.plant.start(q, np.zeros(6), 0.0)
        np.testing.assert_allclose(system.plant.torque_of_push(state, F), torque, atol=1e-9)


def test_moment_in_an_angle_of_the_tool() -> None:
    """Where the Euler angles are zero, l F_r of each is the moment about its axis of the task frame."""
    system = assemble(still())
    estimate, task = system.observe(system.q_0, np.zeros(6), 0.0)
    moment, zero = np.array([0.7, -1.3, 0.4]), np.zeros(6)
    F = np.concatenate([np.zeros(3), moment])
    out = system.controller.evaluate(
        zero, system.reference(0.0), task, estimate, FeedforwardModel.at(estimate), system.q_0, zero, F
    )
    np.testing.assert_allclose(system.layout.l * out.F_c[3:], system.layout.R_ref.T @ moment, atol=1e-12)
    np.testing.assert_allclose(out.F_c[:3], 0.0, atol=1e-10)


def test_a_wrong_wrench_is_refused() -> None:
    system = assemble(still())
    estimate, task = system.observe(system.q_0, np.zeros(6), 0.0)
    with pytest.raises(ValueError, match=r"F: of shape \(3,\); allowed: \(6,\), force and moment"):
        system.controller.evaluate(
            np.zeros(6), system.reference(0.0), task, estimate, FeedforwardModel.at(estimate), system.q_0, np.zeros(6),
            np.zeros(3),
        )  # fmt: skip


@pytest.mark.parametrize("law", ["computed-torque", "vsmrc"])
def test_a_twisted_impedance_rests_where_its_torsional_stiffness_says(law: str) -> None:
    """A moment m about an axis of the task frame turns the tool by m / (l^2 K_m): K_m l^2 is N m/rad."""
    moment = np.array([0.0, 0.0, 1.5])
    loop = ClosedLoop.from_scenario(
        still(truth__push_moment=moment.tolist(), truth__push_start=0.1, controller__law=law)
    )
    R_0 = loop.system.layout.R_ref.copy()
    for _ in range(3000):
        loop.step()
        if loop.t > 0.95:
            break
    last, l = loop.recording.at(loop.t), loop.system.layout.l
    np.testing.assert_allclose(last["moment_push"], moment)
    np.testing.assert_allclose(last["moment"], -moment, atol=1e-12)
    np.testing.assert_allclose(last["F"], 0.0, atol=1e-12)
    K_m = loop.system.controller.model.K_m
    turned = Rotation.from_matrix(loop.system.observe(last["q"], last["q_dot"], 0.0)[0].R @ R_0.T).as_rotvec()
    np.testing.assert_allclose(turned, moment / (l**2 * K_m[3, 3]), atol=2e-3)
    np.testing.assert_allclose(last["e_r"][:3], 0.0, atol=1e-4)


@pytest.mark.parametrize(("scaling", "apart"), [(1.0, 4e-5), (1.15, 2e-4)])
def test_pushed_and_twisted_arm_moves_as_the_target_model_under_that_wrench(scaling: float, apart: float) -> None:
    """(8) integrated alone, with F_r = J_q^-T J^T w from the Euler angles written once more, against the run; links
    15 % heavier move s within the boundary layer."""
    scenario = changed(shipped()[TWISTED], motion="hold", truth__push_start=0.0, truth__push_duration=0.6)
    scenario = edited(scenario, "truth.link_scaling", scaling)
    loop = ClosedLoop.from_scenario(changed(scenario, simulation__duration=1.0))
    while loop.t < 0.9995:
        loop.step()
    assert loop.stopped is None
    record = loop.recording.signals(("t", "e_r", "moment_push"))
    system, truth = loop.system, scenario.truth
    model, R_ref, l = system.controller.model, system.layout.R_ref, system.layout.l
    M_inv = np.linalg.inv(model.M_m)

    def felt(e: np.ndarray, t: float) -> np.ndarray:
        """Generalised force of the push, by the angular velocity that each Euler rate makes."""
        if t >= truth.push_duration:
            return np.zeros(6)
        _, beta, gamma = e[3:] / l
        z, turn = np.array([0.0, 0.0, 1.0]), Rotation.from_euler("z", gamma)
        axes = [(turn * Rotation.from_euler("y", beta)).apply([1.0, 0.0, 0.0]), turn.apply([0.0, 1.0, 0.0]), z]
        return np.concatenate([truth.push, np.array(axes) @ R_ref.T @ np.array(truth.push_moment) / l])

    def slope(t: float, x: np.ndarray) -> np.ndarray:
        e, e_dot = x[:6], x[6:]
        pulled = model.K_f @ felt(e, t) - model.B_m @ e_dot - model.K_m @ e
        return np.concatenate([e_dot, M_inv @ pulled])

    ideal = solve_ivp(slope, (0.0, 1.0), np.zeros(12), t_eval=record["t"], rtol=1e-9, atol=1e-12, max_step=1e-2).y[:6]
    assert np.abs(ideal[3:] / l).max() > 0.03  # rad
    np.testing.assert_allclose(record["e_r"], ideal.T, atol=apart)


def sensor(**settings: object) -> ForceSensor:
    return ForceSensor(Sensor(**settings), 0.001)


def test_moments_have_noise_bias_and_delay_of_their_own() -> None:
    noisy = sensor(moment_noise=0.02, moment_bias=(0.1, 0.0, -0.2))
    reader, wrench = ForceReader(noisy, 4), np.arange(6.0)
    readings = np.array([reader.read(wrench) for _ in range(4000)])
    np.testing.assert_array_equal(readings[:, :3], np.broadcast_to(wrench[:3], (4000, 3)))
    np.testing.assert_allclose(readings[:, 3:].mean(axis=0), [3.1, 4.0, 4.8], atol=1.5e-3)
    np.testing.assert_allclose(readings[:, 3:].std(axis=0), 0.02, rtol=0.05)

    for forces, moments in ((3, 0), (1, 3), (2, 2)):
        late = ForceReader(sensor(delay=0.001 * forces, moment_delay=0.001 * moments), 0)
        read = np.array([late.read(np.full(6, float(k))) for k in range(6)])
        expected = np.maximum(np.arange(6.0)[:, None] - [forces] * 3, 0.0)
        np.testing.assert_array_equal(read[:, :3], expected)
        np.testing.assert_array_equal(read[:, 3:], np.maximum(np.arange(6.0)[:, None] - [moments] * 3, 0.0))


def test_noise_of_the_forces_is_the_same_whatever_that_of_the_moments() -> None:
    """A run of before moments existed has the numbers that it had."""
    alone, both = (ForceReader(sensor(noise=0.5, moment_noise=size), 7) for size in (0.0, 0.3))
    random = np.random.default_rng(7)
    for _ in range(5):
        expected = 0.5 * random.standard_normal(3)
        for reader in (alone, both):
            np.testing.assert_array_equal(reader.read(np.zeros(6))[:3], expected)


def test_declared_moment_error_is_compared_with_bias_and_noise() -> None:
    scenario = still(sensor__moment_noise=0.02, sensor__moment_bias=[0.0, 0.0, 0.1], declared__moment_error=0.19)
    assert outside(scenario, CARTESIAN) == ()
    (sentence,) = outside(edited(scenario, "declared.moment_error", 0.17), CARTESIAN)
    assert sentence == "moment error (bias + 4σ of noise) 0.18 N·m > declared 0.17 N·m"


def test_a_hand_turns_the_tool_by_a_spring() -> None:
    """Torsion N m/rad towards the orientation that it holds, at most its limit, about the axis in between."""
    grip = Grip(None, turned=(0.0, 0.0, 0.3), torsion=10.0, moment_limit=2.0)
    R = Rotation.from_rotvec([0.0, 0.0, 0.2]).as_matrix()
    np.testing.assert_allclose(grip.wrench(np.ones(3), R), [0, 0, 0, 0, 0, 1.0], atol=1e-12)
    np.testing.assert_allclose(grip.wrench(np.ones(3), np.eye(3)), [0, 0, 0, 0, 0, 2.0], atol=1e-12)
    for wrong in ({"turned": (0.0, np.nan, 0.0)}, {"torsion": 0.0}, {"moment_limit": 1e3}):
        with pytest.raises(ValueError, match=rf"push\.{next(iter(wrong))}: .*; allowed: "):
            Grip(None, **wrong)


def test_an_impedance_yields_to_a_hand_that_turns_it() -> None:
    """At rest the two springs share the angle: turned by theta torsion / (torsion + l^2 K_m)."""
    loop = ClosedLoop.from_scenario(still())
    R_0 = loop.system.layout.R_ref.copy()
    held = Rotation.from_rotvec([0.0, 0.0, 0.1]) * Rotation.from_matrix(R_0)
    loop.drag_tool(Grip(None, turned=tuple(held.as_rotvec().tolist()), torsion=20.0))
    for _ in range(1000):
        loop.step()
    last, system = loop.recording.at(loop.t), loop.system
    K_t = system.layout.l**2 * system.controller.model.K_m[3, 3]
    R = system.observe(last["q"], last["q_dot"], 0.0)[0].R
    expected = 0.1 * 20.0 / (20.0 + K_t)
    assert Rotation.from_matrix(R @ R_0.T).as_rotvec()[2] == pytest.approx(expected, rel=0.02)
    np.testing.assert_array_equal(last["F_push"], 0.0)
    assert last["moment_push"][2] == pytest.approx(20.0 * (0.1 - expected), rel=0.02)


def test_a_push_by_the_clock_has_a_moment() -> None:
    push = TimedPush(np.array([1.0, 2.0, 3.0]), 1.0, 0.25, frequency=2.0, moment=np.array([0.1, 0.2, 0.3]))
    sine = np.sin(2 * np.pi * 2.0 * 0.1)
    np.testing.assert_allclose(push.at(1.1), sine * np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3]))
    assert push.at(1.3) is None
