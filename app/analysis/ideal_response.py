"""Ideal response: the error over time if the target model (8) held exactly."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm


@dataclass(frozen=True)
class IdealResponse:
    """Response of (8) from one sample to the next, exact for a force error that is linear in between.

    x = (e, e_dot), (2n,) m and m/s: x_next = free @ x + first @ e_Fc + second @ e_Fc_next.
    """

    free: np.ndarray
    first: np.ndarray
    second: np.ndarray

    @classmethod
    def of(cls, matrices: Mapping[str, np.ndarray], period: float) -> IdealResponse:
        """Response for M_m, B_m, K_m, K_f (n, n) and samples `period` s apart."""
        M_m, B_m, K_m, K_f = (matrices[name] for name in ("M_m", "B_m", "K_m", "K_f"))
        n = len(M_m)
        zero, one = np.zeros((n, n)), np.eye(n)
        rows = np.linalg.solve(M_m, np.hstack([-K_m, -B_m, -K_f, zero]))
        generator = np.zeros((4 * n, 4 * n))  # of e, e_dot, e_Fc, and its change over a period
        generator[:n, n : 2 * n] = period * one
        generator[n : 2 * n] = period * rows
        generator[2 * n : 3 * n, 3 * n :] = one
        step = expm(generator)[: 2 * n]
        held, changing = step[:, 2 * n : 3 * n], step[:, 3 * n :]
        return cls(step[:, : 2 * n], held - changing, changing)

    def onward(self, x: np.ndarray, e_Fc: np.ndarray) -> np.ndarray:
        """State x (2n,) after N - 1 further samples. e_Fc: (N, n) N, at this sample and at each further one."""
        driven = e_Fc[:-1] @ self.first.T + e_Fc[1:] @ self.second.T
        for step in driven:
            x = self.free @ x + step
        return x
