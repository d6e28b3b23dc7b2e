"""Surfaces Phi(x, t) = 0 with the coordinates (phi, psi_1, psi_2) around them, (30) and (31).

phi is penetration: positive inside the environment, so its gradient points into it. Each surface is a frozen class
with the coordinates in its own frame, their exact first and second derivatives, and the inverse; it moves as one
body by a `Motion`, and `Surface.chart` adds what the movement does to every derivative. A surface typed as a formula
(`environments.typed_surface`) may also change its form in time.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np

from environments.bytecode import BLANK, Bytecode
from environments.level_set import distance
from kernels import choice, inline, kernel
from kernels.algebra import dot
from kernels.records import Record


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

    @classmethod
    def zeros(cls) -> Chart:
        """Not yet known."""
        return cls(np.zeros(3), np.zeros((3, 3)), np.zeros((3, 3, 3)), np.zeros(3), np.zeros((3, 3)), np.zeros(3))


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
    """A surface in the kernels' form: which one, origin (3,) m, frame (3, 3) of unit rows, radius m, side +-1, its
    `Motion`, and the bytecode of its formula."""

    kind: int
    origin: np.ndarray
    frame: np.ndarray
    radius: float
    side: float
    direction: np.ndarray
    amplitude: float
    frequency: float
    bytecode: Bytecode


STILL = (0.0, 0.0, 0.0, 0.0, 0.0)  # what a form that does not change adds to phi's derivatives, see `distance`


@inline
def _plane(zeta, shape, _t, chart):
    """Coordinates of zeta (3,) m in the frame of the surface, as all surfaces have them; returns what the form adds in
    time to the derivatives of phi."""
    for i in range(3):
        chart.g[i] = dot(shape.frame[i], zeta)
        for k in range(3):
            chart.G[i, k] = shape.frame[i, k]
            for a in range(3):
                chart.G_p[i, k, a] = 0.0
    return STILL


@inline
def _formula(zeta, shape, t, chart):
    _plane(zeta, shape, t, chart)
    return distance(shape.bytecode, shape.side, zeta, t, chart)


@inline
def _in_plane(zeta, u, v):
    """Radius and angle of zeta in the plane of the unit vectors u, v, with their unit directions e_rho, e_theta."""
    x, y = dot(u, zeta), dot(v, zeta)
    rho = np.hypot(x, y)
    c, s = x / rho, y / rho
    e_rho = (c * u[0] + s * v[0], c * u[1] + s * v[1], c * u[2] + s * v[2])
    e_theta = (c * v[0] - s * u[0], c * v[1] - s * u[1], c * v[2] - s * u[2])
    return rho, np.arctan2(y, x), e_rho, e_theta


@inline
def _arc(i, radius, rho, theta, e_rho, e_theta, chart):
    """Coordinate i is radius * theta."""
    chart.g[i] = radius * theta
    for k in range(3):
        chart.G[i, k] = radius * e_theta[k] / rho
        for a in range(3):
            chart.G_p[i, k, a] = -radius * (e_rho[k] * e_theta[a] + e_theta[k] * e_rho[a]) / rho**2


@inline
def _cylinder(zeta, shape, _t, chart):
    """Rows of the frame: reference direction, tangent, axis."""
    frame, side = shape.frame, shape.side
    rho, theta, e_rho, e_theta = _in_plane(zeta, frame[0], frame[1])
    _arc(1, shape.radius, rho, theta, e_rho, e_theta, chart)
    chart.g[0], chart.g[2] = side * (shape.radius - rho), dot(frame[2], zeta)
    for k in range(3):
        chart.G[0, k], chart.G[2, k] = -side * e_rho[k], frame[2, k]
        for a in range(3):
            chart.G_p[0, k, a] = -side * e_theta[k] * e_theta[a] / rho
            chart.G_p[2, k, a] = 0.0
    return STILL


@inline
def _sphere(zeta, shape, _t, chart):
    """psi_1, psi_2: arc lengths of the angles seen from the reference direction towards each tangent."""
    frame, side = shape.frame, shape.side
    for i in range(1, 3):
        rho, theta, e_rho, e_theta = _in_plane(zeta, frame[0], frame[i])
        _arc(i, shape.radius, rho, theta, e_rho, e_theta, chart)
    rho = np.sqrt(zeta[0] ** 2 + zeta[1] ** 2 + zeta[2] ** 2)
    chart.g[0] = side * (shape.radius - rho)
    for k in range(3):
        chart.G[0, k] = -side * zeta[k] / rho
        for a in range(3):
            across = (1.0 if k == a else 0.0) - zeta[k] * zeta[a] / rho**2
            chart.G_p[0, k, a] = -side * across / rho
    return STILL


PLANE, CYLINDER, SPHERE, FORMULA = range(4)
_local_chart = choice((_plane, _cylinder, _sphere, _formula))


@inline
def surface_chart(shape, p, t, chart):
    """The `Chart` of a point p (3,) m at time t (s)."""
    omega = 2 * np.pi * shape.frequency
    moved, speed = shape.amplitude * np.sin(omega * t), shape.amplitude * omega * np.cos(omega * t)
    u = shape.direction
    zeta = (
        p[0] - shape.origin[0] - moved * u[0],
        p[1] - shape.origin[1] - moved * u[1],
        p[2] - shape.origin[2] - moved * u[2],
    )
    form = _local_chart(shape.kind, zeta, shape, t, chart)
    for i in range(3):  # derivatives in time of g(p - a(t)): the chain rule, exact
        chart.g_t[i], chart.g_tt[i] = 0.0, 0.0
        for k in range(3):
            chart.G_t[i, k] = 0.0
            for a in range(3):
                chart.G_t[i, k] -= chart.G_p[i, k, a] * speed * u[a]
            chart.g_t[i] -= chart.G[i, k] * speed * u[k]
            chart.g_tt[i] += -chart.G_t[i, k] * speed * u[k] + chart.G[i, k] * omega**2 * moved * u[k]
    chart.g_t[0] += form[0]  # and those of its form
    chart.g_tt[0] += form[1]
    for k in range(3):
        chart.G_t[0, k] += form[2 + k]
        chart.g_tt[0] -= 2.0 * form[2 + k] * speed * u[k]


@kernel
def _chart_alone(shape, p, t, chart):
    surface_chart(shape[0], p, t, chart[0])


def _unit(vector: np.ndarray) -> np.ndarray:
    return np.asarray(vector, dtype=float) / np.linalg.norm(vector)


def tangent_frame(normal: np.ndarray) -> np.ndarray:
    """Right-handed rows (normal, t_1, t_2); t_1 lies in the x-z plane whenever the normal does."""
    n = _unit(normal)
    start = np.array([1.0, 0.0, 0.0]) if abs(n[0]) < 0.9 else np.array([0.0, 0.0, 1.0])
    t_1 = _unit(start - (start @ n) * n)
    return np.ascontiguousarray(np.stack([n, t_1, np.cross(n, t_1)]))


def grid(resolution: int, first: tuple[float, float], second: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Two coordinates over their ranges, each (resolution^2,)."""
    u, v = np.meshgrid(np.linspace(*first, resolution), np.linspace(*second, resolution), indexing="ij")
    return u.ravel(), v.ravel()


def triangles(resolution: int) -> np.ndarray:
    """The triangles (M, 3) between the points of a `grid`."""
    cell = np.arange(resolution * resolution).reshape(resolution, resolution)
    a, b, c, d = cell[:-1, :-1].ravel(), cell[1:, :-1].ravel(), cell[1:, 1:].ravel(), cell[:-1, 1:].ravel()
    return np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


@dataclass(frozen=True)
class Surface:
    """What every surface shares: origin (3,) m, its frame (3, 3) of unit rows, its motion; a round one has a radius
    (m) and a side, +1 with the solid inside, -1 with the solid outside and the tool within."""

    origin: np.ndarray
    frame: np.ndarray
    motion: Motion
    radius: float = 0.0
    side: float = 1.0
    bytecode: Bytecode = BLANK
    kind: ClassVar[int]
    resolution: ClassVar[int] = 41

    @property
    def changing(self) -> bool:
        """Whether its form changes in time, not only its place."""
        return False

    @cached_property
    def shape(self) -> Shape:
        """The surface in the kernels' form."""
        m = self.motion
        radius, side, amplitude, frequency = (float(x) for x in (self.radius, self.side, m.amplitude, m.frequency))
        return Shape(self.kind, self.origin, self.frame, radius, side, m.direction, amplitude, frequency, self.bytecode)

    @cached_property
    def _packed(self) -> np.ndarray:
        return Record(self.shape).data

    @property
    def fingerprint(self) -> bytes:
        """All of `shape`: surfaces that share it give the same charts."""
        return self._packed.tobytes()

    def chart(self, p: np.ndarray, t: float) -> Chart:
        """Coordinates of the point p (3,) m at time t (s) with all derivatives."""
        chart = Record(Chart.zeros())
        _chart_alone(self._packed, p, t, chart.data)
        return chart.read()

    def point(self, g: np.ndarray, t: float) -> np.ndarray:
        """The point (3,) with coordinates g = (phi, psi_1, psi_2): the inverse of `chart`."""
        return self.origin + self.motion.offset(t) + self._local_point(g)

    def _local_point(self, g: np.ndarray) -> np.ndarray:
        raise NotImplementedError

    def _extent(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Ranges of psi_1 and psi_2 that are worth drawing, m."""
        raise NotImplementedError

    def mesh(self, around: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (N, 3) m of phi = 0 at time t (s), less the motion's offset then, and triangles (M, 3). What has no
        middle of its own is drawn around the point `around` (3,) m."""
        del around, t
        (a_1, b_1), (a_2, b_2) = self._extent()
        psi_1, psi_2 = grid(self.resolution, (a_1, b_1), (a_2, b_2))
        points = [self._local_point(np.array([0.0, u, v])) for u, v in zip(psi_1, psi_2, strict=True)]
        return self.origin + np.array(points), triangles(self.resolution)


class Plane(Surface):
    """phi = normal . (p - origin): the normal points into the environment; psi along the two tangents."""

    kind = PLANE
    resolution = 2

    @classmethod
    def create(cls, origin: np.ndarray, normal: np.ndarray, motion: Motion) -> Plane:
        return cls(np.asarray(origin, dtype=float), tangent_frame(normal), motion)

    def _local_point(self, g: np.ndarray) -> np.ndarray:
        return self.frame.T @ g

    def _extent(self) -> tuple[tuple[float, float], tuple[float, float]]:
        return (-0.25, 0.25), (-0.25, 0.25)

    def mesh(self, around: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        vertices, faces = super().mesh(around, t)
        away = self.frame[1:] @ (around - self.origin)
        return vertices + self.frame[1:].T @ away, faces


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
