"""Circle through the start."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec.structs import replace

from environments.trajectories.line import Line, unit_circle
from environments.trajectories.trajectory import Course, Trajectory, along, in_plane
from kernels import inline
from parameters import Widget, decades, field, slider

_PLANE = Widget(
    "plane", options=(("first and second", (0, 1)), ("first and third", (0, 2)), ("second and third", (1, 2)))
)


@inline
def _move(course, t, value, rate, acceleration):
    x, y = unit_circle(course, t)
    along(course, x, y, value, rate, acceleration)


class Circle(Trajectory, frozen=True, forbid_unknown_fields=True, tag="circle"):
    """A circle in two coordinates, through the start."""

    title = "circle"
    move = _move

    radius: Annotated[float, field("radius", "m", slider("radius", 0, 0.15), ge=0, le=2)] = 0.05
    period: Annotated[float, field("time of one turn", "s", decades("period", 1, 30), gt=0, le=3600)] = 4.0
    ramp: Annotated[float, field("time to full speed", "s", slider("ramp", 0, 5), ge=0, le=3600)] = 1.0
    axes: Annotated[tuple[int, int], field("which two coordinates, counted from 0", "", _PLANE, title="plane")] = (0, 1)

    def course(self, n: int, free: range) -> Course:
        a, b = self.axes
        if a == b or not all(0 <= axis < len(free) for axis in self.axes):
            raise ValueError(
                f"axes: {list(self.axes)}; allowed: two different numbers from 0 to {len(free) - 1}"
                if len(free) > 1
                else "kind: 'circle' needs two free coordinates; allowed here: another kind"
            )
        along_axes = np.eye(n)[free.start :]
        return in_plane(self.radius * along_axes[a], self.radius * along_axes[b], self.ramp, 2 * np.pi / self.period)

    def within(self, directions: np.ndarray | None, k: int) -> Trajectory:
        """The circle in the first two coordinates, or a line where there is only one."""
        del directions
        if k == 1:
            return Line(displacement=(2 * self.radius,), period=self.period, ramp=self.ramp)
        return replace(self, axes=(0, 1)) if max(self.axes) >= k else self

    def halved(self) -> Trajectory | None:
        return replace(self, radius=0.5 * self.radius) if self.radius > 0.0 else None
