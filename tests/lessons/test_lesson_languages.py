"""Languages of lessons: numbers, names of measures and marks of language in a lesson that is not English."""

from __future__ import annotations

import math
from dataclasses import fields, replace

import msgspec
import numpy as np
import pytest

from app.access.classroom import ClassQuestion
from app.dashboard.panels.lessons import _scored
from app.dashboard.theme.colors import MEASURED
from app.dashboard.widgets.chips import chip
from app.dashboard.widgets.lesson.class_panel import answers_html
from app.dashboard.widgets.lesson.lesson_answers import missed_html
from app.dashboard.widgets.lesson.lesson_list import _state
from app.dashboard.widgets.lesson.outcome_chart import outcome_html
from app.lessons.answers import Answer, LessonProgress, Notebook
from app.lessons.blocks import ChoiceQuestion, Goal, LessonRun, PictureLine
from app.lessons.class_desk import ClassDesk
from app.lessons.course import LessonCourse
from app.lessons.lesson import Lesson, LessonStep, shipped_lessons
from app.lessons.measures import MeasuredNumber, unmet
from app.lessons.playing import LessonOutcome, Trace, runs
from app.lessons.words import ENGLISH, GERMAN, LessonWords, words_of
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
        html = missed_html(missed, goal, each.head.language)
        assert html.startswith(f'<span lang="{each.head.language}">{goal.measures[condition.measure].title}</span>: ')
        assert f"; {words_of(each.head.language).wanted[missed.wanted]} " in html


def test_the_sentence_of_a_german_goal() -> None:
    (goal,) = (goal for each, goal in GOALS if each.head.language == "de")
    (missed,) = unmet(goal.conditions, {"error": MeasuredNumber(1.25, "N")})
    assert missed_html(missed, goal, "de") == (
        '<span lang="de">größter Kraftfehler</span>: 1,25 N; verlangt: unter 0,2 N'
    )
    assert str(missed) == "error is 1.25 N; wanted: below 0.2 N"  # as its author reads it


def test_a_measure_without_a_title_has_its_name() -> None:
    goal = lesson().steps[-1].block
    assert isinstance(goal, Goal)
    (missed,) = unmet(goal.conditions, {"way": MeasuredNumber(9.5, "mm")})
    assert missed_html(missed, goal, "en").startswith('<span lang="en">way</span>: 9.5 mm; wanted: below ')


def test_the_words_of_the_program_have_the_same_gaps_in_every_language() -> None:
    for field in fields(LessonWords):
        english, german = getattr(ENGLISH, field.name), getattr(GERMAN, field.name)
        if isinstance(english, str):
            english, german = {"": english}, {"": german}
        assert english.keys() == german.keys(), field.name
        for name, text in english.items():
            assert text.count("{}") == german[name].count("{}"), (field.name, name)


def test_what_the_page_says_around_a_german_lesson() -> None:
    """In letters: the words of another language in the place of these would pass a comparison with the table."""
    german = shipped_lessons()["03-wall.de"]
    (goal,) = (step for step in german.steps if isinstance(step.block, Goal))
    assert _state(german, LessonProgress(finished=True)) == chip("fertig, Ziel nicht erreicht", "vs-warn")
    assert _state(german, LessonProgress(finished=True, goals=(goal.number,))) == chip("fertig", "vs-good")
    assert GERMAN.of_run("weiche Wand", 2.5, again=True) == "Lauf wiederholen: weiche Wand (2,5 s)"
    line, t = PictureLine(signal="F.1", unit="N", title="Kraft"), np.array([0.0, 1.0])
    run = LessonRun("Lauf", 1.0, (line,), {})
    picture = outcome_html(
        LessonStep(2, 2, "run", "", run, None), [Trace("Lauf", line, t, t)], (), {"Lauf": MEASURED}, GERMAN
    )
    assert 'aria-label="Kraft über der Zeit"' in picture
    assert ">0,5</text>" in picture
    assert ">0.5</text>" not in picture


def test_the_text_of_a_lesson_in_a_language_that_the_program_does_not_speak_is_marked_as_such() -> None:
    """What the program says within it is in English."""
    english = lesson()
    french = replace(english, head=msgspec.structs.replace(english.head, language="fr"))
    (question,) = (step for step in french.steps if isinstance(step.block, ChoiceQuestion) and step.kind == "predict")
    course = LessonCourse(french, Notebook())
    html = _scored(question, Answer(2, 0.0, "what happens: there"), course)
    assert html.startswith('<div class="vs-scored" lang="en">')
    assert html.endswith(
        'Your answer: <i><span lang="fr">back</span></i>. What happens: <span lang="fr">there</span></div>'
    )
    goal = french.steps[-1].block
    assert isinstance(goal, Goal)
    (missed,) = unmet(goal.conditions, {"way": MeasuredNumber(9.5, "mm")})
    assert missed_html(missed, goal, "fr") == '<span lang="fr">way</span>: 9.5 mm; wanted: below 8 mm'


@pytest.mark.parametrize(
    ("value", "english", "german"),
    [
        (-1234.5, "−1234 N", "−1234 N"), (1.234e-5, "1.23·10⁻⁵ N", "1,23·10⁻⁵ N"), (1e-12, "0 N", "0 N"),
        (0.2, "0.2 N", "0,2 N"), (2.5e7, "2.5·10⁷ N", "2,5·10⁷ N"),
        (math.inf, "not within the run", "nicht während des Laufs"),
    ],
)  # fmt: skip
def test_a_measured_number_is_written_as_other_numbers_are(value: float, english: str, german: str) -> None:
    number = MeasuredNumber(value, "N")
    assert (str(number), number.text("de"), number.text("fr")) == (english, german, english)


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
