"""Chart of a surface: coordinates (phi, psi_1, psi_2) around it with their derivatives, (30), (31), and functions
shared by their kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from environments.bytecode import Bytecode
from environments.own_function import OwnFunction
from kernels import inline
from kernels.algebra import dot


class Chart(NamedTuple):
    """Chart at a point p: its three coordinates g(p, t), in m, and their derivatives.

    g, G, G_p: (3,); (3, 3), gradients as rows; (3, 3, 3), Hessians.
    g_t, G_t, g_tt: (3,), (3, 3), (3,), partial derivatives in time of g and G, and the second one of g.
    normal_tt: (3,) 1/s^2, second partial derivative in time of the gradient of phi; only a plane computes it.
    deforming: m/s^2, the part of g_tt[0] of a surface that changes its shape, not only its place.
    turn: (3,) m, the length after which a coordinate is at the same place again; 0 for one that never is.
    """

    g: np.ndarray
    G: np.ndarray
    G_p: np.ndarray
    g_t: np.ndarray
    G_t: np.ndarray
    g_tt: np.ndarray
    normal_tt: np.ndarray
    deforming: float
    turn: np.ndarray

    @classmethod
    def zeros(cls) -> Chart:
        """Chart of zeros, before it is computed."""
        v, square = np.zeros(3), np.zeros((3, 3))
        return cls(v, square, np.zeros((3, 3, 3)), v, square, v, v, 0.0, v)


class Turning(NamedTuple):
    """Turning of a surface to and fro about its origin: by amplitude sin(omega t) rad, omega in rad/s, about the unit
    vector `axis` (3,)."""

    axis: np.ndarray
    amplitude: float
    omega: float


NOT_TURNING = Turning(np.zeros(3), 0.0, 0.0)


class Shape(NamedTuple):
    """Shape of a surface for kernels.
    kind: number of its kind in `table.SURFACES`.
    origin, frame: (3,) m, and (3, 3) of unit rows.
    radius, side: m, and the sign of `form.side_of`.
    direction, amplitude, frequency: unit vector (3,), m and Hz, of its translation to and fro.
    turning: of a plane.
    bytecode, own: its formula, or its function of a user's own."""

    kind: int
    origin: np.ndarray
    frame: np.ndarray
    radius: float
    side: float
    direction: np.ndarray
    amplitude: float
    frequency: float
    turning: Turning
    bytecode: Bytecode
    own: OwnFunction


class Shapes(NamedTuple):
    """Shapes of the surfaces of a world for kernels: `number` of them, up to three; the others are not read.

    edge: (3,), unit direction of the coordinate beside two of them, which is 0 at `base` (3,) m."""

    number: int
    first: Shape
    second: Shape
    third: Shape
    edge: np.ndarray
    base: np.ndarray

    @classmethod
    def of(cls, shapes: tuple[Shape, ...], edge: np.ndarray | None = None, base: np.ndarray | None = None) -> Shapes:
        """Shapes of one, two or three surfaces."""
        first, second, third = (*shapes, *shapes[-1:], *shapes[-1:])[:3]
        nowhere = np.zeros(3)
        return cls(
            len(shapes), first, second, third, nowhere if edge is None else edge, nowhere if base is None else base
        )


# terms that a form that does not change adds to the derivatives of phi: to g_t, g_tt, the three of G_t and `deforming`
STILL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
MIDDLE = 1e-9  # m from the axis of a cylinder or the centre of a sphere, where its normal has no direction


@inline
def swing(amplitude, omega, t):
    """Displacement amplitude sin(omega t) of what moves or turns to and fro, its rate and its acceleration."""
    displacement = amplitude * np.sin(omega * t)
    return displacement, amplitude * omega * np.cos(omega * t), -(omega**2) * displacement


@inline
def one_of(three, i):
    """The first, second or third record of a named tuple of three, counted from 0."""
    if i == 0:
        return three.first
    if i == 1:
        return three.second
    return three.third


@inline
def flat(zeta, shape, _t, chart):
    """Write the coordinates of zeta (3,) m in the frame of the surface; all surfaces have these arguments. Returns the
    terms that the form's change in time adds to the derivatives of phi."""
    for i in range(3):
        chart.g[i] = dot(shape.frame[i], zeta)
        for k in range(3):
            chart.G[i, k] = shape.frame[i, k]
            for a in range(3):
                chart.G_p[i, k, a] = 0.0
    return STILL


@inline
def polar(zeta, u, v):
    """Radius and angle of zeta in the plane of the unit vectors u, v, with their unit directions e_rho, e_theta. In the
    middle, where there is no angle, those of a point beside it along u."""
    x, y = dot(u, zeta), dot(v, zeta)
    rho = np.hypot(x, y)
    if rho < MIDDLE:
        x, y, rho = MIDDLE, 0.0, MIDDLE
    c, s = x / rho, y / rho
    e_rho = (c * u[0] + s * v[0], c * u[1] + s * v[1], c * u[2] + s * v[2])
    e_theta = (c * v[0] - s * u[0], c * v[1] - s * u[1], c * v[2] - s * u[2])
    return rho, np.arctan2(y, x), e_rho, e_theta


@inline
def arc(i, radius, rho, theta, e_rho, e_theta, chart):
    """Set coordinate i to radius * theta."""
    chart.g[i], chart.turn[i] = radius * theta, 2.0 * np.pi * radius
    for k in range(3):
        chart.G[i, k] = radius * e_theta[k] / rho
        for a in range(3):
            chart.G_p[i, k, a] = -radius * (e_rho[k] * e_theta[a] + e_theta[k] * e_rho[a]) / rho**2
