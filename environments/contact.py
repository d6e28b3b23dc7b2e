"""What the tool touches: nothing, a spring, a mass-damper-spring (28), or a rigid surface with its multiplier (39).

All of them are one law for the multiplier lambda along the gradient of phi,

    lambda = M_e phi_ddot + B_e phi_dot + K_e phi,

an elastic surface having no mass and a rigid one an infinite mass; f = grad(phi) lambda is the force on the
environment. Friction adds a part along the relative velocity.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numba import njit

from environments.surfaces import Chart, Surface

SLIP_SPEED = 1e-3  # m/s, where Coulomb friction has reached 3/4 of its value: the smooth transition through rest


@dataclass(frozen=True)
class Contact:
    """M_e kg, B_e N s/m, K_e N/m along phi; friction coefficient (1) and viscous friction (N s/m) along the surface."""

    kind: Literal["free", "elastic", "mass-damper-spring", "rigid"]
    M_e: float = 0.0
    B_e: float = 0.0
    K_e: float = 0.0
    unilateral: bool = True
    friction_coulomb: float = 0.0
    friction_viscous: float = 0.0


class Touch(NamedTuple):
    """Contact at one state. n_q (n,): joint torque of a unit multiplier; drag (3,): friction force per unit
    multiplier; phi m, phi_dot m/s, phi_ddot_bias m/s^2 (phi_ddot without its part in q_ddot); v_rel (3,) m/s slip."""

    n_q: np.ndarray
    normal: np.ndarray
    drag: np.ndarray
    v_rel: np.ndarray
    phi: float
    phi_dot: float
    phi_ddot_bias: float


@njit(cache=True)
def _touch(chart, J_v, p_dot, p_ddot_bias, surface_velocity, mu):
    normal = chart.G[0]
    square = normal @ normal
    v_rel = p_dot - surface_velocity
    v_rel = v_rel - normal * ((normal @ v_rel) / square)
    drag = v_rel * (mu * np.sqrt(square) / np.sqrt(v_rel @ v_rel + SLIP_SPEED**2))
    # the mixed term grad(phi_t) . p_dot stands once in J_dot q_dot and once in the derivative of phi_t
    bias = normal @ p_ddot_bias + p_dot @ (chart.G_p[0] @ p_dot) + 2.0 * (chart.G_t[0] @ p_dot) + chart.g_tt[0]
    return Touch(
        J_v.T @ normal, normal, drag, v_rel, chart.g[0], normal @ p_dot + chart.g_t[0], bias
    )


def touch(
    contact: Contact, surface: Surface, t: float, p: np.ndarray, J_v: np.ndarray, p_dot: np.ndarray, p_ddot_bias: np.ndarray
) -> Touch:
    """The contact's geometry for a tool at p (3,) with Jacobian J_v (3, n), velocity and J_v_dot q_dot (3,)."""
    chart: Chart = surface.chart(p, t)
    return _touch(chart, J_v, p_dot, p_ddot_bias, surface.motion.velocity(t), contact.friction_coulomb)


def spring_multiplier(contact: Contact, at: Touch) -> float:
    """lambda (N) of an elastic surface, (32) with damping; zero in the air unless the surface is bilateral."""
    pull = contact.B_e * at.phi_dot + contact.K_e * at.phi
    if contact.unilateral:
        return max(0.0, pull) if at.phi > 0.0 else 0.0
    return pull


def loaded_multiplier(contact: Contact, at: Touch, phi_ddot_free: float, mobility: float) -> float:
    """lambda (N) where it depends on the acceleration phi_ddot = phi_ddot_free - mobility lambda: (28), (39).

    On a rigid surface it may come out negative: the caller decides whether contact is lost.
    """
    if contact.kind == "rigid":
        return phi_ddot_free / mobility
    if contact.unilateral and at.phi <= 0.0:
        return 0.0
    spring = contact.B_e * at.phi_dot + contact.K_e * at.phi
    pull = (contact.M_e * phi_ddot_free + spring) / (1.0 + contact.M_e * mobility)
    return max(0.0, pull) if contact.unilateral else pull


def viscous_friction(contact: Contact, at: Touch) -> np.ndarray:
    """Viscous part (3,) N of the friction force on the environment, wherever the tool touches it."""
    touching = contact.kind == "rigid" or at.phi > 0.0 or not contact.unilateral
    return contact.friction_viscous * at.v_rel if touching else np.zeros(3)


def force(contact: Contact, at: Touch, multiplier: float) -> np.ndarray:
    """Force (3,) N of the tool on the environment."""
    return multiplier * (at.normal + at.drag) + viscous_friction(contact, at)
