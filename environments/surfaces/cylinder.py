"""Cylinder, full or hollow."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from environments.surfaces.chart import STILL, Shape, arc, polar
from environments.surfaces.form import Form, Radius, Side, side_of, unit
from kernels import inline
from kernels.algebra import dot
from parameters import Vector3, Widget, field


@inline
def _chart(zeta, shape, _t, chart):
    """Write the coordinates of a cylinder. Rows of its frame: reference direction, tangent, axis."""
    frame, side = shape.frame, shape.side
    rho, theta, e_rho, e_theta = polar(zeta, frame[0], frame[1])
    arc(1, shape.radius, rho, theta, e_rho, e_theta, chart)
    chart.g[0], chart.g[2] = side * (shape.radius - rho), dot(frame[2], zeta)
    for k in range(3):
        chart.G[0, k], chart.G[2, k] = -side * e_rho[k], frame[2, k]
        for a in range(3):
            chart.G_p[0, k, a] = -side * e_theta[k] * e_theta[a] / rho
            chart.G_p[2, k, a] = 0.0
    return STILL


class Cylinder(Form, frozen=True, forbid_unknown_fields=True, tag="cylinder"):
    """A cylinder: phi = side (radius - rho); psi_1 = radius * theta from the reference, psi_2 along the axis."""

    title = "cylinder"
    chart = _chart

    axis: Annotated[
        Vector3, field("direction of its axis", "1", Widget("axis"), title="direction of the surface's axis")
    ] = (0.0, 1.0, 0.0)
    reference: Annotated[
        Vector3,
        field(
            "direction from the axis where psi_1 = 0",
            "1",
            Widget("ψ = 0 towards"),
            title="direction from the surface's axis where ψ₁ = 0",
        ),
    ] = (0.0, 0.0, 1.0)
    radius: Radius = 0.3
    side: Side = "outside"

    @property
    def shape(self) -> Shape:
        axis, towards = unit("surface.axis", self.axis), unit("surface.reference", self.reference)
        across = towards - (towards @ axis) * axis
        length = np.linalg.norm(across)
        if length < 1e-6:
            raise ValueError(f"surface.reference: {towards.tolist()} is parallel to the axis; allowed: any other")
        reference = across / length
        frame = np.stack([reference, np.cross(axis, reference), axis])
        return self._placed(frame, self.radius, side_of(self.side))

    def local_point(self, frame: np.ndarray, g: np.ndarray) -> np.ndarray:
        rho, theta = self.radius - side_of(self.side) * g[0], g[1] / self.radius
        return frame.T @ np.array([rho * np.cos(theta), rho * np.sin(theta), g[2]])

    def extent(self) -> tuple[tuple[float, float], tuple[float, float]]:
        half = np.pi * self.radius * (1.0 if self.side == "outside" else 0.5)
        return (-half, half), (-0.2, 0.2)
