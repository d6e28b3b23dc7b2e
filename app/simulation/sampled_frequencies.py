"""Frequencies that a sampled loop can tell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LOWEST = 0.05  # Hz


@dataclass(frozen=True)
class SampledFrequencies:
    """Frequencies that samples taken every `period` s can tell."""

    period: float

    @property
    def highest(self) -> float:
        """Frequency, Hz, beyond which samples cannot tell."""
        return 0.5 / self.period

    def frequencies(self, count: int = 200) -> np.ndarray:
        """Frequencies (count,) Hz from 0.05 Hz on, as far as samples can tell, evenly in the logarithm."""
        return np.geomspace(LOWEST, 0.98 * self.highest, count)
