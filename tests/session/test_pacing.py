"""Wall time: what is measured of it, and that a loop which cannot keep up slows down, says so and skips nothing."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from app.dashboard.widgets.page.status import status_html
from app.process.priority import RealTimePriority
from app.scenario.data import edited, shipped
from app.session.commanded_run import CommandedRun
from app.session.commands import Command, DragTool, Edit, Pause, Play, Reset, Seek, SetSpeed, ShowAgain, ToEnd
from app.session.pacing import Pace, PaceMeter, Schedule
from app.session.runner import Runner
from app.session.snapshot import Snapshot
from drivers.waiting import until
from environments.push import Grip

pytestmark = pytest.mark.slow  # loops in real time

CANNOT = "The loop cannot keep up"


@pytest.fixture
def runner() -> Iterator[Runner]:
    runner = Runner(edited(shipped()["planar2r-semicircle"], "controller.period", 2e-4))
    runner.start()
    yield runner
    runner.close()


def wait(runner: Runner, condition: Callable[[Snapshot], bool]) -> Snapshot:
    def met() -> Snapshot | None:
        return now if condition(now := runner.snapshot) else None

    def missed() -> object:
        now = runner.snapshot
        return now.phase, now.reason, now.refusal, now.pace

    return until(met, missed)


def test_a_speed_that_cannot_be_kept_slows_simulated_time_skips_nothing_and_is_said(runner: Runner):
    runner.post(SetSpeed(100.0))  # half a million steps a second
    now = wait(runner, lambda now: now.pace is not None and now.pace.slowed)
    assert now.pace is not None
    assert now.pace.requested == pytest.approx(5e5)
    assert 0.0 < now.realtime_factor < 97.0
    assert f"{CANNOT}: 100× asked for" in status_html(now, "")
    t = now.recording.signals(("t",))["t"]
    np.testing.assert_allclose(np.diff(t), 2e-4, rtol=1e-9)


def test_no_step_is_skipped_when_edits_hold_the_loop_up(runner: Runner):
    revision = runner.snapshot.revision
    for number, layer in enumerate((0.011, 0.012, 0.013), start=1):
        runner.post(Edit("controller.layer", layer))  # edits that wait for the loop together are one
        wait(runner, lambda now, number=number: now.revision == revision + number)
    now = wait(runner, lambda now: now.t > 0.5)
    t = now.recording.signals(("t",))["t"]
    np.testing.assert_allclose(np.diff(t), 2e-4, rtol=1e-9)


def test_a_paused_loop_has_no_pace(runner: Runner):
    wait(runner, lambda now: now.pace is not None)
    runner.post(Pause())
    now = wait(runner, lambda now: now.phase == "paused")
    assert now.pace is None
    assert now.realtime_factor == 0.0
    assert CANNOT not in status_html(now, "")


def test_a_loop_that_keeps_up_says_nothing(runner: Runner):
    now = wait(runner, lambda now: now.pace is not None)
    assert CANNOT not in status_html(replace(now, pace=Pace(5000.0, 4990.0, 2e-4, 5e-3, 1.0)), "")
    assert CANNOT in status_html(replace(now, pace=Pace(5000.0, 4400.0, 2e-4, 0.1, 1.0)), "")


def test_lateness_of_every_step_follows_from_the_bounds_of_its_batch():
    meter = PaceMeter()
    schedule = Schedule(wall=10.0, t_0=1.0, speed=2.0)
    # ends at t = 1.002 and 1.004, due at 10.001 and 10.002, computed at 10.004 and 10.006
    meter.note(schedule, began=10.002, ended=10.006, first=1.002, last=1.004, steps=2)
    meter.note(schedule, began=10.0065, ended=10.007, first=1.006, last=1.006, steps=1)
    np.testing.assert_allclose(meter.lateness(10.0), [0.003, 0.004, 0.004], atol=1e-12)
    np.testing.assert_allclose(meter.lateness(10.003), [0.004], atol=1e-12)
    assert not meter.pace(10.0, 10.01, requested=400.0).slowed  # the fourth step may be under way
    pace = meter.pace(10.0, 10.01, requested=600.0)
    assert pace.achieved == pytest.approx(300.0)
    assert pace.slowed
    assert pace.late_most == pytest.approx(0.004)
    assert meter.pace(11.0, 12.0, requested=400.0).achieved == 0.0


def test_the_meter_forgets_the_oldest_batches_and_keeps_their_order():
    meter = PaceMeter(kept=4)
    schedule = Schedule(0.0, 0.0, 1.0)
    for k in range(1, 8):  # the k-th is late by k milliseconds
        meter.note(schedule, k + 0.0, k + 1e-3 * k, float(k), float(k), steps=1)
    np.testing.assert_allclose(meter.lateness(0.0), [4e-3, 5e-3, 6e-3, 7e-3])
    np.testing.assert_allclose(meter.lateness(5.5), [6e-3, 7e-3])


def test_slow_motion_moves_also_with_a_long_period_and_warns_of_nothing():
    runner = Runner(edited(shipped()["planar2r-semicircle"], "controller.period", 0.01))
    runner.post(SetSpeed(0.05))  # five steps a second
    runner.start()
    try:
        wait(runner, lambda now: now.speed == 0.05)
        began, slowed = time.monotonic(), False
        while time.monotonic() < began + 2.0:
            now = runner.snapshot
            slowed |= now.pace is not None and now.pace.slowed
            time.sleep(0.01)
        assert now.t >= 0.04
        assert not slowed
    finally:
        runner.close()


def test_a_slider_of_time_is_followed_to_where_it_is_now(runner: Runner, monkeypatch: pytest.MonkeyPatch):
    wait(runner, lambda now: now.t > 0.5)
    runner.post(Pause())
    end = wait(runner, lambda now: now.phase == "paused").end
    sought: list[float] = []
    line = runner._commanded.timeline
    seek = line.seek

    def slow(t: float) -> None:
        sought.append(t)
        time.sleep(0.3)
        seek(t)

    monkeypatch.setattr(line, "seek", slow)
    for fraction in np.linspace(0.1, 0.9, 20):
        runner.post(Seek(fraction * end))
    wait(runner, lambda now: now.t == pytest.approx(0.9 * end, abs=1e-3))
    assert len(sought) < 4


def test_a_hand_lets_go_when_one_looks_back(runner: Runner):
    now = wait(runner, lambda now: now.t > 0.3)
    runner.post(DragTool(Grip(tuple(now.tool + np.array([0.02, 0.0, 0.0])))))
    wait(runner, lambda now: now.state.grip is not None)
    runner.post(Seek(0.1))
    runner.post(DragTool(None))
    runner.post(ToEnd())
    wait(runner, lambda now: now.state.grip is None and not now.looking_back)


def test_a_stretch_is_shown_again_slowly_and_then_the_run_goes_on_as_before(runner: Runner):
    wait(runner, lambda now: now.t > 0.5)
    runner.post(SetSpeed(2.0))
    runner.post(ShowAgain(0.1, 0.13, 0.01))  # for three seconds
    now = wait(runner, lambda now: now.speed == 0.01)
    assert 0.1 <= now.t <= 0.13
    assert (now.phase, now.looking_back) == ("running", True)
    now = wait(runner, lambda now: now.speed != 0.01)
    assert now.speed == 2.0
    assert now.t >= 0.13
    runner.post(ShowAgain(-1.0, 0.1, 0.02))
    now = wait(runner, lambda now: now.refusal_number > 0)
    assert now.refusal is not None
    assert now.refusal.startswith("time: -1 s; allowed: 0 to")
    assert now.speed == 2.0


def test_another_run_is_not_shown_slowly(runner: Runner):
    wait(runner, lambda now: now.t > 0.5)
    runner.post(ShowAgain(0.1, 0.5, 0.01))
    run = wait(runner, lambda now: now.speed == 0.01).run
    runner.post(Reset())
    wait(runner, lambda now: now.run > run and now.speed == 1.0)


class _Priority(RealTimePriority):
    """Real-time priority that is held by its word only."""

    def hold(self) -> None:
        self.held = True

    def give_back(self) -> None:
        self.held = False


def test_a_loop_has_real_time_priority_only_while_it_keeps_up_with_real_time(monkeypatch: pytest.MonkeyPatch):
    priority, held = _Priority(), list[bool]()
    obey = CommandedRun.execute

    def noting(run: CommandedRun, command: Command) -> bool:
        held.append(priority.held)
        return obey(run, command)

    monkeypatch.setattr(CommandedRun, "execute", noting)
    runner = Runner(shipped()["planar2r-semicircle"])
    runner.start(priority)
    try:
        until(lambda: priority.held)
        for command, coming_back in ((SetSpeed(2.0), SetSpeed(1.0)), (Pause(), Play())):
            runner.post(command)
            until(lambda: not priority.held)
            runner.post(coming_back)
            until(lambda: priority.held)
        slow = Pace(requested=1000.0, achieved=800.0, late_median=0.0, late_most=0.0, seconds=2.0)
        monkeypatch.setattr(PaceMeter, "pace", lambda *_: slow)
        until(lambda: not priority.held)
    finally:
        runner.close()
    assert held == [False] * 4  # no command is carried out at it
