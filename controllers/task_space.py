"""Task space r(x, t): r, r_dot, J_q, J_q_dot, v_t, v_t_dot of (3) and (31).

r stacks, all in metres, positions (coordinates of the tool point, on a surface (phi, psi_1, psi_2), in a corner
(phi_1, phi_2, psi) or (phi_1, phi_2, phi_3)), l times Euler
angles of the tool in the task frame, and l times supplemental joint angles (Remark 5). The characteristic length l
makes metres and radians comparable, so that a scalar d and a 2-norm make sense.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kernels import inline
from kernels.algebra import copy, copy_matrix, invert, spectral_norm, times


class TaskSpace(NamedTuple):
    """Task coordinates at one instant.
    r, r_dot, v_t, v_t_dot: (n,).
    J_q, J_q_dot, J_q_inv: (n, n).
    J_q_inv_norm: an upper bound of J_q_inv's norm (see `spectral_norm`).
    normals: (3, 3), gradients of the first three coordinates in the world frame: of phi, or of each phi, first."""

    r: np.ndarray
    r_dot: np.ndarray
    J_q: np.ndarray
    J_q_dot: np.ndarray
    J_q_inv: np.ndarray
    J_q_inv_norm: float
    v_t: np.ndarray
    v_t_dot: np.ndarray
    normals: np.ndarray

    @classmethod
    def zeros(cls, n: int) -> TaskSpace:
        """Task coordinates of an arm with n joints."""
        vector, square = np.zeros(n), np.zeros((n, n))
        return cls(vector, vector, square, square, square, 0.0, vector, vector, np.zeros((3, 3)))


class TaskLayout(NamedTuple):
    """Coordinates that make up r.

    joint: r = q (section 4.1), otherwise positions (2 or 3), angles (0, 1 or 3), then supplemental.
    supplemental: (n,), numbers of the joints that are coordinates themselves, of which the first n - positions - angles
    count.
    l: characteristic length, m.
    R_ref: (3, 3), the tool's orientation at which the Euler angles vanish.
    """

    n: int
    joint: bool
    positions: int
    angles: int
    supplemental: np.ndarray
    l: float
    R_ref: np.ndarray

    @property
    def supplemental_joints(self) -> tuple[int, ...]:
        """Numbers, from 0, of the joints that are coordinates themselves."""
        return tuple(self.supplemental[: self.n - self.positions - self.angles].tolist())


class Scratch(NamedTuple):
    """Scratch memory for intermediate results: S, T, U (n, n), u (n,), and in space Y (3, n)."""

    S: np.ndarray
    T: np.ndarray
    U: np.ndarray
    u: np.ndarray
    Y: np.ndarray

    @classmethod
    def zeros(cls, n: int) -> Scratch:
        """Scratch memory for n joints."""
        square = np.zeros((n, n))
        return cls(square, square, square, np.zeros(n), np.zeros((3, n)))


@inline
def euler_angles(R_ref, R):
    """Angles (alpha, beta, gamma) of R_ref^T R = R_z(gamma) R_y(beta) R_x(alpha)."""
    xx, yx, zx = _relative(R_ref, R, 0)
    _, _, zy = _relative(R_ref, R, 1)
    _, _, zz = _relative(R_ref, R, 2)
    return np.arctan2(zy, zz), np.arctan2(-zx, np.hypot(xx, yx)), np.arctan2(yx, xx)


@inline
def _relative(R_ref, A, j):
    """Column j of R_ref^T A, as a tuple."""
    x, y, z = A[0, j], A[1, j], A[2, j]
    return (
        R_ref[0, 0] * x + R_ref[1, 0] * y + R_ref[2, 0] * z,
        R_ref[0, 1] * x + R_ref[1, 1] * y + R_ref[2, 1] * z,
        R_ref[0, 2] * x + R_ref[1, 2] * y + R_ref[2, 2] * z,
    )


@inline
def _euler_rates(sb, cb, sc, cc, omega):
    """Rates of the Euler angles, E^-1 omega; s and c are sine and cosine of beta and gamma."""
    along = (cc * omega[0] + sc * omega[1]) / cb
    return along, cc * omega[1] - sc * omega[0], sb * along + omega[2]


@inline
def _positions(layout, chart, estimate, task):
    """Compute the coordinates on surfaces, or Cartesian ones, of the tool point: (31) and its derivatives."""
    p_dot = estimate.p_dot
    for i in range(layout.positions):
        task.r[i], task.v_t[i], task.v_t_dot[i] = chart.g[i], chart.g_t[i], chart.g_tt[i]
        for k in range(3):
            task.v_t_dot[i] += chart.G_t[i, k] * p_dot[k]
        for j in range(task.r.shape[0]):
            task.J_q[i, j], task.J_q_dot[i, j] = 0.0, 0.0
        for k in range(3):
            gradient, gradient_dot = chart.G[i, k], chart.G_t[i, k]
            for a in range(3):
                gradient_dot += chart.G_p[i, k, a] * p_dot[a]
            for j in range(task.r.shape[0]):
                task.J_q[i, j] += gradient * estimate.J_v[k, j]
                task.J_q_dot[i, j] += gradient_dot * estimate.J_v[k, j] + gradient * estimate.J_v_dot[k, j]


@inline
def _angles(layout, estimate, q_dot, task):
    """Compute l times three Euler angles, or the one of a planar arm."""
    n, i, l = task.r.shape[0], layout.positions, layout.l
    if layout.angles == 1:
        cos, sin = _relative(layout.R_ref, estimate.R, 0)[0], _relative(layout.R_ref, estimate.R, 2)[0]
        task.r[i] = l * np.arctan2(sin, cos)
        for j in range(n):
            task.J_q[i, j] = l * _relative(layout.R_ref, estimate.J_w, j)[1]
            task.J_q_dot[i, j] = l * _relative(layout.R_ref, estimate.J_w_dot, j)[1]
        return
    alpha, beta, gamma = euler_angles(layout.R_ref, estimate.R)
    task.r[i], task.r[i + 1], task.r[i + 2] = l * alpha, l * beta, l * gamma
    sb, cb, sc, cc = np.sin(beta), np.cos(beta), np.sin(gamma), np.cos(gamma)
    b_dot, c_dot = 0.0, 0.0
    for j in range(n):
        rates = _euler_rates(sb, cb, sc, cc, _relative(layout.R_ref, estimate.J_w, j))
        task.J_q[i, j], task.J_q[i + 1, j], task.J_q[i + 2, j] = l * rates[0], l * rates[1], l * rates[2]
        b_dot += rates[1] * q_dot[j]
        c_dot += rates[2] * q_dot[j]
    for j in range(n):
        # J_phi_dot = E^-1 (J_w_dot - E_dot J_phi), the derivative of E exact
        a, b = task.J_q[i, j] / l, task.J_q[i + 1, j] / l
        w_dot = _relative(layout.R_ref, estimate.J_w_dot, j)
        rates = _euler_rates(
            sb,
            cb,
            sc,
            cc,
            (
                w_dot[0] + (sb * cc * b_dot + cb * sc * c_dot) * a + cc * c_dot * b,
                w_dot[1] + (sb * sc * b_dot - cb * cc * c_dot) * a + sc * c_dot * b,
                w_dot[2] + cb * b_dot * a,
            ),
        )
        task.J_q_dot[i, j], task.J_q_dot[i + 1, j], task.J_q_dot[i + 2, j] = l * rates[0], l * rates[1], l * rates[2]


@inline
def _cartesian(layout, chart, estimate, q, q_dot, work, task):
    n = task.r.shape[0]
    _positions(layout, chart, estimate, task)
    if layout.angles > 0:
        _angles(layout, estimate, q_dot, task)
    first = layout.positions + layout.angles
    for i in range(layout.positions, n):
        task.v_t[i], task.v_t_dot[i] = 0.0, 0.0
    for i in range(first, n):
        joint = layout.supplemental[i - first]
        for j in range(n):
            task.J_q[i, j], task.J_q_dot[i, j] = 0.0, 0.0
        task.r[i] = layout.l * q[joint]
        task.J_q[i, joint] = layout.l
    times(task.J_q, q_dot, task.r_dot)
    for i in range(n):
        task.r_dot[i] += task.v_t[i]
    invert(task.J_q, work.S, task.J_q_inv)
    task.J_q_inv_norm = spectral_norm(task.J_q_inv)


@inline
def _joint(q, q_dot, task):
    copy(q, task.r)
    copy(q_dot, task.r_dot)
    for i in range(q.shape[0]):
        task.v_t[i], task.v_t_dot[i] = 0.0, 0.0
        for j in range(q.shape[0]):
            task.J_q[i, j] = task.J_q_inv[i, j] = 1.0 if i == j else 0.0
            task.J_q_dot[i, j] = 0.0
    task.J_q_inv_norm = 1.0


@inline
def task_space(layout, chart, estimate, q, q_dot, work, task):
    """Compute the `TaskSpace` at one instant, (3).

    chart: g, G, G_p, g_t, G_t, g_tt of the tool point, as `environments.surfaces.Chart` has them; work: a `Scratch`.
    Raises ValueError where J_q is exactly singular.
    """
    copy_matrix(chart.G, task.normals)
    if layout.joint:
        _joint(q, q_dot, task)
    else:
        _cartesian(layout, chart, estimate, q, q_dot, work, task)
