"""Surfaces Phi(x, t) = 0 with the coordinates (phi, psi_1, psi_2) around them, (30) and (31).

phi is penetration: positive inside the environment, so its gradient points into it. Each surface is a frozen class
with the coordinates in its own frame, their exact first and second derivatives, and the inverse; it moves as one
body by a `Motion`, and `Surface.chart` adds what the movement does to every derivative.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar, NamedTuple

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


class Shape(NamedTuple):
    """A surface in the kernels' form: which one, origin (3,) m, frame (3, 3) of unit rows, radius m, side +-1, and
    its `Motion`."""

    kind: int
    origin: np.ndarray
    frame: np.ndarray
    radius: float
    side: float
    direction: np.ndarray
    amplitude: float
    frequency: float


PLANE, CYLINDER, SPHERE = 0, 1, 2


@njit(cache=True, error_model="numpy")
def surface_velocity(shape, t):
    """Velocity (3,) m/s of the surface at time t (s)."""
    omega = 2 * np.pi * shape.frequency
    return shape.direction * (shape.amplitude * omega * np.cos(omega * t))


@njit(cache=True, error_model="numpy")
def _in_motion(g, G, G_p, a_dot, a_ddot):
    """Derivatives in time of g(p - a(t)): the chain rule, exact."""
    G_t = np.empty((3, 3))
    g_tt = np.empty(3)
    for i in range(3):
        G_t[i] = -(G_p[i] @ a_dot)
        g_tt[i] = -(G_t[i] @ a_dot) - G[i] @ a_ddot
    return Chart(g, G, G_p, -(G @ a_dot), G_t, g_tt)


@njit(cache=True, error_model="numpy")
def _polar(zeta, u, v):
    """Radius and angle of zeta in the plane of the unit vectors u, v, each with gradient and Hessian."""
    x, y = u @ zeta, v @ zeta
    rho = np.hypot(x, y)
    e_rho = (x * u + y * v) / rho
    e_theta = (x * v - y * u) / rho
    rho_pp = np.outer(e_theta, e_theta) / rho
    theta_pp = -(np.outer(e_rho, e_theta) + np.outer(e_theta, e_rho)) / rho**2
    return rho, e_rho, rho_pp, np.arctan2(y, x), e_theta / rho, theta_pp


@njit(cache=True, error_model="numpy")
def _plane(zeta, shape):
    return shape.frame @ zeta, shape.frame.copy(), np.zeros((3, 3, 3))


@njit(cache=True, error_model="numpy")
def _cylinder(zeta, shape):
    """Rows of the frame: reference direction, tangent, axis."""
    frame, radius, side = shape.frame, shape.radius, shape.side
    rho, rho_p, rho_pp, theta, theta_p, theta_pp = _polar(zeta, frame[0], frame[1])
    g = np.array([side * (radius - rho), radius * theta, frame[2] @ zeta])
    G, G_p = np.empty((3, 3)), np.zeros((3, 3, 3))
    G[0], G[1], G[2] = -side * rho_p, radius * theta_p, frame[2]
    G_p[0], G_p[1] = -side * rho_pp, radius * theta_pp
    return g, G, G_p


@njit(cache=True, error_model="numpy")
def _sphere(zeta, shape):
    """psi_1, psi_2: arc lengths of the angles seen from the reference direction towards each tangent."""
    frame, radius, side = shape.frame, shape.radius, shape.side
    rho = np.sqrt(zeta @ zeta)
    e_rho = zeta / rho
    _, _, _, theta_1, theta_1_p, theta_1_pp = _polar(zeta, frame[0], frame[1])
    _, _, _, theta_2, theta_2_p, theta_2_pp = _polar(zeta, frame[0], frame[2])
    g = np.array([side * (radius - rho), radius * theta_1, radius * theta_2])
    G, G_p = np.empty((3, 3)), np.empty((3, 3, 3))
    G[0], G[1], G[2] = -side * e_rho, radius * theta_1_p, radius * theta_2_p
    G_p[0] = -side * (np.eye(3) - np.outer(e_rho, e_rho)) / rho
    G_p[1], G_p[2] = radius * theta_1_pp, radius * theta_2_pp
    return g, G, G_p


@njit(cache=True, error_model="numpy")
def surface_chart(shape, p, t):
    """The `Chart` of a point p (3,) m at time t (s)."""
    omega = 2 * np.pi * shape.frequency
    a = shape.direction * (shape.amplitude * np.sin(omega * t))
    zeta = p - shape.origin - a
    if shape.kind == PLANE:
        g, G, G_p = _plane(zeta, shape)
    elif shape.kind == CYLINDER:
        g, G, G_p = _cylinder(zeta, shape)
    else:
        g, G, G_p = _sphere(zeta, shape)
    return _in_motion(g, G, G_p, surface_velocity(shape, t), -(omega**2) * a)


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
    """What every surface shares: origin (3,) m, its frame (3, 3) of unit rows, its motion; a round one has a radius
    (m) and a side, +1 with the solid inside, -1 with the solid outside and the tool within."""

    origin: np.ndarray
    frame: np.ndarray
    motion: Motion
    radius: float = 0.0
    side: float = 1.0
    kind: ClassVar[int]

    @cached_property
    def shape(self) -> Shape:
        """The surface in the kernels' form."""
        m = self.motion
        return Shape(self.kind, self.origin, self.frame, self.radius, self.side, m.direction, m.amplitude, m.frequency)

    def chart(self, p: np.ndarray, t: float) -> Chart:
        """Coordinates of the point p (3,) m at time t (s) with all derivatives."""
        return surface_chart(self.shape, p, t)

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

    kind = PLANE

    @classmethod
    def create(cls, origin: np.ndarray, normal: np.ndarray, motion: Motion) -> Plane:
        return cls(np.asarray(origin, dtype=float), tangent_frame(normal), motion)

    def _local_point(self, g: np.ndarray) -> np.ndarray:
        return self.frame.T @ g

    def _extent(self) -> tuple[tuple[float, float], tuple[float, float]]:
        return (-0.25, 0.25), (-0.25, 0.25)

    def mesh(self, resolution: int = 2) -> tuple[np.ndarray, np.ndarray]:
        return super().mesh(min(resolution, 2))


class Cylinder(Surface):
    """phi = side (radius - rho); psi_1 = radius * theta from the reference direction, psi_2 along the axis."""

    kind = CYLINDER

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

    def _local_point(self, g: np.ndarray) -> np.ndarray:
        rho, theta = self.radius - self.side * g[0], g[1] / self.radius
        return self.frame.T @ np.array([rho * np.cos(theta), rho * np.sin(theta), g[2]])

    def _extent(self) -> tuple[tuple[float, float], tuple[float, float]]:
        half = np.pi * self.radius * (1.0 if self.side > 0 else 0.5)
        return (-half, half), (-0.2, 0.2)


class Sphere(Surface):
    """phi = side (radius - rho); psi_i = radius * angle towards tangent i, both zero in the reference direction."""

    kind = SPHERE

    @classmethod
    def create(cls, origin: np.ndarray, reference: np.ndarray, radius: float, side: float, motion: Motion) -> Sphere:
        return cls(np.asarray(origin, dtype=float), tangent_frame(reference), motion, radius, side)

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
