"""Judgement of a lesson's goal: once, at its instant of a run in which nothing was changed on the way."""

from __future__ import annotations

from dataclasses import dataclass

from app.lessons.blocks import Goal
from app.lessons.measures import taken, unmet
from app.simulation.recording import Recording
from app.simulation.system import System


@dataclass(frozen=True)
class GoalResult:
    """Result of a goal.
    waiting: sentence on when it will be judged, "" where it is.
    missed: a sentence for each condition that does not hold."""

    waiting: str = ""
    missed: tuple[str, ...] = ()

    @property
    def reached(self) -> bool:
        return not self.waiting and not self.missed


def judged(
    goal: Goal, system: System, recording: Recording, changed: float, end: float, *, stopped: bool
) -> GoalResult:
    """Result of a goal in a run. Raises ScenarioError.
    changed: instant of the last change of the run, s; 0 for none on the way. end: of the run so far, s.
    stopped: whether the run has stopped for good."""
    when = f"judged at t = {goal.seconds:g} s of a run from the beginning, without a change on the way"
    if changed > 0.0:
        return GoalResult(f"Changed at t = {changed:.1f} s: try it anew. It is {when}.")
    if end < goal.seconds - 0.5 * system.scenario.controller.period:
        if stopped:
            return GoalResult(f"The run has stopped before t = {goal.seconds:g} s: try it anew.")
        return GoalResult(f"It is {when}: another {goal.seconds - end:.1f} s to go.")
    known = {name: taken(system, recording, goal.seconds, each) for name, each in goal.measures.items()}
    return GoalResult(missed=tuple(unmet(goal.conditions, known)))
