"""Sphere, full or hollow."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from environments.surfaces.chart import MIDDLE, STILL, Shape, arc, polar
from environments.surfaces.form import Form, Radius, Side, side_of, tangent_frame, unit
from kernels import inline
from parameters import Vector3, Widget, field


@inline
def _chart(zeta, shape, _t, chart):
    """Write the coordinates of a sphere. psi_1, psi_2: radius times the angles from the reference direction towards
    each tangent."""
    frame, side = shape.frame, shape.side
    for i in range(1, 3):
        rho, theta, e_rho, e_theta = polar(zeta, frame[0], frame[i])
        arc(i, shape.radius, rho, theta, e_rho, e_theta, chart)
    rho, (x, y, z) = np.sqrt(zeta[0] ** 2 + zeta[1] ** 2 + zeta[2] ** 2), zeta
    if rho < MIDDLE:
        rho, x, y, z = MIDDLE, MIDDLE * frame[0, 0], MIDDLE * frame[0, 1], MIDDLE * frame[0, 2]
    e_rho = (x / rho, y / rho, z / rho)
    chart.g[0] = side * (shape.radius - rho)
    for k in range(3):
        chart.G[0, k] = -side * e_rho[k]
        for a in range(3):
            across = (1.0 if k == a else 0.0) - e_rho[k] * e_rho[a]
            chart.G_p[0, k, a] = -side * across / rho
    return STILL


class Sphere(Form, frozen=True, forbid_unknown_fields=True, tag="sphere"):
    """A sphere: phi = side (radius - rho); psi_i = radius * angle towards tangent i, both zero in the reference
    direction."""

    title = "sphere"
    chart = _chart

    reference: Annotated[
        Vector3,
        field(
            "direction from the centre where psi = 0",
            "1",
            Widget("ψ = 0 towards"),
            title="direction from the surface's centre where ψ = 0",
        ),
    ] = (0.0, 0.0, 1.0)
    radius: Radius = 0.3
    side: Side = "outside"

    @property
    def shape(self) -> Shape:
        return self._placed(tangent_frame(unit("surface.reference", self.reference)), self.radius, side_of(self.side))

    def local_point(self, frame: np.ndarray, g: np.ndarray) -> np.ndarray:
        towards = np.array([1.0, np.tan(g[1] / self.radius), np.tan(g[2] / self.radius)])
        towards *= np.sign(np.cos(g[1] / self.radius))  # of the two points with these tangents, the one on this side
        return frame.T @ ((self.radius - side_of(self.side) * g[0]) * (towards / np.linalg.norm(towards)))

    def extent(self) -> tuple[tuple[float, float], tuple[float, float]]:
        half = 1.2 * self.radius
        return (-half, half), (-half, half)
