"""Coordinates of surfaces for the independent simulator: functions of a point and the time, in plain numpy, whose
partial derivatives are complex steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

TINY = 1e-30  # of complex steps


class Tilt(NamedTuple):
    """Tilt of a plane by amplitude sin(omega t), rad, about an axis (3,) unit."""

    axis: np.ndarray
    amplitude: float
    omega: float


class Face(NamedTuple):
    """Flat face of the tool, which is pressed on a plane as a whole.
    axes: (2, 3) unit, in the tool's frame.
    level: (2, 3) unit, in the world: the turn is the angle of the first axis in their plane."""

    axes: np.ndarray
    level: np.ndarray

    def attitude(self, R: np.ndarray, n: np.ndarray) -> np.ndarray:
        """Tilts n . e_1, n . e_2 and turn (3, k) of tools with orientations R (k, 3, 3) on planes with normals n
        (3, k); analytic in both."""
        first, second = np.einsum("kij,aj->aik", R, self.axes)
        a, b = self.level @ first
        return np.stack([np.sum(n * first, axis=0), np.sum(n * second, axis=0), np.arctan(b / a)])


@dataclass(frozen=True)
class Surface:
    """Surface: a plane, or a sphere with the tool outside; it moves by a sinusoid.

    origin: (3,) m, a point of the plane, or the centre of the sphere.
    normal: (3,) unit, into the plane, or from the centre to the point psi = 0.
    radius: m, 0 for a plane.
    amplitude, omega: (3,) m and rad/s, of the motion.
    tilt: of a plane about its origin, to and fro; None for none.
    """

    origin: np.ndarray
    normal: np.ndarray
    radius: float
    amplitude: np.ndarray
    omega: float
    tilt: Tilt | None = None

    def normal_at(self, t: np.ndarray) -> np.ndarray:
        """Unit normals (3, k) of a plane at the times t (k,), by Rodrigues; analytic in t."""
        e = self.normal[:, None]
        if self.tilt is None:
            return np.broadcast_to(e, (3, len(t)))
        about, angle = self.tilt.axis[:, None], self.tilt.amplitude * np.sin(self.tilt.omega * t)
        aside = np.cross(self.tilt.axis, self.normal)[:, None]
        along = about * (self.tilt.axis @ self.normal)
        return along + (e - along) * np.cos(angle) + aside * np.sin(angle)

    @cached_property
    def axes(self) -> np.ndarray:
        """Axes as rows: the normal, the tangent in the plane of normal and x axis, and the third one of a right-handed
        frame."""
        e = self.normal
        x = np.array([1.0, 0.0, 0.0]) if abs(e[0]) < 0.9 else np.array([0.0, 0.0, 1.0])
        u = x - (x @ e) * e
        u = u / np.sqrt(u @ u)
        return np.stack([e, u, np.cross(e, u)])

    def coordinates(self, p: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Coordinates phi, psi_1, psi_2 (3, k) m of the points p (3, k) m at the times t (k,), (30); analytic in p and
        t."""
        away = p - self.origin[:, None] - np.outer(self.amplitude, np.sin(self.omega * t))
        first, second, third = self.axes @ away
        if self.radius == 0.0:  # psi as at rest
            return np.stack([np.sum(self.normal_at(t) * away, axis=0), second, third])
        R, rho = self.radius, np.sqrt(np.sum(away * away, axis=0))
        return np.stack([R - rho, R * np.arctan(second / first), R * np.arctan(third / first)])

    def with_derivatives(self, p: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Coordinates (3,) m of the point p (3,) m, their gradients (3, 3) in rows, and their partial derivatives in
        time (3,)."""
        return _differentiated(self.coordinates, p, t)

    def acceleration(self, t: float) -> np.ndarray:
        """Acceleration (3,) m/s^2 of a surface that does not tilt."""
        return -(self.omega**2) * self.amplitude * np.sin(self.omega * t)


@dataclass(frozen=True)
class Corner:
    """Corner of one, two or three surfaces, with the coordinates that they give together.
    edge: for two surfaces in space, the point (3,) m at which psi is zero, and the unit vector (3,) along psi."""

    surfaces: tuple[Surface, ...]
    edge: tuple[np.ndarray, np.ndarray] | None = None

    @classmethod
    def at(cls, surfaces: tuple[Surface, ...], p: np.ndarray) -> Corner:
        """Corner of surfaces that the tool meets at the point p (3,) m at t = 0; the edge of two surfaces in space is
        the straight line through p that is tangential to both."""
        if len(surfaces) != 2:
            return cls(surfaces)
        along = np.cross(*(each.with_derivatives(p, 0.0)[1][0] for each in surfaces))
        return cls(surfaces, (p, along / np.sqrt(along @ along)))

    def coordinates(self, p: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Coordinates (3, k) m of the points p (3, k) m at the times t (k,), phi of each surface first, (31)."""
        alone = [each.coordinates(p, t) for each in self.surfaces]
        if self.edge is None:
            return alone[0] if len(alone) == 1 else np.stack([g[0] for g in alone])
        start, along = self.edge
        return np.stack([alone[0][0], alone[1][0], along @ (p - start[:, None])])

    def with_derivatives(self, p: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """See `Surface.with_derivatives`."""
        return _differentiated(self.coordinates, p, t)


def _differentiated(
    coordinates: Callable[[np.ndarray, np.ndarray], np.ndarray], p: np.ndarray, t: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    step = 1j * TINY * np.eye(4)
    g = coordinates(p[:, None] + step[:3], t + step[3])
    return np.real(g[:, 0]), np.imag(g[:, :3]) / TINY, np.imag(g[:, 3]) / TINY
