"""A flat tool on a plane: its contact, its coordinates with a plane that tilts, (35) to (37) with a matrix K_e, and the
alignment that the scenario promises."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from app.analysis.metrics import force_error, moment_error
from app.scenario.data import edited, shipped
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.session.headless_run import simulate
from app.simulation.assembly import assemble
from app.simulation.builders.controller_builder import believed_stiffness, true_stiffness
from app.simulation.closed_loop import ClosedLoop
from app.simulation.compiled_run import CompiledRun
from app.simulation.sampled_loop.sampled_stability import sampled_loop
from app.simulation.system import System
from controllers.reference_estimates import FeedforwardModel
from environments.contact import FEET, face_radius
from environments.surfaces.plane import Plane, Tilt
from environments.surfaces.table import Surface
from tests.support.arms import State
from tests.support.identities import (
    assert_acceleration_of_coordinates,
    assert_derivatives_of_coordinates,
    assert_properties_1_and_2,
    assert_torque_is_force_in_task_space,
    derivative,
)

ALIGN = "panda-align"


def changed(scenario: Scenario, **changes: object) -> Scenario:
    for path, value in changes.items():
        scenario = edited(scenario, path.replace("__", "."), value)
    return scenario


@pytest.fixture(scope="module")
def system() -> System:
    """The shipped scenario with a plane that moves and tilts fast."""
    motion = {"amplitude": 0.02, "frequency": 1.3, "direction": [0.3, 0.4, 0.8]}
    tilt = {"amplitude": 0.2, "frequency": 1.7, "axis": [0.2, 1.0, 0.1]}
    return assemble(changed(shipped()[ALIGN], surface__motion=motion, surface__tilt=tilt))


def state_of(system: System, seed: int) -> State:
    random, n = np.random.default_rng(seed), system.robot.n
    return State(system.q_0 + random.uniform(-0.1, 0.1, n), random.uniform(-1.0, 1.0, n), random.uniform(0.1, 1.0))


def test_a_plane_that_tilts_has_exact_derivatives_in_time() -> None:
    tilt = Tilt(amplitude=0.3, frequency=0.9, axis=(0.3, 1.0, -0.2))
    plane = Surface.of(Plane(origin=(0.4, 0.1, 0.3), normal=(0.2, 0.1, -1.0), tilt=tilt))
    p, t = np.array([0.5, -0.1, 0.35]), 0.23
    chart = plane.chart(p, t)
    for of, found in (("g", chart.g_t), ("g_t", chart.g_tt), ("G", chart.G_t)):
        np.testing.assert_allclose(derivative(lambda h, of=of: getattr(plane.chart(p, t + h), of)), found, atol=1e-8)
    np.testing.assert_allclose(derivative(lambda h: plane.chart(p, t + h).G_t[0]), chart.normal_tt, atol=1e-8)
    assert np.linalg.norm(chart.G[0]) == pytest.approx(1.0, abs=1e-12)
    assert np.linalg.norm(chart.G_t[0]) > 0.1
    np.testing.assert_allclose(plane.point(chart.g, t), p, atol=1e-12)


def test_coordinates_of_a_flat_tool_obey_the_papers_identities(system: System) -> None:
    state = state_of(system, 1)
    assert np.abs(system.observe(*state)[1].v_t[1:3]).max() > 1e-2
    assert_derivatives_of_coordinates(system, state)
    assert_acceleration_of_coordinates(system, state)
    assert_properties_1_and_2(system, state)
    assert_torque_is_force_in_task_space(system, system.controller, state, np.random.default_rng(3))


def test_tilts_are_those_of_the_tools_frame_alone(system: System) -> None:
    """n . e_i for its axes e_i."""
    q, q_dot, t = state_of(system, 1)
    estimate, here = system.observe(q, q_dot, t)
    normal = system.surface.chart(estimate.p, t).G[0]
    np.testing.assert_allclose(here.r[1:3] / system.layout.l, (estimate.R.T @ normal)[:2], atol=1e-12)
    assert system.observe(system.q_0, q_dot, 0.0)[1].r[5] == pytest.approx(0.0, abs=1e-12)
    assert [c.name for c in system.coordinates] == ["φ", "ℓ·θ₁", "ℓ·θ₂", "ψ₁", "ψ₂", "ℓ·γ", "ℓ·q₃"]


def foot_frames(system: System, radius: float) -> tuple[pin.Model, list[int]]:
    """Pinocchio's model of the arm with a frame at each foot of a ring in the tool's x-y plane."""
    robot, model = system.robot, system.robot.model.copy()
    frames = []
    for i in range(FEET):
        angle = 2 * np.pi * i / FEET
        foot = robot.tool_placement * pin.SE3(np.eye(3), radius * np.array([np.cos(angle), np.sin(angle), 0.0]))
        frames.append(model.addFrame(pin.Frame(f"foot {i}", robot.tool_joint, 0, foot, pin.FrameType.OP_FRAME)))
    return model, frames


@pytest.mark.parametrize(("into", "tilted"), [(0.004, 0.0), (0.001, 0.05)])
def test_contact_is_that_of_eight_springs_at_frames_of_pinocchio(system: System, into: float, tilted: float) -> None:
    """Torque by each foot's own Jacobian, J^T f; pressed by some feet only, too, where one side has lifted."""
    scenario, t = changed(system.scenario, contact__B_e=40.0), 0.3
    both = assemble(scenario, system)
    contact, K_t = both.plant.contact, scenario.face.K_t
    q, _ = both.posture_at(both.q_0, t)
    task = both.observe(q, np.zeros_like(q), t)[1]
    wanted = np.zeros_like(q)
    wanted[0], wanted[1] = into - task.r[0], both.layout.l * tilted
    q, q_dot = q + task.J_q_inv @ wanted, 0.1 * np.random.default_rng(1).standard_normal(len(q))
    load = both.plant.start(q, q_dot, t).read().load

    model, frames = foot_frames(both, face_radius(K_t, contact.K_e))
    data, torque, pressed = model.createData(), np.zeros_like(q), 0
    pin.forwardKinematics(model, data, q, q_dot)
    pin.updateFramePlacements(model, data)
    total = np.zeros(3)
    for frame in frames:
        place = data.oMf[frame].translation.copy()
        J = pin.computeFrameJacobian(model, model.createData(), q, frame, pin.LOCAL_WORLD_ALIGNED)[:3]
        chart = both.surface.chart(place, t)
        push = (contact.K_e * chart.g[0] + contact.B_e * (chart.G[0] @ J @ q_dot + chart.g_t[0])) / FEET
        if chart.g[0] > 0.0 and push > 0.0:
            pressed += 1
            torque += J.T @ chart.G[0] * push
            total += chart.G[0] * push
    assert 0 < pressed <= FEET
    assert (pressed == FEET) == (tilted == 0.0)
    np.testing.assert_allclose(load.torque, torque, atol=1e-10)
    np.testing.assert_allclose(load.wrench[:3], total, atol=1e-10)


def test_wholly_pressed_face_has_32_with_a_matrix(system: System) -> None:
    """F_r = diag(K_e, K_t / l^2, K_t / l^2) r_f exactly while every foot presses, felt through J_q^-T J^T."""
    q, _ = system.posture_at(system.q_0, 0.4)
    task = system.observe(q, np.zeros_like(q), 0.4)[1]
    wanted = np.zeros_like(q)
    wanted[:3] = 0.01 - task.r[0], 0.15 * 0.05, -0.15 * 0.03
    q = q + task.J_q_inv @ wanted
    estimate, task = system.observe(q, np.zeros_like(q), 0.4)
    load, zero = system.plant.start(q, np.zeros_like(q), 0.4).read().load, np.zeros_like(q)
    out = system.controller.evaluate(
        zero, system.reference(0.4), task, estimate, FeedforwardModel.at(estimate), q, zero, load.wrench
    )
    np.testing.assert_allclose(out.F_c[:3], true_stiffness(system.scenario) @ task.r[:3], rtol=1e-9)
    assert np.abs(out.F_c[1:3]).min() > 1.0
    np.testing.assert_allclose(out.F_c[3:], 0.0, atol=1e-12)


@pytest.mark.slow
def test_the_scenario_aligns_the_tool_with_the_tilting_plane() -> None:
    loop, metrics = simulate(shipped()[ALIGN])
    assert metrics.stopped is None
    assert metrics.promise.verdict == "holds"
    assert metrics.motion_error_tail <= 1e-4
    assert metrics.force_error_tail is not None
    assert metrics.moment_error_tail is not None
    assert metrics.force_error_tail <= 0.1
    assert metrics.moment_error_tail <= 0.01
    record, system = loop.recording.signals(("r", "F_c", "F_cd", "multiplier", "moment_true")), loop.system
    assert np.abs(record["r"][0, 1:3] / system.layout.l).max() > 0.05  # rad, at the start
    assert np.abs(record["r"][-2000:, 1:3] / system.layout.l).max() < 1e-3
    assert np.linalg.norm(record["moment_true"], axis=1).max() > 0.1  # N m, on the way
    assert moment_error(system, record).max() > 0.1
    assert np.abs(force_error(system, record)[-2000:]).max() <= 0.1


@pytest.mark.parametrize("K_m1", [0.0, 300.0])
def test_steady_moment_is_that_of_37_with_a_matrix(K_m1: float) -> None:
    """K_t misjudged by half and moments desired: e_f = [I - K_e (K_m1 + K_e)^-1] (K_e - K_e_hat) K_e_hat^-1 f_nd."""
    still = {"motion": "hold", "surface__tilt": {}, "surface__normal": [0.0, 0.0, -1.0], "truth__link_scaling": 1.0}
    scenario = changed(shipped()[ALIGN], **still, face__K_t_hat=10.0, face__moment=[0.05, -0.03])
    scenario = edited(scenario, "target_model.K_m", [K_m1, K_m1, K_m1, *4 * [4000.0]])
    loop = ClosedLoop.from_scenario(scenario)
    CompiledRun(loop).advance(4000)
    assert loop.stopped is None
    last, l = loop.recording.at(loop.t), loop.system.layout.l
    K_e, K_hat, f = true_stiffness(scenario), believed_stiffness(scenario), last["F_cd"][:3]
    np.testing.assert_allclose(f, [20.0, 0.05 / l, -0.03 / l])
    e_f = (np.eye(3) - K_e @ np.linalg.inv(K_m1 * np.eye(3) + K_e)) @ (K_e - K_hat) @ np.linalg.inv(K_hat) @ f
    np.testing.assert_allclose(last["F_c"][:3] - f, e_f, atol=5e-3)
    assert (np.abs(e_f[1:]).min() > 0.02) == (K_m1 > 0.0)


def test_steady_moment_of_an_impedance_against_a_tilted_plane() -> None:
    """F_ss = K_e K_m (x_d - x_e) / (K_m + K_e) along the normal, and with K_t, K_m l^2 and the tilt about an axis: a
    tool that holds its place and its attitude in a plane that is 0.05 rad off its face."""
    still = {"motion": "hold", "truth__link_scaling": 1.0, "contact__unilateral": False, "face__flat": True}
    scenario, depth, tilt, K_t, K_e = changed(shipped()["ur5-impedance"], **still), 0.004, 0.05, 20.0, 8000.0
    empty = assemble(edited(scenario, "face.flat", False))
    at, l = empty.nominal.evaluate(empty.q_0, np.zeros(6)), empty.layout.l
    into = np.array([np.sin(tilt), 0.0, -np.cos(tilt)])  # turned about y from where the face looks
    scenario = changed(
        scenario,
        surface={"kind": "plane", "origin": (at.p - depth * into).tolist(), "normal": into.tolist()},
        contact__K_e=K_e,
        face__normal=(at.R.T @ np.array([0.0, 0.0, -1.0])).tolist(),
        face__K_t=K_t,
        target_model={"M_m": [8.0] * 6, "B_m": [150.0] * 6, "K_m": [900.0] * 6, "K_f": [1.0] * 6},
    )
    loop = ClosedLoop.from_scenario(scenario)
    CompiledRun(loop).advance(3000)
    assert loop.stopped is None
    last = loop.recording.at(loop.t)
    pressed = depth / (1.0 / K_e + 1.0 / 900.0)  # the model's spring in series with the surface's
    turned = tilt / (1.0 / K_t + 1.0 / (900.0 * l**2))
    assert last["multiplier"][0] == pytest.approx(pressed, rel=2e-3)
    # what the tool exerts turns the plane to where the face looks
    np.testing.assert_allclose(last["moment_true"], [0.0, turned, 0.0], atol=2e-3 * abs(turned))


def test_compiled_run_has_the_rows_of_the_steps() -> None:
    noise = {"sensor__moment_noise": 0.01, "sensor__moment_delay": 0.002, "contact__B_e": 20.0}
    stepped, compiled = (ClosedLoop.from_scenario(changed(shipped()[ALIGN], **noise)) for _ in range(2))
    CompiledRun(compiled).advance(300)
    for _ in range(300):
        stepped.advance()
    assert np.abs(stepped.recording.signals(("moment_true",))["moment_true"]).max() > 0.01
    for signal, expected in stepped.recording.stretch().items():
        within = 5e-11 * np.nanmax(np.abs(expected), initial=1e-3)
        found = compiled.recording.stretch()[signal]
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=within, err_msg=signal)


def test_sampled_loop_has_the_poles_of_the_model_with_the_tilts(system: System) -> None:
    q, _ = system.posture_at(system.q_0, 0.0)
    model = np.sort_complex(sampled_loop(system, q, 0.0).model)
    M_m, B_m = system.controller.model.M_m[1, 1], system.controller.model.B_m[1, 1]
    tilt = np.roots([M_m, B_m, true_stiffness(system.scenario)[1, 1]])
    for pole in tilt:
        assert np.abs(model - pole).min() < 1e-3 * abs(pole)


REFUSED = {
    "a sphere": ({"surface": "sphere"}, r"face\.flat: true on a surface of kind 'sphere'; allowed: on a plane"),
    "a mass": ({"contact__kind": "mass-damper-spring"}, r"face\.flat: true with contact\.kind 'mass-damper-spring'"),
    "a joint less": ({"task_space__supplemental": [4, 5, 6, 7]}, r"without the tool's angles among the coordinates"),
    "the other side": ({"face__normal": [0.0, 0.0, -1.0]}, r"face\.normal: \[0\.0, 0\.0, -1\.0\], 3\..* rad off"),
    "a second surface": ({"second__contact__kind": "elastic"}, r"face\.flat: true on 2 surfaces; allowed: on one"),
    "a moment": (
        {"face__moment": [5.0, 0.0]},
        r"face\.moment: \[5\.0, 0\.0\] N·m.*; allowed: a size below 0\.5477 ",
    ),
    "a moment of both axes": ({"face__moment": [0.4, -0.4]}, r"face\.moment: .* of size 0\.5657 N·m, .* below 0\.5477"),
    "a moment where the force is least": (
        {"face__moment": [0.3, 0.0], "force": {"kind": "sinusoid", "value": 20.0, "amplitude": 10.0}},
        r"face\.moment: .* force is 10 N; allowed: a size below 0\.2739 N·m",
    ),
    "a moment before a step": (
        {"face__moment": [0.3, 0.0], "force": {"kind": "step", "value": 20.0, "start": 10.0}},
        r"face\.moment: .* force is 10 N; allowed: a size below 0\.2739 N·m",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_flat_tool_that_cannot_be_is_refused(name: str) -> None:
    changes, message = REFUSED[name]
    with pytest.raises(ScenarioError, match=message):
        assemble(changed(shipped()[ALIGN], **changes))


def test_a_moment_just_below_that_which_lifts_a_side_is_reached() -> None:
    """|m| < f_n a / 2, a = sqrt(2 K_t / K_e): on a plane at rest the foot that is pressed least still presses."""
    scenario, largest = shipped()[ALIGN], 0.5 * 20.0 * np.sqrt(2.0 * 15.0 / 1e4)
    still = {"motion": "hold", "surface__tilt": {}, "surface__normal": [0.0, 0.0, -1.0]}
    loop = ClosedLoop.from_scenario(changed(scenario, **still, face__moment=[0.0, float(0.98 * largest)]))
    CompiledRun(loop).advance(4000)
    assert loop.stopped is None
    last = loop.recording.at(loop.t)
    assert loop.system.layout.l * last["F_c"][1:3] == pytest.approx([0.0, 0.98 * largest], abs=0.01)
    phi, tilt = last["r"][0], np.linalg.norm(last["r"][1:3]) / loop.system.layout.l
    assert 0.0 < phi - face_radius(15.0, 1e4) * tilt < 0.1 * phi
    assemble(changed(scenario, face__moment=[5.0, 0.0], contact__unilateral=False))
