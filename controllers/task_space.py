"""The task space r(x, t): r, r_dot, J_q, J_q_dot, v_t, v_t_dot of (3) and (31).

r stacks, all in metres, positions (coordinates of the tool point, on a surface (phi, psi_1, psi_2)), l times Euler
angles of the tool in the task frame, and l times supplemental joint angles (Remark 5). The characteristic length l
makes metres and radians comparable, so that a scalar d and a 2-norm mean something.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from controllers.norms import spectral_norm


class TaskSpace(NamedTuple):
    """r, r_dot, v_t, v_t_dot (n,); J_q, J_q_dot, J_q_inv (n, n) and J_q_inv's norm from above (see `spectral_norm`);
    normal (3,): gradient of phi in the world frame."""

    r: np.ndarray
    r_dot: np.ndarray
    J_q: np.ndarray
    J_q_dot: np.ndarray
    J_q_inv: np.ndarray
    J_q_inv_norm: float
    v_t: np.ndarray
    v_t_dot: np.ndarray
    normal: np.ndarray


class TaskLayout(NamedTuple):
    """Which coordinates make up r.

    joint: r = q (section 4.1), otherwise positions (2 or 3), angles (0, 1 or 3), supplemental joints by number;
    l: characteristic length, m; R_ref (3, 3): the tool's orientation at which the Euler angles vanish.
    """

    joint: bool
    positions: int
    angles: int
    supplemental: np.ndarray
    l: float
    R_ref: np.ndarray

    @property
    def n(self) -> int:
        """Number of task coordinates."""
        return self.positions + self.angles + len(self.supplemental)


@njit(cache=True, error_model="numpy")
def euler_angles(R):
    """Angles (alpha, beta, gamma) of R = R_z(gamma) R_y(beta) R_x(alpha)."""
    return np.array(
        [
            np.arctan2(R[2, 1], R[2, 2]),
            np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0])),
            np.arctan2(R[1, 0], R[0, 0]),
        ]
    )


@njit(cache=True, error_model="numpy")
def _euler_rates(angles, omega):
    """E_inv with angles_dot = E_inv omega, angles_dot, and the exact time derivative of E."""
    b, c = angles[1], angles[2]
    sb, cb, sc, cc = np.sin(b), np.cos(b), np.sin(c), np.cos(c)
    E_inv = np.array([[cc / cb, sc / cb, 0.0], [-sc, cc, 0.0], [cc * sb / cb, sc * sb / cb, 1.0]])
    rates = E_inv @ omega
    b_dot, c_dot = rates[1], rates[2]
    E_dot = np.array(
        [
            [-sb * cc * b_dot - cb * sc * c_dot, -cc * c_dot, 0.0],
            [-sb * sc * b_dot + cb * cc * c_dot, -sc * c_dot, 0.0],
            [-cb * b_dot, 0.0, 0.0],
        ]
    )
    return E_inv, rates, E_dot


@njit(cache=True, error_model="numpy")
def _cartesian(layout, chart, estimate, q, q_dot):
    n, positions, angles, l = q.shape[0], layout.positions, layout.angles, layout.l
    r, v_t, v_t_dot = np.zeros(n), np.zeros(n), np.zeros(n)
    J_q, J_q_dot = np.zeros((n, n)), np.zeros((n, n))
    p_dot = estimate.J_v @ q_dot
    G_dot = chart.G_t.copy()
    for i in range(positions):
        G_dot[i] += chart.G_p[i] @ p_dot
    J_q[:positions] = (chart.G @ estimate.J_v)[:positions]
    J_q_dot[:positions] = (G_dot @ estimate.J_v + chart.G @ estimate.J_v_dot)[:positions]
    r[:positions] = chart.g[:positions]
    v_t[:positions] = chart.g_t[:positions]
    v_t_dot[:positions] = (chart.G_t @ p_dot + chart.g_tt)[:positions]
    if angles > 0:
        R = layout.R_ref.T @ estimate.R
        J_w, J_w_dot = layout.R_ref.T @ estimate.J_w, layout.R_ref.T @ estimate.J_w_dot
        if angles == 3:
            phi = euler_angles(R)
            E_inv, _, E_dot = _euler_rates(phi, J_w @ q_dot)
            J_phi = E_inv @ J_w
            r[positions : positions + 3] = l * phi
            J_q[positions : positions + 3] = l * J_phi
            J_q_dot[positions : positions + 3] = l * (E_inv @ (J_w_dot - E_dot @ J_phi))
        else:
            r[positions] = l * np.arctan2(R[0, 2], R[0, 0])
            J_q[positions] = l * J_w[1]
            J_q_dot[positions] = l * J_w_dot[1]
    for k in range(layout.supplemental.shape[0]):
        r[positions + angles + k] = l * q[layout.supplemental[k]]
        J_q[positions + angles + k, layout.supplemental[k]] = l
    J_q_inv = np.ascontiguousarray(np.linalg.inv(J_q))
    return TaskSpace(
        r, J_q @ q_dot + v_t, J_q, J_q_dot, J_q_inv, spectral_norm(J_q_inv), v_t, v_t_dot, chart.G[0].copy()
    )


@njit(cache=True, error_model="numpy")
def _joint(chart, q, q_dot):
    n = q.shape[0]
    J_q = np.eye(n)
    zero = np.zeros(n)
    return TaskSpace(
        q.copy(), q_dot.copy(), J_q, np.zeros((n, n)), J_q.copy(), 1.0, zero, zero.copy(), chart.G[0].copy()
    )


@njit(cache=True, error_model="numpy")
def task_space(layout, chart, estimate, q, q_dot):
    """The `TaskSpace` at one instant, (3).

    chart: g, G, G_p, g_t, G_t, g_tt of the tool point, as `environments.surfaces.Chart` has them.
    Raises ValueError where J_q is exactly singular.
    """
    if layout.joint:
        return _joint(chart, q, q_dot)
    return _cartesian(layout, chart, estimate, q, q_dot)
