"""Level set Phi(x, y, z, t) = 0 of a typed formula (30): distance from this surface with all derivatives, and points of
it.

phi is the distance, not Phi: however a surface is written, phi is metres of penetration, its gradient a unit vector,
and the multiplier along it the normal force, in N. With p* the point of the surface nearest to p,

    p* - p + mu grad Phi(p*, t) = 0,    Phi(p*, t) = 0,    distance = mu |grad Phi(p*, t)|,

and differentiating these two equations gives every derivative of the distance from the second ones of Phi.
"""

from __future__ import annotations

import numpy as np

from environments.bytecode import GRADIENT, GRADIENT_RATE, HESSIAN, RATE, SECOND_RATE, VALUE, run
from kernels import inline, kernel
from kernels.algebra import dot, invert

ITERATIONS = 15
NEAREST = 1e-12  # m: the step of Newton's method below which p* is found; the next one would be its square
SCAN = 0.01  # m, between two looks for a change of sign along a line


@inline
def _entry(k, a):
    """Index of the bytecode's output for the second derivative with respect to coordinates k and a."""
    low, high = min(k, a), max(k, a)
    return HESSIAN + low + high + (1 if low > 0 else 0)


@inline
def _foot(bytecode, zeta, t):
    """Newton's method for (p*, mu); returns p*, mu, and whether found. K, K_inv and the registers are those at p*."""
    r, out, K = bytecode.registers, bytecode.outputs, bytecode.K
    run(bytecode, zeta[0], zeta[1], zeta[2], t)
    square = r[out[GRADIENT]] ** 2 + r[out[GRADIENT + 1]] ** 2 + r[out[GRADIENT + 2]] ** 2
    mu = r[out[VALUE]] / square
    x, y, z = (
        zeta[0] - mu * r[out[GRADIENT]],
        zeta[1] - mu * r[out[GRADIENT + 1]],
        zeta[2] - mu * r[out[GRADIENT + 2]],
    )
    for _ in range(ITERATIONS):
        run(bytecode, x, y, z, t)
        for k in range(3):
            for a in range(3):
                K[k, a] = mu * r[out[_entry(k, a)]]
            K[k, k] += 1.0
            K[k, 3] = K[3, k] = r[out[GRADIENT + k]]
        K[3, 3] = 0.0
        if not np.isfinite(np.sum(K)):
            break
        invert(K, bytecode.work, bytecode.K_inv)
        rest = (
            x - zeta[0] + mu * r[out[GRADIENT]],
            y - zeta[1] + mu * r[out[GRADIENT + 1]],
            z - zeta[2] + mu * r[out[GRADIENT + 2]],
            r[out[VALUE]],
        )
        dx, dy, dz = dot(bytecode.K_inv[0], rest), dot(bytecode.K_inv[1], rest), dot(bytecode.K_inv[2], rest)
        mu -= dot(bytecode.K_inv[3], rest)
        if abs(dx) + abs(dy) + abs(dz) < NEAREST:
            return mu, True
        x, y, z = x - dx, y - dy, z - dz
    return mu, False


@kernel
def distance(bytecode, side, zeta, t, chart):
    """Row 0 of a `Chart`: side times the distance of zeta (3,) m at time t (s). Returns the terms that the formula's
    own time adds to its derivatives in time, see `chart.STILL`: (phi_t, phi_tt, phi_xt, phi_yt, phi_zt, phi_tt).

    Where no nearest point is found, far from a curved surface, phi is Phi / |grad Phi|, without second derivatives.
    """
    r, out = bytecode.registers, bytecode.outputs
    mu, found = _foot(bytecode, zeta, t)
    if not found:
        return _to_first_order(bytecode, side, zeta, t, chart)
    g = (r[out[GRADIENT]], r[out[GRADIENT + 1]], r[out[GRADIENT + 2]])
    size = np.sqrt(g[0] ** 2 + g[1] ** 2 + g[2] ** 2)
    n = (g[0] / size, g[1] / size, g[2] / size)
    D, change = bytecode.K_inv, bytecode.work  # D: p* by p
    rate = r[out[RATE]]
    for k in range(3):  # change[0]: p* by t
        change[0, k] = -D[k, 3] * rate
        for a in range(3):
            change[0, k] -= D[k, a] * mu * r[out[GRADIENT_RATE + a]]
    stretch = 0.0  # of |grad Phi| by t, at p*
    second = r[out[SECOND_RATE]]
    for k in range(3):  # change[1], K: grad Phi by t and by p, at p*
        change[1, k] = r[out[GRADIENT_RATE + k]]
        second += r[out[GRADIENT_RATE + k]] * change[0, k]
        for a in range(3):
            change[1, k] += r[out[_entry(k, a)]] * change[0, a]
            bytecode.K[k, a] = 0.0
            for b in range(3):
                bytecode.K[k, a] += r[out[_entry(k, b)]] * D[b, a]
        stretch += n[k] * change[1, k]
    chart.g[0] = side * mu * size
    for a in range(3):
        along = n[0] * bytecode.K[0, a] + n[1] * bytecode.K[1, a] + n[2] * bytecode.K[2, a]
        for k in range(3):
            chart.G_p[0, k, a] = side * (bytecode.K[k, a] - n[k] * along) / size
    for k in range(3):
        chart.G[0, k] = side * n[k]
        change[1, k] = side * (change[1, k] - n[k] * stretch) / size
    phi_tt = side * (second - rate * stretch / size) / size
    return side * rate / size, phi_tt, change[1, 0], change[1, 1], change[1, 2], phi_tt


@inline
def _to_first_order(bytecode, side, zeta, t, chart):
    r, out = bytecode.registers, bytecode.outputs
    run(bytecode, zeta[0], zeta[1], zeta[2], t)
    size = np.sqrt(r[out[GRADIENT]] ** 2 + r[out[GRADIENT + 1]] ** 2 + r[out[GRADIENT + 2]] ** 2)
    chart.g[0] = side * r[out[VALUE]] / size
    for k in range(3):
        chart.G[0, k] = side * r[out[GRADIENT + k]] / size
        for a in range(3):
            chart.G_p[0, k, a] = 0.0
    return side * r[out[RATE]] / size, 0.0, 0.0, 0.0, 0.0, 0.0


@inline
def _on_line(bytecode, start, along, h, t):
    """Phi at start + h along, and its derivative by h."""
    r, out = bytecode.registers, bytecode.outputs
    run(bytecode, start[0] + h * along[0], start[1] + h * along[1], start[2] + h * along[2], t)
    g = (r[out[GRADIENT]], r[out[GRADIENT + 1]], r[out[GRADIENT + 2]])
    return r[out[VALUE]], g[0] * along[0] + g[1] * along[1] + g[2] * along[2]


@inline
def _between(bytecode, start, along, low, high, at_low, t):
    """Root between low and high, where the signs of Phi differ, by Newton's method, with bisection where that leaves
    the interval."""
    h = 0.5 * (low + high)
    for _ in range(60):
        value, slope = _on_line(bytecode, start, along, h, t)
        if (value < 0.0) == (at_low < 0.0):
            low = h
        else:
            high = h
        following = h - value / slope
        if not min(low, high) <= following <= max(low, high):
            following = 0.5 * (low + high)
        if abs(following - h) < 1e-15:
            break
        h = following
    return h


@kernel
def crossings(bytecode, starts, along, reach, t, heights):
    """Write heights (N,): the h, m, at which the lines starts (N, 3) + h along (3,) meet Phi = 0 at time t (s), nan if
    nowhere within `reach` m. Of several crossings the one nearest to that of the line before counts, on the first line
    the one nearest to h = 0."""
    bytecode, near = bytecode[0], 0.0
    for i in range(starts.shape[0]):
        start = starts[i]
        up, _ = _on_line(bytecode, start, along, near, t)
        down, heights[i] = up, np.nan
        for step in range(int(reach / SCAN)):
            h, above, below = step * SCAN, up, down
            up, _ = _on_line(bytecode, start, along, near + h + SCAN, t)
            if (up < 0.0) != (above < 0.0) and np.isfinite(up - above):
                heights[i] = _between(bytecode, start, along, near + h, near + h + SCAN, above, t)
            down, _ = _on_line(bytecode, start, along, near - h - SCAN, t)
            if (down < 0.0) != (below < 0.0) and np.isfinite(down - below):
                other = _between(bytecode, start, along, near - h, near - h - SCAN, below, t)
                if not abs(other - near) > abs(heights[i] - near):
                    heights[i] = other
            if np.isfinite(heights[i]):
                break
        near = heights[i] if np.isfinite(heights[i]) else 0.0
