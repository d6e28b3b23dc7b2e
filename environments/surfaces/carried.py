"""Motion of the point of a surface that is at the tool, as the surface carries it along."""

from __future__ import annotations

import numpy as np

from environments.surfaces.chart import swing
from kernels import inline
from kernels.algebra import cross, dot


@inline
def carry(shape, chart, p, t, velocity):
    """Velocity (3,) m/s, written, of the surface's point at p (3,) m at time t (s), and its acceleration along phi
    (m/s^2), returned, which includes that of a surface that changes its shape: of its points along the normal."""
    normal, turning, u = chart.G[0], shape.turning, shape.direction
    moved, speed, acceleration = swing(shape.amplitude, 2 * np.pi * shape.frequency, t)
    into = acceleration * dot(normal, u) - chart.deforming
    for a in range(3):
        velocity[a] = speed * u[a]
    if turning.amplitude != 0.0:
        _, rate, faster = swing(turning.amplitude, turning.omega, t)
        reach = (
            p[0] - shape.origin[0] - moved * u[0],
            p[1] - shape.origin[1] - moved * u[1],
            p[2] - shape.origin[2] - moved * u[2],
        )
        around = cross(turning.axis, reach)
        into += rate**2 * dot(normal, cross(turning.axis, around)) + faster * dot(normal, around)
        for a in range(3):
            velocity[a] += rate * around[a]
    return into
