"""The table of a run: bounded, readable while it grows, thinned where it is old."""

from __future__ import annotations

import threading

import numpy as np

from app.recording import BLOCK, THINNING, Recording


def filled(rows: int, history: int) -> Recording:
    recording = Recording(2, history)
    for k in range(rows):
        recording.new_row()[:] = 1e-3 * k
        recording.commit()
    return recording


def test_recent_rows_are_whole_and_older_ones_thinned() -> None:
    recording = filled(8 * BLOCK, history=2 * BLOCK)
    t = recording.signals(("t",))["t"]
    assert np.all(np.diff(t) > 0)
    recent = t[t > t[-1] - 2 * BLOCK * 1e-3]
    np.testing.assert_allclose(np.diff(recent), 1e-3, rtol=1e-6)
    assert len(t) < 5 * BLOCK
    assert np.isclose(np.diff(t).max(), THINNING * 1e-3)


def test_a_long_run_keeps_no_more_than_its_bound() -> None:
    history = 2 * BLOCK
    blocks = history // BLOCK + 2  # at full rate, and as many thinned ones
    kept = [len(filled(n * BLOCK, history).rows()) for n in (2 * blocks, 3 * blocks, 4 * blocks)]
    assert kept == [blocks * (BLOCK + -(-BLOCK // THINNING))] * 3
    assert len(filled(3 * blocks * BLOCK, history)) >= history


def test_window_is_thinned_and_its_points_stand_still() -> None:
    recording = filled(3000, history=10 * BLOCK)
    first = recording.window(("t", "tau"), 0.5, 2.5, max_points=100)
    later = recording.window(("t",), 0.7, 2.7, max_points=100)
    assert 80 <= len(first["t"]) <= 101
    assert first["tau"].shape == (len(first["t"]), 2)
    shared = later["t"][later["t"] <= first["t"][-1]]
    assert np.isin(shared, first["t"]).all()


def test_reader_never_sees_an_incomplete_row() -> None:
    recording = Recording(2, history=4 * BLOCK)
    done = threading.Event()

    def write() -> None:
        for k in range(6 * BLOCK):
            row = recording.new_row()
            row[0] = k
            row[1:] = k
            recording.commit()
        done.set()

    writer = threading.Thread(target=write)
    writer.start()
    looks = 0
    while not done.is_set():
        rows = recording.rows()
        assert np.array_equal(rows[:, 0], rows[:, -1])
        assert np.all(np.diff(rows[:, 0]) > 0)
        looks += 1
    writer.join()
    assert looks > 0
