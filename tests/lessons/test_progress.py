"""Progress in lessons: its file, damaged, unreadable or on a full disk, and what stays of it."""

from __future__ import annotations

import csv
import errno
import io
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from app.lessons.answers import (
    FILE,
    Answer,
    LessonProgress,
    Notebook,
    csv_of,
)
from app.lessons.blocks import ChoiceQuestion, CurveQuestion, NumberQuestion
from app.lessons.course import LessonCourse
from app.lessons.playing import play
from app.storage.session_index import StateError
from tests.lessons.test_lessons import lesson


def test_a_table_of_answers_has_all_their_digits() -> None:
    given = (1234567.0, 0.12345678, [(0.1234567, 7.0)])
    answers = {number: Answer(each) for number, each in enumerate(given)}
    rows = list(csv.reader(io.StringIO(csv_of({"test": LessonProgress(answers=answers)}))))
    assert [row[2] for row in rows[1:]] == ["1234567", "0.12345678", "0.1234567,7"]


@pytest.mark.parametrize(
    "damaged", [b"{", b'{"\xff": {}}', b'{"test": {"more": ' + b"[" * 100_000], ids=["cut", "no UTF-8", "deep"]
)
def test_a_damaged_file_of_progress_is_set_aside_and_lessons_go_on(damaged: bytes, tmp_path: Path) -> None:
    (tmp_path / FILE).write_bytes(damaged)
    notebook = Notebook()
    problem = notebook.keep_in(tmp_path)
    assert problem.startswith("the progress in lessons cannot be read: ")
    assert (tmp_path / f"set-aside-{FILE}").read_bytes() == damaged
    LessonCourse(lesson(), notebook).go(1)
    assert json.loads((tmp_path / FILE).read_text(encoding="utf-8"))["test"]["step"] == 2


def test_progress_that_cannot_be_read_is_not_written_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / FILE).write_text("{}")
    with monkeypatch.context() as broken:
        broken.setattr("app.lessons.kept_file.read_regular", unreadable)
        notebook = Notebook()
        problem = notebook.keep_in(tmp_path)
    assert problem.endswith(f"cannot be read: Input/output error; it is kept as {tmp_path / f'set-aside-{FILE}'}")
    LessonCourse(lesson(), notebook).go(1)
    assert (tmp_path / f"set-aside-{FILE}").read_text() == "{}"
    assert json.loads((tmp_path / FILE).read_text())["test"]["step"] == 2


def test_progress_that_can_neither_be_read_nor_set_aside_is_said_in_one_sentence(tmp_path: Path) -> None:
    (tmp_path / FILE).write_text("{")
    (tmp_path / f"set-aside-{FILE}").mkdir()
    with pytest.raises(StateError, match=r"the progress in lessons cannot be read: .*, nor be set aside: Is a dir"):
        Notebook().keep_in(tmp_path)
    assert (tmp_path / FILE).read_text() == "{"


def unreadable(*_: object) -> None:
    raise OSError(errno.EIO, os.strerror(errno.EIO))


def test_a_full_disk_loses_no_score(tmp_path: Path) -> None:
    """What cannot be written is said at each step, and in memory everything goes on."""
    notebook = Notebook()
    notebook.keep_in(tmp_path / "gone")
    course = LessonCourse(lesson(), notebook)

    given: dict[type, object] = {NumberQuestion: 27.5, ChoiceQuestion: 1, CurveQuestion: [(0.0, 0.0), (1.0, 30.0)]}

    def fails(act: Callable[[Any], None], argument: object) -> None:
        with pytest.raises(OSError, match="No such file"):
            act(argument)

    while course.step.kind != "explain":
        if course.step.kind == "run":
            outcome = play(course.step)
            fails(lambda outcome: course.take(course.step, outcome), outcome)
        elif course.step.question is not None and course.answer is None and course.open:
            fails(course.give, given[type(course.step.question)])
        fails(course.go, 1)
    scores = [answer.score for _, answer in course.explained()]
    assert len(scores) == 4
    assert None not in scores
    (tmp_path / "gone").mkdir()
    course.go(1)
    later = Notebook()
    later.keep_in(tmp_path / "gone")
    assert later.of("test") == course.progress


@pytest.mark.parametrize("step", [-2, 0, 9])
def test_of_progress_in_another_version_of_the_lesson_stays_what_fits(step: int) -> None:
    kept = {1: 2, 2: 27.5, 3: 1.75e308, 4: 5, 6: 1, 40: 1}
    notebook = Notebook()
    notebook.note("test", LessonProgress(step, {number: Answer(given) for number, given in kept.items()}, (8,)))
    course = LessonCourse(lesson(), notebook)
    assert course.step.number == 1
    assert {number: answer.given for number, answer in course.progress.answers.items()} == {2: 27.5, 6: 1}
    assert course.progress.goals == (8,)
