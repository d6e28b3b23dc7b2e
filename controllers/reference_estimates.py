"""Remark 3: estimates taken beforehand along r_d, so that the law computes little on-line."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from controllers.nominal_model import ON_LINE, Deviation, Estimate, Lipschitz, NominalModel
from kernels import part
from kernels.algebra import copy, copy_matrix


class Believed(NamedTuple):
    """M_hat, C_hat (n, n), G_hat (n,) that (25) uses, and how far they may be from the estimates at q."""

    M_hat: np.ndarray
    C_hat: np.ndarray
    G_hat: np.ndarray
    deviation: Deviation

    @classmethod
    def at(cls, estimate: Estimate) -> Believed:
        """The estimates at q themselves."""
        return cls(estimate.M_hat, estimate.C_hat, estimate.G_hat, ON_LINE)


@part
def believe(estimate, believed):
    """Take the estimates at q themselves."""
    copy_matrix(estimate.M_hat, believed.M_hat)
    copy_matrix(estimate.C_hat, believed.C_hat)
    copy(estimate.G_hat, believed.G_hat)
    deviation = believed.deviation
    deviation.delta_M, deviation.delta_C, deviation.delta_G = 0.0, 0.0, 0.0


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

    def at(self, q: np.ndarray, q_dot: np.ndarray, t: float) -> Believed:
        """M_hat, C_hat, G_hat from the table at time t, and how far they may be from those at q, q_dot."""
        k = round(t / self._period)
        while len(self._table) <= k:
            self._extend()
        q_d, q_d_dot, along = self._table[k]
        deviation = self._lipschitz.deviation(q, q_dot, q_d, q_d_dot)
        return Believed(along.M_hat, along.C_hat, along.G_hat, deviation)

    def _extend(self) -> None:
        for k in range(len(self._table), len(self._table) + self._block):
            self._q, q_d_dot = self._posture(self._q, k * self._period)
            self._table.append((self._q, q_d_dot, self._model.evaluate(self._q, q_d_dot)))
