"""Surfaces Phi(x, t) = 0 with the coordinates (phi, psi_1, psi_2) around them, (30) and (31).

phi is penetration: positive inside the environment, so its gradient points into it. Each surface is a frozen class
with the coordinates in its own frame, their exact first and second derivatives, and the inverse; it moves as one
body by a `Motion`, and `Surface.chart` adds what the movement does to every derivative.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numba import njit


class Chart(NamedTuple):
    """Three coordinates g(p, t) of a point p, in m, and their derivatives.

    g (3,); G (3, 3) rows of gradients; G_p (3, 3, 3) Hessians; g_t (3,), G_t (3, 3), g_tt (3,) partial
    derivatives in time of g, of G, and the second one of g.
    """

    g: np.ndarray
    G: np.ndarray
    G_p: np.ndarray
    g_t: np.ndarray
    G_t: np.ndarray
    g_tt: np.ndarray


@dataclass(frozen=True)
class Motion:
    """Translation a(t) = direction * amplitude * sin(2 pi frequency t); direction (3,) unit, amplitude m, Hz."""

    direction: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    amplitude: float = 0.0
    frequency: float = 0.0

    def offset(self, t: float) -> np.ndarray:
        """a(t), (3,) m."""
        return self.direction * (self.amplitude * np.sin(2 * np.pi * self.frequency * t))

    def velocity(self, t: float) -> np.ndarray:
        """Time derivative of a(t), (3,) m/s."""
        omega = 2 * np.pi * self.frequency
        return self.direction * (self.amplitude * omega * np.cos(omega * t))


@njit(cache=True)
def _zeta(p, t, origin, direction, amplitude, frequency):
    """The point in the moving frame, and velocity and acceleration of that frame."""
    omega = 2 * np.pi * frequency
    a = direction * (amplitude * np.sin(omega * t))
    a_dot = direction * (amplitude * omega * np.cos(omega * t))
    a_ddot = direction * (-amplitude * omega**2 * np.sin(omega * t))
    return p - origin - a, a_dot, a_ddot


@njit(cache=True)
def _in_motion(g, G, G_p, a_dot, a_ddot):
    """Derivatives in time of g(p - a(t)): the chain rule, exact."""
    G_t = np.empty((3, 3))
    g_tt = np.empty(3)
    for i in range(3):
        G_t[i] = -(G_p[i] @ a_dot)
        g_tt[i] = -(G_t[i] @ a_dot) - G[i] @ a_ddot
    return Chart(g, G, G_p, -(G @ a_dot), G_t, g_tt)


@njit(cache=True)
def _polar(zeta, u, v):
    """Radius and angle of zeta in the plane of the unit vectors u, v, each with gradient and Hessian."""
    x, y = u @ zeta, v @ zeta
    rho = np.hypot(x, y)
    e_rho = (x * u + y * v) / rho
    e_theta = (x * v - y * u) / rho
    rho_pp = np.outer(e_theta, e_theta) / rho
    theta_pp = -(np.outer(e_rho, e_theta) + np.outer(e_theta, e_rho)) / rho**2
    return rho, e_rho, rho_pp, np.arctan2(y, x), e_theta / rho, theta_pp


@njit(cache=True)
def _plane_chart(p, t, origin, frame, direction, amplitude, frequency):
    zeta, a_dot, a_ddot = _zeta(p, t, origin, direction, amplitude, frequency)
    return _in_motion(frame @ zeta, frame, np.zeros((3, 3, 3)), a_dot, a_ddot)


@njit(cache=True)
def _cylinder_chart(p, t, origin, frame, radius, side, direction, amplitude, frequency):
    """frame: rows reference direction, tangent, axis; side +1: solid inside (press from outside), -1: solid outside."""
    zeta, a_dot, a_ddot = _zeta(p, t, origin, direction, amplitude, frequency)
    rho, rho_p, rho_pp, theta, theta_p, theta_pp = _polar(zeta, frame[0], frame[1])
    g = np.array([side * (radius - rho), radius * theta, frame[2] @ zeta])
    G = np.empty((3, 3))
    G[0], G[1], G[2] = -side * rho_p, radius * theta_p, frame[2]
    G_p = np.zeros((3, 3, 3))
    G_p[0], G_p[1] = -side * rho_pp, radius * theta_pp
    return _in_motion(g, G, G_p, a_dot, a_ddot)


@njit(cache=True)
def _sphere_chart(p, t, origin, frame, radius, side, direction, amplitude, frequency):
    """psi_1, psi_2: arc lengths of the angles seen from the reference direction towards each tangent."""
    zeta, a_dot, a_ddot = _zeta(p, t, origin, direction, amplitude, frequency)
    rho = np.sqrt(zeta @ zeta)
    e_rho = zeta / rho
    _, _, _, theta_1, theta_1_p, theta_1_pp = _polar(zeta, frame[0], frame[1])
    _, _, _, theta_2, theta_2_p, theta_2_pp = _polar(zeta, frame[0], frame[2])
    g = np.array([side * (radius - rho), radius * theta_1, radius * theta_2])
    G = np.empty((3, 3))
    G[0], G[1], G[2] = -side * e_rho, radius * theta_1_p, radius * theta_2_p
    G_p = np.empty((3, 3, 3))
    G_p[0] = -side * (np.eye(3) - np.outer(e_rho, e_rho)) / rho
    G_p[1], G_p[2] = radius * theta_1_pp, radius * theta_2_pp
    return _in_motion(g, G, G_p, a_dot, a_ddot)


def _unit(vector: np.ndarray) -> np.ndarray:
    return np.asarray(vector, dtype=float) / np.linalg.norm(vector)


def tangent_frame(normal: np.ndarray) -> np.ndarray:
    """Right-handed rows (normal, t_1, t_2); t_1 lies in the x-z plane whenever the normal does."""
    n = _unit(normal)
    start = np.array([1.0, 0.0, 0.0]) if abs(n[0]) < 0.9 else np.array([0.0, 0.0, 1.0])
    t_1 = _unit(start - (start @ n) * n)
    return np.ascontiguousarray(np.stack([n, t_1, np.cross(n, t_1)]))


@dataclass(frozen=True)
class Surface:
    """What every surface shares: origin (3,) m, its frame (3, 3) of unit rows, its motion."""

    origin: np.ndarray
    frame: np.ndarray
    motion: Motion

    def chart(self, p: np.ndarray, t: float) -> Chart:
        """Coordinates of the point p (3,) m at time t (s) with all derivatives."""
        raise NotImplementedError

    def point(self, g: np.ndarray, t: float) -> np.ndarray:
        """The point (3,) with coordinates g = (phi, psi_1, psi_2): the inverse of `chart`."""
        return self.origin + self.motion.offset(t) + self._local_point(g)

    def _local_point(self, g: np.ndarray) -> np.ndarray:
        raise NotImplementedError

    def _extent(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Ranges of psi_1 and psi_2 that are worth drawing, m."""
        raise NotImplementedError

    def mesh(self, resolution: int = 40) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (N, 3) of phi = 0 at rest, in the world frame, and triangles (M, 3)."""
        (a_1, b_1), (a_2, b_2) = self._extent()
        psi_1, psi_2 = np.meshgrid(np.linspace(a_1, b_1, resolution), np.linspace(a_2, b_2, resolution), indexing="ij")
        points = [self._local_point(np.array([0.0, u, v])) for u, v in zip(psi_1.flat, psi_2.flat, strict=True)]
        cell = np.arange(resolution * resolution).reshape(resolution, resolution)
        a, b, c, d = cell[:-1, :-1].ravel(), cell[1:, :-1].ravel(), cell[1:, 1:].ravel(), cell[:-1, 1:].ravel()
        faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
        return self.origin + np.array(points), faces


class Plane(Surface):
    """phi = normal . (p - origin): the normal points into the environment; psi along the two tangents."""

    @classmethod
    def create(cls, origin: np.ndarray, normal: np.ndarray, motion: Motion) -> Plane:
        return cls(np.asarray(origin, dtype=float), tangent_frame(normal), motion)

    def chart(self, p: np.ndarray, t: float) -> Chart:
        m = self.motion
        return _plane_chart(p, t, self.origin, self.frame, m.direction, m.amplitude, m.frequency)

    def _local_point(self, g: np.ndarray) -> np.ndarray:
        return self.frame.T @ g

    def _extent(self) -> tuple[tuple[float, float], tuple[float, float]]:
        return (-0.25, 0.25), (-0.25, 0.25)

    def mesh(self, resolution: int = 2) -> tuple[np.ndarray, np.ndarray]:
        return super().mesh(min(resolution, 2))


@dataclass(frozen=True)
class Round(Surface):
    """A surface with a radius (m) and a side: +1 the solid is inside, -1 the solid is outside and the tool within."""

    radius: float
    side: float


class Cylinder(Round):
    """phi = side (radius - rho); psi_1 = radius * theta from the reference direction, psi_2 along the axis."""

    @classmethod
    def create(
        cls,
        origin: np.ndarray,
        axis: np.ndarray,
        reference: np.ndarray,
        radius: float,
        side: float,
        motion: Motion,
    ) -> Cylinder:
        """Raises ValueError when axis and reference are parallel."""
        e_axis = _unit(axis)
        across = np.asarray(reference, dtype=float) - (np.asarray(reference, dtype=float) @ e_axis) * e_axis
        if np.linalg.norm(across) < 1e-6:
            raise ValueError(f"surface.reference: {list(reference)} is parallel to the axis; allowed: any other")
        e_ref = _unit(across)
        frame = np.ascontiguousarray(np.stack([e_ref, np.cross(e_axis, e_ref), e_axis]))
        return cls(np.asarray(origin, dtype=float), frame, motion, radius, side)

    def chart(self, p: np.ndarray, t: float) -> Chart:
        m = self.motion
        return _cylinder_chart(
            p, t, self.origin, self.frame, self.radius, self.side, m.direction, m.amplitude, m.frequency
        )

    def _local_point(self, g: np.ndarray) -> np.ndarray:
        rho, theta = self.radius - self.side * g[0], g[1] / self.radius
        return self.frame.T @ np.array([rho * np.cos(theta), rho * np.sin(theta), g[2]])

    def _extent(self) -> tuple[tuple[float, float], tuple[float, float]]:
        half = np.pi * self.radius * (1.0 if self.side > 0 else 0.5)
        return (-half, half), (-0.2, 0.2)


class Sphere(Round):
    """phi = side (radius - rho); psi_i = radius * angle towards tangent i, both zero in the reference direction."""

    @classmethod
    def create(
        cls, origin: np.ndarray, reference: np.ndarray, radius: float, side: float, motion: Motion
    ) -> Sphere:
        return cls(np.asarray(origin, dtype=float), tangent_frame(reference), motion, radius, side)

    def chart(self, p: np.ndarray, t: float) -> Chart:
        m = self.motion
        return _sphere_chart(
            p, t, self.origin, self.frame, self.radius, self.side, m.direction, m.amplitude, m.frequency
        )

    def _local_point(self, g: np.ndarray) -> np.ndarray:
        towards = np.array([1.0, np.tan(g[1] / self.radius), np.tan(g[2] / self.radius)])
        return self.frame.T @ ((self.radius - self.side * g[0]) * _unit(towards))

    def _extent(self) -> tuple[tuple[float, float], tuple[float, float]]:
        half = 1.2 * self.radius
        return (-half, half), (-half, half)


class Cartesian(Plane):
    """No surface: the coordinates are those of the point itself, along the rows of `frame`, at rest."""

    @classmethod
    def along(cls, frame: np.ndarray) -> Cartesian:
        return cls(np.zeros(3), np.ascontiguousarray(frame, dtype=float), Motion())
