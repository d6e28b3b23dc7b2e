"""Base class of all desired paths: fields of a scenario, and their compiled function."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import numpy as np

from environments.own_function import NO_FUNCTION, OwnFunction
from kernels import inline
from parameters import Section


class Path(NamedTuple):
    """Desired path at one instant: displacement (n,) m, its rate (m/s) and acceleration (m/s^2)."""

    value: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray


class Course(NamedTuple):
    """Desired path for kernels, x(t) u + y(t) v with u, v (n,) m.
    kind: number of the path.
    ramp: duration, or rise at its beginning, s.
    omega: angular frequency, rad/s.
    first, own: a path of a user's own is a function of the coordinates from `first` on."""

    kind: int
    u: np.ndarray
    v: np.ndarray
    ramp: float
    omega: float
    first: int
    own: OwnFunction


class Trajectory(Section, frozen=True, forbid_unknown_fields=True, tag_field="kind"):
    """Base class of all desired paths: section `motion` or `rotation` of a scenario.

    title: name on the page.
    move: its kernel `move(course, t, value, rate, acceleration)`, which adds the displacement (n,) and its derivatives
    at time t (s).
    comes_to_rest: whether the path ends at a point.
    moves: whether the path leaves the start.
    suits_angles: whether it may be the path of coordinates that are angles, too (section `rotation`).
    """

    title: ClassVar[str]
    move: ClassVar[Any]
    comes_to_rest: ClassVar[bool] = False
    moves: ClassVar[bool] = True
    suits_angles: ClassVar[bool] = True

    def course(self, n: int, free: range) -> Course:
        """The path as a displacement of n coordinates, of which it may move those in `free`; the table sets `kind`.
        Raises ValueError with one sentence that begins with the field's name."""
        raise NotImplementedError

    def within(self, directions: np.ndarray | None, k: int) -> Trajectory:
        """The part of the path that lies within k other free coordinates. directions: (k, j), the other coordinates'
        directions in the j coordinates that the path moves; None where these cannot be compared, as joints and
        positions."""
        del directions, k
        return self

    def halved(self) -> Trajectory | None:
        """The path at half its size; None where it has none."""
        return None


def in_plane(u: np.ndarray, v: np.ndarray, ramp: float = 0.0, omega: float = 0.0) -> Course:
    """Course of a path in the plane of u, v (n,) m."""
    return Course(0, u, v, float(ramp), float(omega), 0, NO_FUNCTION)


def spread(name: str, displacement: tuple[float, ...], n: int, free: range) -> np.ndarray:
    """Displacement of all n coordinates from one of the free coordinates. Raises ValueError with `name` for one with
    too many values."""
    if len(displacement) > len(free):
        raise ValueError(f"{name}: {len(displacement)} values; allowed: at most {len(free)} in this mode with this arm")
    vector = np.zeros(n)
    vector[free.start : free.start + len(displacement)] = displacement
    return vector


@inline
def along(course, x, y, value, rate, acceleration):
    """Add the path of x and y, each with its two derivatives."""
    for i in range(value.shape[0]):
        value[i] += x[0] * course.u[i] + y[0] * course.v[i]
        rate[i] += x[1] * course.u[i] + y[1] * course.v[i]
        acceleration[i] += x[2] * course.u[i] + y[2] * course.v[i]
