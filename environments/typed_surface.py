"""A surface typed as a formula Phi(x, y, z, t) = 0, e.g. "z - 0.1 - 0.02*sin(6*x - 2*t)", (30).

x, y, z are metres from the surface's origin along the world's axes, t is seconds since the run began. phi is the
distance from the surface (`environments.level_set`), psi_1 and psi_2 are those of a plane across `normal`: the chart is
regular where the surface is not parallel to that direction, and no farther from it than its radius of curvature.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from environments.bytecode import bytecode_of
from environments.expression import T
from environments.formula import Formula, FormulaError, parse
from environments.level_set import crossings
from environments.surfaces import FORMULA, Motion, Surface, grid, tangent_frame, triangles
from kernels.records import Record

REACH = 0.4  # m along the normal, within which the surface is looked for
HALF = 0.25  # m, of the part that is drawn
NEAR, DEEP = 0.05, 0.005  # m along and across the surface: where it must be regular
DEEPEST = 0.05  # m inside the solid, where the tool may begin
INSTANTS = 9  # of a run, at which that is looked at
FLATTEST = 0.1  # cosine of the angle between the surface's own normal and the given direction
STEP, AGREEMENT = 1e-5, 1e-3  # m and s, of differences; how well derivatives must agree with them, relatively


@dataclass(frozen=True, kw_only=True)
class TypedSurface(Surface):
    """side: +1 with the solid where the formula is positive, -1 where it is negative; near (3,) m: where it is used, of
    several crossings of a line with the surface the one nearest to it counts."""

    formula: Formula
    near: np.ndarray
    kind = FORMULA
    resolution = 29

    @classmethod
    def create(
        cls,
        text: str,
        origin: np.ndarray,
        normal: np.ndarray,
        solid: Literal["below", "above"],
        motion: Motion,
        near: np.ndarray,
    ) -> TypedSurface:
        """solid: where the formula is negative ("below") or positive. Raises FormulaError."""
        formula = parse(text)
        graph = formula.graph
        bytecode = bytecode_of(formula)
        if all(graph.derivative(formula.root, space) == graph.zero for space in range(3)):
            raise FormulaError("the formula depends on none of x, y, z; allowed: one that does")
        return cls(
            np.asarray(origin, dtype=float),
            tangent_frame(normal),
            motion,
            side=-1.0 if solid == "below" else 1.0,
            bytecode=bytecode,
            formula=formula,
            near=np.asarray(near, dtype=float),
        )

    @property
    def changing(self) -> bool:
        graph = self.formula.graph
        return graph.derivative(self.formula.root, T) != graph.zero

    @cached_property
    def _packed_bytecode(self) -> np.ndarray:
        return Record(self.bytecode).data

    def _heights(self, starts: np.ndarray, t: float) -> np.ndarray:
        """How far (N,) m along the normal the surface is from the points (N, 3) m from its origin; nan: nowhere."""
        heights = np.empty(len(starts))
        crossings(self._packed_bytecode, np.ascontiguousarray(starts), self.frame[0], REACH, t, heights)
        return heights

    def point(self, g: np.ndarray, t: float) -> np.ndarray:
        """The point (3,) with coordinates g = (phi, psi_1, psi_2): the inverse of `chart`, by Newton's method. Where
        the surface is out of reach it is a point at the height of `near`."""
        normal, moved = self.frame[0], self.origin + self.motion.offset(t)
        start = self.frame[1:].T @ g[1:] + normal * (normal @ (self.near - self.origin))
        height = self._heights(start[None], t)[0]
        if not np.isfinite(height):
            return moved + start
        p = moved + start + normal * height
        for _ in range(20):
            chart = self.chart(p, t)
            step = (g[0] - chart.g[0]) / (normal @ chart.G[0])
            if not abs(step) < REACH:
                break
            p = p + normal * step
            if abs(step) < 1e-14:
                break
        return p

    def mesh(self, around: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        normal = self.frame[0]
        middle = around - self.origin - self.motion.offset(t)
        u, v = grid(self.resolution, (-HALF, HALF), (-HALF, HALF))
        starts = middle + np.outer(u, self.frame[1]) + np.outer(v, self.frame[2])
        heights = self._heights(starts, t)
        there = np.isfinite(heights)
        faces = triangles(self.resolution)
        vertices = self.origin + starts + np.outer(np.where(there, heights, 0.0), normal)
        return vertices, faces[there[faces].all(axis=1)]

    def require_regular(self, until: float) -> None:
        """Whether the chart is good for a run of `until` s that begins at `near`: there is a surface, across the
        normal, smooth, its derivatives what differences say, `near` not deep in the solid. Raises FormulaError."""
        depth = self.chart(self.near, 0.0).g[0]
        if depth > DEEPEST:
            raise FormulaError(
                f"the tool at {_written(self.near)} would begin {depth:.3g} m inside the solid; allowed: "
                f"{DEEPEST:g} m, or the other side as surface.solid"
            )
        random = np.random.default_rng(0)
        u, v = (np.append(0.0, w) for w in grid(5, (-NEAR, NEAR), (-NEAR, NEAR)))
        starts = self.near - self.origin + np.outer(u, self.frame[1]) + np.outer(v, self.frame[2])
        for t in np.linspace(0.0, until, INSTANTS):
            heights = self._heights(starts, t)
            if not np.isfinite(heights[0]):
                raise FormulaError(
                    f"at t = {t:.3g} s the line through the tool along surface.normal does not meet the surface; "
                    f"allowed: a crossing within {REACH:g} m of {_written(self.near)}"
                )
            points = self.origin + self.motion.offset(t) + starts + np.outer(heights, self.frame[0])
            for p in points[np.isfinite(heights)]:
                self._require_regular_at(p, t)
            self._require_derivatives(points[0] + random.uniform(-DEEP, DEEP, 3), t)

    def _require_regular_at(self, p: np.ndarray, t: float) -> None:
        where = f"near {_written(p)} at t = {t:.3g} s"
        n = self.chart(p, t).G[0]
        if not abs(n @ self.frame[0]) >= FLATTEST:  # nan included
            raise FormulaError(
                f"{where} the gradient vanishes or is across surface.normal; allowed: a surface that is not parallel "
                "to surface.normal"
            )
        for depth in (-DEEP, DEEP):
            chart = self.chart(p + depth * n, t)
            if not (abs(chart.g[0] - depth) < 1e-8 and np.abs(chart.G[0] - n).max() < 1e-6):
                raise FormulaError(
                    f"{where} the surface is not smooth: {DEEP:g} m away from it no nearest point is found; "
                    "allowed: larger radii of curvature"
                )

    def _require_derivatives(self, p: np.ndarray, t: float) -> None:
        chart, h = self.chart(p, t), STEP
        sides = [(self.chart(p + e, t), self.chart(p - e, t)) for e in h * np.eye(3)]
        sides.append((self.chart(p, t + h), self.chart(p, t - h)))
        pairs = [
            (np.column_stack([chart.G, chart.g_t]), [(a.g - b.g) / (2 * h) for a, b in sides]),
            (np.concatenate([chart.G_p, chart.G_t[:, :, None]], axis=2), [(a.G - b.G) / (2 * h) for a, b in sides]),
            (np.column_stack([chart.G_t, chart.g_tt]), [(a.g_t - b.g_t) / (2 * h) for a, b in sides]),
        ]
        for derivative, differences in pairs:
            away = np.abs(derivative - np.stack(differences, axis=-1)).max()
            if not away <= AGREEMENT * (1.0 + np.abs(derivative).max()):
                raise FormulaError(
                    f"near {_written(p)} at t = {t:.3g} s its derivatives are not what differences say, by {away:.2g}; "
                    "allowed: a formula with two continuous derivatives there"
                )


def _written(p: np.ndarray) -> str:
    return "(" + ", ".join(f"{x:.3g}" for x in p) + ") m"
