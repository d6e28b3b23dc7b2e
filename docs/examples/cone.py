"""A cone that stands upright, the tool on its flank: `vsmrc serve --use docs/examples/cone.py`."""

import numpy as np

from environments.surfaces.own import OwnSurface
from kernels import inline
from parameters import Parameter


@inline
def chart(zeta, p, g, G, G_p):
    """phi: depth below the flank; psi_1: way down the flank; psi_2: way about the axis."""
    s, c = np.sin(p.angle), np.cos(p.angle)
    x, y, z = zeta[0] + p.below * s, zeta[1], zeta[2] - p.below * c  # from the tip
    rho = np.hypot(x, y)
    e, a = (x / rho, y / rho, 0.0), (-y / rho, x / rho, 0.0)  # away from the axis, and about it
    g[0], g[1], g[2] = -c * rho - s * z, s * rho - c * z - p.below, p.below * s * np.arctan2(y, x)
    for i in range(3):
        up = 1.0 if i == 2 else 0.0
        G[0, i], G[1, i], G[2, i] = -c * e[i] - s * up, s * e[i] - c * up, p.below * s * a[i] / rho
        for k in range(3):
            G_p[0, i, k], G_p[1, i, k] = -c * a[i] * a[k] / rho, s * a[i] * a[k] / rho
            G_p[2, i, k] = -p.below * s * (e[i] * a[k] + a[i] * e[k]) / rho**2


SURFACE = OwnSurface(
    kind="cone",
    title="Cone",
    about="A cone that stands upright.",
    chart=chart,
    parameters=(
        Parameter("angle", 1.2, 0.3, 1.5, "rad", "half of its opening angle"),
        Parameter("below", 0.3, 0.1, 1.0, "m", "how far below the tip its origin lies on the flank"),
    ),
)
