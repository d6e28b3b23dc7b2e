"""Priority of threads: lower beside the loop, but where a whole machine is busy on purpose; real time for the loop."""

from __future__ import annotations

import os
import subprocess
import sys
from unittest import mock

import pytest

from app.process import priority
from app.process.priority import SAME, RealTimePriority

RESET = os.SCHED_RESET_ON_FORK  # else what the thread starts would have real-time priority, too


@pytest.mark.parametrize(("same", "lower"), [("", 7), ("1", 0)])
def test_helper_processes_are_nice_unless_same_priority_is_set(same: str, lower: int) -> None:
    code = "import os; from app.process.priority import lower_priority; lower_priority(7); print(os.nice(0))"
    done = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | {SAME: same}, capture_output=True, text=True, check=True
    )
    assert int(done.stdout) == min(os.nice(0) + lower, 19)


@pytest.fixture
def set_scheduler(monkeypatch: pytest.MonkeyPatch) -> mock.Mock:
    """Call of the system that allows everything and does nothing; of two cores."""
    call = mock.Mock()
    monkeypatch.setattr(os, "sched_setscheduler", call)
    monkeypatch.setattr(priority, "usable_cores", lambda: 2)
    return call


def test_real_time_priority_is_taken_and_given_back_once_each(set_scheduler: mock.Mock) -> None:
    own = RealTimePriority()
    own.give_back()  # nothing to give
    own.hold()
    own.hold()
    assert own.held
    own.give_back()
    own.give_back()
    assert not own.held
    assert [call.args[:2] for call in set_scheduler.call_args_list] == [
        (0, os.SCHED_RR | RESET),
        (0, os.SCHED_OTHER | RESET),
    ]


def test_real_time_priority_that_is_not_allowed_is_asked_for_once(set_scheduler: mock.Mock) -> None:
    set_scheduler.side_effect = PermissionError
    own = RealTimePriority()
    for _ in range(2):
        own.hold()
        assert not own.held
        own.give_back()
    assert set_scheduler.call_count == 1


def test_a_single_core_is_left_to_all(set_scheduler: mock.Mock, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(priority, "usable_cores", lambda: 1)
    RealTimePriority().hold()
    assert not set_scheduler.called


def test_the_system_gives_the_thread_what_it_says_to_hold() -> None:
    code = (
        "import os; from app.process.priority import RealTimePriority; own = RealTimePriority(); own.hold();"
        "print(own.held, os.sched_getscheduler(0) == os.SCHED_RR | os.SCHED_RESET_ON_FORK); own.give_back();"
        "print(own.held, os.sched_getscheduler(0) in (os.SCHED_OTHER, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    during, after = done.stdout.splitlines()
    assert during in ("True True", "False False")  # allowed or not: what it says is so
    assert after == "False True"
