"""Estimates of Remark 3, taken beforehand along r_d, so that the law computes little on-line."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from controllers.estimate_rates import Lipschitz
from controllers.nominal_model import ON_LINE, Deviation, Estimate, NominalModel
from kernels import inline
from kernels.algebra import copy, copy_matrix


class FeedforwardModel(NamedTuple):
    """Model of the arm that laws feed forward: M_hat, C_hat (n, n), G_hat (n,) of (25), and the bounds of their
    deviation from the estimates at q."""

    M_hat: np.ndarray
    C_hat: np.ndarray
    G_hat: np.ndarray
    deviation: Deviation

    @classmethod
    def at(cls, estimate: Estimate) -> FeedforwardModel:
        """Model from the estimates at q."""
        return cls(estimate.M_hat, estimate.C_hat, estimate.G_hat, ON_LINE)


@inline
def take_estimates(estimate, feedforward):
    """Copy the estimates at q."""
    copy_matrix(estimate.M_hat, feedforward.M_hat)
    copy_matrix(estimate.C_hat, feedforward.C_hat)
    copy(estimate.G_hat, feedforward.G_hat)
    deviation = feedforward.deviation
    deviation.delta_M = deviation.delta_C = deviation.delta_G = deviation.rate_C = 0.0


class Start(NamedTuple):
    """Start of a table: the number k of a control period, and a posture q (n,) rad near that of r_d then."""

    k: int
    q: np.ndarray


class ReferenceEstimates:
    """Estimates M_hat, C_hat, G_hat at (q_d, q_d_dot)(t), one entry per control period, a block at a time.

    way: (q (n,), q_d (n,)) -> length of a way between them within Omega, rad.
    posture: (q guess (n,), t) -> q_d, q_d_dot, solving r(q_d, t) = r_d(t).
    start: where the block in use begins; a table that is made from there is the same to the last bit.
    """

    def __init__(
        self,
        model: NominalModel,
        lipschitz: Lipschitz,
        way: Callable[[np.ndarray, np.ndarray], float],
        posture: Callable[[np.ndarray, float], tuple[np.ndarray, np.ndarray]],
        period: float,
        start: Start,
        block: int = 20,
    ) -> None:
        self._model, self._lipschitz, self._way, self._posture = model, lipschitz, way, posture
        self._period, self._size = period, block
        self.start = start
        self._block: list[tuple[np.ndarray, np.ndarray, Estimate]] = []

    def at(self, q: np.ndarray, q_dot: np.ndarray, t: float) -> FeedforwardModel:
        """M_hat, C_hat, G_hat from the table at time t, not before its start, with the bounds of their deviation from
        those at q, q_dot."""
        k = round(t / self._period)
        while k >= self.start.k + len(self._block):
            self._go_on()
        q_d, q_d_dot, along = self._block[k - self.start.k]
        deviation = self._lipschitz.deviation(self._way(q, q_d), q_dot, q_d_dot)
        return FeedforwardModel(along.M_hat, along.C_hat, along.G_hat, deviation)

    def _go_on(self) -> None:
        if self._block:
            self.start = Start(self.start.k + len(self._block), self._block[-1][0])
        q, self._block = self.start.q, []
        for k in range(self.start.k, self.start.k + self._size):
            q, q_d_dot = self._posture(q, k * self._period)
            self._block.append((q, q_d_dot, self._model.evaluate(q, q_d_dot)))
