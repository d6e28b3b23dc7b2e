"""Languages of lessons: numbers, names of measures and marks of language in a lesson that is not English."""

from __future__ import annotations

import numpy as np
import pytest

from app.access.classroom import ClassQuestion
from app.dashboard.widgets.lesson.class_panel import answers_html
from app.dashboard.widgets.lesson.lesson_answers import missed_html
from app.lessons.answers import Notebook
from app.lessons.blocks import Goal
from app.lessons.class_desk import ClassDesk
from app.lessons.course import LessonCourse
from app.lessons.lesson import Lesson, shipped_lessons
from app.lessons.measures import MeasuredNumber, unmet
from app.lessons.playing import LessonOutcome, runs
from app.lessons.words import ENGLISH, GERMAN, words_of
from tests.lessons.test_lessons import lesson

GOALS = [
    (each, step.block) for each in shipped_lessons().values() for step in each.steps if isinstance(step.block, Goal)
]


@pytest.mark.parametrize(("name", "text"), [("03-wall", "−1.25 N"), ("03-wall.de", "−1,25 N")])
def test_a_measured_number_has_the_decimal_mark_of_the_lesson(name: str, text: str) -> None:
    course = LessonCourse(shipped_lessons()[name], Notebook())
    run = runs(course.lesson)[0]
    course.go(run.number)
    course.take(run, LessonOutcome({"known": MeasuredNumber(-1.25, "N")}, (), np.empty(0)))
    assert course.measured == {"known": text}


@pytest.mark.parametrize(("each", "goal"), GOALS, ids=[each.name for each, _ in GOALS])
def test_a_goal_that_is_missed_is_told_in_words_of_the_lesson(each: Lesson, goal: Goal) -> None:
    """No sentence has the identifier of a measure, such as "way"."""
    assert all(measure.title for measure in goal.measures.values())
    for condition in goal.conditions:
        far = -1e3 if condition.above is not None else 1e3 + 0.5
        (missed,) = unmet([condition], {condition.measure: MeasuredNumber(far, goal.measures[condition.measure].unit)})
        html = missed_html(missed, goal, words_of(each.head.language))
        assert html.startswith(f'<span lang="{each.head.language}">{goal.measures[condition.measure].title}: ')
        assert f"; {words_of(each.head.language).wanted[missed.wanted]} " in html


def test_the_sentence_of_a_german_goal() -> None:
    (goal,) = (goal for each, goal in GOALS if each.head.language == "de")
    (missed,) = unmet(goal.conditions, {"error": MeasuredNumber(1.25, "N")})
    assert missed_html(missed, goal, GERMAN) == (
        '<span lang="de">größter Kraftfehler: 1,25 N; verlangt: unter 0,2 N</span>'
    )
    assert str(missed) == "error is 1.25 N; wanted: below 0.2 N"  # as its author reads it


def test_a_measure_without_a_title_has_its_name() -> None:
    goal = lesson().steps[-1].block
    assert isinstance(goal, Goal)
    (missed,) = unmet(goal.conditions, {"way": MeasuredNumber(9.5, "mm")})
    assert ">way: 9.5 mm; wanted: below " in missed_html(missed, goal, ENGLISH)


def test_a_question_to_the_class_has_the_language_of_its_lesson() -> None:
    sent: list[ClassQuestion | None] = []
    desk = ClassDesk()
    desk.open(sent.append)
    german = shipped_lessons()["03-wall.de"]
    for step in (step for step in german.steps if step.question):
        desk.ask(german.name, step, "N", {}, german.head.language)
    assert {question.language for question in sent if question is not None} == {"de"}
    choice = next(question for question in sent if question is not None and question.kind == "choice")
    assert answers_html(choice, (1, 2)).startswith('<div lang="de"><table')
    number = next(question for question in sent if question is not None and question.kind == "number")
    assert 'lang="' not in answers_html(number, (1.0, 2.0))  # "below", "to" and "above" are words of the program
