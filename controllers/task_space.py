"""Task space r(x, t): r, r_dot, J_q, J_q_dot, v_t, v_t_dot of (3) and (31).

r stacks, all in metres:
- positions: coordinates of the tool point, on a surface (phi, psi_1, psi_2), in a corner (phi_1, phi_2, psi) or
  (phi_1, phi_2, phi_3);
- l times Euler angles of the tool in the task frame;
- supplemental joints (Remark 5): l times the angle of a revolute one, a prismatic one as it is.
The characteristic length l makes metres and radians comparable, so that a scalar d and a 2-norm make sense.

A flat tool on a plane has (phi, l t_1, l t_2, psi_1, psi_2, l gamma): t_i = n . e_i, the sines of the tilts of two axes
of its face against the plane, which belong to Phi of (30), and its turn gamma about the plane's normal at the start.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kernels import inline
from kernels.algebra import copy, copy_matrix, cross, dot, invert, row_times, spectral_norm, times


class TaskSpace(NamedTuple):
    """Task coordinates at one instant.
    r, r_dot: (n,) m and m/s.
    J_q, J_q_dot: (n, n) m and m/s, of (3).
    J_q_inv: (n, n) 1/m.
    J_q_inv_norm: 1/m, an upper bound of the norm of J_q_inv (see `spectral_norm`).
    v_t, v_t_dot: (n,) m/s and m/s^2, of (3): rate of r with the arm at rest, and its derivative.
    normals: (3, 3), gradients of the first three coordinates in the world frame: of phi, or of each phi, first.
    turn: (n,) m, the length after which a coordinate is at the same place again, as an angle; 0 for one that never
    is."""

    r: np.ndarray
    r_dot: np.ndarray
    J_q: np.ndarray
    J_q_dot: np.ndarray
    J_q_inv: np.ndarray
    J_q_inv_norm: float
    v_t: np.ndarray
    v_t_dot: np.ndarray
    normals: np.ndarray
    turn: np.ndarray

    @classmethod
    def zeros(cls, n: int) -> TaskSpace:
        """Task coordinates of an arm with n joints."""
        vector, square = np.zeros(n), np.zeros((n, n))
        return cls(vector, vector, square, square, square, 0.0, vector, vector, np.zeros((3, 3)), vector)


class TaskLayout(NamedTuple):
    """Coordinates that make up r.

    joint: r = q (section 4.1), otherwise positions (2 or 3), angles (0, 1 or 3), then supplemental.
    supplemental: (n,), numbers of the joints that are coordinates themselves, of which the first n - positions - angles
    count.
    supplemental_lengths: (n,), metres per unit of these: l for a revolute joint, 1 for a prismatic one.
    l: characteristic length, m.
    R_ref: (3, 3), the tool's orientation at which the Euler angles vanish.
    tilts: 2 for a flat tool on a plane, otherwise 0. The two tilts stand after phi, the turn after the positions; the
    tool has no other angles then.
    face: (2, 3), axes of the face in the tool's frame.
    level: (2, 3), directions in the world: of the face's first axis along the plane at the start, and across it.
    """

    n: int
    joint: bool
    positions: int
    angles: int
    supplemental: np.ndarray
    supplemental_lengths: np.ndarray
    l: float
    R_ref: np.ndarray
    tilts: int
    face: np.ndarray
    level: np.ndarray

    @property
    def position_indices(self) -> tuple[int, ...]:
        """Numbers of the coordinates that are positions."""
        return (0, *range(1 + self.tilts, self.end_of_positions)) if self.positions else ()

    @property
    def end_of_positions(self) -> int:
        """Number of the first coordinate after the positions."""
        return self.positions + self.tilts

    @property
    def turns(self) -> tuple[int, ...]:
        """Numbers of the coordinates that are angles of the tool, tilts included."""
        end = self.n - len(self.supplemental_joints)
        return () if self.joint else tuple(i for i in range(end) if i not in self.position_indices)

    @property
    def supplemental_joints(self) -> tuple[int, ...]:
        """Numbers, from 0, of the joints that are coordinates themselves."""
        return tuple(self.supplemental[: self.n - self.positions - self.angles].tolist())

    @property
    def lengths(self) -> np.ndarray:
        """Metres per unit of the coordinates (n,): l of angles, 1 of lengths, and 1 where r = q, whose coordinates stay
        as they are."""
        lengths = np.ones(self.n)
        lengths[list(self.turns)] = self.l
        if not self.joint:
            extra = len(self.supplemental_joints)
            lengths[self.n - extra :] = self.supplemental_lengths[:extra]
        return lengths


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
    for c in range(layout.positions):
        i = c + layout.tilts if c > 0 else 0
        task.r[i], task.v_t[i], task.v_t_dot[i], task.turn[i] = chart.g[c], chart.g_t[c], chart.g_tt[c], chart.turn[c]
        for k in range(3):
            task.v_t_dot[i] += chart.G_t[c, k] * p_dot[k]
        for j in range(task.r.shape[0]):
            task.J_q[i, j], task.J_q_dot[i, j] = 0.0, 0.0
        for k in range(3):
            gradient, gradient_dot = chart.G[c, k], chart.G_t[c, k]
            for a in range(3):
                gradient_dot += chart.G_p[c, k, a] * p_dot[a]
            for j in range(task.r.shape[0]):
                task.J_q[i, j] += gradient * estimate.J_v[k, j]
                task.J_q_dot[i, j] += gradient_dot * estimate.J_v[k, j] + gradient * estimate.J_v_dot[k, j]


@inline
def _turned(R, axis):
    """R axis, as a tuple."""
    return (
        R[0, 0] * axis[0] + R[0, 1] * axis[1] + R[0, 2] * axis[2],
        R[1, 0] * axis[0] + R[1, 1] * axis[1] + R[1, 2] * axis[2],
        R[2, 0] * axis[0] + R[2, 1] * axis[1] + R[2, 2] * axis[2],
    )


@inline
def _turning_row(i, l, about, about_dot, estimate, task):
    """Write row i of J_q and J_q_dot of l times an angle whose rate is about . omega; about, about_dot: tuples."""
    for j in range(task.r.shape[0]):
        rate, rate_dot = 0.0, 0.0
        for a in range(3):
            rate += about[a] * estimate.J_w[a, j]
            rate_dot += about_dot[a] * estimate.J_w[a, j] + about[a] * estimate.J_w_dot[a, j]
        task.J_q[i, j], task.J_q_dot[i, j] = l * rate, l * rate_dot


@inline
def _face(layout, chart, estimate, q_dot, task):
    """Compute l times the tilts t_i = n . e_i, whose rate is (e_i x n) . omega + n_t . e_i, and l times the turn, the
    angle of e_1 from the first axis of `level` to the second."""
    l, n, n_t, n_tt = layout.l, chart.G[0], chart.G_t[0], chart.normal_tt
    x, y, z = 0.0, 0.0, 0.0
    for j in range(task.r.shape[0]):
        x += estimate.J_w[0, j] * q_dot[j]
        y += estimate.J_w[1, j] * q_dot[j]
        z += estimate.J_w[2, j] * q_dot[j]
    omega = (x, y, z)
    for k in range(layout.tilts):
        e = _turned(estimate.R, layout.face[k])
        e_dot = cross(omega, e)
        about, moved, turned = cross(e, n), cross(e_dot, n), cross(e, n_t)
        _turning_row(
            1 + k, l, about, (moved[0] + turned[0], moved[1] + turned[1], moved[2] + turned[2]), estimate, task
        )
        task.r[1 + k], task.v_t[1 + k] = l * dot(n, e), l * dot(n_t, e)
        task.v_t_dot[1 + k] = l * (dot(n_tt, e) + dot(n_t, e_dot))
    e, u, v = _turned(estimate.R, layout.face[0]), layout.level[0], layout.level[1]
    e_dot, i = cross(omega, e), layout.positions + layout.tilts
    a, b, a_dot, b_dot = dot(u, e), dot(v, e), dot(u, e_dot), dot(v, e_dot)
    square = a * a + b * b
    growth = 2.0 * (a * a_dot + b * b_dot) / square
    across, moved = cross(e, v), cross(e_dot, v)
    along, moving = cross(e, u), cross(e_dot, u)
    about = (
        (a * across[0] - b * along[0]) / square,
        (a * across[1] - b * along[1]) / square,
        (a * across[2] - b * along[2]) / square,
    )
    about_dot = (
        (a_dot * across[0] + a * moved[0] - b_dot * along[0] - b * moving[0]) / square - growth * about[0],
        (a_dot * across[1] + a * moved[1] - b_dot * along[1] - b * moving[1]) / square - growth * about[1],
        (a_dot * across[2] + a * moved[2] - b_dot * along[2] - b * moving[2]) / square - growth * about[2],
    )
    _turning_row(i, l, about, about_dot, estimate, task)
    task.r[i], task.turn[i] = l * np.arctan2(b, a), 2.0 * np.pi * l


@inline
def _angles(layout, estimate, q_dot, task):
    """Compute l times three Euler angles, or the one of a planar arm."""
    n, i, l = task.r.shape[0], layout.positions, layout.l
    if layout.angles == 1:
        cos = row_times(layout.R_ref, 0, estimate.R[0])  # of R R_ref^T, a rotation about the world's y axis, however
        sin = row_times(layout.R_ref, 2, estimate.R[0])  # the frame of the tool lies on it
        task.r[i], task.turn[i] = l * np.arctan2(sin, cos), 2.0 * np.pi * l
        for j in range(n):
            task.J_q[i, j] = l * estimate.J_w[1, j]
            task.J_q_dot[i, j] = l * estimate.J_w_dot[1, j]
        return
    alpha, beta, gamma = euler_angles(layout.R_ref, estimate.R)
    task.r[i], task.r[i + 1], task.r[i + 2] = l * alpha, l * beta, l * gamma
    task.turn[i] = task.turn[i + 2] = 2.0 * np.pi * l  # beta stays within a quarter of a turn
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
    for i in range(layout.positions + layout.tilts, n):
        task.v_t[i], task.v_t_dot[i] = 0.0, 0.0
    if layout.tilts > 0:
        _face(layout, chart, estimate, q_dot, task)
    elif layout.angles > 0:
        _angles(layout, estimate, q_dot, task)
    first = layout.positions + layout.angles
    for i in range(first, n):
        joint = layout.supplemental[i - first]
        for j in range(n):
            task.J_q[i, j], task.J_q_dot[i, j] = 0.0, 0.0
        task.r[i] = layout.supplemental_lengths[i - first] * q[joint]
        task.J_q[i, joint] = layout.supplemental_lengths[i - first]
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
def turn_towards(near, task):
    """Move each angle in r by whole turns to the value that is nearest to that in `near` (n,): an angle of (3) is known
    up to whole turns only, and e_r must not jump by one."""
    for i in range(task.r.shape[0]):
        if task.turn[i] > 0.0:
            task.r[i] += task.turn[i] * np.floor((near[i] - task.r[i]) / task.turn[i] + 0.5)


@inline
def task_space(layout, chart, estimate, q, q_dot, work, task):
    """Compute the `TaskSpace` at one instant, (3).

    chart: g, G, G_p, g_t, G_t, g_tt of the tool point, see `environments.surfaces.chart.Chart`; work: a `Scratch`.
    Raises ValueError where J_q is exactly singular.
    """
    copy_matrix(chart.G, task.normals)
    if layout.joint:
        _joint(q, q_dot, task)
    else:
        _cartesian(layout, chart, estimate, q, q_dot, work, task)
