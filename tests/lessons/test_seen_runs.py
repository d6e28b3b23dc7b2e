"""Runs that have been seen: a prediction stays locked after them, until the lesson is taken again."""

from __future__ import annotations

import asyncio
import errno
import json
import os
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast
from unittest.mock import MagicMock

import numpy as np
import pytest

from app.dashboard.widgets.lesson.lesson_list import LessonList
from app.lessons.answers import FILE, Answer, LessonProgress, Notebook
from app.lessons.course import LessonCourse
from app.lessons.lesson import Lesson, shipped_lessons
from app.lessons.measures import MeasuredNumber
from app.lessons.playing import LessonOutcome, runs
from app.scenario.errors import ScenarioError
from tests.lessons.test_lessons import lesson

OUTCOME = LessonOutcome({"way": MeasuredNumber(27.9, "mm")}, (), np.empty(0))


def kept_in(folder: Path) -> Notebook:
    notebook = Notebook()
    assert notebook.keep_in(folder) == ""
    return notebook


def test_a_prediction_stays_locked_when_the_lesson_is_left_after_its_run(tmp_path: Path) -> None:
    """Also without another step between the run and the end of the process."""
    course = LessonCourse(lesson(), kept_in(tmp_path))
    (run,) = runs(course.lesson)
    course.go(run.number - 1)
    course.take(course.step, OUTCOME)
    for again in (LessonCourse(course.lesson, course._notebook), LessonCourse(course.lesson, kept_in(tmp_path))):
        assert again.outcomes == {}
        again.go(-1)
        assert again.step.kind == "predict"
        assert not again.open
        with pytest.raises(ScenarioError, match="locked, as the run has been seen"):
            again.give(1)
        again.go(2)
        assert again.step.kind == "observe"
        assert again.open
        again.go(-1)


def test_a_file_from_before_runs_were_noted_is_read(tmp_path: Path) -> None:
    (tmp_path / FILE).write_text(json.dumps({"test": {"step": 3, "answers": {"2": {"given": 27.5}}}}))
    course = LessonCourse(lesson(), kept_in(tmp_path))
    assert course.progress == LessonProgress(3, {2: Answer(27.5)})
    assert course.open


@pytest.mark.parametrize("seen", [-1, 4, 6, 40])
def test_a_step_that_is_no_run_was_not_seen_as_one(seen: int) -> None:
    notebook = Notebook()
    notebook.note("test", LessonProgress(2, seen=seen))
    course = LessonCourse(lesson(), notebook)
    assert course.progress.seen == 0
    assert course.open


def test_a_full_disk_leaves_the_outcome_and_the_lock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    course = LessonCourse(lesson(), kept_in(tmp_path))
    (run,) = runs(course.lesson)

    def full() -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(course._notebook, "save", full)
    with pytest.raises(OSError, match="No space"):
        course.take(run, OUTCOME)
    assert (course.outcomes, course.progress.seen) == ({run.number: OUTCOME}, run.number)


def listed(notebook: Notebook, lessons: dict[str, Lesson], opened: Callable[[Lesson], None]) -> LessonList:
    def add(*_: object, **options: object) -> Any:
        return MagicMock(value="", visible=options.get("visible", True))

    gui = MagicMock(add_html=add, add_button=add)
    gui.add_dropdown.return_value.value = f"{1}. {next(iter(lessons.values())).head.title}"
    desk = SimpleNamespace(gui=gui, notebook=notebook, classroom=SimpleNamespace(asked=()))
    return LessonList(cast(Any, desk), lessons, opened)


def test_a_lesson_that_is_taken_again_asks_all_its_questions_again() -> None:
    name = "01-target-model"
    of = shipped_lessons()[name]
    goal, first = of.steps[-1].number, next(step for step in of.steps if step.question)
    done = LessonProgress(goal, {first.number: Answer(30.0, 1.0, "right")}, finished=True, seen=runs(of)[-1].number)
    notebook, opened = Notebook(), list[Lesson]()
    shown = listed(notebook, {name: of}, opened.append)

    def labels() -> tuple[str, bool]:
        shown.show(notebook.progress, visible=True)
        return shown._begin.label, shown._goal.visible

    assert labels() == ("Begin", False)
    notebook.note(name, done)
    assert labels() == ("Take it again", True)
    assert "deletes your answers" in shown._about.content
    asyncio.run(shown._on_goal(None))
    assert notebook.of(name) == done

    notebook.note(name, LessonProgress(3, finished=True))  # left on the way through it once more
    assert labels() == ("Continue at step 3", False)
    asyncio.run(shown._on_begin(None))
    assert notebook.of(name).step == 3

    notebook.note(name, LessonProgress(goal, done.answers, (goal,), finished=True, seen=done.seen))
    assert labels() == ("Take it again", False)
    asyncio.run(shown._on_begin(None))
    assert opened == [of, of, of]
    assert notebook.of(name) == LessonProgress()
    course = LessonCourse(of, notebook)
    course.go(first.number - 1)
    assert course.open
    course.give(30.0)
