"""Plane, at rest or tilting."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import msgspec
import numpy as np

from environments.surfaces.chart import STILL, Shape, Turning, flat, swing
from environments.surfaces.form import NORMAL, Form, grid, tangent_frame, triangles, unit
from kernels import inline
from kernels.algebra import cross, dot
from parameters import Section, Vector3, Widget, field, slider

if TYPE_CHECKING:
    from environments.surfaces.table import Surface


@inline
def _chart(zeta, shape, t, chart):
    """Write the coordinates: those of the plane at rest, of which phi turns with its normal n = R(t) n_0."""
    flat(zeta, shape, t, chart)
    n, turning = shape.frame[0], shape.turning
    for k in range(3):
        chart.normal_tt[k] = 0.0
    if turning.amplitude == 0.0:
        return STILL
    axis = turning.axis
    angle, rate, acceleration = swing(turning.amplitude, turning.omega, t)
    s, c, along, aside = np.sin(angle), np.cos(angle), dot(axis, n), cross(axis, n)
    g, g_t, g_tt = 0.0, 0.0, 0.0
    for k in range(3):  # n = along axis + (n_0 - along axis) c + (axis x n_0) s, and its derivatives by the angle
        across = n[k] - along * axis[k]
        here = along * axis[k] + across * c + aside[k] * s
        by_angle, twice = aside[k] * c - across * s, -across * c - aside[k] * s
        chart.G[0, k], chart.G_t[0, k] = here, by_angle * rate
        chart.normal_tt[k] = twice * rate**2 + by_angle * acceleration
        g += here * zeta[k]
        g_t += chart.G_t[0, k] * zeta[k]
        g_tt += chart.normal_tt[k] * zeta[k]
    chart.g[0] = g
    return g_t, g_tt, chart.G_t[0, 0], chart.G_t[0, 1], chart.G_t[0, 2], 0.0


class Tilt(Section, frozen=True, forbid_unknown_fields=True):
    """Tilting about the origin, amplitude * sin(2 pi frequency t)."""

    amplitude: Annotated[
        float,
        field("amplitude", "rad", slider("tilts by", 0, 0.2), ge=0, le=0.5, title="amplitude of the surface's tilt"),
    ] = 0.0
    frequency: Annotated[
        float, field("frequency", "Hz", slider("tilts at", 0, 2), ge=0, le=20, title="frequency of the surface's tilt")
    ] = 0.25
    axis: Annotated[Vector3, field("axis", "1", Widget("about"), title="axis of the surface's tilt")] = (0.0, 1.0, 0.0)


class Plane(Form, frozen=True, forbid_unknown_fields=True, tag="plane"):
    """A plane: phi = normal . (p - origin), psi along its two tangents at rest, also while it tilts."""

    title = "plane"
    chart = _chart
    resolution = 2
    planar = True

    normal: Annotated[Vector3, field("direction into the environment", "1", NORMAL, title="normal of the surface")] = (
        0.0,
        0.0,
        -1.0,
    )
    tilt: Tilt = msgspec.field(default_factory=Tilt)

    @property
    def shape(self) -> Shape:
        axis, omega = unit("surface.tilt.axis", self.tilt.axis), 2 * np.pi * self.tilt.frequency
        placed = self._placed(tangent_frame(unit("surface.normal", self.normal)))
        return placed._replace(turning=Turning(axis, float(self.tilt.amplitude), float(omega)))

    @property
    def changing(self) -> bool:
        return self.tilt.amplitude > 0.0

    @property
    def frequencies(self) -> tuple[float, ...] | None:
        turns = self.tilt.amplitude > 0.0 < self.tilt.frequency
        return (*(super().frequencies or ()), *((self.tilt.frequency,) if turns else ()))

    @property
    def normal_fixed(self) -> bool:
        return not self.changing

    def normal_at(self, surface: Surface, t: float) -> np.ndarray:
        """Unit normal (3,) at time t (s)."""
        return surface.chart(surface.origin, t).G[0]

    def point(self, surface: Surface, g: np.ndarray, t: float) -> np.ndarray:
        rows = np.stack([self.normal_at(surface, t), *surface.frame[1:]])
        return surface.origin + self.motion.offset(t) + np.linalg.solve(rows, g)

    def extent(self) -> tuple[tuple[float, float], tuple[float, float]]:
        return (-0.25, 0.25), (-0.25, 0.25)

    def mesh(self, surface: Surface, around: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        psi_1, psi_2 = grid(self.resolution, *self.extent())
        away = surface.frame[1:] @ (around - surface.origin)
        rows = np.stack([self.normal_at(surface, t), *surface.frame[1:]])
        g = np.stack([0.0 * psi_1, psi_1 + away[0], psi_2 + away[1]])
        return surface.origin + np.linalg.solve(rows, g).T, triangles(self.resolution)
