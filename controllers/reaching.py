"""Reaching, as Theorem 1 promises it: c_1, c_2, V_0, t_r and the envelope of ||s||, (18)-(20)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from kernels import kernel


@dataclass(frozen=True)
class ReachingCertificate:
    """Certificate of reaching.
    k_r_low, k_r_high: kg, k_r_low I <= H(r, t) <= k_r_high I over Omega, Property 1.
    lambda_min_K_s: N s/m; epsilon: N; V_0: J."""

    k_r_low: float
    k_r_high: float
    lambda_min_K_s: float
    epsilon: float
    V_0: float

    @property
    def c_1(self) -> float:
        """Rate c_1, 1/s, (19)."""
        return 2.0 * self.lambda_min_K_s / self.k_r_high

    @property
    def c_2(self) -> float:
        """Rate c_2, sqrt(J)/s, (19)."""
        return self.epsilon * float(np.sqrt(2.0 / self.k_r_high))

    @property
    def t_r(self) -> float:
        """Upper bound of the reaching time, s, (18)."""
        return 2.0 / self.c_1 * float(np.log1p(self.c_1 / self.c_2 * np.sqrt(self.V_0)))

    def time_to(self, radius: float) -> float:
        """Time after which ||s|| has been within `radius` (m/s) at least once, s: when (20) has fallen to the
        radius."""
        rest, begun = np.sqrt(0.5 * self.k_r_low) * radius, np.sqrt(self.V_0)
        ratio = self.c_2 / self.c_1
        return 2.0 / self.c_1 * float(np.log1p(max(begun - rest, 0.0) / (rest + ratio)))

    @property
    def bound(self) -> ReachingBound:
        """Bound of the certificate, in the form for kernels."""
        return ReachingBound(self.k_r_low, self.k_r_high, self.c_1, self.c_2, self.V_0)


class ReachingBound(NamedTuple):
    """Reaching bound in the form for kernels.
    k_r_low, k_r_high: kg, of Property 1.
    c_1: 1/s, (19).
    c_2: sqrt(J)/s, (19).
    V_0: J, at the beginning."""

    k_r_low: float
    k_r_high: float
    c_1: float
    c_2: float
    V_0: float


@kernel
def lyapunov_bound(bound, t):
    """Bound of V (J) at t s after s(0), (24)."""
    ratio, x = bound.c_2 / bound.c_1, 0.5 * bound.c_1 * t
    root = np.sqrt(bound.V_0) * np.exp(-x) + ratio * np.expm1(-x)
    return np.maximum(root, 0.0) ** 2


@kernel
def envelope(bound, t):
    """Bound of ||s|| (m/s) at t s after s(0), (20)."""
    return np.sqrt(2.0 / bound.k_r_low * lyapunov_bound(bound, t))
