"""Nominal model of the arm: estimates M_hat, C_hat, G_hat and the tool's kinematics from Pinocchio: Remarks 1 and 3."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from kernels import inline, kernel
from kernels.algebra import cross
from kernels.records import Record
from kernels.rigid_body import Chain


class StatedErrorBounds(NamedTuple):
    """Stated bounds of the errors of one state's estimates, (7); NaN where a bound follows from the links instead.
    delta_M: kg m^2, of M_hat.
    delta_C: kg m^2/s, of C_hat.
    delta_G: N m, of G_hat.
    delta_f: N m, of friction and disturbance.
    rate_C, rate_f: kg m^2 and N m s, steepest growth of delta_C and delta_f with ||q_dot||, up to the present one."""

    delta_M: float
    delta_C: float
    delta_G: float
    delta_f: float
    rate_C: float
    rate_f: float


UNSTATED_BOUNDS = StatedErrorBounds(np.nan, np.nan, np.nan, np.nan, np.nan, np.nan)


class Estimate(NamedTuple):
    """Estimates of the arm at one state.

    M_hat, M_links: (n, n) kg m^2, inertia with and without that of the rotors.
    M_turning: (n, n) kg m^2, part of M_links from the links' inertias about their centres of mass, for (6).
    spin: (n, n) kg, sum of m J_w^T J_w over the links. It and M_turning are zero unless `turning` computes them.
    C_hat: (n, n) kg m^2/s, the Christoffel matrix (Property 2 needs it).
    G_hat: (n,) N m, gravity.
    G_links: (n, n) N m, row i is the gravity torque of link i.
    p, p_dot: (3,) m and m/s, place and velocity of the tool point.
    R: (3, 3), orientation of the tool.
    J_v, J_w: (3, n) m and 1, linear and angular Jacobian of the tool in the world frame.
    J_v_dot, J_w_dot: (3, n) m/s and 1/s, their time derivatives.
    stated: bounds of the errors of M_hat, C_hat, G_hat.
    """

    M_hat: np.ndarray
    M_links: np.ndarray
    M_turning: np.ndarray
    spin: np.ndarray
    C_hat: np.ndarray
    G_hat: np.ndarray
    G_links: np.ndarray
    p: np.ndarray
    p_dot: np.ndarray
    R: np.ndarray
    J_v: np.ndarray
    J_w: np.ndarray
    J_v_dot: np.ndarray
    J_w_dot: np.ndarray
    stated: StatedErrorBounds

    @classmethod
    def zeros(cls, n: int) -> Estimate:
        """Estimates of an arm with n joints."""
        square, tool = np.zeros((n, n)), np.zeros((3, n))
        return cls(
            square,
            square,
            square,
            square,
            square,
            np.zeros(n),
            square,
            np.zeros(3),
            np.zeros(3),
            np.zeros((3, 3)),
            tool,
            tool,
            tool,
            tool,
            UNSTATED_BOUNDS,
        )


class Deviation(NamedTuple):
    """Bounds of the differences between the estimates used in (25) and those at q; zero when on-line.
    delta_M: kg m^2.
    delta_C: kg m^2/s.
    delta_G: N m.
    rate_C: kg m^2, by which delta_C grows with ||q_dot||."""

    delta_M: float
    delta_C: float
    delta_G: float
    rate_C: float


ON_LINE = Deviation(0.0, 0.0, 0.0, 0.0)


class LinkConstants(NamedTuple):
    """Constants of the links.
    masses: (n,) kg.
    levers: (n, 3) m, centres of mass.
    inertias: (n, 3, 3) kg m^2, about the centres of mass.
    rotor: (n,) kg m^2, inertias of the rotors.
    gravity: (3,) m/s^2.
    total_mass: kg, of the arm.
    tool_joint: number of the joint that moves the tool, counted from 1.
    tool_rotation: (3, 3), of the tool in the frame of that joint.
    tool_lever: (3,) m, tool point in that frame."""

    masses: np.ndarray
    levers: np.ndarray
    inertias: np.ndarray
    rotor: np.ndarray
    gravity: np.ndarray
    total_mass: float
    tool_joint: int
    tool_rotation: np.ndarray
    tool_lever: np.ndarray

    @classmethod
    def of(cls, model: pin.Model, tool_joint: int, tool_placement: pin.SE3) -> LinkConstants:
        """Constants of a model, whose tool is at this place on the link after this joint."""
        links = list(model.inertias)[1:]
        return cls(
            masses=np.array([link.mass for link in links]),
            levers=np.array([link.lever for link in links]),
            inertias=np.array([link.inertia for link in links]),
            rotor=np.array(model.armature),
            gravity=np.array(model.gravity.linear),
            total_mass=float(pin.computeTotalMass(model)),
            tool_joint=tool_joint,
            tool_rotation=np.ascontiguousarray(tool_placement.rotation),
            tool_lever=np.array(tool_placement.translation),
        )


class Terms(NamedTuple):
    """Live views of Pinocchio's arrays.
    momenta: (6, n), of the links from joint j on, per unit of that joint's rate.
    C: (n, n).
    J, J_dot: (6, n), spatial Jacobians of the world origin.
    placements: (3, 4n), the static regressor, whose blocks are the links' placements over the total mass."""

    momenta: np.ndarray
    C: np.ndarray
    J: np.ndarray
    J_dot: np.ndarray
    placements: np.ndarray


@inline
def _placed(links, placements, link, point):
    """Position in the world, (x, y, z) m, of a point of a link, counted from 0."""
    k, total = 4 * link, links.total_mass
    x, y, z = point[0], point[1], point[2]
    return (
        total * (placements[0, k] + placements[0, k + 1] * x + placements[0, k + 2] * y + placements[0, k + 3] * z),
        total * (placements[1, k] + placements[1, k + 1] * x + placements[1, k + 2] * y + placements[1, k + 3] * z),
        total * (placements[2, k] + placements[2, k + 1] * x + placements[2, k + 2] * y + placements[2, k + 3] * z),
    )


@inline
def _gravity(links, J, placements, G_links, G_hat):
    """Compute G_links, whose row i are the torques of the joints that hold link i against gravity, and G_hat."""
    n = G_hat.shape[0]
    for i in range(n):
        G_hat[i] = 0.0
    for i in range(n):
        centre = _placed(links, placements, i, links.levers[i])
        m = links.masses[i]
        weight = (-m * links.gravity[0], -m * links.gravity[1], -m * links.gravity[2])
        turning = cross(centre, weight)
        for j in range(n):
            G_links[i, j] = 0.0
            if j <= i:
                for a in range(3):
                    G_links[i, j] += J[a, j] * weight[a] + J[3 + a, j] * turning[a]
            G_hat[j] += G_links[i, j]


@inline
def _tool(links, J, J_dot, placements, q_dot, e):
    """Compute the tool's placement, velocity and Jacobians from those of the world's origin."""
    n = q_dot.shape[0]
    carrier = links.tool_joint - 1
    p = _placed(links, placements, carrier, links.tool_lever)
    for a in range(3):
        e.p[a], e.p_dot[a] = p[a], 0.0
        for b in range(3):
            e.R[a, b] = 0.0
            for c in range(3):
                e.R[a, b] += links.total_mass * placements[a, 4 * carrier + 1 + c] * links.tool_rotation[c, b]
    for j in range(n):
        around = cross(p, (J[3, j], J[4, j], J[5, j]))
        for a in range(3):
            e.J_w[a, j], e.J_w_dot[a, j] = J[3 + a, j], J_dot[3 + a, j]
            e.J_v[a, j] = J[a, j] - around[a]
            e.p_dot[a] += e.J_v[a, j] * q_dot[j]
    for j in range(n):
        around = cross(p, (J_dot[3, j], J_dot[4, j], J_dot[5, j]))
        moving = cross(e.p_dot, (J[3, j], J[4, j], J[5, j]))
        for a in range(3):
            e.J_v_dot[a, j] = J_dot[a, j] - around[a] - moving[a]


@inline
def estimates(links, momenta, C, J, J_dot, placements, q_dot, estimate):
    """Compute the `Estimate` from the arrays of `Terms`."""
    n = q_dot.shape[0]
    for j in range(n):
        for i in range(j + 1):
            inertia = 0.0
            for a in range(6):
                inertia += J[a, i] * momenta[a, j]
            estimate.M_links[i, j] = estimate.M_links[j, i] = inertia
            estimate.M_hat[i, j] = estimate.M_hat[j, i] = inertia
        estimate.M_hat[j, j] += links.rotor[j]
        for i in range(n):
            estimate.C_hat[i, j] = C[i, j]
    _gravity(links, J, placements, estimate.G_links, estimate.G_hat)
    _tool(links, J, J_dot, placements, q_dot, estimate)


@inline
def turning(links, placements, estimate):
    """Compute M_turning and spin, after `estimates`: link i turns with the first i + 1 columns of J_w."""
    J_w, M, spin, n = estimate.J_w, estimate.M_turning, estimate.spin, estimate.G_hat.shape[0]
    for j in range(n):
        for k in range(j + 1):
            M[j, k], carried = 0.0, 0.0
            for i in range(j, n):
                carried += links.masses[i]
            spin[j, k] = spin[k, j] = carried * (J_w[0, j] * J_w[0, k] + J_w[1, j] * J_w[1, k] + J_w[2, j] * J_w[2, k])
    for i in range(n):
        own, first = links.inertias[i], 4 * i + 1
        for j in range(i + 1):
            w = _in_link(links, placements, first, J_w, j)
            momentum = (
                own[0, 0] * w[0] + own[0, 1] * w[1] + own[0, 2] * w[2],
                own[1, 0] * w[0] + own[1, 1] * w[1] + own[1, 2] * w[2],
                own[2, 0] * w[0] + own[2, 1] * w[1] + own[2, 2] * w[2],
            )
            for k in range(j + 1):
                other = _in_link(links, placements, first, J_w, k)
                M[j, k] += other[0] * momentum[0] + other[1] * momentum[1] + other[2] * momentum[2]
    for j in range(n):
        for k in range(j):
            M[k, j] = M[j, k]


@inline
def _in_link(links, placements, first, J_w, j):
    """Column j of J_w along the axes of the link whose rotation begins at column `first` of the placements."""
    return (
        _along_axis(links, placements, first, J_w, j),
        _along_axis(links, placements, first + 1, J_w, j),
        _along_axis(links, placements, first + 2, J_w, j),
    )


@inline
def _along_axis(links, placements, axis, J_w, j):
    along = placements[0, axis] * J_w[0, j] + placements[1, axis] * J_w[1, j] + placements[2, axis] * J_w[2, j]
    return links.total_mass * along


@kernel
def _estimates_alone(links, momenta, C, J, J_dot, placements, q_dot, estimate):
    estimates(links[0], momenta, C, J, J_dot, placements, q_dot, estimate[0])


class NominalModel:
    """Controller's model of the arm: a serial chain of n links.

    model: pin.Model with nq = nv = n; tool_joint and tool_placement give the place of the tool frame.
    """

    def __init__(self, model: pin.Model, tool_joint: int, tool_placement: pin.SE3) -> None:
        self.model = model
        self.data = model.createData()
        self.constants = LinkConstants.of(model, tool_joint, tool_placement)
        self._links = Record(self.constants)
        self._blank = Record.zeros(Estimate, model.nv)
        d = self.data
        self.terms = Terms(d.Ag, d.C, d.J, d.dJ, d.staticRegressor)

    @cached_property
    def chain(self) -> Chain:
        """Constants of the arm for `kernels.rigid_body`. Raises ValueError where it is no serial chain."""
        return Chain.of(self.model)

    @cached_property
    def saved(self) -> str:
        """All data of Pinocchio's model as text; kept, since making it takes half a millisecond."""
        return self.model.saveToString()

    @cached_property
    def fingerprint(self) -> bytes:
        """Bytes of all data of the model: models with the same bytes give the same estimates."""
        return self.saved.encode() + self._links.data.tobytes()

    def update(self, q: np.ndarray, q_dot: np.ndarray) -> Terms:
        """Pinocchio's terms at q (n,) rad, q_dot (n,) rad/s; they are overwritten by the next call."""
        pin.computeCoriolisMatrix(self.model, self.data, q, q_dot)
        pin.computeStaticRegressor(self.model, self.data, q)
        return self.terms

    def evaluate(self, q: np.ndarray, q_dot: np.ndarray) -> Estimate:
        """Estimates at q (n,) rad, q_dot (n,) rad/s."""
        estimate = self._blank.copy()
        _estimates_alone(self._links.data, *self.update(q, q_dot), q_dot, estimate.data)
        return estimate.read()

    def at_rest(self, q: np.ndarray) -> np.ndarray:
        """Estimates at q (N, n) rad with the arm at rest: records (N,) with the fields of `Estimate`."""
        found, still = np.repeat(self._blank.data, len(q)), np.zeros(q.shape[1])
        for k in range(len(q)):
            _estimates_alone(self._links.data, *self.update(q[k], still), still, found[k : k + 1])
        return found
