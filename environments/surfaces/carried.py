"""Motion of the point of a surface that is at the tool, as the surface carries it along."""

from __future__ import annotations

import numpy as np

from kernels import inline
from kernels.algebra import cross, dot


@inline
def carry(shape, chart, p, t, velocity):
    """Velocity (3,) m/s, written, of the surface's point at p (3,) m at time t (s), and its acceleration along phi
    (m/s^2), returned, which includes that of a surface that changes its shape: of its points along the normal."""
    normal, turning = chart.G[0], shape.turning
    omega, u = 2 * np.pi * shape.frequency, shape.direction
    moved, speed = shape.amplitude * np.sin(omega * t), shape.amplitude * omega * np.cos(omega * t)
    angle, rate = turning.amplitude * np.sin(turning.omega * t), turning.amplitude * turning.omega
    rate *= np.cos(turning.omega * t)
    reach = (
        p[0] - shape.origin[0] - moved * u[0],
        p[1] - shape.origin[1] - moved * u[1],
        p[2] - shape.origin[2] - moved * u[2],
    )
    around = cross(turning.axis, reach)
    inwards = cross(turning.axis, around)
    for a in range(3):
        velocity[a] = speed * u[a] + rate * around[a]
    turned = rate**2 * dot(normal, inwards) - turning.omega**2 * angle * dot(normal, around)
    return turned - omega**2 * moved * dot(normal, u) - chart.deforming
