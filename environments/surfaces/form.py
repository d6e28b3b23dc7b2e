"""Base class of all surfaces: fields of a scenario, their compiled coordinates, and the inverse of these."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import msgspec
import numpy as np

from environments.bytecode import BLANK
from environments.own_function import NO_FUNCTION
from environments.surfaces.chart import NOT_TURNING, Shape
from parameters import Section, Vector3, Widget, decades, field, slider

if TYPE_CHECKING:
    from environments.surfaces.table import Surface

ORIGIN = Widget("origin")
NORMAL = Widget("normal")
SHORTEST, LONGEST = 1e-9, 1e9  # of a vector that gives a direction: far from where squares vanish or overflow
_SIDE = Widget("Tool", options=(("outside", "outside"), ("inside", "inside")))
Radius = Annotated[float, field("radius", "m", decades("radius", 0.05, 2), gt=0, le=100)]
Side = Annotated[
    Literal["outside", "inside"],
    field("where the tool is", "", _SIDE, title="side of the surface on which the tool is"),
]


class SurfaceMotion(Section, frozen=True, forbid_unknown_fields=True):
    """Translation along a direction, amplitude * sin(2 pi frequency t)."""

    amplitude: Annotated[
        float,
        field("amplitude", "m", slider("moves by", 0, 0.05), ge=0, le=1, title="amplitude of the surface's motion"),
    ] = 0.0
    frequency: Annotated[
        float,
        field("frequency", "Hz", slider("moves at", 0, 2), ge=0, le=20, title="frequency of the surface's motion"),
    ] = 0.5
    direction: Annotated[
        Vector3, field("direction", "1", Widget("direction"), title="direction of the surface's motion")
    ] = (0.0, 0.0, 1.0)

    def offset(self, t: float) -> np.ndarray:
        """Displacement at time t (s) from the beginning, (3,) m."""
        along = unit("surface.motion.direction", self.direction)
        return along * (self.amplitude * np.sin(2 * np.pi * self.frequency * t))


class Form(Section, frozen=True, forbid_unknown_fields=True, tag_field="kind"):
    """Base class of all surfaces: section `surface` of a scenario.

    title: name on the page.
    chart: its kernel `chart(zeta, shape, t, chart)`, which writes the coordinates of a point and their derivatives,
    zeta (3,) m from the origin in the surface's place at time t, and returns the terms that the form's change in time
    adds to the derivatives of phi, `STILL` for none.
    resolution: points of its mesh on a side.
    planar: whether it is a plane across its field `normal`, so that a flat tool can touch it.
    typed: whether it is a formula that the user types.
    """

    title: ClassVar[str]
    chart: ClassVar[Any]
    resolution: ClassVar[int] = 41
    planar: ClassVar[bool] = False
    typed: ClassVar[bool] = False

    origin: Annotated[
        Vector3,
        field(
            "a point of it; a sphere's centre, a point of a cylinder's axis", "m", ORIGIN, title="point of the surface"
        ),
    ] = (0.0, 0.0, 0.0)
    motion: SurfaceMotion = msgspec.field(default_factory=SurfaceMotion)

    @property
    def shape(self) -> Shape:
        """The surface for kernels; the table sets `kind`. Raises ValueError with one sentence."""
        raise NotImplementedError

    @property
    def changing(self) -> bool:
        """Whether its form changes in time, not only its place."""
        return False

    @property
    def frequencies(self) -> tuple[float, ...] | None:
        """Frequencies of all in which it moves or changes, Hz; None where it changes otherwise."""
        return (self.motion.frequency,) if self.motion.amplitude > 0.0 < self.motion.frequency else ()

    @property
    def normal_fixed(self) -> bool:
        """Whether its normal is the same everywhere and at all times: that of its frame."""
        return False

    def local_point(self, frame: np.ndarray, g: np.ndarray) -> np.ndarray:
        """Point (3,) m from the origin with coordinates g = (phi, psi_1, psi_2)."""
        raise NotImplementedError

    def extent(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Ranges of psi_1 and psi_2 that are worth drawing, m."""
        raise NotImplementedError

    def point(self, surface: Surface, g: np.ndarray, t: float) -> np.ndarray:
        """Point (3,) m with coordinates g at time t (s): the inverse of the chart."""
        return surface.origin + self.motion.offset(t) + self.local_point(surface.frame, g)

    def mesh(self, surface: Surface, around: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Mesh of the surface: vertices (N, 3) m of phi = 0 at time t (s), without the motion's offset then, and
        triangles (M, 3). A surface without a middle of its own is drawn around the point `around` (3,) m."""
        del around, t
        psi_1, psi_2 = grid(self.resolution, *self.extent())
        points = [self.local_point(surface.frame, np.array([0.0, u, v])) for u, v in zip(psi_1, psi_2, strict=True)]
        return surface.origin + np.array(points), triangles(self.resolution)

    def below(self, p: np.ndarray, phi: float) -> Form | None:
        """The surface with which the tool at p (3,) m begins at phi (m), for kinds that are not moved by their origin;
        None for the others."""
        del p, phi
        return None

    def across(self, normal: np.ndarray, p: np.ndarray, phi: float) -> Form | None:
        """The surface into which the tool at p (3,) m goes along `normal` (3,) and where it begins at phi (m), for
        kinds that are not moved by their origin; None for the others."""
        del normal, p, phi
        return None

    def require_regular(self, surface: Surface, until: float) -> None:
        """Raise ValueError with one sentence unless the coordinates are regular for a run of `until` s."""
        del surface, until

    def _placed(self, frame: np.ndarray, radius: float = 0.0, side: float = 1.0) -> Shape:
        """Shape of a surface with this frame (3, 3) of unit rows."""
        m, origin = self.motion, np.array(self.origin, dtype=float)
        direction = unit("surface.motion.direction", m.direction)
        rest = (float(m.amplitude), float(m.frequency), NOT_TURNING, BLANK, NO_FUNCTION)
        return Shape(0, origin, np.ascontiguousarray(frame), float(radius), side, direction, *rest)


def unit(path: str, vector: Any) -> np.ndarray:
    """Unit vector along a vector (3,). Raises ValueError with `path` for one as good as zero, or too long."""
    with np.errstate(over="ignore"):
        length = float(np.linalg.norm(vector))
    if not SHORTEST <= length <= LONGEST:
        numbers = ", ".join(f"{float(value):g}" for value in vector)
        raise ValueError(
            f"{path}: {numbers} is too {'short' if length < SHORTEST else 'long'} for a direction; allowed: three "
            f"numbers that are not all 0, such as 0, 0, 1, and none beyond {LONGEST:g}"
        )
    return np.array(vector, dtype=float) / length


def side_of(side: str) -> float:
    """Sign of the side: +1 with the solid inside and the tool outside, -1 with the tool within."""
    return 1.0 if side == "outside" else -1.0


def _normalised(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)


def tangent_frame(normal: np.ndarray) -> np.ndarray:
    """Right-handed frame with rows (normal, t_1, t_2); t_1 lies in the x-z plane whenever the normal does."""
    n = _normalised(normal)
    start = np.array([1.0, 0.0, 0.0]) if abs(n[0]) < 0.9 else np.array([0.0, 0.0, 1.0])
    t_1 = _normalised(start - (start @ n) * n)
    return np.ascontiguousarray(np.stack([n, t_1, np.cross(n, t_1)]))


def grid(resolution: int, first: tuple[float, float], second: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Two coordinates over their ranges, each (resolution^2,)."""
    u, v = np.meshgrid(np.linspace(*first, resolution), np.linspace(*second, resolution), indexing="ij")
    return u.ravel(), v.ravel()


def triangles(resolution: int) -> np.ndarray:
    """Triangles (M, 3) between the points of a `grid`."""
    cell = np.arange(resolution * resolution).reshape(resolution, resolution)
    a, b, c, d = cell[:-1, :-1].ravel(), cell[1:, :-1].ravel(), cell[1:, 1:].ravel(), cell[:-1, 1:].ravel()
    return np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
