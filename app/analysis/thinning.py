"""Decimation of signals for plots: the smallest and the largest value of each bucket of time, so that no spike is
lost."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

INSET = 1 / 32  # of a bucket, from its ends to its points: times must rise


@dataclass(frozen=True)
class BucketGrid:
    """Grid of buckets [k width, (k + 1) width), k = first ... first + count - 1, in s. Their edges are multiples of the
    width, so that the drawn points stand still while time goes on."""

    first: int
    count: int
    width: float

    @classmethod
    def over(cls, t_from: float, t_to: float, buckets: int) -> BucketGrid:
        """Grid of about this many buckets; none begins before t_from, the last holds t_to."""
        return cls.up_to(t_to, t_to - t_from, buckets)

    @classmethod
    def up_to(cls, t_to: float, window: float, buckets: int) -> BucketGrid:
        """Grid of about this many buckets over the last `window` s up to t_to; grids of the same window have the same
        width, to the last bit."""
        t_from, width = t_to - window, window / buckets
        first = math.ceil(t_from / width - 1e-9)
        return cls(first, max(math.floor(t_to / width + 1e-9) - first + 1, 1), width)

    def since(self, bucket: int) -> BucketGrid:
        """The part of this grid from the bucket of this number on."""
        return BucketGrid(bucket, self.first + self.count - bucket, self.width)

    @property
    def times(self) -> np.ndarray:
        """Times (2 count,) s of the points: near the two ends of each bucket, so that what rises or falls steadily is a
        straight line, without stairs."""
        return ((self.first + np.arange(self.count))[:, None] + (INSET, 1.0 - INSET)).ravel() * self.width

    def starts(self, t: np.ndarray) -> np.ndarray:
        """Indices (count + 1,) into t (N,), increasing, at which each bucket begins, and at which the last one ends."""
        return np.searchsorted(t, (self.first + np.arange(self.count + 1)) * self.width)

    def openings(self, t: np.ndarray) -> np.ndarray:
        """Indices of the first row of each bucket that has one."""
        starts = self.starts(t)
        return starts[:-1][starts[:-1] < starts[1:]]

    def thin(self, t: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Decimated values (2 count, k) of values (N, k) at t (N,), increasing: the two extremes of each bucket, in the
        order in which the values go through them; nan for empty buckets. Infinite values stand for none: inf where a
        bucket has no others."""
        starts = self.starts(t)
        filled = starts[:-1] < starts[1:]
        thinned = np.full((self.count, 2, values.shape[1]), np.nan)
        if filled.any():
            begin, end = starts[:-1][filled], starts[1:][filled]
            absent = np.isinf(values[: end[-1]])
            known = np.where(absent, np.nan, values[: end[-1]])
            low, high = np.fmin.reduceat(known, begin, axis=0), np.fmax.reduceat(known, begin, axis=0)
            nothing = np.isnan(low) & np.logical_or.reduceat(absent, begin, axis=0)
            low[nothing] = high[nothing] = np.inf
            falls = values[end - 1] < values[begin]
            thinned[filled, 0] = np.where(falls, high, low)
            thinned[filled, 1] = np.where(falls, low, high)
        return thinned.reshape(2 * self.count, -1)
