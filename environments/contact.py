"""Contact of the tool: with nothing, a spring, a mass-damper-spring (28), or a rigid surface with its multiplier (39).

All of them are one law for the multiplier lambda along the gradient of phi,

    lambda = M_e phi_ddot + B_e phi_dot + K_e phi,

an elastic surface having no mass and a rigid one an infinite mass; f = grad(phi) lambda is the force on the
environment. Friction adds a part along the relative velocity.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from environments.surfaces.chart import Chart, Shape
from environments.surfaces.table import surface_chart
from kernels import inline
from kernels.algebra import cross, dot, transposed_times

SLIP_SPEED = 1e-3  # m/s, where Coulomb friction has reached 0.7 of its value: the smooth transition through rest


class Contact(NamedTuple):
    """Parameters of a contact.
    M_e, B_e, K_e: kg, N s/m, N/m, along phi.
    unilateral: pushes only.
    friction_coulomb, friction_viscous: coefficient (1) and viscous friction (N s/m) along the surface."""

    M_e: float
    B_e: float
    K_e: float
    unilateral: bool
    friction_coulomb: float
    friction_viscous: float


class ContactKinematics(NamedTuple):
    """Kinematics of the contact at one state.
    p, p_dot, J_v: (3,) m, (3,) m/s, (3, n), of the tool point.
    chart: the surface at that point.
    drag: (3,), friction per unit multiplier.
    v_rel: (3,) m/s, slip.
    phi, phi_dot: m, m/s.
    phi_ddot_bias: m/s^2, phi_ddot without its part in q_ddot.
    pull: (n,), phi_dot per unit of q_dot."""

    p: np.ndarray
    p_dot: np.ndarray
    J_v: np.ndarray
    chart: Chart
    drag: np.ndarray
    v_rel: np.ndarray
    phi: float
    phi_dot: float
    phi_ddot_bias: float
    pull: np.ndarray

    @classmethod
    def zeros(cls, n: int) -> ContactKinematics:
        """Kinematics of an arm with n joints."""
        v = np.zeros(3)
        return cls(v, v, np.zeros((3, n)), Chart.zeros(), v, v, 0.0, 0.0, 0.0, np.zeros(n))


class ContactForce(NamedTuple):
    """Force of the contact: force (3,) N of the tool on the environment, torque (n,) N m = J_v^T force, multiplier N,
    phi m."""

    force: np.ndarray
    torque: np.ndarray
    multiplier: float
    phi: float

    @classmethod
    def zeros(cls, n: int) -> ContactForce:
        """Force of an arm with n joints that touches nothing."""
        return cls(np.zeros(3), np.zeros(n), 0.0, 0.0)


class World(NamedTuple):
    """Environment of the tool: the lever (3,) m of the tool in the joint that carries it, the surface's shape and the
    contact, rigid or not."""

    lever: np.ndarray
    shape: Shape
    contact: Contact
    rigid: bool


@inline
def place_tool(lever, rotation, translation, p):
    """Compute the tool point p (3,) m from the placement of the joint that carries it."""
    for a in range(3):
        reach = rotation[a, 0] * lever[0] + rotation[a, 1] * lever[1] + rotation[a, 2] * lever[2]
        p[a] = translation[a] + reach


@inline
def touch_at(world, J, rotation, translation, q_dot, t, touch):
    """Compute the `ContactKinematics` from the world Jacobian J (6, n) of the joint that carries the tool and that
    joint's placement; phi_ddot_bias lacks the tool's own drift, see `add_drift`."""
    shape, n = world.shape, q_dot.shape[0]
    p, p_dot, chart = touch.p, touch.p_dot, touch.chart
    place_tool(world.lever, rotation, translation, p)
    for a in range(3):
        p_dot[a] = 0.0
    for j in range(n):
        around = cross(p, (J[3, j], J[4, j], J[5, j]))
        for a in range(3):
            touch.J_v[a, j] = J[a, j] - around[a]
            p_dot[a] += touch.J_v[a, j] * q_dot[j]
    surface_chart(shape, p, t, chart)
    normal = chart.G[0]
    transposed_times(touch.J_v, normal, touch.pull)

    omega = 2 * np.pi * shape.frequency
    surface_speed = shape.amplitude * omega * np.cos(omega * t)
    square, into = dot(normal, normal), 0.0
    for a in range(3):
        touch.v_rel[a] = p_dot[a] - surface_speed * shape.direction[a]
        into += normal[a] * touch.v_rel[a]
    for a in range(3):
        touch.v_rel[a] -= normal[a] * (into / square)
    slip = np.sqrt(square / (dot(touch.v_rel, touch.v_rel) + SLIP_SPEED**2))
    touch.phi, touch.phi_dot = chart.g[0], dot(normal, p_dot) + chart.g_t[0]
    # the mixed term grad(phi_t) . p_dot occurs once in J_dot q_dot and once in the derivative of phi_t
    touch.phi_ddot_bias = 2.0 * dot(chart.G_t[0], p_dot) + chart.g_tt[0]
    for a in range(3):
        touch.drag[a] = touch.v_rel[a] * (world.contact.friction_coulomb * slip)
        touch.phi_ddot_bias += p_dot[a] * dot(chart.G_p[0, a], p_dot)


@inline
def add_drift(J, J_dot, q_dot, touch):
    """Add the part of phi_ddot in the tool's acceleration without q_ddot, J_v_dot q_dot."""
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        drift = 0.0
        for j in range(q_dot.shape[0]):
            turning = touch.p[b] * J_dot[3 + c, j] - touch.p[c] * J_dot[3 + b, j]
            carried = touch.p_dot[b] * J[3 + c, j] - touch.p_dot[c] * J[3 + b, j]
            drift += (J_dot[a, j] - turning - carried) * q_dot[j]
        touch.phi_ddot_bias += touch.chart.G[0, a] * drift


@inline
def spring(contact, phi, phi_dot):
    """Multiplier lambda (N) of an elastic surface, (32) with damping; zero in the air unless the surface is
    bilateral."""
    pull = contact.B_e * phi_dot + contact.K_e * phi
    if contact.unilateral and (phi <= 0.0 or pull <= 0.0):
        return 0.0
    return pull


@inline
def contact_force(contact, multiplier, touching, touch, force):
    """Compute the force (3,) N of the tool on the environment for a multiplier, with friction where they touch."""
    viscous = contact.friction_viscous if touching else 0.0
    for a in range(3):
        along = abs(multiplier) * touch.drag[a] + viscous * touch.v_rel[a]
        force[a] = multiplier * touch.chart.G[0, a] + along


@inline
def elastic_load(contact, touch, load):
    """Compute the `ContactForce` of an elastic surface: it does not depend on the torque."""
    load.multiplier, load.phi = spring(contact, touch.phi, touch.phi_dot), touch.phi
    contact_force(contact, load.multiplier, load.multiplier != 0.0, touch, load.force)
    transposed_times(touch.J_v, load.force, load.torque)


@inline
def heavy_multiplier(contact, rigid, touch, phi_ddot_free, mobility):
    """Multiplier lambda (N) where it depends on the acceleration phi_ddot = phi_ddot_free - mobility lambda: (28),
    (39).

    On a rigid surface it may be negative: the caller decides whether contact is lost.
    """
    if rigid:
        return phi_ddot_free / mobility
    if contact.unilateral and touch.phi <= 0.0:
        return 0.0
    pull = contact.M_e * phi_ddot_free + contact.B_e * touch.phi_dot + contact.K_e * touch.phi
    multiplier = pull / (1.0 + contact.M_e * mobility)
    return max(0.0, multiplier) if contact.unilateral else multiplier
