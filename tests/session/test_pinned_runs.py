"""Runs that are pinned: their numbers, names and figures, and their arms in the scene."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast
from unittest.mock import MagicMock

import numpy as np
import pytest

from app.analysis.metrics import account
from app.dashboard.panels.runs import table_html
from app.dashboard.scene import pinned_arms
from app.dashboard.scene.pinned_arms import posture
from app.scenario.data import edited, shipped
from app.scenario.errors import ScenarioError
from app.session import timeline
from app.session.snapshot import Snapshot
from app.session.timeline import PINS, Timeline
from environments.robots import Robot
from tests.support.timelines import line_of, run

pytestmark = pytest.mark.slow  # long or many simulations


def test_pins_are_numbered_bounded_and_stay_as_they_were() -> None:
    line = line_of(shipped()["planar2r-semicircle"])
    with pytest.raises(ScenarioError, match="pin: nothing"):
        line.pin()
    for _ in range(PINS + 1):
        run(line, 10).pin()
    assert [pinned.number for pinned in line.pinned] == [2, 3, 4]
    assert [len(pinned.recording) for pinned in line.pinned] == [20, 30, 40]
    line.unpin(3)
    with pytest.raises(ScenarioError, match="forget run: 3; allowed: 2, 4"):
        line.unpin(3)


def test_a_run_that_has_not_gone_on_is_pinned_once() -> None:
    line = run(line_of(shipped()["planar2r-semicircle"]), 10)
    line.pin()
    line.rename(1, "first")
    for _ in range(2):
        with pytest.raises(ScenarioError, match="pin: this is pinned already, as first; allowed: when"):
            line.pin()
        line.pin(may_be_pinned=True)
        assert [pinned.number for pinned in line.pinned] == [1]
    run(line, 1).pin()
    assert [pinned.number for pinned in line.pinned] == [1, 2]
    line.seek(0.0)
    with pytest.raises(ScenarioError, match="as run 2"):
        line.pin()


def test_the_arm_of_a_pinned_run_stands_where_it_stood(noisy: Timeline) -> None:
    noisy.pin()
    pinned, rows = noisy.pinned[-1], noisy.recording
    for t in (0.0, 0.4, 1.199):
        shown = posture(pinned, t)
        assert shown is not None
        np.testing.assert_array_equal(shown, rows.at(t + 1e-6)["q"])
    assert posture(pinned, 1.3) is None
    assert posture(pinned, -0.1) is None


def test_figures_of_a_pinned_run_stay_when_the_running_one_goes_on_beyond_it(noisy: Timeline) -> None:
    noisy.pin()
    run(noisy, 600)
    pinned = noisy.pinned[-1]
    seen = SimpleNamespace(
        t=noisy.loop.t, system=noisy.loop.system, recording=noisy.recording,
        scenario=noisy.loop.system.scenario, pinned=noisy.pinned,
    )  # fmt: skip
    html = table_html(cast(Snapshot, seen), 0.4)
    figures = account(pinned.system, pinned.recording, pinned.t - 0.4, pinned.t)
    assert figures is not None
    now = account(noisy.loop.system, noisy.recording, noisy.loop.t - 0.4, noisy.loop.t)
    assert now is not None
    assert 2.0 < (times := figures.path_rms / now.path_rms) < 10.0
    assert f'<td>{1e3 * figures.path_rms:.3g} <span class="vs-dim vs-against">({times:.1f} ×)</span></td>' in html
    assert "—" not in html
    same = table_html(cast(Snapshot, seen), 0.4, over="same")  # the last instants that both have
    assert "—" not in same
    then = account(noisy.loop.system, noisy.recording, pinned.t - 0.4, pinned.t)
    assert then is not None
    assert then.path_max == figures.path_max
    assert f"<td>{1e3 * then.path_rms:.3g}</td>" in same


def test_a_fork_keeps_of_the_run_that_it_leaves_what_came_after_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timeline, "PINNED", 0.6)
    monkeypatch.setattr(timeline, "BEFORE", 0.1)
    line = run(line_of(shipped()["planar3r-hybrid"]), 2000)
    rows = line.recording.rows()
    line.seek(0.4)
    line.fork()
    left = line.pinned[-1]
    assert left.t == pytest.approx(0.9)
    np.testing.assert_array_equal(left.recording.rows(0.4, 0.9), rows[(rows[:, 0] >= 0.4) & (rows[:, 0] <= 0.9)])
    assert left.recording.rows()[-1, 0] == pytest.approx(0.9)


def test_a_pinned_run_is_told_by_what_it_has_run_with() -> None:
    line = run(line_of(shipped()["planar3r-hybrid"]), 300)
    line.edit(edited(line.loop.system.scenario, "force.value", 11.0))
    line.pin()
    assert line.pinned[-1].scenario.force.value == 20.0
    run(line, 10)
    line.pin()
    assert line.pinned[-1].scenario.force.value == 11.0


def test_a_run_is_pinned_once_and_the_pins_of_another_session_come_before_those_of_this_one(noisy: Timeline) -> None:
    other = run(line_of(shipped()["ur5-motion"]), 20)
    other.pin()
    other.rename(1, "yesterday")
    noisy.seek(0.3)
    noisy.pin()  # as the click on a tile does
    noisy.edit(edited(noisy.loop.system.scenario, "force.value", 10.0))
    assert [pinned.number for pinned in noisy.pinned] == [1]
    run(noisy, 50)
    noisy.seek(0.32)
    noisy.edit(edited(noisy.loop.system.scenario, "force.value", 15.0))
    assert [pinned.number for pinned in noisy.pinned] == [1, 2]
    noisy.rename(2, "mine")
    noisy.adopt(other.pinned)
    assert [pinned.title for pinned in noisy.pinned] == ["yesterday", "run 2", "mine"]
    assert len({pinned.number for pinned in noisy.pinned}) == len({pinned.slot for pinned in noisy.pinned}) == 3
    noisy.adopt(other.pinned)  # has all places but one
    assert [pinned.title for pinned in noisy.pinned] == ["yesterday", "run 2", "mine"]


def test_a_pinned_run_has_a_name_and_a_colour_of_its_own(noisy: Timeline) -> None:
    for _ in range(PINS + 1):
        run(noisy, 10)
        noisy.pin()
    noisy.unpin(3)
    run(noisy, 10)
    noisy.pin()
    assert [pinned.title for pinned in noisy.pinned] == ["run 2", "run 4", "run 5"]
    assert {pinned.slot for pinned in noisy.pinned} == set(range(PINS))
    before = noisy.pinned[1]
    noisy.rename(4, "stiff")
    assert noisy.pinned[1].title == "stiff"
    assert (noisy.pinned[1].recording, noisy.pinned[1].slot) == (before.recording, before.slot)
    with pytest.raises(ScenarioError, match="name of run 4: 25 letters; allowed: at most 24"):
        noisy.rename(4, "x" * 25)
    with pytest.raises(ScenarioError, match="there is no such pinned run"):
        noisy.rename(9, "x")
    noisy.rename(4, "")
    assert noisy.pinned[1].title == "run 4"


def test_two_pinned_runs_never_have_one_name(noisy: Timeline) -> None:
    for _ in range(PINS):
        run(noisy, 10)
        noisy.pin()
    noisy.rename(1, "stiff")
    for number, name in ((2, "stiff"), (2, "run 3"), (2, "run 1"), (2, "run 4")):  # 1 and 4 have this name later
        with pytest.raises(ScenarioError) as refused:
            noisy.rename(number, name)
        assert str(refused.value) == f"name of run {number}: {name} is another run; allowed: another name"
    assert [pinned.title for pinned in noisy.pinned] == ["stiff", "run 2", "run 3"]
    noisy.rename(1, "stiff")
    noisy.rename(2, "run 2")
    noisy.rename(2, "running")
    noisy.rename(2, "")
    other = run(line_of(shipped()["ur5-motion"]), 20)
    other.pin()
    other.rename(1, "stiff")
    other.adopt(tuple(replace(pinned, number=pinned.number + 1) for pinned in noisy.pinned[:1]))
    assert [pinned.title for pinned in other.pinned] == ["stiff", "run 3"]
    # of files that an earlier version has written
    older = [
        replace(pinned, number=7 + i, name=name)
        for i, (pinned, name) in enumerate(zip(noisy.pinned, ("run 8", "soft", "soft"), strict=True))
    ]
    other.adopt(tuple(older))
    assert [pinned.title for pinned in other.pinned] == ["run 7", "soft", "run 9"]


def test_the_arm_of_another_run_with_the_same_number_is_another_arm(monkeypatch: pytest.MonkeyPatch) -> None:
    views: list[MagicMock] = []

    def view(_: object, robot: Robot, *__: object) -> MagicMock:
        views.append(MagicMock(robot=robot))
        return views[-1]

    monkeypatch.setattr(pinned_arms, "RobotView", view)
    shown = pinned_arms.PinnedArms(MagicMock(), lambda: "/arm")
    for name in ("ur5-hybrid", "planar2r-semicircle"):
        line = run(line_of(shipped()[name]), 5)
        line.pin()
        seen = SimpleNamespace(pinned=line.pinned, t=0.002, scenario=shipped()[name])
        for _ in range(2):
            shown.show(cast(Snapshot, seen), wanted=True)
        views[-1].set_visible.assert_called_with(visible=True)
    seen.scenario = shipped()["panda-hybrid"]
    shown.show(cast(Snapshot, seen), wanted=True)
    views[-1].set_visible.assert_called_with(visible=False)  # an arm of another kind has no place beside this one
    assert [view.robot.n for view in views] == [6, 2]
    assert [view.remove.call_count for view in views] == [1, 0]
    assert [len(view.show.call_args.args[0]) for view in views] == [6, 2]
