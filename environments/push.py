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
    """A force (3,) N on the tool from `start` s on, for `duration` s, again `every` s where that is not 0: constant, or
    the amplitude of a sine that begins at zero, where `frequency` (Hz) is not 0."""

    force: np.ndarray
    start: float
    duration: float
    every: float = 0.0
    frequency: float = 0.0

    def at(self, t: float) -> np.ndarray | None:
        """Force (3,) N at time t (s), None while the push does not act."""
        force = np.zeros(3)
        return force if push_at.py_func(self, t, force) else None


@inline
def push_at(push, t, force):
    """Compute the force (3,) N of a `TimedPush` at time t (s), and return whether it acts; else the force is left
    alone."""
    since = t - push.start
    if push.every > 0.0:
        since = since % push.every if since >= 0.0 else since
    if not 0.0 <= since < push.duration:
        return False
    share = np.sin(2 * np.pi * push.frequency * since) if push.frequency > 0.0 else 1.0
    for a in range(3):
        force[a] = share * push.force[a]
    return True
