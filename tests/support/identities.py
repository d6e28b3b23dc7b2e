"""The paper's identities at a state, which hold for any arm, coordinates and gains; each is asserted."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from app.simulation.system import System
from controllers.controller import Controller
from controllers.reference_estimates import FeedforwardModel
from controllers.task_space import TaskSpace
from tests.support.arms import State, random_reference, unit_vector

STEP = 1e-5  # of differences, rad and s


def derivative(function: Callable[[float], np.ndarray]) -> np.ndarray:
    """At 0, by the central difference of fourth order."""
    near, far = function(STEP) - function(-STEP), function(2 * STEP) - function(-2 * STEP)
    return (8 * near - far) / (12 * STEP)


def inertia_and_coriolis(system: System, q: np.ndarray, q_dot: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
    """H, kg, and C, kg/s, of (5)."""
    estimate, task = system.observe(q, q_dot, t)
    J_inv = task.J_q_inv
    H = J_inv.T @ estimate.M_hat @ J_inv
    return H, J_inv.T @ estimate.C_hat @ J_inv - H @ task.J_q_dot @ J_inv


def assert_derivatives_of_coordinates(system: System, state: State) -> None:
    """(3): J_q = dr/dq, v_t = dr/dt; r_dot, J_q_dot and v_t_dot are total derivatives along the motion."""
    q, q_dot, t = state

    def task(dq: np.ndarray, dt: float) -> TaskSpace:
        return system.observe(q + dq, q_dot, t + dt)[1]

    def along(of: str) -> np.ndarray:
        return derivative(lambda h: getattr(task(h * q_dot, h), of))

    here, still = task(0.0 * q, 0.0), 0.0 * q
    J_q = np.stack([derivative(lambda h, e=e: task(h * e, 0.0).r) for e in np.eye(len(q))], axis=1)
    np.testing.assert_allclose(here.J_q, J_q, atol=1e-8)
    np.testing.assert_allclose(here.v_t, derivative(lambda h: task(still, h).r), atol=1e-8)
    np.testing.assert_allclose(here.r_dot, along("r"), atol=1e-8)
    np.testing.assert_allclose(here.J_q_dot, along("J_q"), atol=1e-7)
    np.testing.assert_allclose(here.v_t_dot, along("v_t"), atol=1e-7)
    np.testing.assert_allclose(here.J_q_inv @ here.J_q, np.eye(len(q)), atol=1e-9)
    assert 1.0 - 1e-12 <= here.J_q_inv_norm / np.linalg.norm(here.J_q_inv, 2) <= 1.04


def assert_acceleration_of_coordinates(system: System, state: State) -> None:
    """(3): r_ddot = J_q q_ddot + J_q_dot q_dot + v_t_dot against second differences of r(q(t), t) along an oscillation
    q(t), whose amplitude is a fifth of the state's velocity."""
    q_0, swing, t = state.q, 0.2 * state.q_dot, state.t
    omega, h = 3.0, 1e-3

    def r(time: float) -> np.ndarray:
        return system.observe(q_0 + swing * np.sin(omega * time), 0.0 * q_0, time)[1].r

    q, q_dot = q_0 + swing * np.sin(omega * t), omega * swing * np.cos(omega * t)
    q_ddot = -(omega**2) * swing * np.sin(omega * t)
    task = system.observe(q, q_dot, t)[1]
    r_ddot = task.J_q @ q_ddot + task.J_q_dot @ q_dot + task.v_t_dot
    near, far = r(t + h) + r(t - h), r(t + 2 * h) + r(t - 2 * h)
    np.testing.assert_allclose(r_ddot, (16 * near - far - 30 * r(t)) / (12 * h**2), atol=1e-6)


def assert_properties_1_and_2(system: System, state: State) -> None:
    """H s.p.d.; H_dot - 2 C skew-symmetric, which needs the Christoffel matrix."""
    q, q_dot, t = state
    H, C = inertia_and_coriolis(system, q, q_dot, t)
    N = derivative(lambda h: inertia_and_coriolis(system, q + h * q_dot, q_dot, t + h)[0]) - 2 * C
    np.testing.assert_allclose(H, H.T, atol=1e-10 * np.abs(H).max())
    assert np.linalg.eigvalsh(H)[0] > 0.0
    np.testing.assert_allclose(N, -N.T, atol=1e-7 * np.abs(H).max())


def assert_torque_is_force_in_task_space(
    system: System, law: Controller, state: State, random: np.random.Generator
) -> None:
    """(25) = J_q^T times (15), term by term, with z, s, r_eq from (9), (10), (16), near a random reference."""
    q, q_dot, t = state
    estimate, task = system.observe(q, q_dot, t)
    n, J_inv = len(q), task.J_q_inv
    reference, z, F = random_reference(task.r, random), random.standard_normal(n), random.standard_normal(6)
    out = law.evaluate(z, reference, task, estimate, FeedforwardModel.at(estimate), q, q_dot, F)

    c, (H, C) = law.compensator, inertia_and_coriolis(system, q, q_dot, t)
    e_r, e_r_dot = task.r - reference.r_d, task.r_dot - reference.r_d_dot
    J = np.vstack([estimate.J_v, estimate.J_w])
    F_r, normals = J_inv.T @ J.T @ F, task.normals[: law.surfaces]
    F_c = F_r.copy()
    F_c[: law.surfaces] = np.linalg.lstsq(normals.T, F[:3])[0]  # (39), (40): friction is no part of the multipliers
    F_c *= law.controlled
    e_Fc = law.controlled * (F_c - reference.F_cd)
    z_dot = c.A @ z + c.K_pz @ e_r + c.K_vz @ e_r_dot + c.K_fz @ e_Fc
    s = e_r_dot + c.F_1 @ e_r + c.F_2 @ z
    r_eq_dot = reference.r_d_dot - c.F_1 @ e_r - c.F_2 @ z
    r_eq_ddot = reference.r_d_ddot - c.F_1 @ e_r_dot - c.F_2 @ z_dot
    F_t = -H @ task.v_t_dot - C @ task.v_t
    robust = law.K_s @ s + out.d * unit_vector(s, law.switching, law.layer)
    T_r = H @ r_eq_ddot + C @ r_eq_dot + J_inv.T @ estimate.G_hat + F_t + F_r - robust

    np.testing.assert_allclose(out.tau, task.J_q.T @ T_r, atol=1e-9 * np.abs(out.tau).max())
    np.testing.assert_allclose(sum(out.terms), out.tau, atol=1e-12 * np.abs(out.tau).max())
    np.testing.assert_allclose(out.terms.force, J.T @ F, atol=1e-12)
    found = {"e_r": e_r, "e_r_dot": e_r_dot, "F_c": F_c, "e_Fc": e_Fc, "z_dot": z_dot, "s": s}
    for name, expected in found.items():
        np.testing.assert_allclose(getattr(out, name), expected, atol=1e-9, err_msg=name)
