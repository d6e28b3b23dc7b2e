"""Frequencies at which a sampled loop can be judged."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LOWEST = 0.05  # Hz


@dataclass(frozen=True)
class SampledFrequencies:
    """Range of frequencies that samples taken every `period` s resolve."""

    period: float

    @property
    def highest(self) -> float:
        """Highest frequency, Hz, that the samples resolve."""
        return 0.5 / self.period

    def frequencies(self, count: int = 200) -> np.ndarray:
        """Frequencies (count,) Hz from `LOWEST` to the highest, evenly in the logarithm."""
        return np.geomspace(LOWEST, 0.98 * self.highest, count)
