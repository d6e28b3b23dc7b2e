"""Thinning of the rows of a plot: what is kept, and that it stands still."""

import numpy as np

from app.analysis.thinning import BucketGrid
from app.dashboard.plots.charts import BUCKETS


def test_thinning_keeps_a_spike_of_one_sample_and_the_direction_of_a_ramp():
    t = np.arange(8000) * 1e-3
    spike = np.where(t == t[4711], 1.0, 0.0)
    thinned = BucketGrid.over(0.0, 8.0, BUCKETS).thin(t, np.stack([spike, t, -t], axis=1))
    assert np.nanmax(thinned[:, 0]) == 1.0
    assert len(thinned) <= 2 * BUCKETS + 2
    inside = np.isfinite(thinned[:, 1])
    assert np.all(np.diff(thinned[inside, 1]) > 0)
    assert np.all(np.diff(thinned[inside, 2]) < 0)


def test_what_is_drawn_stands_still_while_time_goes_on():
    t = np.arange(9000) * 1e-3
    wave = np.sin(40 * t)[:, None]
    now, later = (BucketGrid.over(end - 4.0, end, BUCKETS) for end in (8.0, 8.5))
    seen = dict(zip(now.times, now.thin(t[t < 8.0], wave[t < 8.0])[:, 0], strict=True))
    again = dict(zip(later.times, later.thin(t, wave)[:, 0], strict=True))
    shared = sorted(set(seen) & set(again))[:-2]  # the last bucket was not full
    assert len(shared) > 1.6 * BUCKETS
    assert [seen[x] for x in shared] == [again[x] for x in shared]


def test_what_exists_in_a_part_of_a_bucket_only_is_kept():
    t = np.arange(1000) * 1e-3
    begins = np.where(t < 0.45, np.inf, np.where(t < 0.452, 7.0, 1.0))[:, None]
    thinned = BucketGrid.over(0.0, 1.0, 10).thin(t, begins)[:, 0].reshape(-1, 2)
    assert np.isinf(thinned[:4]).all()
    assert sorted(thinned[4]) == [1.0, 7.0]
    assert (thinned[5:-1] == 1.0).all()


def test_buckets_without_rows_are_nan():
    thinned = BucketGrid.over(0.0, 1.0, 10).thin(np.array([0.31, 0.62]), np.array([[1.0], [2.0]]))
    assert np.isfinite(thinned[:, 0]).nonzero()[0].tolist() == [6, 7, 12, 13]


def test_a_ramp_is_a_straight_line_without_stairs() -> None:
    t = np.arange(10_000) * 1e-3
    grid = BucketGrid.over(0.0, 9.999, 150)
    drawn, times = grid.thin(t, 2.0 * t[:, None])[:, 0], grid.times
    known = np.isfinite(drawn)
    assert np.abs(drawn - 2.0 * times)[known][:-2].max() < 0.1 * 2.0 * grid.width  # the last bucket is not full
    assert (np.diff(times) > 0.0).all()
