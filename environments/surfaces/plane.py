"""Plane."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np

from environments.surfaces.chart import Shape, flat
from environments.surfaces.form import NORMAL, Form, tangent_frame, unit
from parameters import Vector3, field

if TYPE_CHECKING:
    from environments.surfaces.table import Surface


class Plane(Form, frozen=True, forbid_unknown_fields=True, tag="plane"):
    """A plane: phi = normal . (p - origin), psi along its two tangents."""

    title = "plane"
    chart = flat
    resolution = 2

    normal: Annotated[Vector3, field("direction into the environment", "1", NORMAL)] = (0.0, 0.0, -1.0)

    @property
    def shape(self) -> Shape:
        return self._placed(tangent_frame(unit("surface.normal", self.normal)))

    def local_point(self, frame: np.ndarray, g: np.ndarray) -> np.ndarray:
        return frame.T @ g

    def extent(self) -> tuple[tuple[float, float], tuple[float, float]]:
        return (-0.25, 0.25), (-0.25, 0.25)

    def mesh(self, surface: Surface, around: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        vertices, faces = super().mesh(surface, around, t)
        away = surface.frame[1:] @ (around - surface.origin)
        return vertices + surface.frame[1:].T @ away, faces
