"""Goals of lessons: judged once, at their instant, and only in a run in which nothing was changed on the way."""

from __future__ import annotations

import pytest

from app.lessons.blocks import Goal
from app.lessons.goals import GoalResult, goal_result
from app.lessons.lesson import load
from app.lessons.words import ENGLISH, GERMAN, LessonWords
from app.scenario.data import with_values
from app.simulation.closed_loop import ClosedLoop
from app.storage.constants_store import kept_memory

LESSON = load("01-target-model").steps[-1]
CALM, RESTLESS = 290.0, 60.0  # N·s/m


def loop_with(damping: float) -> tuple[Goal, ClosedLoop]:
    assert isinstance(LESSON.block, Goal)
    assert LESSON.scenario is not None
    return LESSON.block, ClosedLoop.from_scenario(
        with_values(LESSON.scenario, {"target_model.B_m.2": damping}), memory=kept_memory()
    )


def judgement(loop: ClosedLoop, words: LessonWords = ENGLISH) -> GoalResult:
    return goal_result(LESSON, loop.system, loop.recording, loop.t, stopped=loop.stopped is not None, words=words)


def run_to(loop: ClosedLoop, t: float) -> None:
    while loop.t < t - 0.5 * loop.period:
        loop.advance()


@pytest.mark.parametrize(("damping", "reached"), [(CALM, True), (RESTLESS, False)])
def test_a_goal_is_judged_at_its_instant_and_waiting_changes_nothing(damping: float, reached: bool) -> None:
    goal, loop = loop_with(damping)
    run_to(loop, goal.seconds - 0.1)
    assert judgement(loop).waiting.endswith("another 0.1 s to go.")
    assert judgement(loop, GERMAN).waiting == (
        "Das Ziel wird bei t = 4 s beurteilt, in einem Lauf von Anfang an, ohne Änderung auf dem Weg: noch 0,1 s."
    )
    run_to(loop, goal.seconds)
    at_its_instant = judgement(loop)
    assert at_its_instant.reached == reached
    run_to(loop, 2.0 * goal.seconds)  # the restless model has calmed down by now, too
    assert judgement(loop) == at_its_instant


def test_a_run_that_was_changed_on_its_way_is_not_judged() -> None:
    goal, loop = loop_with(RESTLESS)
    run_to(loop, 1.0)
    loop.edit(with_values(loop.system.scenario, {"target_model.B_m.2": CALM}))
    run_to(loop, 2.0 * goal.seconds)
    assert judgement(loop).waiting.startswith("Changed at t = 1.0 s: try it again.")
    assert judgement(loop, GERMAN).waiting.startswith("Bei t = 1,0 s geändert: noch einmal versuchen.")


def test_a_run_that_has_stopped_is_not_waited_for() -> None:
    goal, loop = loop_with(CALM)
    run_to(loop, 0.1)
    verdict = goal_result(LESSON, loop.system, loop.recording, loop.t, stopped=True)
    assert verdict.waiting == f"The run has stopped before t = {goal.seconds:g} s: try it again."


def test_a_change_after_the_judgement_takes_nothing_back() -> None:
    goal, loop = loop_with(CALM)
    run_to(loop, goal.seconds + 0.5)
    loop.edit(with_values(loop.system.scenario, {"target_model.B_m.2": RESTLESS}))
    run_to(loop, goal.seconds + 1.0)
    assert judgement(loop).reached


def test_the_run_of_an_earlier_step_is_not_judged() -> None:
    _, loop = loop_with(CALM)
    earlier = ClosedLoop.from_scenario(
        with_values(loop.system.scenario, {"target_model.M_m.2": 10.0}), memory=kept_memory()
    )
    run_to(earlier, 5.0)
    assert judgement(earlier).waiting.startswith("It is judged at t = 4 s")
