"""Languages of lessons: numbers, names of measures and marks of language in a lesson that is not English."""

from __future__ import annotations

import asyncio
import math
import re
from dataclasses import fields, replace
from types import SimpleNamespace
from typing import Any, cast
from unittest.mock import MagicMock

import msgspec
import numpy as np
import pytest

from app.access.classroom import ClassQuestion
from app.dashboard.panels.lessons import LessonsPanel, _scored
from app.dashboard.plots.lesson_figures import figure_of_run
from app.dashboard.theme.colors import MEASURED
from app.dashboard.widgets.chips import chip
from app.dashboard.widgets.fields.edit_lock import EditLock
from app.dashboard.widgets.lesson.class_panel import ClassPanel, answers_html
from app.dashboard.widgets.lesson.lesson_answers import missed_html
from app.dashboard.widgets.lesson.lesson_list import _state
from app.dashboard.widgets.lesson.outcome_chart import outcome_html
from app.dashboard.widgets.page.complaint import Complaint
from app.dashboard.widgets.page.status import status_html
from app.export.printing import render
from app.lessons.answers import Answer, LessonProgress, Notebook
from app.lessons.blocks import ChoiceQuestion, Goal, LessonRun, PictureLine
from app.lessons.class_desk import ClassDesk
from app.lessons.course import LessonCourse
from app.lessons.lesson import Lesson, LessonStep, shipped_lessons
from app.lessons.measures import MeasuredNumber, unmet
from app.lessons.playing import LessonOutcome, Trace, runs
from app.lessons.words import ENGLISH, GERMAN, LessonWords, words_of
from app.scenario.data import load
from app.session.commands import PushNow
from app.session.runner import Runner
from app.session.snapshot import snapshot_of
from app.simulation.closed_loop import ClosedLoop
from tests.lessons.test_lessons import lesson
from tests.support.svg import texts_of

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
    course = LessonCourse(german, Notebook())
    first = runs(german)[0]
    assert first.run is not None
    traces = [Trace(first.run.title, each, t, t) for each in first.run.show]
    course.take(first, LessonOutcome({}, tuple(traces), np.empty(0), stopped="t = 1 s: contact lost"))
    figure = figure_of_run(german, first, course.outcomes[first.number], traces, ())
    numbers = texts_of(render(figure, "svg"))
    assert figure.caption.endswith(" Abgebrochen: t = 1 s: contact lost.")
    assert "0,2" in numbers
    assert not [text for text in numbers if "." in text and text[0].isdecimal()]


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
    html = answers_html(number, (*(0.5 * k for k in range(30)), -100.0, 100.0))
    assert html.startswith('<div lang="de"><table')
    rows = re.findall("<td>([^<]*)</td>", html)
    assert (rows[0], rows[1], rows[-1]) == ("unter 0,275 N", "0,275 bis 1,67 N", "über 14,2 N")
    french = msgspec.structs.replace(number, language="fr")  # "to" is a word of the program
    assert answers_html(french, (1.0, 2.0)).startswith('<div lang="en"><table')


def test_the_class_of_a_german_lesson_is_asked_and_told_in_german() -> None:
    classroom = ClassDesk()
    classroom.open(lambda _: None)
    gui = MagicMock()
    gui.add_button.side_effect = lambda *_, **__: MagicMock()
    panel = ClassPanel(cast(Any, SimpleNamespace(gui=gui, classroom=classroom)))
    course = LessonCourse(shipped_lessons()["03-wall.de"], Notebook())
    course.go(next(step.number for step in course.lesson.steps if step.question) - 1)
    panel.show(course, "N")
    assert (panel._ask.label, panel._reveal.label) == ("Die Klasse fragen", "Antworten zeigen")
    assert panel._reveal.hint == "Dann zählt keine weitere Antwort."
    asyncio.run(panel._on_ask(None))
    classroom.take(1, (1,))
    panel.show(course, "N")
    assert panel._ask.label == "Noch einmal fragen"
    assert '<b lang="de">1 Antwort</b>' in panel._html.content
    asyncio.run(panel._on_reveal(None))
    assert classroom.present is not None
    assert classroom.present.question.result.endswith("; bitte nach vorn schauen")
    classroom.rest()
    panel.show(course, "N")
    assert '<b lang="de">1 Antwort, als zuletzt gefragt wurde</b>' in panel._html.content


def test_the_strip_over_the_scene_has_german_words_in_a_german_lesson(monkeypatch: pytest.MonkeyPatch) -> None:
    snapshot = snapshot_of(ClosedLoop.from_scenario(load("planar2r-semicircle")))
    runner = Runner.__new__(Runner)  # of a run that stands still
    monkeypatch.setattr(Runner, "snapshot", snapshot, raising=False)
    monkeypatch.setattr(Runner, "posted", 0, raising=False)
    monkeypatch.setattr(Runner, "post", lambda *_: 1)
    told = Complaint(runner, lambda: lock.words)
    lock = EditLock(runner.post, told.refuse)
    panel = LessonsPanel.__new__(LessonsPanel)
    panel._course, panel._busy, panel._entered = None, None, 0
    panel._desk = cast(Any, SimpleNamespace(lock=lock, notebook=Notebook(), classroom=ClassDesk()))
    panel._open(shipped_lessons()["03-wall.de"])
    lock.fields = frozenset({"contact.K_e"})
    lock.post(PushNow())
    assert told.text(snapshot, 0.0) == (
        "Abgelehnt: a push: gesperrt durch das Ziel der Lektion; erlaubt: "
        "K_e, stiffness of the surface, oder die Lektion verlassen"
    )
    told.withdraw()
    assert told.text(snapshot, 0.0) == ""
    told.fail("no room")
    told.withdraw()  # which a failure is not
    assert told.text(snapshot, 0.0) == "Fehlgeschlagen: no room"
    stopped = replace(snapshot, phase="stopped", reason="t = 1.000 s: <too fast>")
    html = status_html(stopped, "", words=lock.words)
    assert "Abgebrochen: t = 1.000 s: &lt;too fast&gt;. Eine Änderung oder Reset (R) beginnt einen neuen Lauf" in html
    panel._close()
    assert lock.words is ENGLISH
