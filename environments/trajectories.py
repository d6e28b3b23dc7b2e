"""References r_d(t) and F_cd(t), each with two exact derivatives.

A trajectory is a displacement from where it starts. A new one is a short frozen class with `evaluate(t)`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numba import njit


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


class Trajectory(Protocol):
    def evaluate(self, t: float) -> Path: ...


class ForceProfile(Protocol):
    def evaluate(self, t: float) -> Signal: ...


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
def _phase(t, omega, ramp):
    """theta(t) whose rate rises smoothly from 0 to omega within `ramp` s (the integral of minimum jerk)."""
    if ramp <= 0.0:
        return omega * t, omega, 0.0
    if t >= ramp:
        return omega * (t - 0.5 * ramp), omega, 0.0
    sigma, sigma_dot, _ = minimum_jerk(t, ramp)
    u = max(t, 0.0) / ramp
    return omega * ramp * u**4 * (2.5 - 3 * u + u**2), omega * sigma, omega * sigma_dot


@njit(cache=True, error_model="numpy")
def _point_to_point(t, displacement, duration):
    sigma, sigma_dot, sigma_ddot = minimum_jerk(t, duration)
    return Path(displacement * sigma, displacement * sigma_dot, displacement * sigma_ddot)


@njit(cache=True, error_model="numpy")
def _circle(t, u, v, radius, omega, ramp):
    theta, theta_dot, theta_ddot = _phase(t, omega, ramp)
    c, s = np.cos(theta), np.sin(theta)
    along = -s * u + c * v
    inward = c * u + s * v
    return Path(
        radius * (inward - u),
        radius * theta_dot * along,
        radius * (theta_ddot * along - theta_dot**2 * inward),
    )


@njit(cache=True, error_model="numpy")
def _line(t, displacement, omega, ramp):
    theta, theta_dot, theta_ddot = _phase(t, omega, ramp)
    c, s = np.cos(theta), np.sin(theta)
    return Path(
        displacement * (0.5 * (1 - c)),
        displacement * (0.5 * s * theta_dot),
        displacement * (0.5 * (c * theta_dot**2 + s * theta_ddot)),
    )


@dataclass(frozen=True)
class PointToPoint:
    """A minimum-jerk move by `displacement` (n,) within `duration` s, then rest. Hold: no displacement."""

    displacement: np.ndarray
    duration: float = 1.0

    def evaluate(self, t: float) -> Path:
        return _point_to_point(t, self.displacement, self.duration)


@dataclass(frozen=True)
class Circle:
    """A circle of `radius` m through the start in the plane of the unit vectors u, v (n,); `ramp` s to full speed."""

    u: np.ndarray
    v: np.ndarray
    radius: float
    period: float
    ramp: float

    def evaluate(self, t: float) -> Path:
        return _circle(t, self.u, self.v, self.radius, 2 * np.pi / self.period, self.ramp)


@dataclass(frozen=True)
class Line:
    """Back and forth between the start and start + displacement (n,), a harmonic of `period` s."""

    displacement: np.ndarray
    period: float
    ramp: float

    def evaluate(self, t: float) -> Path:
        return _line(t, self.displacement, 2 * np.pi / self.period, self.ramp)


@dataclass(frozen=True)
class ForceStep:
    """From `start` to `value` N at time `time` s, minimum jerk within `rise` s. A constant force: start = value."""

    value: float
    start: float
    time: float = 0.0
    rise: float = 0.1

    def evaluate(self, t: float) -> Signal:
        sigma, sigma_dot, sigma_ddot = minimum_jerk(t - self.time, self.rise)
        change = self.value - self.start
        return Signal(self.start + change * sigma, change * sigma_dot, change * sigma_ddot)


@dataclass(frozen=True)
class ForceSinusoid:
    """value + amplitude * sin(2 pi frequency t), N."""

    value: float
    amplitude: float
    frequency: float

    def evaluate(self, t: float) -> Signal:
        omega = 2 * np.pi * self.frequency
        s, c = self.amplitude * np.sin(omega * t), self.amplitude * np.cos(omega * t)
        return Signal(self.value + s, omega * c, -(omega**2) * s)
