"""Shift of a desired path as a whole."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from environments.trajectories.trajectory import Path
from kernels import inline, kernel
from kernels.records import Record


class SmoothShift(NamedTuple):
    """Shift of a trajectory as a whole: from `begin` s on and within `duration` s, the displacement `way` (n,) m with
    its rate (m/s) and acceleration (m/s^2) at `begin` changes into rest at `end` (n,) m, without a jump in any of the
    three."""

    begin: float
    duration: float
    way: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray
    end: np.ndarray

    @classmethod
    def fresh(cls, end: np.ndarray, duration: float) -> SmoothShift:
        """Shift from rest at zero, at t = 0."""
        zero = np.zeros_like(end)
        return cls(0.0, float(duration), zero, zero, zero, end)

    def turned(self, t: float, end: np.ndarray, duration: float) -> SmoothShift:
        """Shift from the place of this one at time t (s) to another end."""
        now = self.evaluate(t)
        return SmoothShift(t, float(duration), now.value, now.rate, now.acceleration, end)

    def evaluate(self, t: float) -> Path:
        """Displacement, rate and acceleration at time t (s)."""
        path = Record(Path(*3 * (np.zeros(len(self.end)),)))
        _shift_alone(Record(self).data, t, path.data)
        return path.read()


@inline
def add_shift(shift, t, value, rate, acceleration):
    """Add a shift to a path: the polynomial of fifth order that meets both ends with two derivatives."""
    T = shift.duration
    u = (t - shift.begin) / T
    for i in range(value.shape[0]):
        if u >= 1.0:
            value[i] += shift.end[i]
            continue
        V, A = T * shift.rate[i], T**2 * shift.acceleration[i]
        D = shift.end[i] - shift.way[i]
        a, b, c = 10 * D - 6 * V - 1.5 * A, -15 * D + 8 * V + 1.5 * A, 6 * D - 3 * V - 0.5 * A
        value[i] += shift.way[i] + u * (V + u * (0.5 * A + u * (a + u * (b + u * c))))
        rate[i] += (V + u * (A + u * (3 * a + u * (4 * b + u * 5 * c)))) / T
        acceleration[i] += (A + u * (6 * a + u * (12 * b + u * 20 * c))) / T**2


@kernel
def _shift_alone(shift, t, path):
    add_shift(shift[0], t, path[0].value, path[0].rate, path[0].acceleration)
