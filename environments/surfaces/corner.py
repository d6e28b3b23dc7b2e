"""Corner of two or three surfaces, and the coordinates (30), (31) that they give together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from environments.surfaces.chart import Shapes
from environments.surfaces.table import Charted, Surface

INDEPENDENT = 0.05  # least singular value of the unit normals of surfaces that make a corner
STEPS, CLOSE = 30, 1e-12  # of Newton's method for `point`, and m


@dataclass(frozen=True)
class Corner(Charted):
    """Corner of two or three surfaces near the point `near` (3,) m: a groove, an edge, or the corner of a room.

    Its coordinates are phi of each, and beside two of them the way along the straight line that is tangential to both
    at `near`. Raises ValueError where the gradients of phi are not independent there.
    """

    surfaces: tuple[Surface, ...]
    near: np.ndarray

    def __post_init__(self) -> None:
        G = np.array([each.chart(self.near, 0.0).G[0] for each in self.surfaces])
        if np.linalg.svd(G / np.linalg.norm(G, axis=1)[:, None], compute_uv=False)[-1] < INDEPENDENT:
            raise ValueError(
                f"the normals {np.round(G, 3).tolist()} of the {len(G)} surfaces at the tool are not "
                "independent; allowed: surfaces that meet at an angle, not parallel ones"
            )

    @property
    def shapes(self) -> Shapes:
        """The surfaces for kernels."""
        shapes = tuple(each.shape for each in self.surfaces)
        if len(shapes) > 2:
            return Shapes.of(shapes)
        across = np.cross(*(each.chart(self.near, 0.0).G[0] for each in self.surfaces))
        return Shapes.of(shapes, across / np.linalg.norm(across), self.near)

    @property
    def frame(self) -> np.ndarray:
        """Frame (3, 3) of unit rows of the first surface."""
        return self.surfaces[0].frame

    def point(self, g: np.ndarray, t: float) -> np.ndarray:
        """The point (3,) m with coordinates g (3,), by Newton's method: the inverse of `chart`."""
        p = self.near
        for _ in range(STEPS):
            chart = self.chart(p, t)
            away = np.linalg.solve(chart.G, g - chart.g)
            p = p + away
            if np.abs(away).max() < CLOSE:
                break
        return p
