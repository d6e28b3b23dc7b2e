"""A push by the button: of its run only, whatever begins the next one."""

from __future__ import annotations

from typing import cast

import numpy as np
import pytest

from app.dashboard.widgets.run.whatif import around
from app.scenario.data import edited, shipped
from app.session.autosave import _subject
from app.session.commands import BeginScenario, Command, Edit, Load, PushNow, Reset
from app.session.runner import Runner
from app.simulation.builders.restarts import begins_anew
from app.simulation.closed_loop import ClosedLoop

OWN = {"push_start": 0.2, "push_every": 0.3, "push_duration": 0.05}


def pushes(runner: Runner, periods: int) -> list[float]:
    """Instants (s) at which pushes begin within so many periods."""
    for _ in range(periods):
        runner._commanded.step()
    record = runner._loop.recording.signals(("t", "F_push"))
    pushed = record["F_push"].any(axis=1)
    return record["t"][pushed & ~np.append(False, pushed[:-1])].tolist()


@pytest.mark.parametrize("name", ["planar3r-hybrid", "ur5-heavy"])
@pytest.mark.parametrize("again", [Reset(), Edit("task_space.characteristic_length", 0.2), "stopped"])
def test_a_push_by_the_button_is_of_its_run_only(name: str, again: Command | str) -> None:
    own = shipped()[name]
    for field, value in OWN.items():
        own = edited(own, f"truth.{field}", value)
    alone = pushes(Runner(own), 600)
    assert bool(alone) == (name == "ur5-heavy")
    runner = Runner(own)
    pushes(runner, 250)
    runner._obey([PushNow()])
    pushes(runner, 50)
    runner._obey([PushNow(), Edit("controller.layer", 0.03)])
    own = edited(own, "controller.layer", 0.03)
    done = runner._publish().scenario
    assert done.truth.push_start == pytest.approx(0.3)  # what is saved and exported is what happened
    pushes(runner, 20)
    assert runner._loop.recording.at(runner._loop.t)["F_push"].any()
    if again == "stopped":
        runner._loop.fail("the arm", ArithmeticError("torn"))
        again = Edit("controller.layer", 0.02)
    revision = runner._publish().revision
    runner._obey([cast(Command, again)])
    begun = runner._publish()
    expected = edited(own, again.path, again.value) if isinstance(again, Edit) else own
    assert (begun.t, begun.scenario) == (0.0, expected)
    assert begun.revision > revision
    assert [epoch.t for epoch in runner._loop.recording.epochs] == [0.0]
    if isinstance(again, Reset):
        assert pushes(runner, 600) == alone
        fresh = ClosedLoop.from_scenario(own)
        for _ in range(600):
            fresh.step()
        np.testing.assert_array_equal(runner._loop.recording.rows(), fresh.recording.rows())


def test_what_was_edited_after_a_push_by_the_button_and_another_scenario_stay_as_they_are() -> None:
    runner = Runner(shipped()["ur5-hybrid"])
    own = runner._publish().scenario.truth
    pushes(runner, 20)
    runner._obey([PushNow(), Edit("truth.push", [0.0, 5.0, 0.0]), PushNow(), Reset()])
    truth = runner._publish().scenario.truth
    assert truth.push == (0.0, 5.0, 0.0)
    assert (truth.push_start, truth.push_duration) == (own.push_start, own.push_duration)
    pushes(runner, 20)
    runner._obey([PushNow()])
    runner._loop.fail("the arm", ArithmeticError("torn"))
    runner._obey([PushNow()])  # begins a new run, which it pushes at once
    assert runner._publish().scenario.truth.push_start == 0.0
    runner._obey([Reset()])
    assert runner._publish().scenario.truth == truth
    pushes(runner, 20)
    runner._obey([PushNow()])
    saved = runner._publish().scenario
    for command in (Load(saved), BeginScenario(saved), Reset()):
        runner._obey([command])
        assert runner._publish().scenario == saved


def test_a_second_push_in_a_run_that_the_first_one_has_stopped_is_a_push() -> None:
    runner = Runner(own := shipped()["ur5-hybrid"])
    pushes(runner, 20)
    runner._obey([PushNow()])
    runner._loop.fail("the arm", ArithmeticError("torn"))
    runner._obey([PushNow()])
    assert pushes(runner, 40) == pytest.approx([0.0], abs=0.0015)
    runner._obey([Reset()])
    assert runner._publish().scenario == own


def test_a_push_by_the_button_is_neither_saved_for_another_server_nor_in_the_preview_of_a_new_run() -> None:
    runner = Runner(own := shipped()["ur5-hybrid"])
    pushes(runner, 20)
    runner._obey([PushNow()])
    now = runner._publish()
    assert now.scenario.truth.push_start == pytest.approx(0.02)
    assert _subject(now)[0] == own
    goes_on, anew = Edit("controller.layer", 0.02), Edit("simulation.domain_radius", 0.1)
    assert around(now, goes_on) == (now.scenario, edited(now.scenario, goes_on.path, goes_on.value))
    assert around(now, anew) == (own, edited(own, anew.path, anew.value))
    assert begins_anew(now.scenario, edited(now.scenario, anew.path, anew.value))
