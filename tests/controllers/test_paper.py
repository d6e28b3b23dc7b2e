"""The paper's identities at random states, for every arm and surface: what must hold whatever the gains."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pinocchio as pin
import pytest

from app.scenario.data import edited, from_plain, shipped, to_plain
from app.scenario.errors import ScenarioError
from app.simulation.assembly import assemble
from app.simulation.system import System
from controllers.compensator import Compensator
from controllers.control_law import Reference
from controllers.nominal_model import Estimate
from controllers.reference_estimates import FeedforwardModel
from controllers.switching import Switching, layer_width
from controllers.target_model import InvalidGain, TargetModel
from environments.robots import CATALOGUE
from tests.support.arms import unit_vector
from tests.support.cases import scenario_of, surfaces_for

pytestmark = pytest.mark.usefixtures("rough_constants")  # identities hold whatever the gain

STEP = 1e-5  # of differences, rad and s
MOVING = [(robot, surface) for robot in CATALOGUE for surface in surfaces_for(robot)]


@cache
def system_of(robot: str, surface: str, bounds: str = "tight") -> System:
    scenario = scenario_of(robot, "hybrid-impedance", "elastic", surface)
    assert scenario.controller.bounds == "tight"
    return assemble(edited(scenario, "controller.bounds", bounds))


def random_state(system: System, seed: int) -> tuple[np.ndarray, np.ndarray, float]:
    random = np.random.default_rng(seed)
    n = system.robot.n
    return system.q_0 + random.uniform(-0.15, 0.15, n), random.uniform(-1.0, 1.0, n), random.uniform(0.1, 1.0)


def derivative(function: Callable[[float], np.ndarray], t: float = 0.0, step: float = STEP) -> np.ndarray:
    """Central difference, fourth order."""
    near, far = function(t + step) - function(t - step), function(t + 2 * step) - function(t - 2 * step)
    return (8 * near - far) / (12 * step)


@pytest.mark.parametrize("robot", CATALOGUE)
def test_estimates_are_those_of_recursive_newton_euler(robot: str) -> None:
    system = system_of(robot, "plane")
    model, data = system.robot.model, system.robot.model.createData()
    for seed in range(3):
        q, q_dot, _ = random_state(system, seed)
        q_ddot = np.random.default_rng(seed).standard_normal(system.robot.n)
        e = system.nominal.evaluate(q, q_dot)
        torque = pin.rnea(model, data, q, q_dot, q_ddot) + (0 if _has_armature_in_rnea() else model.armature * q_ddot)
        np.testing.assert_allclose(e.M_hat @ q_ddot + e.C_hat @ q_dot + e.G_hat, torque, atol=1e-10)
        np.testing.assert_allclose(e.G_links.sum(axis=0), pin.computeGeneralizedGravity(model, data, q), atol=1e-10)
        np.testing.assert_allclose(e.M_hat - e.M_links, np.diag(model.armature), atol=1e-12)
        assert_kinematics(system, q, q_dot)


def assert_kinematics(system: System, q: np.ndarray, q_dot: np.ndarray) -> None:
    def moved(h: float) -> Estimate:
        return system.nominal.evaluate(q + h * q_dot, q_dot)

    e = moved(0.0)
    np.testing.assert_allclose(derivative(lambda h: moved(h).p), e.J_v @ q_dot, atol=1e-8)
    np.testing.assert_allclose(derivative(lambda h: moved(h).J_v), e.J_v_dot, atol=1e-8)
    np.testing.assert_allclose(derivative(lambda h: moved(h).J_w), e.J_w_dot, atol=1e-8)
    np.testing.assert_allclose(derivative(lambda h: moved(h).R) @ e.R.T, pin.skew(e.J_w @ q_dot), atol=1e-8)


def _has_armature_in_rnea() -> bool:
    model = pin.buildSampleModelManipulator()
    model.armature = np.ones(model.nv)
    zero, one = np.zeros(model.nv), np.eye(model.nv)[0]
    data = model.createData()
    with_rotor = pin.rnea(model, data, zero, zero, one)[0]
    model.armature = np.zeros(model.nv)
    return not np.isclose(with_rotor, pin.rnea(model, data, zero, zero, one)[0])


@pytest.mark.parametrize(("robot", "surface"), MOVING)
def test_task_space_and_its_derivatives(robot: str, surface: str) -> None:
    """(3): r_dot = J_q q_dot + v_t and r_ddot = J_q q_ddot + J_q_dot q_dot + v_t_dot along a curve q(t)."""
    system = system_of(robot, surface)
    q, q_dot, t = random_state(system, 1)
    q_ddot = np.random.default_rng(2).uniform(-1, 1, system.robot.n)

    def task(h: float):
        return system.observe(q + h * q_dot + 0.5 * h * h * q_ddot, q_dot + h * q_ddot, t + h)[1]

    here = task(0.0)
    np.testing.assert_allclose(derivative(lambda h: task(h).r), here.r_dot, atol=1e-8)
    np.testing.assert_allclose(derivative(lambda h: task(h).J_q), here.J_q_dot, atol=1e-7)
    r_ddot = here.J_q @ q_ddot + here.J_q_dot @ q_dot + here.v_t_dot
    np.testing.assert_allclose(derivative(lambda h: task(h).r_dot), r_ddot, atol=1e-7)
    np.testing.assert_allclose(here.J_q_inv @ here.J_q, np.eye(system.robot.n), atol=1e-9)
    if "moving" in surface:
        assert np.linalg.norm(here.v_t) > 1e-3
    for k in range(5):
        assert 1.0 - 1e-12 <= task(1e-3 * k).J_q_inv_norm / np.linalg.norm(task(1e-3 * k).J_q_inv, 2) <= 1.04


@pytest.mark.parametrize(("robot", "surface"), MOVING)
def test_inertia_is_spd_and_property_2_holds(robot: str, surface: str) -> None:
    """(5): H s.p.d. and H_dot - 2 C skew-symmetric, which needs the Christoffel matrix."""
    system = system_of(robot, surface)
    q, q_dot, t = random_state(system, 3)

    def H(h: float) -> np.ndarray:
        e, task = system.observe(q + h * q_dot, q_dot, t + h)
        return task.J_q_inv.T @ e.M_hat @ task.J_q_inv

    e, task = system.observe(q, q_dot, t)
    J_inv = task.J_q_inv
    C = J_inv.T @ e.C_hat @ J_inv - H(0.0) @ task.J_q_dot @ J_inv
    N = derivative(H) - 2 * C
    scale = np.abs(C).max()
    np.testing.assert_allclose(N, -N.T, atol=1e-6 * scale)
    np.testing.assert_allclose(H(0.0), H(0.0).T, atol=1e-9 * np.abs(H(0.0)).max())
    assert np.linalg.eigvalsh(H(0.0))[0] > 0


@pytest.mark.parametrize(("robot", "surface"), MOVING)
@pytest.mark.parametrize("bounds", ["tight", "paper"])
def test_torque_25_is_force_15_in_task_space(robot: str, surface: str, bounds: str) -> None:
    system = system_of(robot, surface, bounds)
    n, random = system.robot.n, np.random.default_rng(5)
    q, q_dot, t = random_state(system, 4)
    e, task = system.observe(q, q_dot, t)
    reference = Reference(
        task.r + 0.01 * random.standard_normal(n), *(random.standard_normal(n) for _ in range(2)), np.zeros(n)
    )
    z, F = random.standard_normal(n), random.standard_normal(6)
    out = system.controller.evaluate(z, reference, task, e, FeedforwardModel.at(e), q, q_dot, F)
    c, J_inv = system.controller.compensator, task.J_q_inv
    e_r, e_r_dot = task.r - reference.r_d, task.r_dot - reference.r_d_dot
    F_r = J_inv.T @ np.vstack([e.J_v, e.J_w]).T @ F
    z_dot = c.A @ z + c.K_pz @ e_r + c.K_vz @ e_r_dot + c.K_fz @ out.F_c
    s = e_r_dot + c.F_1 @ e_r + c.F_2 @ z
    r_eq_dot, r_eq_ddot = task.r_dot - s, reference.r_d_ddot - c.F_1 @ e_r_dot - c.F_2 @ z_dot
    H = J_inv.T @ e.M_hat @ J_inv
    C = J_inv.T @ e.C_hat @ J_inv - H @ task.J_q_dot @ J_inv
    F_t = -H @ task.v_t_dot - C @ task.v_t
    robust = system.controller.K_s @ s + out.d * s / max(np.linalg.norm(s), system.controller.layer)
    T_r = H @ r_eq_ddot + C @ r_eq_dot + J_inv.T @ e.G_hat + F_t + F_r - robust
    np.testing.assert_allclose(out.tau, task.J_q.T @ T_r, atol=1e-8 * np.abs(out.tau).max())
    np.testing.assert_allclose(out.s, s, atol=1e-12)
    np.testing.assert_allclose(sum(out.terms), out.tau, atol=1e-9)
    # what makes contact: the normal part of F, and F_r along the surface (38)
    np.testing.assert_allclose(out.F_c[1:], F_r[1:], atol=1e-9)
    np.testing.assert_allclose(out.F_c[0], task.normals[0] @ F[:3], atol=1e-12)


def random_model(random: np.random.Generator, n: int) -> TargetModel:
    matrices = random.standard_normal((4, n, n)) + 4 * np.eye(n)
    return TargetModel(*matrices)


def test_sliding_mode_is_the_target_model() -> None:
    """(9)-(14) for full matrices: M_m e_ddot + B_m e_dot + K_m e + K_f e_F = M_m (s_dot - A s), identically."""
    random = np.random.default_rng(0)
    for _ in range(20):
        n = 4
        model = random_model(random, n)
        c = Compensator.design(model, -random.uniform(0, 3, n), random.uniform(-3, 3, n), random.uniform(0.5, 2, n))
        e, e_dot, e_ddot, e_F, z = random.standard_normal((5, n))
        z_dot = c.A @ z + c.K_pz @ e + c.K_vz @ e_dot + c.K_fz @ e_F
        s, s_dot = e_dot + c.F_1 @ e + c.F_2 @ z, e_ddot + c.F_1 @ e_dot + c.F_2 @ z_dot
        np.testing.assert_allclose(model.residual(e, e_dot, e_ddot, e_F), model.M_m @ (s_dot - c.A @ s), atol=1e-9)
        at_rest = e_dot + c.F_1 @ e + c.F_2 @ c.without_reaching(e, e_dot)
        np.testing.assert_allclose(at_rest, 0.0, atol=1e-12)


@pytest.mark.parametrize("kind", Switching)
def test_switching_functions(kind: Switching) -> None:
    random = np.random.default_rng(1)
    layer = 0.01
    for size in (1e-4, 0.01, 1.0):
        s = random.standard_normal(5)
        s *= size / np.linalg.norm(s)
        sigma = unit_vector(s, int(kind), layer)
        assert np.linalg.norm(sigma) <= 1.0 + 1e-12
        assert np.isclose(sigma @ s, np.linalg.norm(sigma) * np.linalg.norm(s))
        np.testing.assert_allclose(unit_vector(s, int(kind), 1e-12 * size), s / size, atol=1e-10)
    d, epsilon = 20.0, 2.0
    width = layer_width(int(kind), layer, d, epsilon)
    outside = unit_vector(np.array([width * (1 + 1e-9) + 1e-15, 0.0]), int(kind), layer)[0]
    assert d * outside >= d - (1.0 - kind.reaching_share) * epsilon - 1e-6
    assert np.array_equal(unit_vector(np.zeros(3), int(kind), layer), np.zeros(3))


@pytest.mark.parametrize(
    ("mode", "path", "value", "said"),
    [
        ("motion", "target_model.M_m", [0.0, 1, 1, 1, 1, 1], "target_model.M_m: singular"),
        ("motion", "target_model.K_m", [-1.0, 1, 1, 1, 1, 1], "target_model.K_m: smallest eigenvalue -1"),
        ("motion", "target_model.K_f", [1.0, 0, 0, 0, 0, 0], "target_model.K_f: an entry that motion mode fixes at 0"),
        ("impedance", "target_model.B_m", [0.0, 1, 1, 1, 1, 1], "target_model.B_m: smallest eigenvalue 0"),
        ("hybrid", "target_model.K_m", [-1.0, 1, 1, 1, 1, 1], "target_model.K_m1: smallest eigenvalue -1"),
        ("hybrid", "target_model.K_f", [0.0, 0, 0, 0, 0, 0], "target_model.K_f1: smallest eigenvalue 0"),
        ("hybrid", "target_model.K_f", [1.0, 1, 0, 0, 0, 0], "target_model.K_f: an entry that hybrid mode fixes"),
        ("constrained", "target_model.K_m", [1.0, 1, 1, 1, 1, 1], "target_model.K_m: an entry that constrained mode"),
        ("motion", "target_model.M_m", [1.0, 2.0], "target_model.M_m: 2 entries; allowed: 6"),
        ("motion", "controller.A", 0.5, "controller.A: 0.5 on the diagonal; allowed: entries <= 0"),
        ("motion", "controller.F_2", [1.0, 1, 0, 1, 1, 1], "controller.F_2: singular"),
        ("motion", "controller.K_s", -1.0, "controller.K_s: smallest eigenvalue -1"),
        ("motion", "target_model.B_m", [[float("nan")] * 6] * 6, "nan; allowed: a finite number"),
    ],
)
def test_invalid_gains_are_refused_by_name(mode: str, path: str, value: object, said: str) -> None:
    with pytest.raises(ScenarioError) as refusal:
        assemble(
            edited(scenario_of("ur5", mode, "rigid" if mode == "constrained" else "elastic", "plane"), path, value)
        )
    assert said in str(refusal.value)


def test_types_refuse_what_the_theory_does_not_admit() -> None:
    with pytest.raises(InvalidGain, match=r"target_model.B_m: shape \(3, 3\)"):
        TargetModel(np.eye(2), np.eye(3), np.eye(2), np.eye(2))
    with pytest.raises(InvalidGain, match=r"target_model.K_m: has an entry that is not a finite number"):
        TargetModel(np.eye(2), np.eye(2), np.full((2, 2), np.inf), np.eye(2))
    with pytest.raises(InvalidGain, match=r"controller.F_1: not diagonal"):
        Compensator.design(TargetModel(*[np.eye(2)] * 4), np.zeros(2), np.ones((2, 2)), np.ones(2))


@pytest.mark.parametrize("kind", [Switching.RATIONAL, Switching.TANH])
def test_a_gain_below_half_of_the_margin_has_no_layer(kind: Switching) -> None:
    """Outside of which it would keep anything: the band is that of ||s|| = 0, a number."""
    assert layer_width(int(kind), 0.01, 0.5, 2.0) == 0.0


def test_a_singular_start_is_refused() -> None:
    straight = edited(edited(shipped()["planar2r-semicircle"], "robot.posture", [0.0, 0.0]), "mode", "motion")
    with pytest.raises(ScenarioError, match=r"robot.posture: \[0.0, 0.0\] rad; allowed: one at which J_q"):
        assemble(edited(edited(straight, "contact.kind", "free"), "target_model", {}))


def test_unstable_target_model_is_refused() -> None:
    data = to_plain(shipped()["ur5-hybrid"])
    model = [[10.0 if i == j else 0.0 for j in range(6)] for i in range(6)]
    # symmetric positive definite, but the mode requires s.p.d. blocks: couple what the mode keeps apart
    model[0][1] = model[1][0] = 1.0
    data["target_model"] = {"B_m": model}
    with pytest.raises(ScenarioError, match="B_m"):
        assemble(from_plain(data))


def test_poles_are_those_of_the_model() -> None:
    model = TargetModel(np.diag([2.0, 5.0]), np.diag([8.0, 10.0]), np.diag([8.0, 105.0]), np.eye(2))
    np.testing.assert_allclose(np.sort_complex(model.poles()), [-2, -2, -1 - 4.4721359j, -1 + 4.4721359j], atol=1e-6)
    stiff = model.poles(np.diag([24.0, 0.0]))
    assert np.isclose(stiff, -2 + 3.4641016j, atol=1e-6).any()
