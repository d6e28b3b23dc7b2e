"""A figure of eight along the first two free coordinates: `vsmrc serve --use docs/examples/figure_eight.py`."""

import numpy as np

from environments.smooth_step import phase
from environments.trajectories.own import OwnTrajectory
from kernels import inline
from parameters import Parameter


@inline
def path(t, p, value, rate, acceleration):
    """(width sin(theta), height sin(2 theta)), where theta takes a second to its full rate."""
    theta, theta_dot, theta_ddot = phase(t, 2 * np.pi / p.period, 1.0)
    for i, size, times in ((0, p.width, 1.0), (1, p.height, 2.0)):
        if i == value.shape[0]:  # a planar arm that presses has one free coordinate
            break
        s, c = size * np.sin(times * theta), size * np.cos(times * theta)
        value[i], rate[i] = s, times * c * theta_dot
        acceleration[i] = times * c * theta_ddot - times**2 * s * theta_dot**2


TRAJECTORY = OwnTrajectory(
    kind="figure-eight",
    title="Figure of eight",
    about="A figure of eight in the first two coordinates.",
    path=path,
    parameters=(
        Parameter("width", 0.08, 0.0, 0.2, "m", "half of its width"),
        Parameter("height", 0.04, 0.0, 0.2, "m", "half of its height"),
        Parameter("period", 6.0, 2.0, 30.0, "s", "time of one turn"),
    ),
)
