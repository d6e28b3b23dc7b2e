"""Pushes on the tool besides the surface: by a hand that holds it by springs, and by a push at a fixed time; each is a
wrench (6,), force N and moment N m at the tool point along the world's axes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from kernels import inline

# N/m, N, N m/rad, N m: largest values of a hand
MOST_STIFF, MOST_FORCE, MOST_TORSION, MOST_MOMENT = 5000.0, 500.0, 500.0, 50.0
NO_MOMENT = np.zeros(3)
ROUNDING = 1e-9  # s, of the instants of a run: less than any period, so that a push acts for as many as it lasts


@dataclass(frozen=True)
class Grip:
    """Springs by which a hand holds the tool.

    anchor: (3,) m, where a spring of `stiffness` N/m from the tool point leads, at most `limit` N; None for none.
    turned: (3,) rad, rotation vector in the world of the orientation to which a spring of `torsion` N m/rad turns the
    tool, with at most `moment_limit` N m; None for none.

    Raises ValueError for an anchor or orientation that is not finite, and for a stiffness or limit beyond those of a
    hand.
    """

    anchor: tuple[float, float, float] | None
    stiffness: float = 500.0
    limit: float = 60.0
    turned: tuple[float, float, float] | None = None
    torsion: float = 30.0
    moment_limit: float = 5.0

    def __post_init__(self) -> None:
        for name in ("anchor", "turned"):
            given = getattr(self, name)
            if given is not None and (len(given) != 3 or not np.isfinite(given).all()):
                raise ValueError(f"push.{name}: {given}; allowed: three finite numbers")
        largest = {
            "stiffness": MOST_STIFF,
            "limit": MOST_FORCE,
            "torsion": MOST_TORSION,
            "moment_limit": MOST_MOMENT,
        }
        for name, most in largest.items():
            value = getattr(self, name)
            if not 0.0 < value <= most:
                raise ValueError(f"push.{name}: {value:g}; allowed: above 0, up to {most:g}")

    def wrench(self, p: np.ndarray, R: np.ndarray) -> np.ndarray:
        """Wrench on the tool (6,), when its point is at p (3,) m and its orientation is R (3, 3)."""
        wrench = np.zeros(6)
        if self.anchor is not None:
            wrench[:3] = _at_most(self.limit, self.stiffness * (np.asarray(self.anchor) - p))
        if self.turned is not None:
            apart = pin.log3(pin.exp3(np.asarray(self.turned)) @ R.T)
            wrench[3:] = _at_most(self.moment_limit, self.torsion * apart)
        return wrench


def _at_most(limit: float, pull: np.ndarray) -> np.ndarray:
    size = float(np.linalg.norm(pull))
    return pull if size <= limit else pull * (limit / size)


class TimedPush(NamedTuple):
    """Push on the tool at fixed times.
    force, moment: (3,) N and (3,) N m: constant, or the amplitudes of a sine that begins at zero.
    start, duration: s; every: s after which the push begins again, 0 for never.
    frequency: Hz, of the sine, 0 for a constant push.
    sweep_to: Hz, to which a chirp goes while the push lasts, evenly in the logarithm; 0 for no chirp."""

    force: np.ndarray
    start: float
    duration: float
    every: float = 0.0
    frequency: float = 0.0
    moment: np.ndarray = NO_MOMENT
    sweep_to: float = 0.0

    @property
    def acts(self) -> bool:
        """Whether force or moment is not zero."""
        return bool(self.force.any() or self.moment.any())

    def at(self, t: float) -> np.ndarray | None:
        """Wrench (6,) at time t (s), None while the push does not act."""
        wrench = np.zeros(6)
        return wrench if push_at.py_func(self, t, wrench) else None


@inline
def push_at(push, t, wrench):
    """Compute the wrench (6,) of a `TimedPush` at time t (s), and return whether it acts; else the wrench is left
    alone."""
    since = t - push.start
    if push.every > 0.0 and since >= -ROUNDING:
        since = (since + ROUNDING) % push.every - ROUNDING
    if not -ROUNDING <= since < push.duration - ROUNDING:
        return False
    share = 1.0
    if push.frequency > 0.0:
        cycles = push.frequency * since
        if push.sweep_to > 0.0 and push.sweep_to != push.frequency:
            rate = np.log(push.sweep_to / push.frequency) / push.duration
            cycles = push.frequency * (np.exp(rate * since) - 1.0) / rate
        share = np.sin(2 * np.pi * cycles)
    for a in range(3):
        wrench[a], wrench[3 + a] = share * push.force[a], share * push.moment[a]
    return True
