"""Check of a lesson: plays its runs, scores its reference answers and planted wrong ones, and reads its texts."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from app.access.classroom import POINTS
from app.lessons.answers import score_choice, score_curve, score_number
from app.lessons.blocks import ChoiceQuestion, CurveQuestion, Explain, Goal, LessonRun, NumberQuestion, StartScenario
from app.lessons.lesson import NAMED, Lesson, LessonStep
from app.lessons.measures import MeasuredNumber, unmet
from app.lessons.playing import GoalRunStopped, LessonOutcome, Trace, play, reached
from app.scenario.errors import ScenarioError
from app.simulation.closed_loop import ClosedLoop
from app.simulation.omega.search_memory import Memory

WORDS = 130.0  # read by a student per minute, with formulas between them
QUESTION, GOAL, LOOKING = 0.5, 2.0, 0.4  # minutes for an answer, for a goal, and for looking at the picture of a run
NEAR = 0.35  # share by which the estimated time may differ from the time that the lesson states


@dataclass
class Checked:
    """Result of the check of a lesson.
    measurements: all measured numbers, by name.
    outcomes: of the runs, by number of their step.
    minutes: estimated time for the lesson.
    problems: a sentence each."""

    lesson: Lesson
    measurements: dict[str, MeasuredNumber] = field(default_factory=dict)
    outcomes: dict[int, LessonOutcome] = field(default_factory=dict)
    minutes: float = 0.0
    problems: list[str] = field(default_factory=list)


def check(lesson: Lesson, memory: Memory | None = None) -> Checked:
    """Result of the check of a lesson, which is fit for a class where it has no problems."""
    checked = Checked(lesson)
    memory = memory or Memory()
    waiting: list[LessonStep] = []
    for step in lesson.steps:
        if step.kind == "observe" or isinstance(step.block, Explain):
            for question in waiting:
                checked.problems += _found(lesson, question, _scored(question, checked))
            waiting.clear()
        checked.problems += _found(lesson, step, _problems(step, checked, memory))
        if step.kind == "predict":
            waiting.append(step)
    checked.problems += [_at(lesson, step, "the question is never answered by a run") for step in waiting]
    checked.minutes = _minutes(lesson)
    if abs(checked.minutes / lesson.head.minutes - 1.0) > NEAR:
        checked.problems.append(
            f"{lesson.source}: it takes about {checked.minutes:.0f} minutes, and says {lesson.head.minutes:g}"
        )
    return checked


def _found(lesson: Lesson, step: LessonStep, problems: Iterator[str]) -> list[str]:
    """Problems of a step with its place, up to one that is an exception."""
    found: list[str] = []
    try:
        found.extend(_at(lesson, step, problem) for problem in problems)
    except (ScenarioError, ValueError) as error:
        found.append(_at(lesson, step, str(error)))
    return found


def _at(lesson: Lesson, step: LessonStep, problem: str) -> str:
    return f"{lesson.source}, line {step.line}: {step.kind}: {problem}"


def _problems(step: LessonStep, checked: Checked, memory: Memory) -> Iterator[str]:
    """Problems of a step, except those of a prediction's answers: they can be scored only after its run."""
    block = step.block
    for name in NAMED.findall(" ".join([step.text, getattr(block, "ask", ""), *getattr(block, "options", ())])):
        if name not in checked.measurements:
            yield f"{{{{{name}}}}} stands in the text and was not measured before"
    match block:
        case StartScenario():
            assert step.scenario is not None
            ClosedLoop.from_scenario(step.scenario, 1, memory=memory)
        case ChoiceQuestion() | NumberQuestion() | CurveQuestion() if step.kind == "observe":
            yield from _scored(step, checked)
        case LessonRun():
            outcome = play(step, memory)
            checked.outcomes[step.number] = outcome
            if again := [name for name in outcome.measurements if name in checked.measurements]:
                yield f"measures: {again[0]} is measured a second time; allowed: another name"
            titles = [run.title for each in checked.lesson.steps[: step.number - 1] if (run := each.run)]
            if strangers := [title for title in block.beside if title not in titles]:
                yield f"beside: {strangers[0]!r:.60}; allowed: titles of earlier runs"
            checked.measurements |= outcome.measurements
            for name, wanted, happened in (
                ("stops", block.stops, outcome.stopped),
                ("refused", block.refused, outcome.refusal),
            ):
                if (wanted or "") not in happened or bool(wanted) != bool(happened):
                    yield f"{name}: {wanted or 'nothing'}; what happened: {happened or 'nothing'}"
        case Goal():
            yield from _goal(step, memory)
        case _:
            pass


def _scored(step: LessonStep, checked: Checked) -> Iterator[str]:
    """Problems with the answers to a question whose outcome is known."""
    match step.block:
        case ChoiceQuestion() as question:
            if score_choice(question, question.right).points < 1.0:
                yield "the reference answer does not count in full"
            others = [k + 1 for k in range(len(question.options)) if k + 1 != question.right]
            if any(score_choice(question, other).points >= 1.0 for other in others):
                yield "a wrong option counts in full"
            yield from map(str, unmet(question.because, checked.measurements))
        case NumberQuestion() as question:
            if question.measure not in checked.measurements:
                yield f"measure {question.measure!r:.40}: no run before the explanation measures it"
                return
            measurement = checked.measurements[question.measure]
            if (
                not math.isfinite(measurement.value)
                or score_number(question, measurement.value, checked.measurements).points < 1.0
            ):
                yield "the reference answer does not count in full"
            for wrong in question.wrong:
                if score_number(question, wrong, checked.measurements).points >= 1.0:
                    yield f"the planted wrong answer {wrong:g} counts in full, measured {measurement}"
        case CurveQuestion() as question:
            trace = trace_for(step, checked.outcomes)
            if trace is None:
                yield f"curve: no run after it shows {question.line.signal!r:.40}"
                return
            inside = (trace.t >= question.start) & (trace.t <= question.end) & np.isfinite(trace.values)
            if inside.sum() < 2:
                yield "start, end: the run has ended before"
                return
            values = trace.values[inside]
            places = np.linspace(question.start, question.end, POINTS)  # as a hand can draw it
            reference = list(zip(places.tolist(), trace.at(places).tolist(), strict=True))
            if score_curve(question, reference, trace).points < 1.0:
                yield "the reference answer does not count in full"
            if values.min() < question.low or values.max() > question.high:
                yield f"low, high: what is measured goes from {values.min():.3g} to {values.max():.3g}"
            for wrong in question.wrong:
                if score_curve(question, [(t, value) for t, value in wrong], trace).points >= 1.0:
                    yield f"the planted wrong course that begins with {wrong[0]} counts in full"
        case _:
            pass


def trace_for(step: LessonStep, outcomes: dict[int, LessonOutcome]) -> Trace | None:
    """Measured line for a question with a drawn curve: the first line of a later run that shows its signal."""
    question = step.block
    assert isinstance(question, CurveQuestion)
    for number, outcome in sorted(outcomes.items()):
        if number > step.number:
            shows = (trace for trace in outcome.traces if trace.line.shows(question.line))
            if (found := next(shows, None)) is not None:
                return found
    return None


def _reaches(goal: Goal, step: LessonStep, values: dict[str, float], memory: Memory) -> bool:
    """Whether a goal is reached with these values of its controls, by path; not by a run that stops."""
    try:
        return not unmet(goal.conditions, reached(step, values, memory))
    except GoalRunStopped:
        return False


def _goal(step: LessonStep, memory: Memory) -> Iterator[str]:
    goal = step.block
    assert isinstance(goal, Goal)
    try:
        at_reference = reached(step, {control.path: control.reference for control in goal.controls}, memory)
        yield from (f"with the reference, {problem}" for problem in unmet(goal.conditions, at_reference))
    except GoalRunStopped as error:
        yield f"with the reference, {error}"
    if _reaches(goal, step, {control.path: control.wrong for control in goal.controls}, memory):
        yield "the planted wrong values reach the goal"
    if _reaches(goal, step, {}, memory):
        yield "the goal is reached before anything is done"
    for control in goal.controls:
        if not all(control.low <= value <= control.high for value in (control.reference, control.wrong)):
            yield f"{control.path}: reference and wrong; allowed: {control.low:g} to {control.high:g}"


def _minutes(lesson: Lesson) -> float:
    minutes = 0.0
    for step in lesson.steps:
        block = step.block
        question = getattr(block, "ask", "") + " ".join(getattr(block, "options", ()))
        minutes += len(re.findall(r"\w+", step.text + question)) / WORDS
        match block:
            case ChoiceQuestion() | NumberQuestion() | CurveQuestion():
                minutes += QUESTION
            case LessonRun():
                minutes += block.seconds / 60.0 + LOOKING
            case Goal():
                minutes += GOAL
            case _:
                pass
    return minutes
