"""Check of a surface's derivatives against finite differences."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from environments.surfaces.table import Surface

STEP, AGREEMENT = 1e-5, 1e-3  # m and s, of differences; how well derivatives must agree with them, relatively


def require_derivatives(path: str, surface: Surface, p: np.ndarray, t: float) -> None:
    """Raise ValueError with `path`, the field that is to blame, unless the derivatives at p (3,) m, t (s) agree with
    differences."""
    chart, h = surface.chart(p, t), STEP
    sides = [(surface.chart(p + e, t), surface.chart(p - e, t)) for e in h * np.eye(3)]
    sides.append((surface.chart(p, t + h), surface.chart(p, t - h)))
    pairs = [
        (np.column_stack([chart.G, chart.g_t]), [(a.g - b.g) / (2 * h) for a, b in sides]),
        (np.concatenate([chart.G_p, chart.G_t[:, :, None]], axis=2), [(a.G - b.G) / (2 * h) for a, b in sides]),
        (np.column_stack([chart.G_t, chart.g_tt]), [(a.g_t - b.g_t) / (2 * h) for a, b in sides]),
    ]
    for derivative, differences in pairs:
        away = np.abs(derivative - np.stack(differences, axis=-1)).max()
        if not away <= AGREEMENT * (1.0 + np.abs(derivative).max()):
            raise ValueError(
                f"{path}: near {written(p)} at t = {t:.3g} s its derivatives are not what differences say, by "
                f"{away:.2g}; allowed: a surface with two continuous derivatives there"
            )


def written(p: np.ndarray) -> str:
    """Point (3,) m as text."""
    return "(" + ", ".join(f"{x:.3g}" for x in p) + ") m"
