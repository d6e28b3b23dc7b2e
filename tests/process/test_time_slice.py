"""Time slice of a thread: asked for by this thread only, and nothing else of its scheduling changes."""

from __future__ import annotations

import os
import platform
import sys
import threading

import pytest

from app.process.time_slice import shorten_time_slice, time_slice


def test_a_thread_has_the_time_slice_that_it_asks_for_and_others_keep_theirs() -> None:
    def ask() -> None:
        before, nice = time_slice(), os.getpriority(os.PRIO_PROCESS, 0)
        shorten_time_slice(5e-4)
        found.extend((before, time_slice(), os.getpriority(os.PRIO_PROCESS, 0) - nice))

    found, ours = list[float | None](), time_slice()
    thread = threading.Thread(target=ask)
    thread.start()
    thread.join()
    before, after, renice = found
    followed = sys.platform == "linux" and tuple(map(int, platform.release().split(".")[:2])) >= (6, 12)
    assert after == (pytest.approx(5e-4) if followed and before is not None else before)
    assert renice == 0
    assert time_slice() == ours


def test_a_system_that_has_none_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("app.process.time_slice.sys.platform", "darwin")
    shorten_time_slice(5e-4)
    assert time_slice() is None
