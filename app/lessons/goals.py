"""Judgement of a lesson's goal: once, at its instant of a run in which nothing was changed on the way."""

from __future__ import annotations

from dataclasses import dataclass

from app.lessons.blocks import Goal
from app.lessons.lesson import LessonStep
from app.lessons.measures import Unmet, taken, unmet
from app.lessons.words import ENGLISH, LessonWords
from app.scenario.data import with_values
from app.scenario.schema import Scenario
from app.simulation.recording import Recording
from app.simulation.system import System


@dataclass(frozen=True)
class GoalResult:
    """Result of a goal.
    waiting: sentence on when it will be judged, "" where it is.
    missed: the conditions that do not hold."""

    waiting: str = ""
    missed: tuple[Unmet, ...] = ()

    @property
    def reached(self) -> bool:
        return not self.waiting and not self.missed


def goal_result(
    step: LessonStep,
    system: System,
    recording: Recording,
    end: float,
    *,
    stopped: bool,
    words: LessonWords = ENGLISH,
) -> GoalResult:
    """Result of a step's goal in a run. Raises ScenarioError.
    system: at the run's end. recording: of the whole run. end: of the run so far, s.
    stopped: whether the run has stopped for good."""
    goal = step.block
    assert isinstance(goal, Goal)
    seconds = words.number(f"{goal.seconds:g}")
    when = words.judged.format(seconds)
    half = 0.5 * system.scenario.controller.period
    begun, *later = recording.epochs
    if on_the_way := [epoch.t for epoch in later if epoch.t < goal.seconds - half]:
        return GoalResult(words.changed_at.format(words.number(f"{on_the_way[0]:.1f}"), when))
    if end < goal.seconds - half:
        if stopped:
            return GoalResult(words.stopped_before.format(seconds))
        return GoalResult(words.to_go.format(when, words.number(f"{goal.seconds - end:.1f}")))
    if not _is_of(step, begun.scenario):  # the run of an earlier step, of which the last rows are still to come
        return GoalResult(words.to_go.format(when, seconds))
    known = {name: taken(system, recording, goal.seconds, each) for name, each in goal.measures.items()}
    return GoalResult(missed=tuple(unmet(goal.conditions, known)))


def _is_of(step: LessonStep, scenario: Scenario) -> bool:
    """Whether a scenario is the step's, but for its controls."""
    assert isinstance(step.block, Goal)
    assert step.scenario is not None
    alike = {control.path: control.reference for control in step.block.controls}
    return with_values(scenario, dict(alike)) == with_values(step.scenario, dict(alike))
