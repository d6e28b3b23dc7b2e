"""The lecturer's desk: what a class is asked, when its answers are shown, and what is left of them."""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path

import pytest

from app.access.classroom import POINTS, ClassQuestion
from app.dashboard.widgets.lesson.class_panel import answers_html
from app.lessons import kept_file
from app.lessons.class_desk import FILE, ClassDesk
from app.lessons.lesson import LessonStep
from tests.lessons.test_lessons import lesson

STEPS = lesson().steps
NUMBER, CURVE, CHOICE, OBSERVE = STEPS[1], STEPS[2], STEPS[3], STEPS[5]


def desk() -> tuple[ClassDesk, list[ClassQuestion | None]]:
    sent: list[ClassQuestion | None] = []
    made = ClassDesk()
    assert not made.is_open
    made.open(sent.append)
    return made, sent


def ask(made: ClassDesk, step: LessonStep, unit: str = "") -> None:
    made.ask("test", step, unit, {"way": "27.9 mm"})


def test_questions_are_those_of_the_lesson_as_markup_that_is_safe() -> None:
    made, sent = desk()
    for step, unit in ((NUMBER, "mm"), (CURVE, ""), (CHOICE, ""), (OBSERVE, "")):
        ask(made, step, unit)
    number, curve, choice, observed = sent
    assert number is not None
    assert curve is not None
    assert choice is not None
    assert observed is not None
    assert (number.kind, number.unit, number.ask) == ("number", "mm", "How far, in mm?")
    assert (curve.kind, curve.axis, curve.end, curve.low, curve.high) == ("curve", "way [mm]", 1.0, -10.0, 40.0)
    assert (choice.kind, choice.options) == ("choice", ("there", "back"))
    assert observed.ask == "Seen? 27.9 mm"
    assert [each.number for each in (number, curve, choice, observed)] == [1, 2, 3, 4]


def test_answers_are_counted_first_and_shown_when_the_lecturer_says_so() -> None:
    made, sent = desk()
    ask(made, CHOICE)
    made.take(1, (1, 2, 2))
    made.take(7, (1,))  # of a question that was never asked
    assert made.present is not None
    assert made.present.answers == (1, 2, 2)
    made.reveal("A: 1, B: 2")
    assert sent[-1] is not None
    assert (sent[-1].number, sent[-1].open, sent[-1].result) == (1, False, "A: 1, B: 2")
    ask(made, CHOICE)  # asked again: a question of its own
    assert made.present.question.number == 2
    assert made.present.answers == ()
    made.rest()
    assert sent[-1] is None
    assert made.present is None
    made.rest()
    assert len(sent) == 4

    made.take(2, (2,))
    rows = list(csv.reader(io.StringIO(made.csv())))
    assert rows == [
        ["lesson", "step", "asked", "kind", "answer"],
        *([["test", "4", "1", "choice", each] for each in ("1", "2", "2")]),
        ["test", "4", "2", "choice", "2"],
    ]


def test_answers_are_bars_or_lines_over_each_other() -> None:
    made, sent = desk()
    for step in (NUMBER, CURVE, CHOICE):
        ask(made, step, "mm")
    number, curve, choice = (each for each in sent if each is not None)
    html = answers_html(choice, (1, 2, 2, 2))
    assert html.index(">1</td>") < html.index(">3</td>")
    assert "A) there" in html
    html = answers_html(number, (10.0, 10.0, 20.0))
    assert html.count("<tr>") == 2
    assert ">2</td>" in html
    html = answers_html(number, (0.3, 0.1 + 0.2))
    assert html.count("<tr>") == 1
    assert "<td>0.3 mm</td>" in html
    assert ">2</td>" in html
    html = answers_html(number, (-5.0, *([0.0] * 50), 7.0, 8.0))
    assert re.findall("<td>([^<]*)</td><td[^>]*>([0-9]+)<", html) == [
        ("below 0 mm", "1"),
        ("0 mm", "50"),
        ("above 0 mm", "2"),
    ]
    html = answers_html(number, (*range(1, 101), 900))
    assert re.findall("<td>(below|above) [^<]*</td><td[^>]*>([0-9]+)<", html) == [("below", "5"), ("above", "5")]
    assert answers_html(curve, ([0.0] * POINTS, [10.0] * POINTS)).count('opacity="0.45"') == 2
    assert [answers_html(each, ()).count(">0</td>") for each in (number, curve, choice)] == [0, 0, 2]


def test_a_class_survives_its_process_and_a_question_that_nobody_is_asked_any_more_is_over(tmp_path: Path) -> None:
    first, _ = desk()
    assert first.keep_in(tmp_path, pytest.fail) == ""
    ask(first, NUMBER, "mm")
    first.take(1, (12.5, 3))
    ask(first, CURVE)
    first.take(2, ([0.5] * POINTS,))

    second, sent = ClassDesk(), list[ClassQuestion | None]()
    assert second.keep_in(tmp_path, pytest.fail) == ""
    second.open(sent.append, 2)
    assert second.asked == first.asked
    assert second.present == first.present
    assert sent == [first.asked[-1].question]

    third, sent = ClassDesk(), list[ClassQuestion | None]()
    third.keep_in(tmp_path, pytest.fail)
    third.open(sent.append, 1)
    assert (third.present, sent) == (None, [None])
    assert third.csv() == first.csv()
    ask(third, CHOICE)
    assert third.present is not None
    assert third.present.question.number == 3


def test_a_file_that_asks_none_of_its_questions_opens(tmp_path: Path) -> None:
    (tmp_path / FILE).write_text('{"asked": [], "asks": true}')
    made, _ = desk()
    assert made.keep_in(tmp_path, pytest.fail) == ""
    made.open(lambda _: None, 1)
    assert made.present is None


def test_answers_that_would_be_too_many_to_read_leave_the_file_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, _ = desk()
    complaints: list[str] = []
    made.keep_in(tmp_path, complaints.append)
    ask(made, CHOICE)
    before = (tmp_path / FILE).read_bytes()
    monkeypatch.setattr(kept_file, "LARGEST", len(before))
    made.take(1, (1, 2, 1))
    assert complaints == ["the class's answers cannot be saved: File too large; the class goes on"]
    assert (tmp_path / FILE).read_bytes() == before
    assert "1,choice,2" in made.csv()


def test_a_class_that_cannot_be_read_is_set_aside_and_one_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    (tmp_path / FILE).write_text("{")
    made, _ = desk()
    assert "set-aside-class.json" in made.keep_in(tmp_path, pytest.fail)
    complaints: list[str] = []
    made.keep_in(tmp_path / "gone", complaints.append)
    ask(made, CHOICE)
    assert complaints == ["the class's answers cannot be saved: No such file or directory; the class goes on"]
    assert made.present is not None
