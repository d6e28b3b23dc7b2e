"""Lessons panel: what is loaded at a step, what is said of a refused edit, and what the class was asked before."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any, cast
from unittest.mock import MagicMock

import pytest

from app.dashboard.panels.lessons import LessonsPanel
from app.dashboard.widgets.fields.field_words import refusal_in_words
from app.dashboard.widgets.lesson.class_panel import ClassPanel
from app.dashboard.widgets.lesson.lesson_list import LessonList
from app.lessons.answers import Notebook
from app.lessons.class_desk import ClassDesk
from app.lessons.course import LessonCourse
from app.lessons.lesson import load, shipped_lessons
from app.lessons.playing import play, runs
from app.session.commands import Command, Load, Pause, Play, Reset
from app.storage.constants_store import kept_memory
from tests.lessons.test_lessons import lesson
from tests.support.desks import Posted


def entered(course: LessonCourse, *, again: bool) -> list[Command]:
    """Commands that the panel posts when it enters the shown step."""
    posted = Posted()
    lock = SimpleNamespace(post=posted.post, fields=None)
    panel = SimpleNamespace(_course=course, _desk=SimpleNamespace(lock=lock), _entered=0)
    LessonsPanel._enter(cast(LessonsPanel, panel), again=again)
    return posted


@pytest.mark.parametrize("again", [False, True])
def test_a_run_rests_at_its_beginning_also_when_the_scene_is_returned_to(again: bool) -> None:
    """It would answer a prediction that was skipped, and play without an end."""
    course = LessonCourse(lesson(), Notebook())
    (run,) = runs(course.lesson)
    course.go(run.number - 1)
    assert run.scenario is not None
    assert entered(course, again=again) == [Load(run.scenario), Reset(), Pause()]


def test_the_scene_of_a_step_without_a_question_plays() -> None:
    course = LessonCourse(lesson(), Notebook())
    assert isinstance(entered(course, again=False)[-1], Pause)  # a prediction follows
    course.go(6)
    assert course.step.kind == "explain"
    assert entered(course, again=False) == []
    assert isinstance(entered(course, again=True)[-1], Play)


def test_a_refused_blend_is_said_once_and_without_the_path_of_its_field() -> None:
    (blend,) = (step for step in runs(load("12-blends")) if getattr(step.block, "refused", None))
    refusal = play(blend, kept_memory()).refusal
    assert refusal.startswith("blend.to: refused: ")
    assert refusal_in_words(refusal) == refusal.removeprefix("blend.to: refused: ")
    assert refusal_in_words(refusal).startswith("at α = 0.5 a pole at ")
    assert refusal_in_words("target_model.K_m: -900; allowed: larger") == "K_m: -900; allowed: larger"


def test_a_question_that_the_class_was_asked_before_the_run_can_be_asked_again() -> None:
    classroom = ClassDesk()
    classroom.open(lambda _: None)
    gui = MagicMock()
    gui.add_button.side_effect = lambda *_, **__: MagicMock()
    panel = ClassPanel(cast(Any, SimpleNamespace(gui=gui, classroom=classroom)))
    course = LessonCourse(lesson(), Notebook())

    def shown() -> tuple[str, bool, bool, bool]:
        panel.show(course, "mm")
        return panel._ask.label, panel._ask.visible, panel._reveal.visible, panel._html.visible

    course.go(3)
    assert course.step.kind == "predict"
    assert shown() == ("Ask the class", True, False, False)
    asyncio.run(panel._on_ask(None))
    classroom.take(1, (1, 2, 2))
    assert shown() == ("Ask again", True, True, True)
    asyncio.run(panel._on_reveal(None))
    course.go(1)
    assert shown() == ("Ask the class", False, False, False)  # the run
    assert classroom.present is None
    course.go(-1)
    assert shown() == ("Ask again", True, False, True)
    assert "3 answers when it was asked last" in panel._html.content
    assert "A) there" in panel._html.content
    course.go(-1)
    assert shown() == ("Ask the class", True, False, False)  # another question
    course.go(1)
    asyncio.run(panel._on_ask(None))
    assert shown() == ("Ask again", True, True, True)
    assert "0 answers</b>" in panel._html.content


def test_what_a_german_lesson_teaches_is_marked_as_german_in_the_list() -> None:
    german = shipped_lessons()["03-wall.de"]
    gui = MagicMock()
    gui.add_dropdown.return_value.value = f"3. {german.head.title} (Deutsch)"
    desk = SimpleNamespace(gui=gui, notebook=Notebook(), classroom=SimpleNamespace(asked=()))
    listed = LessonList(cast(Any, desk), {german.name: german}, lambda _: None)
    listed.show({}, visible=True)
    assert '<ul lang="de"><li>warum eine Positionsfeder' in listed._about.content
    assert listed._begin.label == "Beginnen"
