"""Margins of the force loop: how wrong or late the reading of the force may be while the sampled loop stays stable.

The loop is opened where the law takes the reading: y, what the sensor gives, answers to u, what the law is given, by
y = L(z) u, in one control period the change x -> A x + B (u - y) with y = C x. With u = y it is closed. It stays stable
under u = k y for every k between the gain margins, and under a reading that comes later by less than the delay margin.
Of several readings all are changed alike: then the eigenvalues of L(z) are what one reading's L(z) is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from app.simulation.sampled_loop.sampled_frequencies import LOWEST, SampledFrequencies

LARGEST_GAIN = 1e3  # gain, beyond which there is no limit to speak of
GAINS, FREQUENCIES = 121, 1500  # at which a margin is looked for, before it is found exactly
ROUNDING = 1e-7  # of the spectral radius: a coordinate that is free to move without its force has a pole at 1
SMALLEST_GAIN = 1e-6  # a loop gain below which an eigenvalue counts as zero


@dataclass(frozen=True)
class Margins:
    """Margins of a stable loop; infinite, and `low` 0, where there is no limit.
    low, high: factors on the reading, between which the loop is stable.
    phase: rad, by which the reading may be shifted at every frequency; delay: s, by which it may come later.
    crossing: Hz, at which the delay margin is found, nan where there is none."""

    low: float
    high: float
    phase: float
    delay: float
    crossing: float


@dataclass(frozen=True)
class ForceLoop(SampledFrequencies):
    """The force loop at rest at one posture. period: s. A (k, k), B (k, r), C (r, k): see the module; readings N, and
    N m of a flat tool."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray

    def gains(self, frequency: np.ndarray) -> np.ndarray:
        """Eigenvalues (N, p) of L at frequencies (N,) Hz, largest first, without those that are zero everywhere."""
        values = self._eigenvalues(frequency)
        return values[:, : self._count]

    def _eigenvalues(self, frequency: np.ndarray) -> np.ndarray:
        z = np.exp(2j * np.pi * frequency * self.period)[:, None, None]
        opened = self.A - self.B @ self.C
        x = np.linalg.solve(z * np.eye(len(opened)) - opened, np.broadcast_to(self.B, (len(z), *self.B.shape)))
        values = np.linalg.eigvals(self.C @ x)
        return np.take_along_axis(values, np.argsort(-np.abs(values), axis=1), axis=1)

    @cached_property
    def _count(self) -> int:
        """Number of eigenvalues of L that are not zero everywhere."""
        largest = np.abs(self._eigenvalues(self.frequencies(40))).max(axis=0)
        return max(1, int((largest > SMALLEST_GAIN).sum()))

    def growth(self, gain: float) -> float:
        """Growth of a deviation per control period when the law is given `gain` times the reading."""
        return float(np.abs(np.linalg.eigvals(self.A + (gain - 1.0) * self.B @ self.C)).max())

    @cached_property
    def margins(self) -> Margins | None:
        """Margins; None where the loop is not stable as it is."""
        if self._unstable(1.0) > 0.0:
            return None
        high = self._limit(np.geomspace(1.0, LARGEST_GAIN, GAINS))
        low = self._limit(np.linspace(1.0, 0.0, GAINS))
        phase, delay, crossing = math.inf, math.inf, math.nan
        for frequency, value in self._crossings():
            phase = min(phase, abs(float(np.angle(value))))
            late = float(np.angle(value)) % (2.0 * np.pi) / (2.0 * np.pi * frequency)
            if late < delay:
                delay, crossing = late, frequency
        return Margins(0.0 if math.isinf(low) else low, high, phase, delay, crossing)

    def _unstable(self, gain: float) -> float:
        """More than 0 where a gain makes the loop unstable."""
        return self.growth(gain) - 1.0 - ROUNDING

    def _limit(self, gains: np.ndarray) -> float:
        """First gain along these, which begin at a stable one, beyond which the loop is unstable; infinite for none."""
        from scipy.optimize import root_scalar  # takes 0.1 s: a run without a page does not wait for it

        for before, after in pairwise(gains):
            if self._unstable(after) > 0.0:
                return root_scalar(self._unstable, bracket=(before, after), rtol=1e-6).root
        return math.inf

    def _crossings(self) -> list[tuple[float, complex]]:
        """Frequencies, Hz, at which an eigenvalue of L has size 1, and that eigenvalue."""
        from scipy.optimize import root_scalar  # as in `_limit`

        frequency = np.geomspace(LOWEST, self.highest, FREQUENCIES)
        over = np.abs(self.gains(frequency)) > 1.0
        found = []
        for k, column in np.argwhere(over[1:] != over[:-1]):

            def beyond(f: float, column: int = column) -> float:
                return float(np.abs(self.gains(np.array([f]))[0, column])) - 1.0

            root = root_scalar(beyond, bracket=(frequency[k], frequency[k + 1]), rtol=1e-9).root
            found.append((root, complex(self.gains(np.array([root]))[0, column])))
        return found


def margins_sentence(loop: ForceLoop) -> str:
    """Sentence on the margins."""
    if loop.margins is None:
        return "force loop: unstable, so it has no margins"
    return "force loop: " + ", ".join(f"{name} margin {words}" for name, words in in_words(loop.margins, loop.period))


def in_words(margins: Margins, period: float) -> list[tuple[str, str]]:
    """Margins by name, each in words."""
    high = f"{margins.high:.3g}" if math.isfinite(margins.high) else "infinite"
    gain = high if margins.low == 0.0 else f"{margins.low:.3g} and {high}"
    if math.isinf(margins.delay):
        return [("gain", gain), ("phase", "infinite"), ("delay", "infinite")]
    late = f"{1e3 * margins.delay:.3g} ms ({margins.delay / period:.3g} periods, at {margins.crossing:.3g} Hz)"
    return [("gain", gain), ("phase", f"{math.degrees(margins.phase):.3g}°"), ("delay", late)]
