"""Remark 3: estimates taken beforehand along r_d, so that the law computes little on-line."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba import njit

from controllers.nominal_model import ON_LINE, Deviation, Estimate, Lipschitz, NominalModel


class EstimateOverride(NamedTuple):
    """M_hat, C_hat (n, n), G_hat (n,) to be used in (25) where `active`, and their deviation from those at q."""

    active: bool
    M_hat: np.ndarray
    C_hat: np.ndarray
    G_hat: np.ndarray
    deviation: Deviation

    @classmethod
    def none(cls, n: int) -> EstimateOverride:
        """Estimates are taken on-line."""
        return cls(False, np.zeros((n, n)), np.zeros((n, n)), np.zeros(n), ON_LINE)


@njit(cache=True, error_model="numpy")
def believed_estimate(estimate, override):
    """The estimate that (25) uses: with M_hat, C_hat, G_hat of the override where it is active."""
    if not override.active:
        return estimate
    e = estimate
    return Estimate(
        override.M_hat,
        e.M_links,
        override.C_hat,
        override.G_hat,
        e.G_links,
        e.p,
        e.R,
        e.J_v,
        e.J_w,
        e.J_v_dot,
        e.J_w_dot,
    )


class ReferenceEstimates:
    """M_hat, C_hat, G_hat at (q_d, q_d_dot)(t), a table with one entry per control period, filled in blocks.

    posture: (q guess (n,), t) -> q_d, q_d_dot, solving r(q_d, t) = r_d(t).
    """

    def __init__(
        self,
        model: NominalModel,
        lipschitz: Lipschitz,
        posture: Callable[[np.ndarray, float], tuple[np.ndarray, np.ndarray]],
        q_0: np.ndarray,
        period: float,
        block: int = 20,
    ) -> None:
        self._model, self._lipschitz, self._posture = model, lipschitz, posture
        self._period, self._block = period, block
        self._q = q_0
        self._table: list[tuple[np.ndarray, np.ndarray, Estimate]] = []

    def at(self, q: np.ndarray, q_dot: np.ndarray, t: float) -> EstimateOverride:
        """M_hat, C_hat, G_hat from the table at time t, and how far they may be from those at q, q_dot."""
        k = round(t / self._period)
        while len(self._table) <= k:
            self._extend()
        q_d, q_d_dot, along = self._table[k]
        deviation = self._lipschitz.deviation(q, q_dot, q_d, q_d_dot)
        return EstimateOverride(True, along.M_hat, along.C_hat, along.G_hat, deviation)

    def _extend(self) -> None:
        for k in range(len(self._table), len(self._table) + self._block):
            self._q, q_d_dot = self._posture(self._q, k * self._period)
            self._table.append((self._q, q_d_dot, self._model.evaluate(self._q, q_d_dot)))
