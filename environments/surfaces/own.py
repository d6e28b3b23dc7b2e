"""Surface of a user's own, in a file that `--use` names."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Annotated

import msgspec
import numpy as np

from environments.own_function import OwnFunction, call, own_function, written_beyond
from environments.surfaces.chart import STILL, Shape
from environments.surfaces.form import Form, grid, triangles
from environments.surfaces.regular import require_derivatives, written
from kernels import inline
from parameters import Name, Parameter, field, values_of

if TYPE_CHECKING:
    from environments.surfaces.table import Surface

HALF = 0.2  # m, of the part that is drawn
NEAREST = 1e-14  # m, at which the search for a point ends
FOUND = 1e-9  # m: largest error of its coordinates
STEEP = 1e-6  # largest difference of the length of phi's gradient from 1 on the surface
NEAR = 0.01  # m from its origin: where its derivatives are checked


@dataclass(frozen=True)
class OwnSurface:
    """Surface of a user's own, as its file describes it under the name SURFACE.

    kind: its name in a scenario (`surface.name`); title: its name on the page; about: a sentence for the page.
    chart: `chart(zeta, parameters, g, G, G_p)` writes the coordinates g = (phi, psi_1, psi_2) in m of the point zeta
    (3,) m from the surface's origin, along the world's axes, the rows G (3, 3) of their gradients, and their Hessians
    G_p (3, 3, 3); all are zero before. phi is penetration; the origin is a point of the surface, with g = 0, about
    which the coordinates are regular. It is decorated with `kernels.inline` or
    `kernels.allocating`.
    """

    kind: str
    title: str
    about: str
    chart: Callable[..., None]
    parameters: tuple[Parameter, ...] = ()

    def shape(self, form: OwnForm) -> Shape:
        """Shape for kernels, with the parameters of a scenario. Raises ValueError with one sentence,
        OwnFunctionError, and numba's errors."""
        values = values_of(self.parameters, form.parameters, "surface.parameters")
        own = own_function(_adapted(self.chart), self.chart, values, ((3,), (3, 3), (3, 3, 3)))
        _require_within(self.kind, own)
        return form.shape._replace(own=own)


def _require_within(kind: str, own: OwnFunction) -> None:
    """Raise ValueError where the chart writes beyond its arrays, and OwnFunctionError where it fails."""
    for zeta in (np.zeros(3), *(NEAR * np.eye(3)), np.full(3, -NEAR)):
        places = written_beyond(own, 0.0, (3, 9, 27), f"tried at zeta = {written(zeta)}", zeta)
        behind = [name for name, place in zip(("g", "G", "G_p"), places, strict=True) if place is not None]
        if behind:
            raise ValueError(f"surface.name: {kind!r} writes behind the end of {behind[0]}; allowed: indices 0 to 2")


@cache
def _adapted(chart: Callable[..., None]) -> Callable[..., None]:
    @inline
    def adapted(_t, parameters, g, G, G_p):
        zeta = (g[0], g[1], g[2])
        for i in range(3):
            g[i] = 0.0
            for k in range(3):
                G[i, k] = 0.0
                for a in range(3):
                    G_p[i, k, a] = 0.0
        chart(zeta, parameters, g, G, G_p)

    return adapted


@inline
def _chart(zeta, shape, t, chart):
    for i in range(3):
        chart.g[i] = zeta[i]
    own = shape.own
    call(own.address, t, own.parameters, chart.g, chart.G, chart.G_p)
    return STILL


class OwnForm(Form, frozen=True, forbid_unknown_fields=True, tag="own"):
    """A surface of your own (`--use`)."""

    title = "own"
    chart = _chart
    resolution = 29

    name: Annotated[Name, field("kind of the surface in your file", "")] = ""
    parameters: Annotated[dict[Name, float], field("its parameters, by name", "")] = msgspec.field(default_factory=dict)

    @property
    def shape(self) -> Shape:
        return self._placed(np.eye(3))

    def point(self, surface: Surface, g: np.ndarray, t: float) -> np.ndarray:
        """Point (3,) m with coordinates g at time t (s), searched for from the place where the surface is used."""
        return _point(surface, g, t, surface.near + self.motion.offset(t))

    def mesh(self, surface: Surface, around: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        psi, k = surface.chart(around, t).g, self.resolution
        psi_1, psi_2 = grid(k, (psi[1] - HALF, psi[1] + HALF), (psi[2] - HALF, psi[2] + HALF))
        points = np.array(
            [_point_drawn(surface, np.array([0.0, u, v]), t, around) for u, v in zip(psi_1, psi_2, strict=True)]
        )
        there = np.isfinite(points.sum(axis=1))
        vertices, faces = np.where(there[:, None], points - self.motion.offset(t), 0.0), triangles(k)
        return vertices, faces[there[faces].all(axis=1)]

    def require_regular(self, surface: Surface, until: float) -> None:
        """Raise ValueError unless the derivatives agree with differences at the tool's place, and phi grows by a metre
        in a metre there: else lambda would be no force in N."""
        random = np.random.default_rng(0)
        for t in np.linspace(0.0, until, 3):
            require_derivatives("surface.name", surface, surface.near + NEAR * random.uniform(-1.0, 1.0, 3), t)
            beside = surface.chart(surface.near + self.motion.offset(t), t).g * (0.0, 1.0, 1.0)
            p = self.point(surface, beside, t)
            slope = np.linalg.norm(surface.chart(p, t).G[0])
            if abs(slope - 1.0) > STEEP:
                raise ValueError(
                    f"surface.name: {self.name!r} has a gradient of phi of the length {slope:.6g} at {written(p)}; "
                    "allowed: 1 on the surface, where phi is the penetration in metres"
                )


def _point_drawn(surface: Surface, g: np.ndarray, t: float, start: np.ndarray) -> np.ndarray:
    """Point (3,) m as `_point` finds it; nan also where the chart raises an exception on the way, since it may have no
    coordinates far from the tool."""
    try:
        return _point(surface, g, t, start)
    except (ArithmeticError, LookupError, ValueError):
        return np.full(3, np.nan)


def _point(surface: Surface, g: np.ndarray, t: float, start: np.ndarray) -> np.ndarray:
    """Point (3,) m with coordinates g at time t (s), by Powell's method from a point (3,) m; nan where there is
    none."""
    from scipy.optimize import root  # imported here: a program that only reads scenarios does not wait for it

    def residual(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        chart = surface.chart(p, t)
        return chart.g - g, chart.G

    found = root(residual, start, jac=True, options={"xtol": NEAREST})
    return found.x if np.abs(found.fun).max() < FOUND else np.full(3, np.nan)
