"""Bounds of the modelling errors and what the gain d must be: (6), (7), (17).

What is declared: every link's inertia is scaled by a factor in [1 - rho, 1 + rho] (rotor inertia is known), a point
mass of at most `payload_mass` sits within `payload_offset` of the tool point, joint friction and a disturbance are
bounded. Then -rho M_links <= Delta M <= rho M_links, and gravity link by link; two sets of bounds follow:

- "paper": (7), norms of joint-space errors times ||J_q^-1|| and ||J_q^-1||^2;
- "tight": the same argument in task space. With w = J_q q_eq_ddot, ||Delta H w|| <= rho sqrt(lambda_max(H) w^T H w).

Both bound the same perturbation ||Delta H r_eq_ddot + Delta C r_eq_dot + Delta G + Delta F_t + F_tilde||.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from controllers.nominal_model import Estimate
from controllers.norms import norm, spectral_norm
from controllers.task_space import TaskSpace


class Uncertainty(NamedTuple):
    """What the controller is told of its ignorance.

    rho (1): half-width of the links' scaling; payload_mass kg; payload_offset m; coulomb N m and viscous N m s/rad
    per joint; disturbance N m, norm of the torque; force_error N, norm of the sensor's error; k_C kg m^2/rad: the sum
    of the links' ||C_i(q, q_dot)|| is at most k_C ||q_dot|| over Omega.
    """

    rho: float
    payload_mass: float
    payload_offset: float
    coulomb: float
    viscous: float
    disturbance: float
    force_error: float
    k_C: float


class RequiredGain(NamedTuple):
    """The terms of (17), N: d must be at least their sum. In the tight bound task_motion is part of the others."""

    inertia: float
    coriolis: float
    gravity: float
    task_motion: float
    disturbance: float
    epsilon: float


@njit(cache=True, error_model="numpy")
def paper_bound(u, deviation, estimate, task, q_dot, r_eq_dot, r_eq_ddot):
    """Each product of (17) with the bounds (7); delta_Ft stands in `task_motion`."""
    J_inv = task.J_q_inv_norm
    reach = spectral_norm(estimate.J_v) + u.payload_offset * spectral_norm(estimate.J_w)
    reach_dot = spectral_norm(estimate.J_v_dot) + u.payload_offset * (
        spectral_norm(estimate.J_w_dot) + norm(estimate.J_w @ q_dot) * spectral_norm(estimate.J_w)
    )
    weight = 0.0
    for i in range(q_dot.shape[0]):
        weight += norm(estimate.G_links[i])
    delta_M = u.rho * spectral_norm(estimate.M_links) + u.payload_mass * reach**2 + deviation.delta_M
    delta_C_q = u.rho * u.k_C * norm(q_dot) + u.payload_mass * reach * reach_dot + deviation.delta_C
    delta_G_q = u.rho * weight + u.payload_mass * 9.81 * reach + deviation.delta_G
    delta_f = (
        u.coulomb * np.sqrt(q_dot.shape[0])
        + u.viscous * norm(q_dot)
        + u.disturbance
        + u.force_error * spectral_norm(estimate.J_v)
    )
    delta_H = delta_M * J_inv**2
    delta_C = delta_C_q * J_inv**2 + delta_M * J_inv * spectral_norm(task.J_q_inv @ task.J_q_dot @ task.J_q_inv)
    return (
        delta_H * norm(r_eq_ddot),
        delta_C * norm(r_eq_dot),
        J_inv * delta_G_q,
        delta_H * norm(task.v_t_dot) + delta_C * norm(task.v_t),
        J_inv * delta_f,
    )


@njit(cache=True, error_model="numpy")
def tight_bound(u, deviation, estimate, task, q_dot, q_eq_dot, q_eq_ddot):
    """The same perturbation bounded in task space, term by term."""
    J_inv_T = np.ascontiguousarray(task.J_q_inv.T)
    H_links = J_inv_T @ estimate.M_links @ task.J_q_inv
    J_inv = task.J_q_inv_norm
    carry = 0.0  # of a force at the tool to r
    if u.payload_mass > 0.0 or u.force_error > 0.0:
        carry = spectral_norm(estimate.J_v @ task.J_q_inv)
    inertia = u.rho * np.sqrt(max(spectral_norm(H_links) * (q_eq_ddot @ estimate.M_links @ q_eq_ddot), 0.0))
    coriolis = u.rho * u.k_C * J_inv * norm(q_dot) * norm(q_eq_dot)
    gravity = 0.0
    pulls = estimate.G_links @ task.J_q_inv
    for i in range(q_dot.shape[0]):
        gravity += u.rho * norm(pulls[i])
    inertia += J_inv * deviation.delta_M * norm(q_eq_ddot)
    coriolis += J_inv * deviation.delta_C * norm(q_eq_dot)
    gravity += J_inv * deviation.delta_G
    if u.payload_mass > 0.0:
        c = u.payload_offset
        load = u.payload_mass * (carry + c * spectral_norm(estimate.J_w @ task.J_q_inv))
        inertia += load * (norm(estimate.J_v @ q_eq_ddot) + c * norm(estimate.J_w @ q_eq_ddot))
        turning = norm(estimate.J_w_dot @ q_eq_dot) + norm(estimate.J_w @ q_dot) * norm(estimate.J_w @ q_eq_dot)
        coriolis += load * (norm(estimate.J_v_dot @ q_eq_dot) + c * turning)
        gravity += load * 9.81
    torque = u.coulomb * np.sqrt(q_dot.shape[0]) + u.viscous * norm(q_dot) + u.disturbance
    return inertia, coriolis, gravity, 0.0, J_inv * torque + u.force_error * carry


@dataclass(frozen=True)
class InertiaRange:
    """H_low <= H(r, t) <= H_high (n, n) kg for every arm inside the declared set, at one state."""

    H_low: np.ndarray
    H_high: np.ndarray

    @classmethod
    def at(cls, u: Uncertainty, estimate: Estimate, task: TaskSpace) -> InertiaRange:
        """From the estimate M_hat at that state; the payload adds its mass at most."""
        J_inv = task.J_q_inv
        links, rotor = estimate.M_links, estimate.M_hat - estimate.M_links
        low = J_inv.T @ ((1 - u.rho) * links + rotor) @ J_inv
        high = J_inv.T @ ((1 + u.rho) * links + rotor) @ J_inv
        carried, turned = estimate.J_v @ J_inv, estimate.J_w @ J_inv
        if u.payload_offset > 0.0:  # (a + b)^2 <= 2 a^2 + 2 b^2
            high = high + 2 * u.payload_mass * (carried.T @ carried + u.payload_offset**2 * turned.T @ turned)
        else:
            high = high + u.payload_mass * carried.T @ carried
        return cls(low, high)
