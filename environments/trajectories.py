"""References r_d(t) and F_cd(t), each with two exact derivatives.

A trajectory is a displacement from where it starts. A new one is a short frozen class with its `course`, and a
kernel among those of `_in_plane` or `_profile`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from kernels import choice, inline, kernel
from kernels.records import Record


class Path(NamedTuple):
    """Displacement (n,) m, its rate (m/s) and acceleration (m/s^2)."""

    value: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray


class Signal(NamedTuple):
    """A scalar (N), its rate and second derivative."""

    value: float
    rate: float
    acceleration: float


class Course(NamedTuple):
    """A trajectory in the kernels' form, x(t) u + y(t) v with u, v (n,) m: which one, the duration or rise at its
    beginning (s), and its angular frequency (rad/s)."""

    kind: int
    u: np.ndarray
    v: np.ndarray
    ramp: float
    omega: float


class ForceCourse(NamedTuple):
    """A force profile in the kernels' form: which one; start N and change N; the time of a step and its rise, s; the
    angular frequency of a harmonic, rad/s."""

    kind: int
    start: float
    change: float
    time: float
    rise: float
    omega: float


class Shift(NamedTuple):
    """What moves a trajectory as a whole: from `begin` s on and within `duration` s, the way (n,) m with its rate (m/s)
    and acceleration (m/s^2) there goes over into rest at `end` (n,) m, without a jump in any of the three."""

    begin: float
    duration: float
    way: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray
    end: np.ndarray

    @classmethod
    def fresh(cls, end: np.ndarray, duration: float) -> Shift:
        """From rest at zero, at t = 0."""
        zero = np.zeros_like(end)
        return cls(0.0, float(duration), zero, zero, zero, end)

    def turned(self, t: float, end: np.ndarray, duration: float) -> Shift:
        """From where this one is at time t (s) to another end."""
        now = self.evaluate(t)
        return Shift(t, float(duration), now.value, now.rate, now.acceleration, end)

    def evaluate(self, t: float) -> Path:
        """At time t (s)."""
        path = Record(Path(*3 * (np.zeros(len(self.end)),)))
        _shift_alone(Record(self).data, t, path.data)
        return path.read()


@inline
def minimum_jerk(t, duration):
    """sigma(t) from 0 to 1 in `duration` s with zero speed and acceleration at both ends, and two derivatives."""
    if t <= 0.0:
        return 0.0, 0.0, 0.0
    if t >= duration:
        return 1.0, 0.0, 0.0
    u = t / duration
    return (
        u**3 * (10 - 15 * u + 6 * u**2),
        30 * u**2 * (1 - u) ** 2 / duration,
        60 * u * (1 - u) * (1 - 2 * u) / duration**2,
    )


@inline
def _phase(t, omega, ramp):
    """theta(t) whose rate rises smoothly from 0 to omega within `ramp` s (the integral of minimum jerk)."""
    if ramp <= 0.0:
        return omega * t, omega, 0.0
    if t >= ramp:
        return omega * (t - 0.5 * ramp), omega, 0.0
    sigma, sigma_dot, _ = minimum_jerk(t, ramp)
    u = max(t, 0.0) / ramp
    return omega * ramp * u**4 * (2.5 - 3 * u + u**2), omega * sigma, omega * sigma_dot


@inline
def _move(course, t):
    """x, y of a course and their first and second derivatives, as all trajectories have them."""
    sigma, sigma_dot, sigma_ddot = minimum_jerk(t, course.ramp)
    return sigma, 0.0, sigma_dot, 0.0, sigma_ddot, 0.0


@inline
def _circle(course, t):
    theta, theta_dot, theta_ddot = _phase(t, course.omega, course.ramp)
    c, s = np.cos(theta), np.sin(theta)
    s_dot, c_dot = c * theta_dot, -s * theta_dot
    s_ddot, c_ddot = c * theta_ddot - s * theta_dot**2, -s * theta_ddot - c * theta_dot**2
    return c - 1.0, s, c_dot, s_dot, c_ddot, s_ddot


@inline
def _line(course, t):
    x, _, x_dot, _, x_ddot, _ = _circle(course, t)
    return -0.5 * x, 0.0, -0.5 * x_dot, 0.0, -0.5 * x_ddot, 0.0


POINT_TO_POINT, CIRCLE, LINE = range(3)
_in_plane = choice((_move, _circle, _line))


@inline
def path_at(course, t, value, rate, acceleration):
    """The displacement (n,) and its derivatives at time t (s)."""
    x, y, x_dot, y_dot, x_ddot, y_ddot = _in_plane(course.kind, course, t)
    for i in range(value.shape[0]):
        value[i] = x * course.u[i] + y * course.v[i]
        rate[i] = x_dot * course.u[i] + y_dot * course.v[i]
        acceleration[i] = x_ddot * course.u[i] + y_ddot * course.v[i]


@inline
def add_shift(shift, t, value, rate, acceleration):
    """Add a shift to a path: the polynomial of fifth order that meets both ends with two derivatives."""
    T = shift.duration
    u = (t - shift.begin) / T
    for i in range(value.shape[0]):
        if u >= 1.0:
            value[i] += shift.end[i]
            continue
        V, A = T * shift.rate[i], T**2 * shift.acceleration[i]
        D = shift.end[i] - shift.way[i]
        a, b, c = 10 * D - 6 * V - 1.5 * A, -15 * D + 8 * V + 1.5 * A, 6 * D - 3 * V - 0.5 * A
        value[i] += shift.way[i] + u * (V + u * (0.5 * A + u * (a + u * (b + u * c))))
        rate[i] += (V + u * (A + u * (3 * a + u * (4 * b + u * 5 * c)))) / T
        acceleration[i] += (A + u * (6 * a + u * (12 * b + u * 20 * c))) / T**2


@inline
def _step(course, t):
    """A force (N) and its derivatives, as all profiles have them."""
    sigma, sigma_dot, sigma_ddot = minimum_jerk(t - course.time, course.rise)
    return course.start + course.change * sigma, course.change * sigma_dot, course.change * sigma_ddot


@inline
def _sinusoid(course, t):
    omega = course.omega
    s, c = course.change * np.sin(omega * t), course.change * np.cos(omega * t)
    return course.start + s, omega * c, -(omega**2) * s


STEP, SINUSOID = range(2)
_profile = choice((_step, _sinusoid))


@inline
def force_at(course, t):
    """The force (N) and its derivatives at time t (s)."""
    return _profile(course.kind, course, t)


@kernel
def _path_alone(course, t, path):
    path_at(course[0], t, path[0].value, path[0].rate, path[0].acceleration)


@kernel
def _shift_alone(shift, t, path):
    add_shift(shift[0], t, path[0].value, path[0].rate, path[0].acceleration)


@kernel
def _force_alone(course, t):
    return force_at(course[0], t)


class Trajectory(ABC):
    """What all trajectories share: their course, evaluated outside the loop too."""

    @property
    @abstractmethod
    def course(self) -> Course: ...

    def evaluate(self, t: float) -> Path:
        """At time t (s)."""
        course = self.course
        path = Record(Path(*3 * (np.zeros(len(course.u)),)))
        _path_alone(Record(course).data, t, path.data)
        return path.read()


class ForceProfile(ABC):
    """What all force profiles share."""

    @property
    @abstractmethod
    def course(self) -> ForceCourse: ...

    def evaluate(self, t: float) -> Signal:
        """At time t (s)."""
        return Signal(*_force_alone(Record(self.course).data, t))


@dataclass(frozen=True)
class PointToPoint(Trajectory):
    """A minimum-jerk move by `displacement` (n,) within `duration` s, then rest. Hold: no displacement."""

    displacement: np.ndarray
    duration: float = 1.0

    @property
    def course(self) -> Course:
        u = np.asarray(self.displacement, dtype=float)
        return Course(POINT_TO_POINT, u, np.zeros_like(u), float(self.duration), 0.0)


@dataclass(frozen=True)
class Circle(Trajectory):
    """A circle of `radius` m through the start in the plane of the unit vectors u, v (n,); `ramp` s to full speed."""

    u: np.ndarray
    v: np.ndarray
    radius: float
    period: float
    ramp: float

    @property
    def course(self) -> Course:
        return Course(CIRCLE, self.radius * self.u, self.radius * self.v, float(self.ramp), 2 * np.pi / self.period)


@dataclass(frozen=True)
class Line(Trajectory):
    """Back and forth between the start and start + displacement (n,), a harmonic of `period` s."""

    displacement: np.ndarray
    period: float
    ramp: float

    @property
    def course(self) -> Course:
        u = np.asarray(self.displacement, dtype=float)
        return Course(LINE, u, np.zeros_like(u), float(self.ramp), 2 * np.pi / self.period)


@dataclass(frozen=True)
class ForceStep(ForceProfile):
    """From `start` to `value` N at time `time` s, minimum jerk within `rise` s. A constant force: start = value."""

    value: float
    start: float
    time: float = 0.0
    rise: float = 0.1

    @property
    def course(self) -> ForceCourse:
        start, value, time, rise = (float(x) for x in (self.start, self.value, self.time, self.rise))
        return ForceCourse(STEP, start, value - start, time, rise, 0.0)


@dataclass(frozen=True)
class ForceSinusoid(ForceProfile):
    """value + amplitude * sin(2 pi frequency t), N."""

    value: float
    amplitude: float
    frequency: float

    @property
    def course(self) -> ForceCourse:
        return ForceCourse(SINUSOID, float(self.value), float(self.amplitude), 0.0, 0.0, 2 * np.pi * self.frequency)
