"""Contact of the tool: with nothing, a spring, a mass-damper-spring (28), or a rigid surface with its multiplier (39).

All of them are one law for the multiplier lambda along the gradient of phi,

    lambda = M_e (phi_ddot + a_e) + B_e phi_dot + K_e phi,

with a_e the acceleration along phi of the surface itself where it moves, since M_e is accelerated in space (28);
an elastic surface having no mass and a rigid one an infinite mass; f = grad(phi) lambda is the force on the
environment. Friction adds a part along the relative velocity. Of several surfaces M_e, B_e and K_e may be matrices
(`environments.coupled_surfaces`).

A tool touches with a point, or with a flat face on an elastic plane: springs K_e / k on a ring of k points of the face,
each pushing by itself. While all of them press, the face has (32) with a matrix: the force K_e phi, and about two axes
the moments K_t t_i of its tilts t_i = n . e_i, K_t = K_e a^2 / 2 with the ring's radius a.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from environments.coupled_surfaces import EnvironmentMatrices, find_pressed
from environments.multipliers import heavy_multipliers
from environments.surfaces.carried import carry
from environments.surfaces.chart import Chart, Shapes, one_of
from environments.surfaces.table import surface_chart
from kernels import inline
from kernels.algebra import cross, dot, torque_of_wrench, transposed_times

FEET = 8  # points of a flat face: three would do for (32), more of them lift one after the other
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


class Face(NamedTuple):
    """Face of the tool.
    flat: whether it touches as a whole, otherwise its middle, the tool point, does.
    feet: (FEET, 3) m, the points that touch, from the tool point in the frame of the joint that carries the tool."""

    flat: bool
    feet: np.ndarray

    @classmethod
    def point(cls) -> Face:
        """A tool that touches with a point."""
        return cls(flat=False, feet=np.zeros((FEET, 3)))

    @classmethod
    def of(cls, axes: np.ndarray, radius: float) -> Face:
        """A flat face with two orthogonal unit axes (2, 3), and a ring of this radius, m."""
        angles = 2 * np.pi * np.arange(FEET) / FEET
        return cls(flat=True, feet=radius * np.stack([np.cos(angles), np.sin(angles)], axis=1) @ axes)


def face_radius(K_t: float, K_e: float) -> float:
    """Radius (m) of the ring of springs with together K_e N/m and K_t N m/rad, (32)."""
    return float(np.sqrt(2.0 * K_t / K_e))


class Contacts(NamedTuple):
    """Contacts with up to three surfaces; those beyond the number of surfaces are not read."""

    first: Contact
    second: Contact
    third: Contact

    @classmethod
    def of(cls, contacts: tuple[Contact, ...]) -> Contacts:
        """Contacts of one, two or three surfaces."""
        return cls._make((*contacts, *contacts[-1:], *contacts[-1:])[:3])


class ToolKinematics(NamedTuple):
    """Kinematics of the tool point at one state: p (3,) m, p_dot (3,) m/s, J_v (3, n) m."""

    p: np.ndarray
    p_dot: np.ndarray
    J_v: np.ndarray


class ContactKinematics(NamedTuple):
    """Kinematics of the contact with one surface at one state.
    chart: the surface at the tool point.
    drag: (3,), friction per unit multiplier.
    v_rel: (3,) m/s, slip.
    phi, phi_dot: m, m/s.
    phi_ddot_bias: m/s^2, phi_ddot without its part in q_ddot.
    a_e: m/s^2, acceleration of the surface along phi.
    pull: (n,), phi_dot per unit of q_dot."""

    chart: Chart
    drag: np.ndarray
    v_rel: np.ndarray
    phi: float
    phi_dot: float
    phi_ddot_bias: float
    a_e: float
    pull: np.ndarray

    @classmethod
    def zeros(cls, n: int) -> ContactKinematics:
        """Kinematics of an arm with n joints."""
        v = np.zeros(3)
        return cls(Chart.zeros(), v, v, 0.0, 0.0, 0.0, 0.0, np.zeros(n))


class FaceKinematics(NamedTuple):
    """Kinematics of a flat face: angular velocity omega (3,) rad/s, its Jacobian J_w (3, n), feet (FEET, 3) m, from the
    tool point along the world's axes."""

    omega: np.ndarray
    J_w: np.ndarray
    feet: np.ndarray


class ToolContacts(NamedTuple):
    """Kinematics of the tool, of its face where that is flat, and of its contacts with up to three surfaces."""

    tool: ToolKinematics
    face: FaceKinematics
    first: ContactKinematics
    second: ContactKinematics
    third: ContactKinematics

    @classmethod
    def zeros(cls, n: int) -> ToolContacts:
        """Kinematics of an arm with n joints."""
        v, J, met = np.zeros(3), np.zeros((3, n)), ContactKinematics.zeros(n)
        return cls(ToolKinematics(v, v, J), FaceKinematics(v, J, np.zeros((FEET, 3))), met, met, met)


class ContactForce(NamedTuple):
    """Force of all contacts together.
    wrench: (6,), of the tool on the environment, force N and moment N m at the tool point.
    torque: (n,) N m, of that wrench in the joints.
    multiplier, phi: (3,) N and (3,) m, of each surface, 0 beyond the number of surfaces."""

    wrench: np.ndarray
    torque: np.ndarray
    multiplier: np.ndarray
    phi: np.ndarray

    @classmethod
    def zeros(cls, n: int) -> ContactForce:
        """Force of an arm with n joints that touches nothing."""
        return cls(np.zeros(6), np.zeros(n), np.zeros(3), np.zeros(3))


class Holding(NamedTuple):
    """Rigid surfaces that the tool is held on, and how it came off them; each field (3,).
    held: 1 while the tool is held on the surface, 0 while it has left it, `MET` where it has just reached it.
    absent: 1 if contact was interrupted since it was last cleared (rigid), or carried no force in the previous period
    (mass).
    lost, made: instants of the last loss and of the last impact, s, nan for none.
    pull: N, the negative multiplier that the surface would have needed when it was lost, -inf at an impact on another
    one."""

    held: np.ndarray
    absent: np.ndarray
    lost: np.ndarray
    made: np.ndarray
    pull: np.ndarray

    @classmethod
    def none(cls) -> Holding:
        """No surface is held, none was lost."""
        never, no = np.full(3, np.nan), np.zeros(3, dtype=np.int64)
        return cls(no, no, never, never, np.zeros(3))


MET = 2  # in `Holding.held`


class World(NamedTuple):
    """Environment of the tool.
    lever: (3,) m, the tool point in the frame of the joint that carries the tool.
    face: of the tool.
    shapes, contacts: of the surfaces; all of them are rigid, or none.
    environment: the matrices of (28).
    unloaded: (3,) m, the phi of each spring at which it carries no force; not 0 only where the contact is linearised
    off the surface (`Plant.press`)."""

    lever: np.ndarray
    face: Face
    shapes: Shapes
    contacts: Contacts
    rigid: bool
    environment: EnvironmentMatrices
    unloaded: np.ndarray


@inline
def place_tool(lever, rotation, translation, p):
    """Compute the tool point p (3,) m from the placement of the joint that carries it."""
    for a in range(3):
        reach = rotation[a, 0] * lever[0] + rotation[a, 1] * lever[1] + rotation[a, 2] * lever[2]
        p[a] = translation[a] + reach


@inline
def touch_at(world, J, rotation, translation, q_dot, t, touch):
    """Compute the `ToolContacts` from the world Jacobian J (6, n) of the joint that carries the tool and that joint's
    placement; phi_ddot_bias lacks the tool's own drift, see `add_drift`."""
    p, p_dot, J_v = touch.tool.p, touch.tool.p_dot, touch.tool.J_v
    place_tool(world.lever, rotation, translation, p)
    for a in range(3):
        p_dot[a] = 0.0
    for j in range(q_dot.shape[0]):
        around = cross(p, (J[3, j], J[4, j], J[5, j]))
        for a in range(3):
            J_v[a, j] = J[a, j] - around[a]
            p_dot[a] += J_v[a, j] * q_dot[j]
    for i in range(world.shapes.number):
        _meet(one_of(world.shapes, i), one_of(world.contacts, i), touch.tool, t, one_of(touch, i))
        one_of(touch, i).phi -= world.unloaded[i]
    if world.face.flat:
        _turn_face(world.face, J, rotation, q_dot, touch.face)


@inline
def _turn_face(face, J, rotation, q_dot, turned):
    """Compute the `FaceKinematics`."""
    for a in range(3):
        turned.omega[a] = 0.0
        for j in range(q_dot.shape[0]):
            turned.J_w[a, j] = J[3 + a, j]
            turned.omega[a] += J[3 + a, j] * q_dot[j]
        for i in range(FEET):
            foot = face.feet[i]
            turned.feet[i, a] = rotation[a, 0] * foot[0] + rotation[a, 1] * foot[1] + rotation[a, 2] * foot[2]


@inline
def _meet(shape, contact, tool, t, met):
    """Compute the `ContactKinematics` of the tool with one surface."""
    p_dot, chart = tool.p_dot, met.chart
    surface_chart(shape, tool.p, t, chart)
    normal = chart.G[0]
    transposed_times(tool.J_v, normal, met.pull)

    met.a_e = carry(shape, chart, tool.p, t, met.v_rel)
    square, into = dot(normal, normal), 0.0
    for a in range(3):
        met.v_rel[a] = p_dot[a] - met.v_rel[a]
        into += normal[a] * met.v_rel[a]
    for a in range(3):
        met.v_rel[a] -= normal[a] * (into / square)
    slip = np.sqrt(square / (dot(met.v_rel, met.v_rel) + SLIP_SPEED**2))
    met.phi, met.phi_dot = chart.g[0], dot(normal, p_dot) + chart.g_t[0]
    # the mixed term grad(phi_t) . p_dot occurs once in J_dot q_dot and once in the derivative of phi_t
    met.phi_ddot_bias = 2.0 * dot(chart.G_t[0], p_dot) + chart.g_tt[0]
    for a in range(3):
        met.drag[a] = met.v_rel[a] * (contact.friction_coulomb * slip)
        met.phi_ddot_bias += p_dot[a] * dot(chart.G_p[0, a], p_dot)


@inline
def add_drift(world, J, J_dot, q_dot, touch):
    """Add the part of each phi_ddot in the tool's acceleration without q_ddot, J_v_dot q_dot."""
    p, p_dot = touch.tool.p, touch.tool.p_dot
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        drift = 0.0
        for j in range(q_dot.shape[0]):
            turning = p[b] * J_dot[3 + c, j] - p[c] * J_dot[3 + b, j]
            carried = p_dot[b] * J[3 + c, j] - p_dot[c] * J[3 + b, j]
            drift += (J_dot[a, j] - turning - carried) * q_dot[j]
        for i in range(world.shapes.number):
            met = one_of(touch, i)
            met.phi_ddot_bias += met.chart.G[0, a] * drift


@inline
def spring(contact, phi, phi_dot):
    """Multiplier lambda (N) of an elastic surface, (32) with damping; zero in the air unless the surface is
    bilateral."""
    pull = contact.B_e * phi_dot + contact.K_e * phi
    if contact.unilateral and (phi <= 0.0 or pull <= 0.0):
        return 0.0
    return pull


@inline
def add_contact_force(contact, multiplier, touches, met, force):
    """Add the force of the tool on one surface for a multiplier, with friction where it touches, to the first three
    entries (N) of `force`."""
    viscous = contact.friction_viscous if touches else 0.0
    for a in range(3):
        along = abs(multiplier) * met.drag[a] + viscous * met.v_rel[a]
        force[a] += multiplier * met.chart.G[0, a] + along


@inline
def elastic_load(world, touch, work, load):
    """Compute the `ContactForce` of elastic surfaces: it does not depend on the torque."""
    for a in range(6):
        load.wrench[a] = 0.0
    if world.face.flat:
        _press_face(world.contacts.first, touch, load)
        torque_of_wrench(touch.tool.J_v, touch.face.J_w, load.wrench, load.torque)
        return
    if world.environment.coupled:
        _press_coupled(world, touch, work, load.multiplier)
    for i in range(world.shapes.number):
        contact, met = one_of(world.contacts, i), one_of(touch, i)
        if not world.environment.coupled:
            load.multiplier[i] = spring(contact, met.phi, met.phi_dot)
        load.phi[i] = met.phi
        add_contact_force(contact, load.multiplier[i], load.multiplier[i] != 0.0, met, load.wrench)
    transposed_times(touch.tool.J_v, load.wrench, load.torque)


@inline
def _press_coupled(world, touch, work, multiplier):
    """Compute the multipliers (3,) N of coupled surfaces without their mass."""
    for i in range(world.shapes.number):
        work.free[i] = 0.0
        for j in range(world.shapes.number):
            work.mobility[i, j] = 0.0
    find_pressed(world, touch, work)
    heavy_multipliers(world, touch, work, multiplier)


@inline
def _press_face(contact, touch, load):
    """Compute the wrench of a flat face on an elastic plane, foot by foot: each has phi + n . x of its place x, and the
    force that its spring has there."""
    met, turned = touch.first, touch.face
    normal, normal_t, pressed = met.chart.G[0], met.chart.G_t[0], 0.0
    for i in range(FEET):
        foot = turned.feet[i]
        speed = cross(turned.omega, foot)
        phi, phi_dot = met.phi, met.phi_dot
        for a in range(3):
            phi += normal[a] * foot[a]
            phi_dot += normal[a] * speed[a] + normal_t[a] * foot[a]
        push = spring(contact, phi, phi_dot) / FEET
        pressed += push
        turning = cross(foot, normal)
        for a in range(3):
            load.wrench[3 + a] += push * turning[a]
    load.multiplier[0], load.phi[0] = pressed, met.phi
    add_contact_force(contact, pressed, pressed != 0.0, met, load.wrench)
