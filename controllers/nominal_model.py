"""Estimates M_hat, C_hat, G_hat and the tool's kinematics from Pinocchio: Remarks 1 and 3."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numba import njit


class Estimate(NamedTuple):
    """What the controller believes of the arm at one state.

    M_hat (n, n) with and M_links (n, n) without rotor inertia, C_hat (n, n) the Christoffel matrix (Property 2 needs
    it), G_hat (n,), G_links (n, n) whose row i is the gravity torque of link i; the tool: p (3,) m, R (3, 3),
    J_v, J_w (3, n) linear and angular Jacobian in the world frame, J_v_dot, J_w_dot (3, n) their time derivatives.
    """

    M_hat: np.ndarray
    M_links: np.ndarray
    C_hat: np.ndarray
    G_hat: np.ndarray
    G_links: np.ndarray
    p: np.ndarray
    R: np.ndarray
    J_v: np.ndarray
    J_w: np.ndarray
    J_v_dot: np.ndarray
    J_w_dot: np.ndarray


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


@njit(cache=True, error_model="numpy")
def _cross_columns(a, J):
    """a x J, column by column."""
    out = np.empty(J.shape)
    out[0] = a[1] * J[2] - a[2] * J[1]
    out[1] = a[2] * J[0] - a[0] * J[2]
    out[2] = a[0] * J[1] - a[1] * J[0]
    return out


class Terms(NamedTuple):
    """Live views of Pinocchio's arrays: M, C (n, n); J, J_dot (6, n) spatial Jacobians of the world origin; placements
    (3, 4n) the static regressor, whose blocks are the links' placements over the total mass."""

    M: np.ndarray
    C: np.ndarray
    J: np.ndarray
    J_dot: np.ndarray
    placements: np.ndarray


@njit(cache=True, error_model="numpy")
def estimates(terms, links, q_dot):
    """The `Estimate` from Pinocchio's arrays."""
    n = q_dot.shape[0]
    J, J_dot, placements = terms.J, terms.J_dot, terms.placements
    G_links = np.zeros((n, n))
    for i in range(n):
        block = links.total_mass * placements[:, 4 * i : 4 * i + 4]
        centre = block[:, 0] + np.ascontiguousarray(block[:, 1:]) @ links.levers[i]
        weight = -links.masses[i] * links.gravity
        turning = np.array(
            [
                centre[1] * weight[2] - centre[2] * weight[1],
                centre[2] * weight[0] - centre[0] * weight[2],
                centre[0] * weight[1] - centre[1] * weight[0],
            ]
        )
        for j in range(i + 1):
            for k in range(3):
                G_links[i, j] += J[k, j] * weight[k] + J[3 + k, j] * turning[k]
    k = 4 * (links.tool_joint - 1)
    carrier = links.total_mass * placements[:, k : k + 4]
    carrier_rotation = np.ascontiguousarray(carrier[:, 1:])
    p = carrier[:, 0] + carrier_rotation @ links.tool_lever
    J_w = np.ascontiguousarray(J[3:])
    J_w_dot = np.ascontiguousarray(J_dot[3:])
    J_v = J[:3] - _cross_columns(p, J_w)
    J_v_dot = J_dot[:3] - _cross_columns(p, J_w_dot) - _cross_columns(J_v @ q_dot, J_w)
    M_hat = np.ascontiguousarray(terms.M)
    return Estimate(
        M_hat,
        M_hat - np.diag(links.rotor),
        np.ascontiguousarray(terms.C),
        G_links.sum(axis=0),
        G_links,
        p,
        carrier_rotation @ links.tool_rotation,
        J_v,
        J_w,
        J_v_dot,
        J_w_dot,
    )


class NominalModel:
    """The arm as the controller knows it: a serial chain of n links.

    model: pin.Model with nq = nv = n; tool_joint and tool_placement say where the tool frame sits.
    """

    def __init__(self, model: pin.Model, tool_joint: int, tool_placement: pin.SE3) -> None:
        self.model = model
        self.data = model.createData()
        links = list(model.inertias)[1:]
        self.links = LinkConstants(
            masses=np.array([link.mass for link in links]),
            levers=np.array([link.lever for link in links]),
            rotor=np.array(model.armature),
            gravity=np.array(model.gravity.linear),
            total_mass=float(pin.computeTotalMass(model)),
            tool_joint=tool_joint,
            tool_rotation=np.ascontiguousarray(tool_placement.rotation),
            tool_lever=np.array(tool_placement.translation),
        )
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
        return estimates(self.update(q, q_dot), self.links, q_dot)


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
