"""Straight move to another point, and staying at the start."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec.structs import replace

from environments.smooth_step import minimum_jerk
from environments.trajectories.trajectory import Course, Trajectory, along, in_plane, spread
from kernels import inline
from parameters import Vector, Widget, decades, field


@inline
def _move(course, t, value, rate, acceleration):
    along(course, minimum_jerk(t, course.ramp), (0.0, 0.0, 0.0), value, rate, acceleration)


class Hold(Trajectory, frozen=True, forbid_unknown_fields=True, tag="hold"):
    """Stay at the start."""

    title = "hold"
    move = _move
    comes_to_rest = True
    moves = False

    def course(self, n: int, free: range) -> Course:
        del free
        return in_plane(np.zeros(n), np.zeros(n), 1.0)


class Displaced(Trajectory, frozen=True, forbid_unknown_fields=True):
    """Base class of paths along one displacement."""

    displacement: Annotated[
        Vector, field("by how much, each coordinate that it may move", "m", Widget("by"), title="displacement")
    ] = (0.1,)

    def within(self, directions: np.ndarray | None, k: int) -> Trajectory:
        """The path's part along the directions where it has more values than there are directions."""
        if len(self.displacement) <= k:
            return self
        if directions is None:
            return Hold()
        given = self.displacement[: directions.shape[1]]
        kept = directions[:, : len(given)] @ np.array(given)
        return replace(self, displacement=tuple(kept.round(6).tolist()))

    def halved(self) -> Trajectory | None:
        half = tuple(0.5 * value for value in self.displacement)
        return replace(self, displacement=half) if any(half) else None


class PointToPoint(Displaced, frozen=True, forbid_unknown_fields=True, tag="point-to-point"):
    """A minimum-jerk move."""

    title = "point to point"
    move = _move
    comes_to_rest = True

    duration: Annotated[float, field("duration", "s", decades("duration", 0.2, 20), gt=0, le=3600)] = 2.0

    def course(self, n: int, free: range) -> Course:
        u = spread("displacement", self.displacement, n, free)
        return in_plane(u, np.zeros(n), self.duration)
