"""Player of a lesson's runs without a page; on a page, the runner makes the same edits at the same instants."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from app.analysis.thinning import BucketGrid
from app.lessons.blocks import Goal, LessonRun, PictureLine
from app.lessons.lesson import Lesson, LessonStep
from app.lessons.measures import MeasuredNumber, factor_for, measured, si_unit_of, signal_of, taken
from app.scenario.data import edited, field_of, with_value, with_values
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.session.commands import Perform, TimedChange
from app.simulation.closed_loop import ClosedLoop
from app.simulation.omega.search_memory import Memory
from app.simulation.recording import Recording
from app.simulation.system import System

POINTS = 400  # of a line


@dataclass(frozen=True)
class Trace:
    """Points of a line of a run's picture.
    run: title of the run.
    t: (N,) s.
    values: (N,) in the unit of the line, nan where the signal has none."""

    run: str
    line: PictureLine
    t: np.ndarray
    values: np.ndarray

    def at(self, t: np.ndarray) -> np.ndarray:
        """Values at t s, on straight lines between the known points."""
        known = np.isfinite(self.values)
        return np.interp(t, self.t[known], self.values[known])


@dataclass(frozen=True)
class LessonOutcome:
    """Outcome of a lesson's run.
    measurements: measured numbers by name.
    traces: lines of the run's picture.
    q: (n,) rad, joint angles in the last control period.
    refusal: sentence with which an edit was refused, "" for none.
    stopped: reason for which the run ended early, "" for none."""

    measurements: dict[str, MeasuredNumber]
    traces: tuple[Trace, ...]
    q: np.ndarray
    refusal: str = ""
    stopped: str = ""


def performance(step: LessonStep) -> Perform:
    """Command that plays a step's run on the page."""
    run, scenario = _run_of(step)
    changes, so_far = [], scenario
    for edit in sorted(run.edits, key=lambda each: each.at):
        field = field_of(edit.set)
        try:
            so_far = with_value(so_far, edit.set, edit.value)
        except ScenarioError:  # the run refuses it at its instant, and says so
            changes.append(TimedChange(edit.at, edit.set, edit.value))
            continue
        changes.append(TimedChange(edit.at, field, _plain(so_far, field) if field != edit.set else edit.value))
    return Perform(scenario, tuple(changes), run.seconds)


def play(step: LessonStep, memory: Memory | None = None) -> LessonOutcome:
    """Outcome of a step's run. Raises ScenarioError."""
    performed = performance(step)
    loop, refusal = ClosedLoop.from_scenario(performed.scenario, memory=memory), ""
    waiting = list(performed.changes)
    while loop.stopped is None and loop.t < performed.end - 0.5 * loop.period:
        while waiting and waiting[0].due(loop.t, loop.period):
            change = waiting.pop(0)
            before = loop.recording
            try:
                loop.edit(edited(loop.system.scenario, change.path, change.value))
            except ScenarioError as error:
                refusal = str(error)
            if loop.recording is not before:
                raise ScenarioError(f"edits: {change.path} begins a run anew; allowed: fields that change within a run")
        loop.advance()
    if not len(loop.recording):
        reason = loop.stopped or f"seconds: {performed.end:g}; allowed: at least a control period, {loop.period:g} s"
        raise ScenarioError(f"nothing is recorded: {reason}")
    run, _ = _run_of(step)
    measurements = {name: measured(loop, each) for name, each in run.measures.items()}
    lines = tuple(_trace(loop.system, loop.recording, line, run.title) for line in run.show)
    return LessonOutcome(measurements, lines, last_q(loop.recording), refusal, loop.stopped or "")


def last_q(recording: Recording) -> np.ndarray:
    """Joint angles (n,) rad of a recording's last row; an empty array for an empty recording."""
    pieces = recording.pieces()
    return pieces[-1][-1, recording.columns["q"]].copy() if pieces else np.empty(0)


def _trace(system: System, recording: Recording, line: PictureLine, title: str) -> Trace:
    """Points of a line of a picture, thinned so that the extremes stay. Raises ScenarioError."""
    record = recording.stretch()
    if len(record["t"]) < 2:
        raise ScenarioError(f"show: {line.signal!r:.40}: nothing is recorded; allowed: a run that lasts")
    values = signal_of(system, record, line.signal)
    values = factor_for(line.unit, si_unit_of(system, line.signal), f"the signal {line.signal}") * values
    t, known = record["t"], np.isfinite(values)
    if len(t) > POINTS:
        grid = BucketGrid.over(float(t[0]), float(t[-1]), POINTS // 2)
        t, values = grid.times, grid.thin(t[known], values[known, None])[:, 0]
    there = np.flatnonzero(np.isfinite(values))
    stretch = slice(there[0], there[-1] + 1)
    return Trace(title, line, t[stretch], values[stretch])


class GoalRunStopped(ScenarioError):
    """The run of a goal that stops before its end: the goal is missed."""


def reached(step: LessonStep, values: dict[str, float], memory: Memory | None = None) -> dict[str, MeasuredNumber]:
    """Measured numbers of a goal, by name, at the end of its run with these values of its controls, by path. Raises
    GoalRunStopped, and ScenarioError."""
    goal = step.block
    assert isinstance(goal, Goal)
    assert step.scenario is not None
    loop = ClosedLoop.from_scenario(with_values(step.scenario, dict(values)), memory=memory)
    while loop.stopped is None and loop.t < goal.seconds - 0.5 * loop.period:
        loop.advance()
    if loop.stopped:
        raise GoalRunStopped(f"the run stops: {loop.stopped}")
    return {name: taken(loop.system, loop.recording, loop.t, each) for name, each in goal.measures.items()}


def _run_of(step: LessonStep) -> tuple[LessonRun, Scenario]:
    assert step.run is not None
    assert step.scenario is not None
    return step.run, step.scenario


def _plain(scenario: Scenario, field: str) -> object:
    value: object = scenario
    for part in field.split("."):
        value = getattr(value, part)
    return value


def runs(lesson: Lesson) -> list[LessonStep]:
    """Steps of a lesson that are runs."""
    return [step for step in lesson.steps if step.run]
