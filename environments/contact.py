"""What the tool touches: nothing, a spring, a mass-damper-spring (28), or a rigid surface with its multiplier (39).

All of them are one law for the multiplier lambda along the gradient of phi,

    lambda = M_e phi_ddot + B_e phi_dot + K_e phi,

an elastic surface having no mass and a rigid one an infinite mass; f = grad(phi) lambda is the force on the
environment. Friction adds a part along the relative velocity.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from environments.surfaces import Shape, surface_chart, surface_velocity

SLIP_SPEED = 1e-3  # m/s, where Coulomb friction has reached 0.7 of its value: the smooth transition through rest


class Contact(NamedTuple):
    """M_e kg, B_e N s/m, K_e N/m along phi; unilateral: pushes only; friction coefficient (1) and viscous friction
    (N s/m) along the surface."""

    M_e: float
    B_e: float
    K_e: float
    unilateral: bool
    friction_coulomb: float
    friction_viscous: float


class Touch(NamedTuple):
    """The contact's geometry at one state. normal (3,): gradient of phi; drag (3,): friction per unit multiplier;
    v_rel (3,) m/s: slip; phi m, phi_dot m/s, phi_ddot_bias m/s^2: phi_ddot without its part in q_ddot."""

    normal: np.ndarray
    drag: np.ndarray
    v_rel: np.ndarray
    phi: float
    phi_dot: float
    phi_ddot_bias: float


class Load(NamedTuple):
    """force (3,) N of the tool on the environment, torque (n,) N m = J_v^T force, multiplier N, phi m."""

    force: np.ndarray
    torque: np.ndarray
    multiplier: float
    phi: float


@njit(cache=True, error_model="numpy")
def tool_point(J, rotation, translation, lever, q_dot):
    """Tool point p (3,) m, its Jacobian J_v (3, n) and velocity (3,) m/s, from the world Jacobian J (6, n) of the
    joint that carries it, that joint's placement, and the lever (3,) m of the tool in it."""
    p = translation + np.ascontiguousarray(rotation) @ lever
    J_v = np.empty((3, J.shape[1]))
    for j in range(J.shape[1]):
        J_v[0, j] = J[0, j] + J[4, j] * p[2] - J[5, j] * p[1]
        J_v[1, j] = J[1, j] + J[5, j] * p[0] - J[3, j] * p[2]
        J_v[2, j] = J[2, j] + J[3, j] * p[1] - J[4, j] * p[0]
    return p, J_v, J_v @ q_dot


@njit(cache=True, error_model="numpy")
def touch(shape, contact, t, p, p_dot, p_ddot_bias):
    """The `Touch` of a tool at p (3,) m with velocity p_dot (3,) and acceleration bias J_v_dot q_dot (3,)."""
    chart = surface_chart(shape, p, t)
    normal = chart.G[0].copy()
    square = normal @ normal
    v_rel = p_dot - surface_velocity(shape, t)
    v_rel = v_rel - normal * ((normal @ v_rel) / square)
    drag = v_rel * (contact.friction_coulomb * np.sqrt(square / (v_rel @ v_rel + SLIP_SPEED**2)))
    # the mixed term grad(phi_t) . p_dot stands once in J_dot q_dot and once in the derivative of phi_t
    bias = normal @ p_ddot_bias + p_dot @ (chart.G_p[0] @ p_dot) + 2.0 * (chart.G_t[0] @ p_dot) + chart.g_tt[0]
    return Touch(normal, drag, v_rel, chart.g[0], normal @ p_dot + chart.g_t[0], bias)


@njit(cache=True, error_model="numpy")
def spring(contact, phi, phi_dot):
    """lambda (N) of an elastic surface, (32) with damping; zero in the air unless the surface is bilateral."""
    pull = contact.B_e * phi_dot + contact.K_e * phi
    if contact.unilateral and (phi <= 0.0 or pull <= 0.0):
        return 0.0
    return pull


class World(NamedTuple):
    """What a contact sees of the arm: live views of J and of the placement of the joint that carries the tool; the
    lever (3,) m of the tool in it; the surface's shape and the contact."""

    J: np.ndarray
    rotation: np.ndarray
    translation: np.ndarray
    lever: np.ndarray
    shape: Shape
    contact: Contact


@njit(cache=True, error_model="numpy")
def touch_at(held, q_dot, t, p_ddot_bias):
    """The `Touch` and the tool's Jacobian J_v (3, n) at the state of the arm that `held`, a `World`, looks at."""
    world = held.value
    p, J_v, p_dot = tool_point(world.J, world.rotation, world.translation, world.lever, q_dot)
    return touch(world.shape, world.contact, t, p, p_dot, p_ddot_bias), J_v


@njit(cache=True, error_model="numpy")
def elastic_load(held, q_dot, t):
    """The `Load` of an elastic surface at one state: it does not depend on the torque. held: a `World`."""
    contact = held.value.contact
    at, J_v = touch_at(held, q_dot, t, np.zeros(3))
    multiplier = spring(contact, at.phi, at.phi_dot)
    force = multiplier * at.normal + abs(multiplier) * at.drag
    if multiplier != 0.0:
        force += contact.friction_viscous * at.v_rel
    return Load(force, J_v.T @ force, multiplier, at.phi)


def heavy_multiplier(contact: Contact, rigid: bool, at: Touch, phi_ddot_free: float, mobility: float) -> float:
    """lambda (N) where it depends on the acceleration phi_ddot = phi_ddot_free - mobility lambda: (28), (39).

    On a rigid surface it may come out negative: the caller decides whether contact is lost.
    """
    if rigid:
        return phi_ddot_free / mobility
    if contact.unilateral and at.phi <= 0.0:
        return 0.0
    pull = contact.M_e * phi_ddot_free + contact.B_e * at.phi_dot + contact.K_e * at.phi
    multiplier = pull / (1.0 + contact.M_e * mobility)
    return max(0.0, multiplier) if contact.unilateral else multiplier
