"""The table of a run: bounded, readable while it grows, thinned where it is old."""

from __future__ import annotations

import threading

import msgspec
import numpy as np

from app.scenario.data import load
from app.simulation.recording import BLOCK, THINNING, Epoch, Recording
from app.simulation.state import UNPROMISED
from app.storage.epoch_bytes import FORMER, from_bytes, to_bytes
from controllers.target_model import TargetModel


def filled(rows: int, history: int) -> Recording:
    recording = Recording(2, history)
    for k in range(rows):
        recording.new_row().view(float)[:] = 1e-3 * k
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


def test_a_branch_of_the_thinned_past_can_be_branched_again() -> None:
    recording = filled(8 * BLOCK, history=2 * BLOCK)
    end = recording.first + 2.0  # of 33 s
    branch = recording.branch(-np.inf, end)
    again = branch.branch(-np.inf, end)
    np.testing.assert_array_equal(again.rows(), branch.rows())
    assert np.isclose(branch.rows()[-1, 0], end, atol=THINNING * 1e-3)


def test_a_long_run_keeps_no_more_than_its_bound() -> None:
    history = 2 * BLOCK
    blocks = history // BLOCK + 2  # at full rate, and as many thinned ones
    kept = [len(filled(n * BLOCK, history).rows()) for n in (2 * blocks, 3 * blocks, 4 * blocks)]
    assert kept == [blocks * (BLOCK + -(-BLOCK // THINNING))] * 3
    assert len(filled(3 * blocks * BLOCK, history)) >= history


def test_a_stretch_has_its_rows_and_copies_a_signal_when_it_is_asked_for() -> None:
    recording = filled(2 * BLOCK, history=10 * BLOCK)
    stretch = recording.stretch(4.0, 4.2)
    assert (stretch["t"][0], stretch["t"][-1], len(stretch["t"])) == (4.0, 4.2, 201)  # across two blocks
    assert stretch["tau"].shape == (201, 2)
    assert stretch["tau"] is stretch["tau"]
    assert len(recording.stretch(9e9)["e_r"]) == 0


def test_picked_rows_are_those_of_their_numbers_in_every_signal() -> None:
    recording = filled(2 * BLOCK + 5, history=10 * BLOCK)
    numbers = np.array([0, BLOCK - 1, BLOCK, 2 * BLOCK + 4])  # at the edges of blocks
    picked, whole = recording.picked(numbers), recording.stretch()
    assert list(picked) == list(whole)
    for name, values in picked.items():
        np.testing.assert_array_equal(values, whole[name][numbers])
    assert [len(values) for values in recording.picked(numbers[:0]).values()] == [0] * len(whole)


def test_reader_never_sees_an_incomplete_row() -> None:
    recording = Recording(2, history=4 * BLOCK)
    done = threading.Event()

    def write() -> None:
        for k in range(6 * BLOCK):
            row = recording.new_row().view(float)
            row[0] = k
            row[1:] = k
            recording.commit()
        done.set()

    writer = threading.Thread(target=write)
    writer.start()
    looks = 0
    while not (looks and done.is_set()):
        rows = recording.rows()
        assert np.array_equal(rows[:, 0], rows[:, -1])
        assert np.all(np.diff(rows[:, 0]) > 0)
        looks += 1
    writer.join()


def test_epochs_of_files_of_earlier_versions_are_read_by_the_former_names() -> None:
    instants = {"layer_reached": 0.1, "band_reached": 0.2, "layer_reached_by": 0.3, "band_reached_by": 0.4}
    epoch = Epoch(0.0, load("ur5-hybrid"), TargetModel(*np.ones((4, 1, 1))), UNPROMISED, **instants)
    (plain,) = msgspec.msgpack.decode(to_bytes([epoch]))
    former = {present: name for name, present in FORMER.items()}
    earlier = msgspec.msgpack.encode([{former.get(name, name): value for name, value in plain.items()}])
    assert b"layer_reached" not in earlier
    (read,) = from_bytes(earlier, 1)
    assert {name: getattr(read, name) for name in instants} == instants
    assert to_bytes([read]) == to_bytes([epoch])
