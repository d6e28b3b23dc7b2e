"""A surface typed as a formula Phi(x, y, z, t) = 0, e.g. "z - 0.1 - 0.02*sin(6*x - 2*t)", (30).

x, y, z are metres from the surface's origin along the world's axes, t is seconds since the run began. phi is the
distance from the surface (`environments.level_set`), psi_1 and psi_2 are those of a plane across `normal`: the chart is
regular where the surface is not parallel to that direction, and no farther from it than its radius of curvature.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from msgspec.structs import replace

from environments.bytecode import Bytecode, bytecode_of
from environments.expression import T
from environments.formula import Formula, FormulaError, parse
from environments.level_set import crossings, distance
from environments.surfaces.chart import Shape, flat
from environments.surfaces.form import NORMAL, Form, grid, tangent_frame, triangles, unit
from environments.surfaces.regular import require_derivatives, written
from kernels import inline
from kernels.records import Record
from parameters import Text, Vector3, Widget, field

if TYPE_CHECKING:
    from environments.surfaces.table import Surface

REACH = 0.4  # m along the normal, within which the surface is looked for
HALF = 0.25  # m, half the side of the drawn part
NEAR, DEEP = 0.05, 0.005  # m along and across the surface: where it must be regular
DEEPEST = 0.05  # m inside the solid, where the tool may begin
INSTANTS = 9  # of a run, at which regularity is checked
FLATTEST = 0.1  # cosine of the angle between the surface's own normal and the given direction
SOLID = Widget("Solid", options=(("where the formula < 0", "below"), ("where the formula > 0", "above")))


@inline
def _chart(zeta, shape, t, chart):
    flat(zeta, shape, t, chart)
    return distance(shape.bytecode, shape.side, zeta, t, chart)


class FormulaSurface(Form, frozen=True, forbid_unknown_fields=True, tag="formula"):
    """A surface typed as a formula that is 0 on it. Of several crossings of a line with it, the one nearest to the
    place where it is used (`Surface.near`) counts."""

    title = "formula"
    chart = _chart
    resolution = 29
    typed = True

    text: Annotated[
        Text,
        field(
            "of x, y, z (m from the origin) and t (s): 0 on the surface",
            "",
            Widget("0 ="),
            title="formula of the surface",
        ),
    ] = "z - 0.02*sin(8*x - 2*t)"
    solid: Annotated[
        Literal["below", "above"],
        field(
            "side that is solid: where the formula is below 0, or above",
            "",
            SOLID,
            title="side of the formula that is solid",
        ),
    ] = "below"
    normal: Annotated[
        Vector3,
        field("direction across the surface; psi_1, psi_2 run across it", "1", NORMAL, title="normal of the surface"),
    ] = (0.0, 0.0, -1.0)

    @property
    def shape(self) -> Shape:
        frame = tangent_frame(unit("surface.normal", self.normal))
        try:
            _, bytecode = _translated(self.text)
        except FormulaError as error:
            raise ValueError(f"surface.text: {error}") from error
        return self._placed(frame, side=-1.0 if self.solid == "below" else 1.0)._replace(bytecode=bytecode)

    @property
    def changing(self) -> bool:
        formula, _ = _translated(self.text)
        graph = formula.graph
        return graph.derivative(formula.root, T) != graph.zero

    @property
    def frequencies(self) -> tuple[float, ...] | None:
        return None if self.changing else super().frequencies

    def point(self, surface: Surface, g: np.ndarray, t: float) -> np.ndarray:
        """Point (3,) with coordinates g = (phi, psi_1, psi_2): the inverse of `chart`, by Newton's method. Where the
        surface is out of reach, it is a point at the height of `surface.near`."""
        normal, moved = surface.frame[0], surface.origin + self.motion.offset(t)
        start = surface.frame[1:].T @ g[1:] + normal * (normal @ (surface.near - surface.origin))
        height = _heights(surface, start[None], t)[0]
        if not np.isfinite(height):
            return moved + start
        p = moved + start + normal * height
        for _ in range(20):
            chart = surface.chart(p, t)
            step = (g[0] - chart.g[0]) / (normal @ chart.G[0])
            if not abs(step) < REACH:
                break
            p = p + normal * step
            if abs(step) < 1e-14:
                break
        return p

    def mesh(self, surface: Surface, around: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        normal = surface.frame[0]
        middle = around - surface.origin - self.motion.offset(t)
        u, v = grid(self.resolution, (-HALF, HALF), (-HALF, HALF))
        starts = middle + np.outer(u, surface.frame[1]) + np.outer(v, surface.frame[2])
        heights = _heights(surface, starts, t)
        there = np.isfinite(heights)
        faces = triangles(self.resolution)
        vertices = surface.origin + starts + np.outer(np.where(there, heights, 0.0), normal)
        return vertices, faces[there[faces].all(axis=1)]

    def below(self, p: np.ndarray, phi: float) -> Form | None:
        """A wave in the world's coordinates, below the tool. It stands still: for one that changes with time nothing
        is promised after `simulation.duration`."""
        height = p[2] + phi - 0.015 * np.sin(15 * p[0])
        return replace(self, text=f"z {-height:+.4f} - 0.015*sin(15*x)")

    def across(self, normal: np.ndarray, p: np.ndarray, phi: float) -> Form | None:
        """A plane."""
        terms = " ".join(
            f"{-value:+.4g}*{name}" for name, value in zip("xyz", normal, strict=True) if abs(value) > 1e-4
        )
        return replace(self, text=f"{normal @ p - phi:.4g} {terms}", normal=tuple(normal.round(4).tolist()))

    def require_regular(self, surface: Surface, until: float) -> None:
        """Raise ValueError unless the chart is regular for a run of `until` s that begins at `surface.near`: there is a
        surface, across the normal, smooth, with derivatives that agree with differences, and `surface.near` is not deep
        in the solid."""
        depth = surface.chart(surface.near, 0.0).g[0]
        if depth > DEEPEST:
            raise ValueError(
                f"surface.text: the tool at {written(surface.near)} would begin {depth:.3g} m inside the solid; "
                f"allowed: {DEEPEST:g} m, or the other side as surface.solid"
            )
        random = np.random.default_rng(0)
        u, v = (np.append(0.0, w) for w in grid(5, (-NEAR, NEAR), (-NEAR, NEAR)))
        starts = surface.near - surface.origin + np.outer(u, surface.frame[1]) + np.outer(v, surface.frame[2])
        for t in np.linspace(0.0, until, INSTANTS):
            heights = _heights(surface, starts, t)
            if not np.isfinite(heights[0]):
                raise ValueError(
                    f"surface.text: at t = {t:.3g} s the line through the tool along surface.normal does not meet the "
                    f"surface; allowed: a crossing within {REACH:g} m of {written(surface.near)}"
                )
            points = surface.origin + self.motion.offset(t) + starts + np.outer(heights, surface.frame[0])
            for p in points[np.isfinite(heights)]:
                _require_regular_at(surface, p, t)
            require_derivatives("surface.text", surface, points[0] + random.uniform(-DEEP, DEEP, 3), t)


@lru_cache(maxsize=16)
def _translated(text: str) -> tuple[Formula, Bytecode]:
    """Formula of a text, and its bytecode for kernels. Raises FormulaError."""
    formula = parse(text)
    graph = formula.graph
    bytecode = bytecode_of(formula)
    if all(graph.derivative(formula.root, space) == graph.zero for space in range(3)):
        raise FormulaError("the formula depends on none of x, y, z; allowed: one that does")
    return formula, bytecode


def _heights(surface: Surface, starts: np.ndarray, t: float) -> np.ndarray:
    """Distances (N,) m along the normal from the points (N, 3) m, relative to the surface's origin, to the surface; nan
    where there is none."""
    heights, bytecode = np.empty(len(starts)), Record(surface.shape.bytecode).data
    crossings(bytecode, np.ascontiguousarray(starts), surface.frame[0], REACH, t, heights)
    return heights


def _require_regular_at(surface: Surface, p: np.ndarray, t: float) -> None:
    where = f"surface.text: near {written(p)} at t = {t:.3g} s"
    n = surface.chart(p, t).G[0]
    if not abs(n @ surface.frame[0]) >= FLATTEST:  # nan included
        raise ValueError(
            f"{where} the gradient vanishes or is across surface.normal; allowed: a surface that is not parallel "
            "to surface.normal"
        )
    for depth in (-DEEP, DEEP):
        chart = surface.chart(p + depth * n, t)
        if not (abs(chart.g[0] - depth) < 1e-8 and np.abs(chart.G[0] - n).max() < 1e-6):
            raise ValueError(
                f"{where} the surface is not smooth: {DEEP:g} m away from it no nearest point is found; "
                "allowed: larger radii of curvature"
            )
