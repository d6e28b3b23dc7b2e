"""Independent simulator: the closed loop as a differential equation, straight from the paper, in continuous time.

It uses nothing of `controllers/`, and of `environments/` only the arm's description: (2), (3), (5), (9), (10), (13),
(15), (16), (31), (32), (39) in plain numpy, with the law in task space where the product has it in joint space (25).
Pinocchio gives M, C, G and the tool's Jacobian. Coordinates are written as functions of the tool's position and time
alone: their partial derivatives are computed by complex steps, J_q_dot and v_t_dot by central differences along the
motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

from app.evidence.independent_surfaces import TINY, Corner, Face, Surface
from environments.robots import Robot

STEP = 1e-3  # s, of differences along the motion, fourth order


class Kinematics(NamedTuple):
    """Kinematics (3).
    r: (n,) m.
    J_q: (n, n).
    v_t: (n,) m/s.
    J: (6, n), of the tool.
    normals: (k, 3), gradients of phi of k surfaces.
    turning: (2, 3) m, which gives the rates of l times a flat face's tilts from the angular velocity; (0, 3) for
    another tool."""

    r: np.ndarray
    J_q: np.ndarray
    v_t: np.ndarray
    J: np.ndarray
    normals: np.ndarray
    turning: np.ndarray


class Motion(NamedTuple):
    """Motion of the tool: r, r_dot, J_q, J_q_dot, v_t, v_t_dot of (3), and J, normals and turning as in
    `Kinematics`."""

    r: np.ndarray
    r_dot: np.ndarray
    J_q: np.ndarray
    J_q_dot: np.ndarray
    v_t: np.ndarray
    v_t_dot: np.ndarray
    J: np.ndarray
    normals: np.ndarray
    turning: np.ndarray

    def wrench(self, lam: np.ndarray) -> np.ndarray:
        """Wrench (6,) of the tool on the environment. lam: multipliers (m,) N, of a flat face also moments over l."""
        k = len(self.normals)
        return np.concatenate([self.normals.T @ lam[:k], self.turning.T @ lam[k:]])


class LawAnswer(NamedTuple):
    """Answer of the law: tau (n,) N m, z_dot (n,) m/s^2 and s (n,) m/s."""

    tau: np.ndarray
    z_dot: np.ndarray
    s: np.ndarray


@dataclass(frozen=True)
class Gains:
    """Gains of the law, matrices (n, n).
    M_m, B_m, K_m, K_f: of (8).
    A, F_1, F_2: of (9), (10).
    K_s: of (15).
    d: N.
    layer: boundary layer, m/s."""

    M_m: np.ndarray
    B_m: np.ndarray
    K_m: np.ndarray
    K_f: np.ndarray
    A: np.ndarray
    F_1: np.ndarray
    F_2: np.ndarray
    K_s: np.ndarray
    d: float
    layer: float


@dataclass(frozen=True)
class Wish:
    """Reference of the law: a path to and fro, and sinusoidal forces.
    displacement: (n,) m, of r_d, which goes there from its start and back, once in 2 pi / omega s.
    omega: rad/s.
    mean, swing: (p,) N, of f_nd = mean + swing sin(f_omega t).
    f_omega: rad/s.
    compliance, beside: (p, p) m/N and (p, m - p) N/m, of r_fd = compliance (f_nd - beside r_od), (33), where r_od is
    the desired distance from the other m - p surfaces, all of which are touched."""

    displacement: np.ndarray
    omega: float
    mean: np.ndarray
    swing: np.ndarray
    f_omega: float
    compliance: np.ndarray
    beside: np.ndarray


@dataclass(frozen=True)
class World:
    """World around the controller.
    rigid: whether the surfaces are rigid.
    M_e, B_e, K_e: (m, m) kg, N s/m, N/m, of the contacts with m elastic surfaces.
    scaling: factor of all links' inertia.
    viscous: friction in the joints, N m s/rad.
    all: whether F_c = F_r rather than its normal part.
    push: wrench (6,) on the tool, N and N m along the world's axes, which the sensor measures like the contact's.
    face: of a flat tool, None for another tool."""

    surfaces: tuple[Surface, ...]
    rigid: bool
    M_e: np.ndarray
    B_e: np.ndarray
    K_e: np.ndarray
    scaling: float
    viscous: float
    all: bool
    push: np.ndarray
    face: Face | None = None


class PaperLoop:
    """Loop of an arm on bilateral surfaces under the law of Theorem 1, from q_0 rad, q_dot_0 rad/s (n,) with s(0) = 0.

    r: phi of each of m surfaces, psi (psi_1, psi_2), then l times the Euler angles of the tool: three, or one for an
    arm in the x-z plane. With a flat face on one plane: phi, l times two tilts, psi_1, psi_2, l times the turn.
    """

    def __init__(
        self, robot: Robot, q_0: np.ndarray, q_dot_0: np.ndarray, gains: Gains, wish: Wish, world: World, l: float
    ) -> None:
        self.q_0, self.q_dot_0, self.gains, self.wish, self.world, self.l = q_0, q_dot_0, gains, wish, world, l
        self.planar, self.n, self.m = robot.geometry == "planar", robot.n, len(world.surfaces)
        self.m += 0 if world.face is None else len(world.face.axes)
        self.believed = robot.model.copy()
        tool = pin.Frame("tool of the paper", robot.tool_joint, 0, robot.tool_placement, pin.FrameType.OP_FRAME)
        self.frame = self.believed.addFrame(tool)
        self.true = robot.model.copy()
        for i in range(1, self.true.njoints):
            body = self.true.inertias[i]
            self.true.inertias[i] = pin.Inertia(world.scaling * body.mass, body.lever, world.scaling * body.inertia)
        self.data, self.true_data = self.believed.createData(), self.true.createData()
        p_0, self.R_0, _ = self._tool(q_0)
        self.corner = Corner.at(world.surfaces, p_0)

    def _tool(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        J = pin.computeFrameJacobian(self.believed, self.data, q, self.frame, pin.LOCAL_WORLD_ALIGNED).copy()
        return self.data.oMf[self.frame].translation.copy(), self.data.oMf[self.frame].rotation.copy(), J

    def kinematics(self, q: np.ndarray, t: float) -> Kinematics:
        """Kinematics (3): r, dr/dq and dr/dt at the joint angles q (n,) rad and the time t (s)."""
        p, R, J = self._tool(q)
        g, G, g_t = self.corner.with_derivatives(p, t)
        normals = G[: len(self.world.surfaces)]
        if self.world.face is not None:
            return self._on_face(self.world.face, R, J, (g, G, g_t), t)
        turned, spin = self.R_0.T @ R, self.R_0.T @ J[3:]
        if self.planar:
            k, angles, J_angles = 2, [np.arctan2(turned[0, 2], turned[0, 0])][: self.n - 2], spin[1:2][: self.n - 2]
        else:
            k, angles = 3, pin.rpy.matrixToRpy(turned)
            x, y, z = np.eye(3)
            Rz, Ry = pin.rpy.rpyToMatrix(0.0, 0.0, angles[2]), pin.rpy.rpyToMatrix(0.0, angles[1], 0.0)
            J_angles = np.linalg.solve(np.stack([Rz @ Ry @ x, Rz @ y, z], axis=1), spin)
        return Kinematics(
            np.concatenate([g[:k], self.l * np.array(angles)]),
            np.vstack([(G @ J[:3])[:k], self.l * J_angles]),
            np.concatenate([g_t[:k], np.zeros(len(angles))]),
            J,
            normals,
            np.zeros((0, 3)),
        )

    def _on_face(
        self, face: Face, R: np.ndarray, J: np.ndarray, place: tuple[np.ndarray, np.ndarray, np.ndarray], t: float
    ) -> Kinematics:
        """Kinematics of a flat face. place: coordinates of the tool's position with their derivatives."""
        (g, G, g_t), l = place, self.l
        turns = [R + 1j * TINY * np.cross(axis, R, axisb=0, axisc=0) for axis in np.eye(3)]
        times = t + 1j * TINY * np.eye(4)[3]
        angles = face.attitude(np.stack([*turns, R]), self.world.surfaces[0].normal_at(times))
        by_turn, in_time = l * np.imag(angles[:, :3]) / TINY, l * np.imag(angles[:, 3]) / TINY
        order = [0, 3, 4, 1, 2, 5]  # phi, tilts, psi, turn
        return Kinematics(
            np.concatenate([g, l * np.real(angles[:, 0])])[order],
            np.vstack([G @ J[:3], by_turn @ J[3:]])[order],
            np.concatenate([g_t, in_time])[order],
            J,
            G[:1],
            by_turn[:2],
        )

    def motion(self, q: np.ndarray, q_dot: np.ndarray, t: float) -> Motion:
        """Motion (3) with the total derivatives of J_q and v_t."""
        here = self.kinematics(q, t)
        around = [self.kinematics(q + k * STEP * q_dot, t + k * STEP) for k in (-2, -1, 1, 2)]
        weights = np.array([1.0, -8.0, 8.0, -1.0]) / (12 * STEP)
        J_q_dot = np.tensordot(weights, [k.J_q for k in around], 1)
        v_t_dot = np.tensordot(weights, [k.v_t for k in around], 1)
        r_dot = here.J_q @ q_dot + here.v_t
        return Motion(here.r, r_dot, here.J_q, J_q_dot, here.v_t, v_t_dot, here.J, here.normals, here.turning)

    def reference(self, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Reference: r_d m, its two derivatives, and f_nd N."""
        w = self.wish
        start, to, c, s = self._start, w.displacement, np.cos(w.omega * t), np.sin(w.omega * t)
        r_d = start + to * (1 - c) / 2
        rate, acceleration = to * w.omega * s / 2, to * w.omega**2 * c / 2
        fc, fs = np.cos(w.f_omega * t), np.sin(w.f_omega * t)
        p, m = len(w.mean), self.m
        r_d[:p] = w.compliance @ (w.mean + w.swing * fs - w.beside @ r_d[p:m])
        rate[:p] = w.compliance @ (w.swing * w.f_omega * fc - w.beside @ rate[p:m])
        acceleration[:p] = w.compliance @ (-w.swing * w.f_omega**2 * fs - w.beside @ acceleration[p:m])
        return r_d, rate, acceleration, w.mean + w.swing * fs

    @cached_property
    def _start(self) -> np.ndarray:
        return self.kinematics(self.q_0, 0.0).r

    def forces(self, m: Motion, lam: np.ndarray, f_nd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """F_r and e_Fc (n,) N, where the sensor measures the force of the multipliers lam (m,) N and the push; (40)
        leaves the multipliers whose force is nearest to the measured one."""
        F, k, p = m.wrench(lam) - self.world.push, len(m.normals), len(f_nd)
        F_r = np.linalg.solve(m.J_q.T, m.J.T @ F)
        e_F = F_r.copy() if self.world.all else np.zeros(self.n)
        e_F[:p] = np.concatenate([np.linalg.lstsq(m.normals.T, F[:3])[0], F_r[k : self.m]])[:p] - f_nd
        return F_r, e_F

    def law(self, m: Motion, q: np.ndarray, q_dot: np.ndarray, z: np.ndarray, lam: np.ndarray, t: float) -> LawAnswer:
        """Law (9), (10), (13), (15), (16) with the force of the multipliers lam (m,) N, see `forces`."""
        g = self.gains
        r_d, r_d_dot, r_d_ddot, f_nd = self.reference(t)
        e, e_dot = m.r - r_d, m.r_dot - r_d_dot
        F_r, e_F = self.forces(m, lam, f_nd)
        by_M, by_F_2 = np.linalg.inv(g.M_m), np.linalg.inv(g.F_2)
        K_vz = by_F_2 @ (by_M @ g.B_m - g.F_1 + g.A)
        K_pz = by_F_2 @ (by_M @ g.K_m + g.A @ g.F_1)
        z_dot = g.A @ z + K_pz @ e + K_vz @ e_dot + by_F_2 @ by_M @ g.K_f @ e_F
        s = e_dot + g.F_1 @ e + g.F_2 @ z
        r_eq_dot = r_d_dot - g.F_1 @ e - g.F_2 @ z
        r_eq_ddot = r_d_ddot - g.F_1 @ e_dot - g.F_2 @ z_dot
        J_inv = np.linalg.inv(m.J_q)
        M_hat = pin.crba(self.believed, self.data, q)
        C_hat = pin.computeCoriolisMatrix(self.believed, self.data, q, q_dot)
        G_hat = pin.computeGeneralizedGravity(self.believed, self.data, q)
        H = J_inv.T @ M_hat @ J_inv
        C = J_inv.T @ C_hat @ J_inv - J_inv.T @ M_hat @ J_inv @ m.J_q_dot @ J_inv
        F_t = -H @ m.v_t_dot - C @ m.v_t
        robust = g.K_s @ s + g.d * s / max(float(np.linalg.norm(s)), g.layer)
        T_r = H @ r_eq_ddot + C @ r_eq_dot + J_inv.T @ G_hat + F_t + F_r - robust
        return LawAnswer(m.J_q.T @ T_r, z_dot, s)

    def acceleration(self, q: np.ndarray, q_dot: np.ndarray, torque: np.ndarray) -> np.ndarray:
        """Acceleration (n,) rad/s^2 of the true arm by (2), without the contact's part. torque: (n,) N m."""
        h = pin.nonLinearEffects(self.true, self.true_data, q, q_dot) + self.world.viscous * q_dot
        return np.linalg.solve(pin.crba(self.true, self.true_data, q), torque - h)

    def contact(
        self, m: Motion, q: np.ndarray, q_dot: np.ndarray, t: float, torque: Callable[[np.ndarray], np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Contact: lambda (m,) N and q_ddot (n,) rad/s^2, with lambda = M_e (phi_ddot + a_e) + B_e phi_dot + K_e phi,
        (28) and (32), where a_e is the acceleration of the surfaces along phi, or with phi_ddot = 0, the constraints
        (39) differentiated twice. torque: function of lambda, affine."""
        w, k = self.world, self.m
        a_e = np.zeros(k)
        for i, normal in enumerate(m.normals):
            a_e[i] = normal @ w.surfaces[i].acceleration(t)

        def miss(lam: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            q_ddot = self.acceleration(q, q_dot, torque(lam) - m.J.T @ (m.wrench(lam) - w.push))
            phi_ddot = (m.J_q @ q_ddot + m.J_q_dot @ q_dot + m.v_t_dot)[:k]
            pressed = w.M_e @ (phi_ddot + a_e) + w.B_e @ m.r_dot[:k] + w.K_e @ m.r[:k]
            return (phi_ddot if w.rigid else pressed - lam), q_ddot

        (at_0, without), ones = miss(np.zeros(k)), [miss(one) for one in np.eye(k)]
        lam = np.linalg.solve(np.column_stack([at_0 - at for at, _ in ones]), at_0)
        return lam, without + np.column_stack([with_one - without for _, with_one in ones]) @ lam

    def slope(self, t: float, y: np.ndarray) -> np.ndarray:
        """Derivative d/dt of (q, q_dot, z) (3n,) under the law."""
        q, q_dot, z = y.reshape(3, self.n)
        m = self.motion(q, q_dot, t)
        lam, q_ddot = self.contact(m, q, q_dot, t, lambda lam: self.law(m, q, q_dot, z, lam, t).tau)
        return np.concatenate([q_dot, q_ddot, self.law(m, q, q_dot, z, lam, t).z_dot])

    def slope_under(self, tau: np.ndarray) -> Callable[[float, np.ndarray], np.ndarray]:
        """Derivative d/dt of (q, q_dot) (2n,) under a constant torque (n,) N m."""

        def slope(t: float, y: np.ndarray) -> np.ndarray:
            q, q_dot = y.reshape(2, self.n)
            return np.concatenate([q_dot, self.contact(self.motion(q, q_dot, t), q, q_dot, t, lambda _: tau)[1]])

        return slope

    def without_reaching(self) -> np.ndarray:
        """Initial z(0) (n,) m/s of Remark 2."""
        start, (r_d, r_d_dot, _, _) = self.motion(self.q_0, self.q_dot_0, 0.0), self.reference(0.0)
        return -np.linalg.solve(self.gains.F_2, start.r_dot - r_d_dot + self.gains.F_1 @ (start.r - r_d))

    def solve(self, times: np.ndarray) -> np.ndarray:
        """Solution (q, q_dot, z) (N, 3, n) at the times (N,) s."""
        y_0 = np.concatenate([self.q_0, self.q_dot_0, self.without_reaching()])
        return integrate(self.slope, y_0, times).reshape(len(times), 3, self.n)


def integrate(
    slope: Callable[[float, np.ndarray], np.ndarray], y_0: np.ndarray, times: np.ndarray, rtol: float = 1e-10
) -> np.ndarray:
    """Solution y (N, k) at the times (N,) s, from y_0 (k,) at 0 s, by Dormand and Prince's method of order 8."""
    solution = solve_ivp(slope, (0.0, float(times[-1])), y_0, "DOP853", times, rtol=rtol, atol=1e-2 * rtol)
    assert solution.success, solution.message
    return solution.y.T


def order(steps: Sequence[float] | np.ndarray, errors: np.ndarray) -> float:
    """Order of convergence: the slope of log(error) over log(step)."""
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])
