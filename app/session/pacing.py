"""Pacing of simulated time against wall time: when each step is due, how late it was computed, and the achieved
rate."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

KEPT = 1 << 16  # batches: a minute at 1 kHz
SLOWED = 0.9  # of the rate asked for: below it one sees that simulated time falls behind


class Schedule(NamedTuple):
    """Schedule of the steps: simulated time t (s) is due at wall time wall + (t - t_0) / speed (s of
    `time.perf_counter`)."""

    wall: float
    t_0: float
    speed: float

    def due(self, t: float) -> float:
        """Wall time at which the step that ends at simulated time t is due."""
        return self.wall + (t - self.t_0) / self.speed

    def target(self, now: float) -> float:
        """Simulated time that is due now."""
        return self.t_0 + (now - self.wall) * self.speed


class Pace(NamedTuple):
    """Pace of the loop over the last `seconds` s.
    requested, achieved: control steps per second of wall time.
    late_median, late_most: median and largest lateness of a step, s: when it was computed minus when it was due."""

    requested: float
    achieved: float
    late_median: float
    late_most: float
    seconds: float

    @property
    def slowed(self) -> bool:
        """Whether simulated time runs more slowly than it should; the step in progress does not count against it."""
        return self.achieved + 1.0 / self.seconds < SLOWED * self.requested


class PaceMeter:
    """Meter of the pace: notes each batch of steps by its bounds. It is always on, so it must cost nothing per step.

    Only one thread notes. A row: wall times of beginning and end, s; number of steps; lateness of the first and the
    last, s.
    """

    def __init__(self, kept: int = KEPT) -> None:
        self._batches = np.zeros((kept, 5))
        self._noted = 0

    def note(self, schedule: Schedule, began: float, ended: float, first: float, last: float, steps: int) -> None:
        """Note a batch of steps, computed from `began` to `ended`, ending at simulated times `first` to `last` s."""
        first_computed = began + (ended - began) / steps
        self._batches[self._noted % len(self._batches)] = (
            began,
            ended,
            steps,
            first_computed - schedule.due(first),
            ended - schedule.due(last),
        )
        self._noted += 1

    def lateness(self, since: float) -> np.ndarray:
        """Lateness (N,) s of every step computed since that wall time, oldest batch first, as far as it is kept.

        The steps between the first and the last of a batch are taken to be equally long.
        """
        batches = self._since(since)
        counts = batches[:, 2].astype(int)
        at = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        fraction = at / np.repeat(np.maximum(counts - 1, 1), counts)
        first, last = (np.repeat(batches[:, column], counts) for column in (3, 4))
        return first + fraction * (last - first)

    def pace(self, since: float, now: float, requested: float) -> Pace:
        """Pace since that wall time. requested: steps per second."""
        late = self.lateness(since)
        if not len(late):
            return Pace(requested, 0.0, 0.0, 0.0, now - since)
        return Pace(requested, len(late) / (now - since), float(np.median(late)), float(late.max()), now - since)

    def _since(self, since: float) -> np.ndarray:
        head = self._noted % len(self._batches)
        older = self._batches[head:] if self._noted >= len(self._batches) else self._batches[:0]
        newer = self._batches[:head]
        return np.concatenate([part[np.searchsorted(part[:, 0], since) :] for part in (older, newer)])
