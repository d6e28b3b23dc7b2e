"""The paper's identities at random states, for every arm and surface: what must hold whatever the gains."""

from __future__ import annotations

from functools import cache

import numpy as np
import pinocchio as pin
import pytest

from app.scenario.data import edited, from_plain, shipped, to_plain
from app.scenario.errors import ScenarioError
from app.simulation.assembly import assemble
from app.simulation.system import System
from controllers.compensator import Compensator
from controllers.nominal_model import Estimate
from controllers.target_model import InvalidGain, TargetModel, require_spsd
from environments.catalogue import CATALOGUE
from tests.support.arms import State
from tests.support.cases import scenario_of
from tests.support.identities import assert_torque_is_force_in_task_space, derivative

pytestmark = pytest.mark.usefixtures("rough_constants")  # identities hold whatever the gain


@cache
def system_of(robot: str, surface: str, bounds: str = "tight") -> System:
    scenario = scenario_of(robot, "hybrid-impedance", "elastic", surface)
    assert scenario.controller.bounds == "tight"
    return assemble(edited(scenario, "controller.bounds", bounds))


def random_state(system: System, seed: int) -> State:
    random = np.random.default_rng(seed)
    n = system.robot.n
    return State(system.q_0 + random.uniform(-0.15, 0.15, n), random.uniform(-1.0, 1.0, n), random.uniform(0.1, 1.0))


@pytest.mark.parametrize("robot", CATALOGUE)
def test_estimates_are_those_of_recursive_newton_euler(robot: str) -> None:
    system = system_of(robot, "plane")
    model, data = system.robot.model, system.robot.model.createData()
    for seed in range(3):
        q, q_dot, _ = random_state(system, seed)
        q_ddot = np.random.default_rng(seed).standard_normal(system.robot.n)
        e = system.nominal.evaluate(q, q_dot)
        torque = pin.rnea(model, data, q, q_dot, q_ddot)
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


@pytest.mark.parametrize("surface", ["plane", "moving sphere"])
@pytest.mark.parametrize("bounds", ["tight", "paper"])
@pytest.mark.parametrize("robot", CATALOGUE)
def test_controller_of_a_scenario_is_the_law_in_task_space(robot: str, bounds: str, surface: str) -> None:
    """On a surface, whose multiplier is the normal part of the measured force."""
    system = system_of(robot, surface, bounds)
    assert system.controller.surfaces == 1
    state = random_state(system, 4)
    assert_torque_is_force_in_task_space(system, system.controller, state, np.random.default_rng(5))


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


@pytest.mark.parametrize(
    ("mode", "path", "value", "message"),
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
def test_invalid_gains_are_refused_by_name(mode: str, path: str, value: object, message: str) -> None:
    with pytest.raises(ScenarioError) as refusal:
        assemble(
            edited(scenario_of("ur5", mode, "rigid" if mode == "constrained" else "elastic", "plane"), path, value)
        )
    assert message in str(refusal.value)


def test_types_refuse_what_the_theory_does_not_admit() -> None:
    with pytest.raises(InvalidGain, match=r"target_model.B_m: shape \(3, 3\)"):
        TargetModel(np.eye(2), np.eye(3), np.eye(2), np.eye(2))
    with pytest.raises(InvalidGain, match=r"target_model.K_m: has an entry that is not a finite number"):
        TargetModel(np.eye(2), np.eye(2), np.full((2, 2), np.inf), np.eye(2))
    with pytest.raises(InvalidGain, match=r"controller.F_1: not diagonal"):
        Compensator.design(TargetModel(*[np.eye(2)] * 4), np.zeros(2), np.ones((2, 2)), np.ones(2))


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
    stiff = np.sort_complex(model.poles(np.diag([24.0, 0.0])))
    in_contact, free = 2.0j * np.sqrt(3.0), 2.0j * np.sqrt(5.0)  # 2 s^2 + 8 s + 32, 5 s^2 + 10 s + 105
    np.testing.assert_allclose(stiff, [-2 - in_contact, -2 + in_contact, -1 - free, -1 + free], atol=1e-9)


def test_a_singular_stiffness_along_the_normals_is_admitted_however_it_is_rounded() -> None:
    for a, b in ((4.0, 19.0), (1.0, 3.0), (7.0, 11.0)):
        require_spsd("K_m1", 700.0 * np.outer([a, b], [a, b]))
    with pytest.raises(InvalidGain):
        require_spsd("K_m1", np.diag([1e5, -1e-3]))
