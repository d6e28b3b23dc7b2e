"""Blocks of a lesson, which its file holds as fenced TOML: a class for each kind."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct

from parameters import ONE_LINE

Name = Annotated[str, Meta(pattern="^[a-z][a-z0-9_]{0,39}$")]
# a control character does not fit into an SVG, and would steer a terminal
Text = Annotated[str, Meta(min_length=1, max_length=600, pattern=r"^[^\x00-\x09\x0b-\x1f\x7f-\x9f\ufffe\uffff]*\Z")]
Title = Annotated[str, Meta(min_length=1, max_length=600, pattern=ONE_LINE)]
Statistic = Literal["mean", "largest", "least", "peak", "rms", "last", "span", "variation", "settles", "below"]


class Block(Struct, frozen=True, forbid_unknown_fields=True):
    """Block of a lesson; fields that no block has are refused."""


class Head(Block, frozen=True):
    """Head of a lesson, its first block.
    minutes: time for the lesson.
    knows: things that one knows after the lesson, a sentence each.
    language: code as in HTML, such as en or de."""

    title: Title
    minutes: Annotated[float, Meta(gt=0, le=120)]
    knows: Annotated[tuple[Text, ...], Meta(min_length=1)]
    language: Annotated[str, Meta(pattern="^[a-z]{2}$")] = "en"


class StartScenario(Block, frozen=True):
    """Scenario from which the following steps begin.
    base: a shipped scenario.
    set: other values of its fields, by dotted path; "target_model.K_m.2" is the second entry of a list."""

    base: Text
    set: dict[str, Any] = msgspec.field(default_factory=dict)


class Measure(Block, frozen=True):
    """Measure of a run: a statistic of a signal, or a metric of the whole run.

    unit: of the number, a key of `measures.UNITS` that fits the signal; s or ms for the statistics that are times.
    signal: field of the recording, "e_r.1" for its first entry; or "force_error", "path_error" or "contact_force".
    metric: field of metrics.json, in place of a signal.
    statistic: of the signal. peak: largest size. span: largest minus least. variation: sum of sizes of changes, per s.
    settles: time until the signal stays within 2 % of its largest deviation from its final value. below: time until its
    size stays below `level`.
    start, end: of the interval that is measured, s of the run.
    last: length of this interval, s, in place of start.
    level: for the statistic below, in SI units.
    title: of the measured number, in sentences to the student.
    """

    unit: str
    signal: str | None = None
    metric: str | None = None
    statistic: Statistic = "last"
    start: Annotated[float, Meta(ge=0)] = 0.0
    end: Annotated[float, Meta(gt=0)] | None = None
    last: Annotated[float, Meta(gt=0)] | None = None
    level: float | None = None
    title: Title | None = None

    def interval(self, now: float) -> tuple[float, float]:
        """Interval that is measured, s of the run, which has come to `now`."""
        end = now if self.end is None else min(self.end, now)
        return self.start if self.last is None else max(end - self.last, 0.0), end


class Condition(Block, frozen=True):
    """Condition on a measure.
    measure: its name.
    above, below: limits, a number in the measure's unit or the name of another measure.
    times: factor of the limits."""

    measure: Name
    above: float | Name | None = None
    below: float | Name | None = None
    times: float = 1.0


class TimedEdit(Block, frozen=True):
    """Edit of a field, by dotted path, at an instant (s) of a run."""

    at: Annotated[float, Meta(ge=0, le=600)]
    set: str
    value: Any


class PictureLine(Block, frozen=True):
    """Line of a run's picture.
    signal: as in `Measure`.
    unit: of the drawn values, a key of `measures.UNITS` that fits the signal.
    title: of the line in the picture."""

    signal: str
    unit: str
    title: Title

    def shows(self, other: PictureLine) -> bool:
        """Whether both lines show the same signal in the same unit, under any title."""
        return (self.signal, self.unit) == (other.signal, other.unit)


class LessonRun(Block, frozen=True):
    """Run of the lesson's scenario.

    title: of the run, in pictures.
    seconds: length of the run.
    show: lines of the run's picture.
    measures: by the names that later texts, predictions and conditions use.
    set: other values of the scenario's fields, by dotted path, from the start on.
    edits: of fields during the run.
    beside: titles of earlier runs whose lines are drawn in the picture, too.
    refused: part of the sentence with which the last edit must be refused.
    stops: part of the reason for which the run must stop early.
    """

    title: Title
    seconds: Annotated[float, Meta(gt=0, le=60)]
    show: Annotated[tuple[PictureLine, ...], Meta(min_length=1, max_length=3)]
    measures: dict[Name, Measure] = msgspec.field(default_factory=dict)
    set: dict[str, Any] = msgspec.field(default_factory=dict)
    edits: tuple[TimedEdit, ...] = ()
    beside: tuple[str, ...] = ()
    refused: str | None = None
    stops: str | None = None


class ChoiceQuestion(Block, frozen=True, tag_field="kind", tag="choice"):
    """Question with options.
    ask: text of the question.
    right: number of the right option, from 1.
    because: conditions that hold for the measured numbers if this option is right."""

    ask: Text
    options: Annotated[tuple[Title, ...], Meta(min_length=2, max_length=5)]
    right: Annotated[int, Meta(ge=1)]
    because: tuple[Condition, ...] = ()

    def __post_init__(self) -> None:
        if self.right > len(self.options):
            raise ValueError(f"right: {self.right}; allowed: 1 to {len(self.options)}")


class NumberQuestion(Block, frozen=True, tag_field="kind", tag="number"):
    """Question for a number.
    ask: text of the question.
    measure: name of the measure that is asked for; answers are in its unit.
    tolerance: largest error of a right answer.
    wrong: answers that must be scored as wrong."""

    ask: Text
    measure: Name
    tolerance: Annotated[float, Meta(gt=0)]
    wrong: Annotated[tuple[float, ...], Meta(min_length=1)]


class CurveQuestion(Block, frozen=True, tag_field="kind", tag="curve"):
    """Question for a signal's curve over time, which the student draws.

    ask: text of the question.
    line: signal and unit that are asked for.
    start, end: of the time axis, s of the run.
    low, high: of the value axis, in the line's unit.
    tolerance: largest RMS error of a right curve, in the line's unit.
    wrong: curves that must be scored as wrong, each as [t, value] points.
    """

    ask: Text
    line: PictureLine
    start: Annotated[float, Meta(ge=0)]
    end: Annotated[float, Meta(gt=0)]
    low: float
    high: float
    tolerance: Annotated[float, Meta(gt=0)]
    wrong: Annotated[tuple[tuple[tuple[float, float], ...], ...], Meta(min_length=1)]

    def __post_init__(self) -> None:
        if not (self.start < self.end and self.low < self.high):
            raise ValueError("start, end, low, high: allowed: start before end, low below high")
        for points in self.wrong:
            t = [at for at, _ in points]
            if len(t) < 2 or t != sorted(t):
                raise ValueError(f"wrong: {len(t)} points; allowed: at least 2 in each curve, from left to right")


Question = ChoiceQuestion | NumberQuestion | CurveQuestion


class Explain(Block, frozen=True):
    """Explanation: shows the text above this block, and scores the predictions.
    equation: its number in the paper."""

    equation: str = ""


class GoalSlider(Block, frozen=True):
    """Control of a goal, a slider.
    path: dotted path of the scenario's field that it changes.
    low, high: range of the slider.
    reference: value with which the goal is reached.
    wrong: value with which the goal is not reached."""

    path: str
    label: Title
    low: float
    high: float
    reference: float
    wrong: float
    logarithmic: bool = False

    def __post_init__(self) -> None:
        if not self.low < self.high or (self.logarithmic and self.low <= 0.0):
            raise ValueError(f"low, high: {self.low:g} to {self.high:g}; allowed: low below high, logarithmic above 0")


class Goal(Block, frozen=True):
    """Goal: conditions that the student fulfils with some controls, while all others are locked.
    ask: text of the task.
    seconds: instant of a run at which it is judged, s; nothing may be changed on the way.
    measures: by the names that the conditions use.
    set: other values of the scenario's fields, by dotted path."""

    ask: Text
    seconds: Annotated[float, Meta(gt=0, le=60)]
    controls: Annotated[tuple[GoalSlider, ...], Meta(min_length=1, max_length=4)]
    measures: dict[Name, Measure]
    conditions: Annotated[tuple[Condition, ...], Meta(min_length=1)]
    set: dict[str, Any] = msgspec.field(default_factory=dict)


Content = StartScenario | ChoiceQuestion | NumberQuestion | CurveQuestion | LessonRun | Explain | Goal
KINDS: dict[str, Any] = {
    "lesson": Head,
    "scenario": StartScenario,
    "predict": Question,
    "run": LessonRun,
    "observe": Question,
    "explain": Explain,
    "goal": Goal,
}
