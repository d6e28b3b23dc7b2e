"""Straight line, back and forth."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from environments.smooth_step import phase
from environments.trajectories.point_to_point import Displaced
from environments.trajectories.trajectory import Course, along, in_plane, spread
from kernels import inline
from parameters import decades, field, slider


@inline
def unit_circle(course, t):
    """Coordinates x, y of the unit circle about (-1, 0), each with two derivatives."""
    theta, theta_dot, theta_ddot = phase(t, course.omega, course.ramp)
    c, s = np.cos(theta), np.sin(theta)
    s_dot, c_dot = c * theta_dot, -s * theta_dot
    s_ddot, c_ddot = c * theta_ddot - s * theta_dot**2, -s * theta_ddot - c * theta_dot**2
    return (c - 1.0, c_dot, c_ddot), (s, s_dot, s_ddot)


@inline
def _move(course, t, value, rate, acceleration):
    x, _ = unit_circle(course, t)
    half = (-0.5 * x[0], -0.5 * x[1], -0.5 * x[2])
    along(course, half, (0.0, 0.0, 0.0), value, rate, acceleration)


class Line(Displaced, frozen=True, forbid_unknown_fields=True, tag="line"):
    """Back and forth between the start and start + displacement, a harmonic."""

    title = "line"
    move = _move

    period: Annotated[float, field("time there and back", "s", decades("period", 1, 30), gt=0, le=3600)] = 4.0
    ramp: Annotated[float, field("time to full speed", "s", slider("ramp", 0, 5), ge=0, le=3600)] = 1.0

    def course(self, n: int, free: range) -> Course:
        u = spread("displacement", self.displacement, n, free)
        return in_plane(u, np.zeros(n), self.ramp, 2 * np.pi / self.period)
