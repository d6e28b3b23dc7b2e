"""Table of surfaces, by their names in a scenario, and one kernel for all."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Union

import numpy as np

from environments.surfaces.chart import Chart, Shape, Shapes, one_of, swing
from environments.surfaces.cylinder import Cylinder
from environments.surfaces.form import Form, SurfaceMotion
from environments.surfaces.formula import FormulaSurface
from environments.surfaces.own import OwnForm
from environments.surfaces.plane import Plane
from environments.surfaces.sphere import Sphere
from kernels import choice, inline, kernel
from kernels.records import Record

SURFACES: tuple[type[Form], ...] = (Plane, Cylinder, Sphere, FormulaSurface, OwnForm)
if TYPE_CHECKING:
    AnyForm = Form
else:
    AnyForm = Union[SURFACES]  # noqa: UP007

_local_chart = choice([each.chart for each in SURFACES])


@inline
def surface_chart(shape, p, t, chart):
    """Write the `Chart` of a point p (3,) m at time t (s)."""
    moved, speed, acceleration = swing(shape.amplitude, 2 * np.pi * shape.frequency, t)
    u = shape.direction
    zeta = (
        p[0] - shape.origin[0] - moved * u[0],
        p[1] - shape.origin[1] - moved * u[1],
        p[2] - shape.origin[2] - moved * u[2],
    )
    form = _local_chart(shape.kind, zeta, shape, t, chart)
    for i in range(3):  # derivatives in time of g(p - a(t)): the chain rule, exact
        chart.g_t[i], chart.g_tt[i] = 0.0, 0.0
        for k in range(3):
            chart.G_t[i, k] = 0.0
            for a in range(3):
                chart.G_t[i, k] -= chart.G_p[i, k, a] * speed * u[a]
            chart.g_t[i] -= chart.G[i, k] * speed * u[k]
            chart.g_tt[i] -= chart.G_t[i, k] * speed * u[k] + chart.G[i, k] * acceleration * u[k]
    chart.g_t[0] += form[0]  # and those of its form
    chart.g_tt[0] += form[1]
    chart.deforming = form[5]
    for k in range(3):
        chart.G_t[0, k] += form[2 + k]
        chart.g_tt[0] -= 2.0 * form[2 + k] * speed * u[k]


@inline
def task_chart(shapes, p, t, spare, chart):
    """Write the `Chart` of the task coordinates (31) of a point p (3,) m at time t (s): the coordinates of one surface,
    or phi of two and the way along their edge, or phi of three. spare: memory for another chart."""
    surface_chart(shapes.first, p, t, chart)
    for i in range(1, shapes.number):
        surface_chart(one_of(shapes, i), p, t, spare)
        chart.g[i], chart.g_t[i], chart.g_tt[i], chart.turn[i] = spare.g[0], spare.g_t[0], spare.g_tt[0], 0.0
        for k in range(3):
            chart.G[i, k], chart.G_t[i, k] = spare.G[0, k], spare.G_t[0, k]
            for a in range(3):
                chart.G_p[i, k, a] = spare.G_p[0, k, a]
    if shapes.number == 2:
        chart.g[2], chart.g_t[2], chart.g_tt[2], chart.turn[2] = 0.0, 0.0, 0.0, 0.0
        for k in range(3):
            chart.g[2] += shapes.edge[k] * (p[k] - shapes.base[k])
            chart.G[2, k], chart.G_t[2, k] = shapes.edge[k], 0.0
            for a in range(3):
                chart.G_p[2, k, a] = 0.0


_BLANK = Record(Chart.zeros())


@kernel
def _chart_alone(shapes, p, t, spare, chart):
    task_chart(shapes[0], p, t, spare[0], chart[0])


def chart_at(shapes: np.ndarray, p: np.ndarray, t: float) -> Chart:
    """Chart of the point p (3,) m at time t (s); shapes: data of a record of `Shapes`."""
    spare, chart = _BLANK.copy(), _BLANK.copy()
    _chart_alone(shapes, p, t, spare.data, chart.data)
    return chart.read()


class Charted:
    """Base class of `Surface` and `Corner`, each of which has a chart."""

    @property
    def shapes(self) -> Shapes:
        """Its surfaces, for kernels."""
        raise NotImplementedError

    @cached_property
    def _packed(self) -> np.ndarray:
        return Record(self.shapes).data

    @property
    def fingerprint(self) -> bytes:
        """Bytes of `shapes`: what has the same bytes gives the same charts."""
        return self._packed.tobytes()

    def chart(self, p: np.ndarray, t: float) -> Chart:
        """Coordinates of the point p (3,) m at time t (s) with all derivatives."""
        return chart_at(self._packed, p, t)


@dataclass(frozen=True)
class Surface(Charted):
    """A surface in use: its form in the scenario, its shape for kernels, and the place where it is used, (3,) m."""

    form: Form
    shape: Shape
    near: np.ndarray

    @classmethod
    def of(cls, form: Form, near: np.ndarray | None = None, shape: Shape | None = None) -> Surface:
        """Surface of a form, used near a point (3,) m; `shape`: the form's unless another is given. Raises ValueError
        with one sentence."""
        kind = SURFACES.index(type(form))
        return cls(form, (shape or form.shape)._replace(kind=kind), np.zeros(3) if near is None else near)

    @classmethod
    def cartesian(cls, frame: np.ndarray) -> Surface:
        """Cartesian axes in place of a surface: the coordinates are those of the point itself, along the rows of
        `frame` (3, 3), at rest."""
        return cls.of(Plane(), shape=Plane().shape._replace(frame=np.ascontiguousarray(frame, dtype=float)))

    @property
    def origin(self) -> np.ndarray:
        """Origin (3,) m."""
        return self.shape.origin

    @property
    def frame(self) -> np.ndarray:
        """Frame (3, 3) of unit rows."""
        return self.shape.frame

    @property
    def motion(self) -> SurfaceMotion:
        return self.form.motion

    @property
    def changing(self) -> bool:
        """Whether its form changes in time, not only its place."""
        return self.form.changing

    @property
    def turning(self) -> bool:
        """Whether its normal at a fixed point changes in time: its form does, or a curved one moves."""
        return self.form.changing or (not self.form.normal_fixed and self.motion.amplitude > 0.0)

    @property
    def resolution(self) -> int:
        """Number of points of its mesh on a side."""
        return self.form.resolution

    @property
    def shapes(self) -> Shapes:
        """This surface alone, for kernels."""
        return Shapes.of((self.shape,))

    def point(self, g: np.ndarray, t: float) -> np.ndarray:
        """The point (3,) m with coordinates g = (phi, psi_1, psi_2): the inverse of `chart`."""
        return self.form.point(self, g, t)

    def mesh(self, around: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        """See `Form.mesh`."""
        return self.form.mesh(self, around, t)

    def require_regular(self, until: float) -> None:
        """See `Form.require_regular`."""
        self.form.require_regular(self, until)
