"""Table of desired paths, by their names in a scenario, and one kernel for all."""

from __future__ import annotations

from typing import TYPE_CHECKING, Union

import numpy as np

from environments.trajectories.circle import Circle
from environments.trajectories.line import Line
from environments.trajectories.own import OwnPath
from environments.trajectories.point_to_point import Hold, PointToPoint
from environments.trajectories.trajectory import Course, Path, Trajectory
from kernels import choice, inline, kernel
from kernels.records import Record

TRAJECTORIES: tuple[type[Trajectory], ...] = (Hold, PointToPoint, Circle, Line, OwnPath)
ROTATIONS = tuple(each for each in TRAJECTORIES if each.suits_angles)
if TYPE_CHECKING:
    AnyTrajectory = AnyRotation = Trajectory
else:
    AnyTrajectory, AnyRotation = Union[TRAJECTORIES], Union[ROTATIONS]  # noqa: UP007

_move = choice([each.move for each in TRAJECTORIES])


def course_of(section: str, trajectory: Trajectory, n: int, free: range) -> Course:
    """The path in a section of a scenario as a displacement of n coordinates, of which it may move those in `free`.
    Raises ValueError with one sentence."""
    try:
        return numbered(trajectory, trajectory.course(n, free))
    except ValueError as error:
        raise ValueError(f"{section}.{error}") from error


def numbered(trajectory: Trajectory, course: Course) -> Course:
    """The course with the number of the trajectory's kind."""
    return course._replace(kind=TRAJECTORIES.index(type(trajectory)))


@inline
def path_at(course, t, value, rate, acceleration):
    """Write the displacement (n,) and its derivatives at time t (s)."""
    for i in range(value.shape[0]):
        value[i], rate[i], acceleration[i] = 0.0, 0.0, 0.0
    add_path(course, t, value, rate, acceleration)


@inline
def add_path(course, t, value, rate, acceleration):
    """Add the displacement (n,) and its derivatives at time t (s)."""
    _move(course.kind, course, t, value, rate, acceleration)


@kernel
def _path_alone(course, t, path):
    path_at(course[0], t, path[0].value, path[0].rate, path[0].acceleration)


def evaluated(course: Course, t: float) -> Path:
    """The path at time t (s)."""
    path = Record(Path(*3 * (np.zeros(len(course.u)),)))
    _path_alone(Record(course).data, t, path.data)
    return path.read()
