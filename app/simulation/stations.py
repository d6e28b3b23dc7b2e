"""Stations: postures along the reference at which the sampled loops are judged, instead of at every posture between
them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

APART = 0.1  # rad, largest change of a joint from one station to the next


@dataclass(frozen=True)
class Stations:
    """Postures along the reference, `APART` from each other.
    q: (S, n) rad.
    t: (S,) s.
    of: (N,), number of the station that stands for each centre of Omega."""

    q: np.ndarray
    t: np.ndarray
    of: np.ndarray

    @classmethod
    def along(cls, centres: np.ndarray, instants: np.ndarray) -> Stations:
        """Stations among the centres (N, n) of Omega, at which the reference is at the instants (N,) s."""
        chosen, of = [0], np.zeros(len(centres), dtype=int)
        for k, q in enumerate(centres):
            apart = np.abs(centres[chosen] - q).max(axis=1)
            if apart.min() > APART:
                chosen.append(k)
                of[k] = len(chosen) - 1
            else:
                of[k] = apart.argmin()
        return cls(centres[chosen], instants[chosen], of)
