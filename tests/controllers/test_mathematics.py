"""The paper's equations for full matrices, arbitrary gains and every kind of task coordinates."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pinocchio as pin
import pytest
from scipy.linalg import expm

from controllers.modes import MODES
from controllers.reaching import ReachingCertificate, envelope
from controllers.reference_estimates import FeedforwardModel
from controllers.switching import SWITCHING
from controllers.target_model import InvalidGain, TargetModel, require_spd
from environments.acceleration import Arm, PlantWorkspace, accelerate_heavy
from environments.contact import Contact, ContactKinematics, Contacts, Face, World
from environments.coupled_surfaces import EnvironmentMatrices
from environments.force_profiles import table as forces
from environments.force_profiles.sinusoid import ForceSinusoid
from environments.force_profiles.step import ForceStep
from environments.trajectories import table as paths
from environments.trajectories.circle import Circle
from environments.trajectories.line import Line
from environments.trajectories.point_to_point import PointToPoint
from kernels.records import Record
from tests.support.arms import (
    CHARTS,
    ROBOTS,
    arm,
    charted,
    lipschitz_of,
    random_law,
    random_reference,
    random_spd,
    random_state,
    unit_vector,
)
from tests.support.identities import (
    assert_acceleration_of_coordinates,
    assert_derivatives_of_coordinates,
    assert_properties_1_and_2,
    assert_torque_is_force_in_task_space,
    inertia_and_coriolis,
)

FEEDBACK = ("none", "normal", "all")


@pytest.fixture
def random() -> np.random.Generator:
    return np.random.default_rng(0)


@pytest.mark.parametrize("chart", CHARTS)
@pytest.mark.parametrize("robot", ROBOTS)
class TestTaskSpace:
    """(3), (5) in every kind of coordinates."""

    def test_each_derivative_by_itself(self, robot: str, chart: str, random: np.random.Generator) -> None:
        system = charted(robot, chart)
        assert_derivatives_of_coordinates(system, random_state(system, random))

    def test_acceleration_along_a_smooth_curve(self, robot: str, chart: str, random: np.random.Generator) -> None:
        system = charted(robot, chart)
        assert_acceleration_of_coordinates(system, random_state(system, random))

    def test_properties_1_and_2(self, robot: str, chart: str, random: np.random.Generator) -> None:
        system = charted(robot, chart)
        assert_properties_1_and_2(system, random_state(system, random))


def controlled(feedback: str, n: int) -> np.ndarray:
    return {"none": np.zeros(n), "normal": np.eye(n)[0], "all": np.ones(n)}[feedback]


@pytest.mark.parametrize("feedback", FEEDBACK)
@pytest.mark.parametrize("chart", CHARTS)
@pytest.mark.parametrize("robot", ROBOTS)
def test_law_in_joint_space_is_the_law_in_task_space(
    robot: str, chart: str, feedback: str, random: np.random.Generator
) -> None:
    system = charted(robot, chart)
    n, switching = system.robot.n, list(SWITCHING.values())[random.integers(4)]
    law = random_law(random, n, switching, controlled(feedback, n))
    assert_torque_is_force_in_task_space(system, law, random_state(system, random), random)


@pytest.mark.parametrize("kind", ["vsmrc", "computed-torque"])
@pytest.mark.parametrize("chart", CHARTS)
@pytest.mark.parametrize("robot", ROBOTS)
def test_known_arm_obeys_the_target_model(robot: str, chart: str, kind: str, random: np.random.Generator) -> None:
    """(14) with H s_dot + C s = -K_s s - d sigma(s), the inside of (22); and (8) at once under computed torque."""
    system = charted(robot, chart)
    n = system.robot.n
    law = random_law(random, n, SWITCHING["saturation"], np.ones(n), kind=kind)
    q, q_dot, t = random_state(system, random)
    estimate, task = system.observe(q, q_dot, t)
    reference, z, F = random_reference(task.r, random), random.standard_normal(n), random.standard_normal(6)
    out = law.evaluate(z, reference, task, estimate, FeedforwardModel.at(estimate), q, q_dot, F)

    J = np.vstack([estimate.J_v, estimate.J_w])
    q_ddot = pin.aba(system.robot.model, system.robot.model.createData(), q, q_dot, out.tau - J.T @ F)
    e_r_ddot = task.J_q @ q_ddot + task.J_q_dot @ q_dot + task.v_t_dot - reference.r_d_ddot
    H, C = inertia_and_coriolis(system, q, q_dot, t)
    s_dot = -np.linalg.solve(H, C @ out.s + law.K_s @ out.s + out.d * unit_vector(out.s, law.switching, law.layer))
    reaching = law.model.M_m @ (s_dot - law.compensator.A @ out.s) if law.law.robust else np.zeros(n)
    residual = law.model.residual(out.e_r, out.e_r_dot, e_r_ddot, out.e_Fc)
    np.testing.assert_allclose(residual, reaching, atol=1e-8 * np.abs(e_r_ddot).max() * 30.0)


@pytest.mark.parametrize("robot", ROBOTS)
def test_gravity_link_by_link(robot: str, random: np.random.Generator) -> None:
    system = arm(robot)
    q, q_dot, _ = random_state(system, random)
    G_links = system.nominal.evaluate(q, q_dot).G_links
    for link in range(1, system.robot.n + 1):
        alone = system.robot.model.copy()
        for other in set(range(1, alone.njoints)) - {link}:
            alone.inertias[other] = pin.Inertia.Zero()
        gravity = pin.computeGeneralizedGravity(alone, alone.createData(), q)
        np.testing.assert_allclose(G_links[link - 1], gravity, atol=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("chart", CHARTS[2:])
def test_contact_acceleration_of_a_moving_surface(chart: str, random: np.random.Generator) -> None:
    """phi_ddot = grad(phi) p_ddot + bias, the mixed term twice in it, along a curve p(t)."""
    shapes = charted("ur5", chart).charted.shapes
    middle, swing, t, h = charted("ur5", chart).nominal.evaluate(arm("ur5").q_0, np.zeros(6)).p, 0.05, 0.3, 1e-3
    u, v = random.standard_normal((2, 3))
    contacts = Contacts.of((Contact(0.0, 0.0, 1.0, False, 0.0, 0.0),))
    environment = EnvironmentMatrices.apart(*np.zeros((3, shapes.number)))
    world = World(np.zeros(3), Face.point(), shapes, contacts, False, environment, np.zeros(3))
    workspace = Record(PlantWorkspace.of(world, charted("ur5", chart).plant.truth.resistance, 3))
    M = turned = np.eye(3, order="F")  # as Pinocchio has them, for which the kernel is compiled already
    state, still = Record.zeros(Arm, 3), np.zeros(3)

    def touch(time: float, p: np.ndarray, p_dot: np.ndarray, p_ddot: np.ndarray) -> ContactKinematics:
        """Of three orthogonal sliders whose directions turn just so that p_ddot follows without their acceleration."""
        J, J_dot = np.eye(6, 3, order="F"), np.zeros((6, 3), order="F")
        J_dot[:3] = np.outer(p_ddot, p_dot) / max(p_dot @ p_dot, 1e-9)
        state.views.q_dot[:] = p_dot
        accelerate_heavy(workspace.data, M, still, J, J_dot, turned, p, state.data, still, time)
        return workspace.read().touch.first

    def phi(time: float) -> float:
        p = middle + swing * (u * np.sin(2 * time) + v * np.cos(3 * time))
        return touch(time, p, np.zeros(3), np.zeros(3)).phi

    p = middle + swing * (u * np.sin(2 * t) + v * np.cos(3 * t))
    p_dot = swing * (2 * u * np.cos(2 * t) - 3 * v * np.sin(3 * t))
    p_ddot = -swing * (4 * u * np.sin(2 * t) + 9 * v * np.cos(3 * t))
    at = touch(t, p, p_dot, p_ddot)
    near, far = (phi(t + h), phi(t - h)), (phi(t + 2 * h), phi(t - 2 * h))
    assert at.phi_dot == pytest.approx((8 * (near[0] - near[1]) - (far[0] - far[1])) / (12 * h), abs=1e-8)
    assert at.phi_ddot_bias == pytest.approx((16 * sum(near) - sum(far) - 30 * phi(t)) / (12 * h**2), abs=1e-6)


@pytest.mark.parametrize(("K_s", "epsilon"), [(20.0, 1.0), (300.0, 10.0)])
def test_promise_is_sharp_for_a_mass(K_s: float, epsilon: float) -> None:
    """k s_dot = -K_s s - epsilon sign(s), the worst case of (23): (18) and (20) are its exact solution."""
    k, s_0 = 8.0, 0.4
    certificate = ReachingCertificate(k, k, K_s, epsilon, V_0=0.5 * k * s_0**2)
    t_r = k / K_s * np.log1p(K_s * s_0 / epsilon)
    t = np.linspace(0.0, t_r, 20)
    s = (s_0 + epsilon / K_s) * np.exp(-K_s / k * t) - epsilon / K_s
    assert certificate.t_r == pytest.approx(t_r)
    np.testing.assert_allclose([envelope(certificate.bound, each) for each in t], s, atol=1e-12)
    assert envelope(certificate.bound, 1.1 * t_r) == 0.0
    wider = ReachingCertificate(k / 4, k, K_s, epsilon, V_0=0.5 * k * s_0**2)
    np.testing.assert_allclose(
        [envelope(wider.bound, each) for each in t], 2 * s, atol=1e-12
    )  # sqrt(k_r''/k_r') times as much
    assert wider.t_r == certificate.t_r


@pytest.mark.parametrize("robot", ROBOTS)
def test_constants_over_omega_hold(robot: str) -> None:
    """k_C, k_M, k_Cq, k_G over postures and directions of which none was used to find them."""
    system, random = arm(robot), np.random.default_rng(9)
    constants, n = system.constants, system.robot.n
    u = lipschitz_of(system)
    links = [system.robot.model.copy() for _ in range(n)]
    for link, model in enumerate(links, start=1):
        for other in set(range(1, n + 1)) - {link}:
            model.inertias[other] = pin.Inertia.Zero()
    data = [model.createData() for model in links]
    for _ in range(300):
        towards, v, away = (x / np.linalg.norm(x) for x in random.standard_normal((3, n)))
        q = system.q_0 + constants.radius * random.uniform() ** (1 / n) * away
        per_link = [pin.computeCoriolisMatrix(m, d, q, v) for m, d in zip(links, data, strict=True)]
        assert sum(np.linalg.norm(C, 2) for C in per_link) <= u.k_C
        h = 1e-3
        here, beside = (system.nominal.evaluate(x, v) for x in (q, q + h * towards))
        assert np.linalg.norm(here.M_hat - beside.M_hat, 2) <= u.k_M * h
        assert np.linalg.norm(here.C_hat - beside.C_hat, 2) <= u.k_Cq * h
        assert np.linalg.norm(here.G_hat - beside.G_hat) <= u.k_G * h


def test_poles_are_those_of_the_response(random: np.random.Generator) -> None:
    """e(t) of (8) pressing on K_e: exp of the poles are the eigenvalues of the transition matrix."""
    n = 3
    M_m, B_m, K_m, K_f = (random_spd(random, n, 1.0, 9.0) for _ in range(4))
    model = TargetModel(M_m, B_m, K_m, K_f)
    K_e = random_spd(random, n, 1.0, 5.0)
    M_inv = np.linalg.inv(model.M_m)
    system = np.block([
        [np.zeros((n, n)), np.eye(n)],
        [-M_inv @ (model.K_m + model.K_f @ K_e), -M_inv @ model.B_m],
    ])  # fmt: skip
    transition = np.linalg.eigvals(expm(system))
    np.testing.assert_allclose(np.sort_complex(np.exp(model.poles(K_e))), np.sort_complex(transition), atol=1e-9)


PATHS = {
    "point to point": PointToPoint(displacement=(0.1, -0.2), duration=0.8),
    "circle": Circle(radius=0.3, period=2.0, ramp=0.7),
    "circle at once": Circle(radius=0.3, period=2.0, ramp=0.0),
    "line": Line(displacement=(0.3, 0.1), period=1.5, ramp=0.7),
    "force step": ForceStep(value=20.0, start=5.0, time=0.2, rise=0.5),
    "force sinusoid": ForceSinusoid(value=20.0, amplitude=5.0, frequency=1.5),
}


@pytest.mark.parametrize("path", PATHS.values(), ids=PATHS.keys())
def test_references_have_exact_derivatives(path: PointToPoint | Circle | Line | ForceStep | ForceSinusoid) -> None:
    h = 1e-5
    if isinstance(path, ForceStep | ForceSinusoid):
        at = partial(forces.evaluated, forces.course_of(path))
    else:
        at = partial(paths.evaluated, paths.course_of("motion", path, 2, range(2)))
        np.testing.assert_allclose(at(0.0).value, 0.0, atol=1e-15)
    for t in np.linspace(0.013, 1.2, 9):
        before, here, after = (at(float(t + dt)) for dt in (-h, 0.0, h))
        np.testing.assert_allclose((after[0] - before[0]) / (2 * h), here[1], atol=1e-6)
        np.testing.assert_allclose((after[1] - before[1]) / (2 * h), here[2], atol=1e-5)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"epsilon": 0.0}, r"controller\.epsilon: 0\.0; allowed: a number > 0"),
        ({"epsilon": float("nan")}, r"controller\.epsilon: nan"),
        ({"d": -1.0}, r"controller\.d: -1\.0"),
        ({"layer": 0.0}, r"controller\.layer: 0\.0"),
        ({"layer": float("nan")}, r"controller\.layer: nan"),
        ({"K_s": np.ones((3, 3))}, r"controller\.K_s: smallest eigenvalue"),
        ({"K_s": np.eye(2)}, r"controller\.K_s: shape \(2, 2\)"),
        ({"K_s": np.eye(3) + np.eye(3, k=1)}, r"controller\.K_s: not symmetric"),
    ],
)
def test_law_refuses_by_name(change: dict[str, object], said: str, random: np.random.Generator) -> None:
    law = random_law(random, 3, SWITCHING["saturation"], np.ones(3))
    with pytest.raises(InvalidGain, match=said):
        replace(law, **change)


def test_a_model_that_does_not_settle_is_refused() -> None:
    """Positive definite matrices are stable, but a stiffness of nothing leaves a pole at zero."""
    lazy = TargetModel(np.eye(2), 1e4 * np.eye(2), 1e-9 * np.eye(2), np.zeros((2, 2)))
    with pytest.raises(InvalidGain, match=r"target_model: unstable in contact, a pole at"):
        MODES["motion"].check(lazy, K_e_hat=1e4)
    with pytest.raises(InvalidGain, match=r"K_m: not symmetric"):
        require_spd("K_m", np.array([[2.0, 1.0], [0.0, 2.0]]))
