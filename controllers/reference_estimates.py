"""Remark 3: estimates taken beforehand along r_d, so that the law computes little on-line."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from controllers.nominal_model import Deviation, Estimate, Lipschitz, NominalModel


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
        block: int = 1000,
    ) -> None:
        self._model, self._lipschitz, self._posture = model, lipschitz, posture
        self._period, self._block = period, block
        self._q = q_0
        self._table: list[tuple[np.ndarray, np.ndarray, Estimate]] = []

    def replace(
        self, estimate: Estimate, q: np.ndarray, q_dot: np.ndarray, t: float
    ) -> tuple[Estimate, Deviation]:
        """The estimate with M_hat, C_hat, G_hat from the table, and how far they may be from those at q."""
        k = round(t / self._period)
        while len(self._table) <= k:
            self._extend()
        q_d, q_d_dot, along = self._table[k]
        replaced = estimate._replace(M_hat=along.M_hat, C_hat=along.C_hat, G_hat=along.G_hat)
        return replaced, self._lipschitz.deviation(q, q_dot, q_d, q_d_dot)

    def _extend(self) -> None:
        for k in range(len(self._table), len(self._table) + self._block):
            self._q, q_d_dot = self._posture(self._q, k * self._period)
            self._table.append((self._q, q_d_dot, self._model.evaluate(self._q, q_d_dot)))
