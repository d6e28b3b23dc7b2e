"""Class panel of the lecturer's page: asks a class the question of the shown step, and counts and shows its answers."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np
import viser

from app.access.classroom import ClassQuestion, Given
from app.dashboard.theme.colors import ACCENT, css
from app.dashboard.widgets.fields.controls import Desk
from app.dashboard.widgets.lesson.outcome_chart import courses_html
from app.lessons.class_desk import AskedQuestion
from app.lessons.course import LessonCourse
from app.lessons.markup import inline_html
from app.lessons.words import words_of
from app.scenario.number_text import rounded

BINS = 10
NARROW = 1e-9  # of the size of the answers: a smaller range of them counts as one number


class ClassPanel:
    """Class panel in the current container: buttons that ask and reveal, and the answers. Hidden where there is no
    class."""

    def __init__(self, desk: Desk) -> None:
        self._desk, gui = desk, desk.gui
        self._course: LessonCourse | None = None
        self._unit = ""
        self._ask = gui.add_button("", icon=viser.Icon.USERS, visible=False)
        self._html = gui.add_html("", visible=False)
        self._reveal = gui.add_button("", icon=viser.Icon.EYE, visible=False)
        self._ask.on_click(self._on_ask)
        self._reveal.on_click(self._on_reveal)

    async def _on_ask(self, _: object) -> None:
        course = self._course
        if course is not None and course.step.question is not None:
            language = course.lesson.head.language
            self._desk.classroom.ask(course.lesson.name, course.step, self._unit, course.measured, language)

    async def _on_reveal(self, _: object) -> None:
        present, course = self._desk.classroom.present, self._course
        if present is not None and course is not None:
            self._desk.classroom.reveal(_summary(present.question, present.answers))

    def show(self, course: LessonCourse | None, unit: str) -> None:
        """Show the panel for the shown step, and end the question of another step. unit: of a number that is asked for.

        Without a lesson the question stays open: the lecturer may come back after a crash."""
        classroom = self._desk.classroom
        self._course, self._unit = course, unit
        if not classroom.is_open:
            return
        asks = course is not None and course.step.question is not None
        present = classroom.present
        here = None if course is None else (course.lesson.name, course.step.number)
        if present is not None and here is not None and here != (present.lesson, present.step):
            classroom.rest()
            present = None
        asked = present if here is None else classroom.last_of(*here)  # also where the lecturer comes back to it
        self._ask.visible = asks
        words = words_of("en" if asked is None else asked.question.language) if course is None else course.words
        self._ask.label = words.ask_class if asked is None else words.ask_class_again
        self._reveal.label = words.show_answers
        self._ask.hint, self._reveal.hint = words.ask_class_hint, words.show_answers_hint
        self._reveal.visible, self._html.visible = present is not None, asked is not None
        if present is not None:
            self._reveal.disabled = not present.question.open
        if asked is not None:
            content = _html(asked, over=present is None)
            if self._html.content != content:
                self._html.content = content


def _html(asked: AskedQuestion, *, over: bool) -> str:
    """Answers to a question as HTML: their number, and their picture once it was revealed. over: whether the class is
    asked the question no longer."""
    words = words_of(asked.question.language)
    total = words.counted(len(asked.answers))
    if over:
        total = words.answers_before.format(total)
    shown = "" if asked.question.open else answers_html(asked.question, asked.answers)
    return (
        f'<div class="vs-lesson" data-asked="{asked.question.number}">'
        f'<b lang="{words.language}">{total}</b>{shown}</div>'
    )


def answers_html(question: ClassQuestion, answers: Sequence[Given]) -> str:
    """Picture of the answers: bars, or curves over each other."""
    if question.kind == "curve":
        times = np.linspace(
            question.start, question.end, len(answers[0]) if answers and isinstance(answers[0], list) else 2
        )
        courses = [np.column_stack([times, given]) for given in answers if isinstance(given, list)]
        ends = question.start, question.end, question.low, question.high
        picture = courses_html(question.axis, ends, courses, words_of(question.language))
    else:
        picture = _bars(_counted(question, answers))
    # what stands beside numbers are words of this program
    language = words_of(question.language).language if question.kind == "number" else question.language
    return f'<div lang="{escape(language)}">{picture}</div>'


def _counted(question: ClassQuestion, answers: Sequence[Given]) -> list[tuple[str, int]]:
    """Number of answers by option, or in each of a few ranges of numbers."""
    if question.kind == "choice":
        given = [int(each) for each in answers if not isinstance(each, list)]
        return [(f"{'ABCDE'[k]}) {text}", given.count(k + 1)) for k, text in enumerate(question.options)]
    values = np.array([each for each in answers if not isinstance(each, list)])
    if not len(values):
        return []
    low, high = np.quantile(values, [0.05, 0.95]) if len(values) > 20 else (values.min(), values.max())
    words, unit = words_of(question.language), escape(question.unit)
    room = NARROW * max(abs(low), abs(high))

    def told(value: float) -> str:
        return words.number(rounded(value))

    if high - low <= room:  # numpy has no bins that small
        low, high = low - room, high + room
        inside = [(f"{told((low + high) / 2.0)} {unit}", int(np.sum((low <= values) & (values <= high))))]
    else:
        bins = min(BINS, len(np.unique(values)))
        counts, edges = np.histogram(values, bins=bins, range=(low, high))
        inside = [
            (words.between.format(told(first), told(after), unit), int(count))
            for count, first, after in zip(counts, edges[:-1], edges[1:], strict=True)
        ]
    below, above = int(np.sum(values < low)), int(np.sum(values > high))
    return [
        *([(words.below.format(told(low), unit), below)] if below else []),
        *inside,
        *([(words.above.format(told(high), unit), above)] if above else []),
    ]


def _bars(counted: Sequence[tuple[str, int]]) -> str:
    most = max((count for _, count in counted), default=0) or 1
    rows = "".join(
        f'<tr><td>{label}</td><td class="vs-count">{count}</td>'
        f'<td><i style="width: {count / most:.0%}; background: {css(ACCENT)}"></i></td></tr>'
        for label, count in counted
    )
    return f'<table class="vs-bars">{rows}</table>'


def _summary(question: ClassQuestion, answers: Sequence[Given]) -> str:
    """Summary of the answers for the students' pages, as HTML."""
    words = words_of(question.language)
    if question.kind != "choice":
        return inline_html(words.class_told.format(words.counted(len(answers))))
    counted = ", ".join(f"{'ABCDE'[k]}: {count}" for k, (_, count) in enumerate(_counted(question, answers)))
    return inline_html(words.class_told.format(counted))
