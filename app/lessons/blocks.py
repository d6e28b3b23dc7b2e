"""Blocks of a lesson: what its fenced TOML says, kind by kind."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct

Name = Annotated[str, Meta(pattern="^[a-z][a-z0-9_]{0,39}$")]
Text = Annotated[str, Meta(min_length=1, max_length=600)]
Statistic = Literal["mean", "largest", "least", "peak", "rms", "last", "span", "variation", "settles", "below"]


class Block(Struct, frozen=True, forbid_unknown_fields=True):
    """Block of a lesson."""


class Head(Block, frozen=True):
    """First block of a lesson.
    minutes: that it takes.
    knows: what one will know afterwards, a sentence each.
    language: as in HTML, such as en or de."""

    title: Text
    minutes: Annotated[float, Meta(gt=0, le=120)]
    knows: Annotated[tuple[Text, ...], Meta(min_length=1)]
    language: Annotated[str, Meta(pattern="^[a-z]{2}$")] = "en"


class Setting(Block, frozen=True):
    """Scenario from which the following steps begin.
    base: a shipped scenario.
    set: other values of its fields, by dotted path; "target_model.K_m.2" is the second entry of a list."""

    base: Text
    set: dict[str, Any] = msgspec.field(default_factory=dict)


class Measure(Block, frozen=True):
    """Number that is measured in a run: a statistic of a signal, or a figure of the whole run.

    signal: of the recording, "e_r.1" for its first number, or "force_error", "path_error" or "contact_force".
    metric: field of metrics.json, in place of a signal.
    statistic: of the signal. peak: largest size. span: largest minus least. variation: sum of sizes of changes, per s.
    settles: s until it stays within 2 % of its largest deviation from its end. below: s until its size stays below
    `level`.
    start, end: s, of the run; last: so many s before its end, in place of start.
    unit: in which it is told, one that `measures.FACTORS` knows.
    """

    unit: str
    signal: str | None = None
    metric: str | None = None
    statistic: Statistic = "last"
    start: Annotated[float, Meta(ge=0)] = 0.0
    end: Annotated[float, Meta(gt=0)] | None = None
    last: Annotated[float, Meta(gt=0)] | None = None
    level: float | None = None


class Condition(Block, frozen=True):
    """Comparison of a measure with a number in its unit, or with another measure `times` a factor."""

    measure: Name
    above: float | Name | None = None
    below: float | Name | None = None
    times: float = 1.0


class TimedEdit(Block, frozen=True):
    """Edit of a field, by dotted path, at an instant (s) of a run."""

    at: Annotated[float, Meta(ge=0, le=600)]
    set: str
    value: Any


class Line(Block, frozen=True):
    """Signal of the picture of a run, told in a unit; title: what it is called there."""

    signal: str
    unit: str
    title: Text

    def shows(self, other: Line) -> bool:
        """Whether it shows the same, whatever it is called."""
        return (self.signal, self.unit) == (other.signal, other.unit)


class Run(Block, frozen=True):
    """Run of so many seconds from the lesson's scenario.

    title: what its lines are called.
    set: other values of fields from the start on; edits: later ones.
    show: what the picture of the run shows; beside: titles of earlier runs whose lines are drawn there, too.
    measures: by names that later texts, predictions and conditions use.
    refused: part of the sentence with which the last edit must be refused.
    stops: part of the reason for which it must stop before its end.
    """

    title: Text
    seconds: Annotated[float, Meta(gt=0, le=60)]
    show: Annotated[tuple[Line, ...], Meta(min_length=1, max_length=3)]
    measures: dict[Name, Measure] = msgspec.field(default_factory=dict)
    set: dict[str, Any] = msgspec.field(default_factory=dict)
    edits: tuple[TimedEdit, ...] = ()
    beside: tuple[str, ...] = ()
    refused: str | None = None
    stops: str | None = None


class Choice(Block, frozen=True, tag_field="kind", tag="choice"):
    """Question with options, of which number `right`, from 1, is right.
    because: what is measured if that is so."""

    ask: Text
    options: Annotated[tuple[Text, ...], Meta(min_length=2, max_length=5)]
    right: Annotated[int, Meta(ge=1)]
    because: tuple[Condition, ...] = ()

    def __post_init__(self) -> None:
        if self.right > len(self.options):
            raise ValueError(f"right: {self.right}; allowed: 1 to {len(self.options)}")


class Number(Block, frozen=True, tag_field="kind", tag="number"):
    """Question for a number in the unit of a measure, which is right within the tolerance.
    wrong: answers that must not count."""

    ask: Text
    measure: Name
    tolerance: Annotated[float, Meta(gt=0)]
    wrong: Annotated[tuple[float, ...], Meta(min_length=1)]


class Curve(Block, frozen=True, tag_field="kind", tag="curve"):
    """Question for a signal's course, drawn on the axes of its picture.

    run: title of the run that follows.
    start, end: s; low, high: in the unit of the line.
    tolerance: RMS of what is drawn minus what is measured, in that unit.
    wrong: courses that must not count, each as [t, value] points.
    """

    ask: Text
    line: Line
    start: Annotated[float, Meta(ge=0)]
    end: Annotated[float, Meta(gt=0)]
    low: float
    high: float
    tolerance: Annotated[float, Meta(gt=0)]
    wrong: Annotated[tuple[tuple[tuple[float, float], ...], ...], Meta(min_length=1)]

    def __post_init__(self) -> None:
        if not (self.start < self.end and self.low < self.high):
            raise ValueError("start, end, low, high: allowed: start before end, low below high")


Question = Choice | Number | Curve


class Explain(Block, frozen=True):
    """Explanation: the text above it, shown after the run.
    equation: the paper's number."""

    equation: str = ""


class Control(Block, frozen=True):
    """Slider of a goal: its field by dotted path, its label and range.
    reference: a value with which the goal is reached; wrong: one with which it is not."""

    path: str
    label: Text
    low: float
    high: float
    reference: float
    wrong: float
    logarithmic: bool = False

    def __post_init__(self) -> None:
        if not self.low < self.high or (self.logarithmic and self.low <= 0.0):
            raise ValueError(f"low, high: {self.low:g} to {self.high:g}; allowed: low below high, logarithmic above 0")


class Goal(Block, frozen=True):
    """Goal: conditions on measures of the last seconds, to be reached with these controls while others are locked.
    seconds: of a run after which the reference reaches it."""

    ask: Text
    seconds: Annotated[float, Meta(gt=0, le=60)]
    controls: Annotated[tuple[Control, ...], Meta(min_length=1, max_length=4)]
    measures: dict[Name, Measure]
    conditions: Annotated[tuple[Condition, ...], Meta(min_length=1)]
    set: dict[str, Any] = msgspec.field(default_factory=dict)


Content = Setting | Choice | Number | Curve | Run | Explain | Goal
KINDS: dict[str, Any] = {
    "lesson": Head,
    "scenario": Setting,
    "predict": Question,
    "run": Run,
    "observe": Question,
    "explain": Explain,
    "goal": Goal,
}
