"""Answers in a lesson: what a person clicks, writes, draws or sets for each kind of question, and for a goal."""

from __future__ import annotations

import re
from collections.abc import Callable, Coroutine
from html import escape

import msgspec
import viser

from app.dashboard.theme.style import ENTERED, MARKS, without_marks
from app.dashboard.transport.callback_errors import Fault
from app.dashboard.transport.page_values import PageEvent, from_pages
from app.dashboard.widgets.chips import chip
from app.dashboard.widgets.fields.controls import Desk, NumberField
from app.dashboard.widgets.fields.field_binding import FieldBinding, SliderScale
from app.dashboard.widgets.fields.model_fields import DiagonalBinding
from app.dashboard.widgets.lesson.outcome_chart import pad_html
from app.lessons import blocks
from app.lessons.answers import Answer
from app.lessons.course import LessonCourse
from app.lessons.goals import goal_result
from app.lessons.lesson import LessonStep
from app.lessons.measures import Unmet
from app.lessons.words import ENGLISH, words_of
from app.scenario.errors import ScenarioError
from app.scenario.number_text import plain
from app.session.commands import Play, Reset
from app.session.snapshot import Snapshot

MOST_OPTIONS = 5
_GROUPED = re.compile(r"-?[1-9]\d{0,2},\d{3}")  # with a comma of decimals, or of thousands


class OptionAnswer:
    """Buttons of a question with options."""

    def __init__(self, desk: Desk, answer: Callable[[object], None]) -> None:
        self._answer = answer
        self._folder = desk.gui.add_folder(None, visible=False)
        with self._folder:
            desk.gui.add_html('<i class="vs-options"></i>')
            self._buttons = [desk.gui.add_button("", visible=False) for _ in range(MOST_OPTIONS)]
            desk.gui.add_html('<i class="vs-options-end"></i>')
        for number, button in enumerate(self._buttons, start=1):
            button.on_click(self._answering(number))

    def _answering(self, number: int) -> Callable[[object], Coroutine[None, None, None]]:
        async def on_click(_: object) -> None:
            self._answer(number)

        return on_click

    def show(self, step: LessonStep, answer: Answer | None, course: LessonCourse) -> None:
        options = step.block.options if isinstance(step.block, blocks.ChoiceQuestion) else ()
        self._folder.visible = bool(options)
        for number, button in enumerate(self._buttons, start=1):
            button.visible = number <= len(options)
            if number <= len(options):
                text = options[number - 1]
                for name, measured in course.measured.items():
                    text = text.replace(f"{{{{{name}}}}}", measured)
                chosen = answer if answer is not None and answer.given == number else None
                button.label = f"{'ABCDE'[number - 1]}) {text}"
                icon = None if chosen is None else _mark(chosen)
                if button.icon != icon:
                    button.icon = icon
                button.color = "gray" if chosen is None and answer is not None else None
                button.disabled = chosen is None and not course.open


def _mark(answer: Answer) -> viser.IconName:
    """Icon of the chosen option: a point until it is scored."""
    if answer.score is None:
        return viser.Icon.POINT
    return viser.Icon.CHECK if answer.score > 0.0 else viser.Icon.X


class NumberAnswer:
    """Text field of a question for a number, and the button that locks the answer."""

    def __init__(self, desk: Desk, answer: Callable[[object], None]) -> None:
        self._desk, self._answer = desk, answer
        self._form = desk.gui.add_form(None, visible=False)
        with self._form:
            self._text = desk.gui.add_text("", "")
        self._lock = desk.gui.add_button("", visible=False)
        self._text.on_update(from_pages(self._on_text))
        self._lock.on_click(self._on_lock)
        self._question: object = None  # the shown one
        self._words = ENGLISH  # of its lesson

    async def _on_text(self, _: PageEvent) -> None:
        entered = self._text.value.endswith(ENTERED)
        if self._text.value.endswith(MARKS):
            self._text.value = without_marks(self._text.value)
        if entered:
            self._lock_answer()

    async def _on_lock(self, _: object) -> None:
        self._lock_answer()

    def _lock_answer(self) -> None:
        text, words = without_marks(self._text.value).strip().replace("−", "-"), self._words
        if _GROUPED.fullmatch(text):
            # a decimal comma is told from one of thousands by a fourth digit behind it
            decimal = text.replace(",", ".") if words.decimal == "." else f"{text}0"
            self._desk.complain(words.two_numbers.format(text, decimal, text.replace(",", "")))
            return
        try:
            self._answer(float(text.replace(",", ".")))
        except ValueError:
            self._desk.complain(words.no_number.format(f"{text!r:.40}"))

    def show(self, step: LessonStep, answer: Answer | None, course: LessonCourse) -> None:
        asks = isinstance(step.block, blocks.NumberQuestion)
        self._form.visible = asks
        self._lock.visible = asks and course.open
        if not asks:
            return
        words = self._words = course.words
        self._lock.label = words.lock_answer
        self._lock.hint = f"{words.lock_hint} {words.key.format('Enter')}"
        unit = answer_unit(step, course)
        self._text.label = f"{words.your_answer} [{unit}]" if unit else words.your_answer
        self._text.disabled = not course.open
        question = course.lesson.name, step.number, answer is not None
        if answer is not None and isinstance(answer.given, int | float):
            self._text.value = words.number(plain(answer.given))
        elif self._question != question:  # another one, or this one when the lesson is taken again
            self._text.value = ""
        self._question = question


def answer_unit(step: LessonStep, course: LessonCourse) -> str:
    """Unit of the number that a question asks for, "" for other questions."""
    if not isinstance(step.block, blocks.NumberQuestion):
        return ""
    for each in course.lesson.steps:
        if (run := each.run) and step.block.measure in run.measures:
            return run.measures[step.block.measure].unit
    return ""


class CurveAnswer:
    """Axes on which a curve is drawn; the page's script writes its points into a hidden text field."""

    def __init__(self, desk: Desk, answer: Callable[[object], None]) -> None:
        self._desk, self._answer = desk, answer
        self._html = desk.gui.add_html("", visible=False)
        self._field = desk.gui.add_text("", "", visible=False)
        self._lock = desk.gui.add_button("", visible=False)
        self._lock.on_click(self._on_lock)
        self._words = ENGLISH  # of the lesson

    async def _on_lock(self, _: object) -> None:
        try:
            points = msgspec.json.decode(self._field.value or "null")
        except (msgspec.DecodeError, UnicodeError, RecursionError):
            points = None
        if not points:
            self._desk.complain(self._words.no_line)
        else:
            self._answer(points)

    def show(self, step: LessonStep, answer: Answer | None, course: LessonCourse) -> None:
        asks = isinstance(step.block, blocks.CurveQuestion)
        self._html.visible = self._field.visible = asks
        self._lock.visible = asks and course.open
        words = self._words = course.words
        self._lock.label = words.lock_line
        self._lock.hint = words.lock_hint
        if not isinstance(step.block, blocks.CurveQuestion):
            self._html.content = ""
            self._field.value = ""
            return
        drawn = answer.given if answer is not None and isinstance(answer.given, list) else None
        content = pad_html(step.block, drawn, words)
        if self._html.content != content:  # sent again, the axes would lose the strokes that are being drawn
            self._html.content = content
            self._field.value = ""  # of other axes


class GoalControls:
    """Sliders and conditions of a goal."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._rows: list[NumberField] = []
        self._of = 0
        self._missed_in = -1  # number of the last run that was judged
        self._missed: tuple[str, ...] = ()  # HTML
        self._folder = desk.gui.add_folder("Your controls", visible=False)
        self._state = desk.gui.add_html("")
        self._anew = desk.gui.add_button("", visible=False)
        self._anew.on_click(self._on_anew)

    async def _on_anew(self, _: object) -> None:
        self._desk.lock.post(Reset())
        self._desk.lock.post(Play())

    def show(self, step: LessonStep, course: LessonCourse, snapshot: Snapshot, entered: int) -> None:
        goal = step.block
        visible = isinstance(goal, blocks.Goal)
        if self._folder.visible != visible:
            self._folder.visible = self._anew.visible = visible
        if not isinstance(goal, blocks.Goal):
            self._clear()
            return
        if self._of != entered:
            self._clear()
            with self._folder:
                self._rows = [
                    NumberField(
                        self._desk, _binding(each), each.label, SliderScale(each.low, each.high, each.logarithmic)
                    )
                    for each in goal.controls
                ]
            self._of = entered
        words = course.words
        self._folder.label = words.controls
        self._anew.label = words.anew
        self._anew.hint = f"{words.key.format('R')}. {words.anew_hint}"
        for row in self._rows:
            row.show(snapshot)
        content = self._html(course, snapshot)
        if self._state.content != content:
            self._state.content = content

    def _clear(self) -> None:
        for row in self._rows:
            row.remove()
        self._rows, self._of, self._missed_in = [], 0, -1
        if self._state.content:
            self._state.content = ""

    def _html(self, course: LessonCourse, snapshot: Snapshot) -> str:
        words = course.words
        lang = f'lang="{words.language}"'
        if course.step.number in course.progress.goals:
            return f'<div class="vs-scored" {lang}>{chip(words.reached, "vs-good")}</div>'
        if self._missed_in != snapshot.run:
            try:
                stopped = snapshot.phase == "stopped"
                result = goal_result(
                    course.step, snapshot.latest, snapshot.recording, snapshot.end, stopped=stopped, words=words
                )
            except ScenarioError as error:
                return f'<div class="vs-note">{escape(str(error))}</div>'
            if result.waiting:
                return f'<div class="vs-note" {lang}>{result.waiting}</div>'
            if result.reached:
                try:
                    course.reached_goal()
                except OSError as error:
                    self._desk.complain(
                        Fault(f"the progress of lessons cannot be saved: {error.strerror}; the lesson goes on")
                    )
            assert isinstance(course.step.block, blocks.Goal)
            goal = course.step.block
            self._missed_in = snapshot.run
            self._missed = tuple(missed_html(each, goal, course.lesson.head.language) for each in result.missed)
        missed = "".join(
            f'<div class="vs-scored" {lang}>{chip(words.not_yet, "vs-warn")} {each}</div>' for each in self._missed
        )
        changed = len(snapshot.recording.epochs) > 1
        return missed + (f'<div class="vs-note" {lang}>{words.changed}</div>' if missed and changed else "")


def missed_html(missed: Unmet, goal: blocks.Goal, language: str) -> str:
    """Condition of a goal that does not hold as HTML, within words of the program. language: of the lesson, which the
    program may not speak."""
    title = escape(goal.measures[missed.measure].title or missed.measure)
    measured, limit = (escape(number.text(language)) for number in (missed.value, missed.limit))
    wanted = words_of(language).wanted[missed.wanted]
    return f'<span lang="{escape(language)}">{title}</span>: {measured}; {wanted} {limit}'


def _binding(control: blocks.GoalSlider) -> FieldBinding:
    field, _, last = control.path.rpartition(".")
    return DiagonalBinding(field, int(last) - 1) if last.isdecimal() else FieldBinding(control.path)
