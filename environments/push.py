"""Pushes on the tool besides the surface: by a hand that holds it by a spring, and by a push at a fixed time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from kernels import inline

MOST_STIFF, MOST_FORCE = 5000.0, 500.0  # N/m, N: largest values of a hand


@dataclass(frozen=True)
class Grip:
    """A spring from the tool point to the `anchor` (3,) m that a hand holds: stiffness N/m, but at most `limit` N.

    Raises ValueError for an anchor that is not finite, and for a stiffness or limit beyond those of a hand.
    """

    anchor: tuple[float, float, float]
    stiffness: float = 500.0
    limit: float = 60.0

    def __post_init__(self) -> None:
        if len(self.anchor) != 3 or not np.isfinite(self.anchor).all():
            raise ValueError(f"push.anchor: {self.anchor}; allowed: three finite numbers")
        for name, most in (("stiffness", MOST_STIFF), ("limit", MOST_FORCE)):
            value = getattr(self, name)
            if not 0.0 < value <= most:
                raise ValueError(f"push.{name}: {value:g}; allowed: above 0, up to {most:g}")

    def force(self, p: np.ndarray) -> np.ndarray:
        """Force on the tool (3,) N, when it is at p (3,) m."""
        pull = self.stiffness * (np.asarray(self.anchor) - p)
        size = float(np.linalg.norm(pull))
        return pull if size <= self.limit else pull * (self.limit / size)


class TimedPush(NamedTuple):
    """A constant force (3,) N on the tool from `start` s on, for `duration` s, again `every` s where that is not 0."""

    force: np.ndarray
    start: float
    duration: float
    every: float = 0.0

    def acts(self, t: float) -> bool:
        """Whether the push acts at time t (s)."""
        return acts.py_func(self, t)


@inline
def acts(push, t):
    """Whether a `TimedPush` acts at time t (s)."""
    since = t - push.start
    if push.every > 0.0:
        since = since % push.every if since >= 0.0 else since
    return 0.0 <= since < push.duration
