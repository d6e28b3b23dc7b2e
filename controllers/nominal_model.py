"""Estimates M_hat, C_hat, G_hat and the tool's kinematics from Pinocchio: Remarks 1 and 3."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from kernels import kernel, part
from kernels.algebra import cross
from kernels.records import Record


class Estimate(NamedTuple):
    """What the controller believes of the arm at one state.

    M_hat (n, n) with and M_links (n, n) without rotor inertia, C_hat (n, n) the Christoffel matrix (Property 2 needs
    it), G_hat (n,), G_links (n, n) whose row i is the gravity torque of link i; the tool: p (3,) m, p_dot (3,) m/s,
    R (3, 3), J_v, J_w (3, n) linear and angular Jacobian in the world frame, J_v_dot, J_w_dot (3, n) their time
    derivatives.
    """

    M_hat: np.ndarray
    M_links: np.ndarray
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

    @classmethod
    def zeros(cls, n: int) -> Estimate:
        """Of an arm with n joints."""
        square, tool = np.zeros((n, n)), np.zeros((3, n))
        return cls(
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
        )


class Deviation(NamedTuple):
    """Bounds of what the estimates used in (25) differ from those at q: kg m^2, kg m^2/s, N m. Zero when on-line."""

    delta_M: float
    delta_C: float
    delta_G: float


ON_LINE = Deviation(0.0, 0.0, 0.0)


class LinkConstants(NamedTuple):
    """masses (n,) kg, levers (n, 3) m of the links' centres of mass, rotor (n,) kg m^2, gravity (3,) m/s^2."""

    masses: np.ndarray
    levers: np.ndarray
    rotor: np.ndarray
    gravity: np.ndarray
    total_mass: float
    tool_joint: int
    tool_rotation: np.ndarray
    tool_lever: np.ndarray


class Terms(NamedTuple):
    """Live views of Pinocchio's arrays: M, C (n, n); J, J_dot (6, n) spatial Jacobians of the world origin; placements
    (3, 4n) the static regressor, whose blocks are the links' placements over the total mass."""

    M: np.ndarray
    C: np.ndarray
    J: np.ndarray
    J_dot: np.ndarray
    placements: np.ndarray


@part
def _placed(links, placements, link, point):
    """A point of a link, counted from 0, in the world: (x, y, z) m."""
    k, total = 4 * link, links.total_mass
    x, y, z = point[0], point[1], point[2]
    return (
        total * (placements[0, k] + placements[0, k + 1] * x + placements[0, k + 2] * y + placements[0, k + 3] * z),
        total * (placements[1, k] + placements[1, k + 1] * x + placements[1, k + 2] * y + placements[1, k + 3] * z),
        total * (placements[2, k] + placements[2, k + 1] * x + placements[2, k + 2] * y + placements[2, k + 3] * z),
    )


@part
def _gravity(links, J, placements, G_links, G_hat):
    """Row i of G_links: what holding link i against gravity takes of every joint before it."""
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


@part
def _tool(links, J, J_dot, placements, q_dot, e):
    """The tool's placement, velocity and Jacobians from those of the world's origin."""
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


@part
def estimates(links, M, C, J, J_dot, placements, q_dot, estimate):
    """The `Estimate` from the arrays of `Terms`."""
    n = q_dot.shape[0]
    for i in range(n):
        for j in range(n):
            estimate.M_hat[i, j] = M[i, j]
            estimate.M_links[i, j] = M[i, j]
            estimate.C_hat[i, j] = C[i, j]
        estimate.M_links[i, i] -= links.rotor[i]
    _gravity(links, J, placements, estimate.G_links, estimate.G_hat)
    _tool(links, J, J_dot, placements, q_dot, estimate)


@kernel
def _estimates_alone(links, M, C, J, J_dot, placements, q_dot, estimate):
    estimates(links[0], M, C, J, J_dot, placements, q_dot, estimate[0])


class NominalModel:
    """The arm as the controller knows it: a serial chain of n links.

    model: pin.Model with nq = nv = n; tool_joint and tool_placement say where the tool frame sits.
    """

    def __init__(self, model: pin.Model, tool_joint: int, tool_placement: pin.SE3) -> None:
        self.model = model
        self.data = model.createData()
        links = list(model.inertias)[1:]
        self.constants = LinkConstants(
            masses=np.array([link.mass for link in links]),
            levers=np.array([link.lever for link in links]),
            rotor=np.array(model.armature),
            gravity=np.array(model.gravity.linear),
            total_mass=float(pin.computeTotalMass(model)),
            tool_joint=tool_joint,
            tool_rotation=np.ascontiguousarray(tool_placement.rotation),
            tool_lever=np.array(tool_placement.translation),
        )
        self._links = Record(self.constants)
        self._blank = Record(Estimate.zeros(model.nv))
        d = self.data
        self.terms = Terms(d.M, d.C, d.J, d.dJ, d.staticRegressor)

    def update(self, q: np.ndarray, q_dot: np.ndarray) -> Terms:
        """Pinocchio's terms at q (n,) rad, q_dot (n,) rad/s; they are overwritten by the next call."""
        pin.computeCoriolisMatrix(self.model, self.data, q, q_dot)
        pin.crba(self.model, self.data, q)
        pin.computeStaticRegressor(self.model, self.data, q)
        return self.terms

    def evaluate(self, q: np.ndarray, q_dot: np.ndarray) -> Estimate:
        """Estimates at q (n,) rad, q_dot (n,) rad/s."""
        estimate = self._blank.copy()
        _estimates_alone(self._links.data, *self.update(q, q_dot), q_dot, estimate.data)
        return estimate.read()


class Lipschitz(NamedTuple):
    """Constants over Omega: k_C as in `bounds.Uncertainty`; k_M, k_G: M_hat and G_hat change by at most that much per
    rad; k_Cq: C_hat / ||q_dot|| per rad."""

    k_C: float
    k_M: float
    k_Cq: float
    k_G: float

    def deviation(self, q: np.ndarray, q_dot: np.ndarray, q_d: np.ndarray, q_d_dot: np.ndarray) -> Deviation:
        """What estimates taken at (q_d, q_d_dot) miss at (q, q_dot), Remark 3."""
        away = float(np.linalg.norm(q - q_d))
        slower = float(np.linalg.norm(q_dot - q_d_dot))
        speed = float(np.linalg.norm(q_d_dot))
        return Deviation(self.k_M * away, self.k_C * slower + self.k_Cq * away * speed, self.k_G * away)


def _largest(T: np.ndarray) -> float:
    """At least ||T(., u, ...)|| for unit vectors u, ... in all axes but one: the least of the flattenings' norms."""
    flat = (np.moveaxis(T, axis, 0).reshape(T.shape[axis], -1) for axis in range(T.ndim))
    return float(min(np.linalg.norm(A, 2) for A in flat))


def lipschitz_constants(model: pin.Model, samples: np.ndarray, margin: float = 1.25) -> Lipschitz:
    """From above over all directions at the sampled postures (N, n) rad, times `margin` for what lies between them."""
    n, step = model.nv, 1e-5
    data = model.createData()
    links = []
    for link in range(1, n + 1):
        alone = model.copy()
        for other in range(1, n + 1):
            if other != link:
                alone.inertias[other] = pin.Inertia.Zero()
        links.append((alone, alone.createData()))

    def C(m: pin.Model, d: pin.Data, q: np.ndarray) -> np.ndarray:
        """C is linear in q_dot: (n, n, n), one C for each joint at 1 rad/s."""
        return np.array([pin.computeCoriolisMatrix(m, d, q, one) for one in np.eye(n)])

    def terms(q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        M, G = pin.crba(model, data, q).copy(), pin.computeGeneralizedGravity(model, data, q).copy()
        return M, C(model, data, q), G

    largest = np.zeros(4)
    for q in samples:
        here, beside = terms(q), [terms(q + h) for h in step * np.eye(n)]
        k_M, k_Cq, k_G = (_largest(np.array([b[k] - here[k] for b in beside]) / step) for k in range(3))
        k_C = sum(_largest(C(m, d, q)) for m, d in links)
        largest = np.maximum(largest, np.array([k_C, k_M, k_Cq, k_G]))
    return Lipschitz(*(float(v) for v in margin * largest))
