"""Course through a lesson: what is locked when, what is scored, what is kept; and the run on the page is the run that
is measured."""

from __future__ import annotations

import asyncio
import csv
import io
import json
import re
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast
from unittest.mock import MagicMock

import numpy as np
import pytest

from app.dashboard.panels.lessons import LessonsPanel
from app.dashboard.plots.lesson_figures import run_colors
from app.dashboard.theme.colors import MEASURED, line_css
from app.dashboard.widgets.lesson.lesson_answers import CurveAnswer, NumberAnswer, OptionAnswer
from app.dashboard.widgets.lesson.lesson_list import _state
from app.dashboard.widgets.lesson.outcome_chart import _Frame, _path, outcome_html
from app.lessons.answers import (
    Answer,
    LessonProgress,
    Notebook,
    admitted,
    csv_of,
    json_of,
    score_choice,
    score_curve,
    score_number,
)
from app.lessons.blocks import ChoiceQuestion, CurveQuestion, Goal, LessonRun, NumberQuestion, PictureLine
from app.lessons.course import LessonCourse
from app.lessons.lesson import LessonStep, shipped_lessons
from app.lessons.measures import MeasuredNumber
from app.lessons.playing import POINTS, Trace, _trace, performance, play, runs
from app.lessons.words import ENGLISH, GERMAN
from app.scenario.data import edited, load, shipped
from app.scenario.errors import ScenarioError
from app.session.commands import SetSpeed
from app.session.runner import Runner
from app.simulation.closed_loop import ClosedLoop
from drivers.waiting import until
from tests.lessons.test_lessons import lesson

NUMBER = NumberQuestion(ask="?", measure="way", tolerance=1.0, wrong=(0.0,))
LINE = PictureLine(signal="e_r.2", unit="mm", title="way")
CURVE = CurveQuestion(
    ask="?", line=LINE, start=0.0, end=1.0, low=-1.0, high=1.0, tolerance=0.1, wrong=(((0.0, 0.0), (1.0, 0.0)),)
)
CHOICE = ChoiceQuestion(ask="?", options=("a", "b"), right=2)


def through(course: LessonCourse, to: str) -> None:
    """Go on to the next step of this kind."""
    course.go(1)
    while course.step.kind != to:
        course.go(1)


def test_an_answer_counts_once_before_the_run_and_is_scored_at_the_explanation() -> None:
    course = LessonCourse(lesson(), Notebook())
    course.go(1)
    course.give(27.5)
    with pytest.raises(ScenarioError, match="locked, as one was given before"):
        course.give(28.0)
    course.go(2)
    course.give(2)
    through(course, "run")
    assert not course.ready
    course.take(course.step, play(course.step))
    assert course.ready
    assert [answer.given for _, answer in course.predictions(course.step)] == [27.5, 2]
    assert all(answer.score is None for answer in course.progress.answers.values())
    course.go(-2)  # the curve was skipped, and now its outcome is known
    assert not course.open
    with pytest.raises(ScenarioError, match="locked, as the run has been seen"):
        course.give([(0.0, 0.0), (1.0, 1.0)])
    through(course, "observe")
    course.give(1)
    through(course, "explain")
    scores = {step.number: answer.score for step, answer in course.explained()}
    assert scores == {2: 1.0, 4: 0.0, 6: 1.0}
    assert "measured 27.9 mm" in course.progress.answers[2].feedback
    assert course.measured == {"way": "27.9 mm"}
    through(course, "goal")
    assert not course.ready
    course.reached_goal()
    assert course.ready
    assert course.progress.finished


def test_progress_survives_a_restart_and_the_runs_are_played_again(tmp_path: Path) -> None:
    notebook = Notebook()
    assert notebook.keep_in(tmp_path) == ""
    course = LessonCourse(lesson(), notebook)
    course.go(1)
    course.give(3.0)
    course.go(1)
    course.give([(0.0, 0.0), (1.0, 30.0)])
    through(course, "run")
    course.take(course.step, play(course.step))
    through(course, "explain")

    later = Notebook()
    assert later.keep_in(tmp_path) == ""
    again = LessonCourse(lesson(), later)
    assert again.progress == course.progress
    assert again.step.kind == "explain"
    assert again.measured == {}
    again.make_up()
    assert again.measured == course.measured

    rows = list(csv.reader(io.StringIO(csv_of(later.progress))))
    assert rows[0] == ["lesson", "step", "answer", "score", "verdict"]
    assert rows[1][:4] == ["test", "2", "3", "0"]
    assert rows[2][:3] == ["test", "3", "0,0 1,30"]
    assert json.loads(json_of(later.progress))["test"]["answers"]["2"]["given"] == 3.0


def test_an_observation_that_was_skipped_can_be_made_after_a_later_run() -> None:
    """Only a prediction is locked by the run that it predicts."""
    again = '```run\ntitle = "again"\nseconds = 0.1\nshow = [{ signal = "e_r.2", unit = "mm", title = "way" }]\n```\n'
    course = LessonCourse(lesson(("```explain", f"{again}```explain")), Notebook())
    for _ in range(2):
        through(course, "run")
        course.take(course.step, play(course.step))
    course.go(-1)
    assert course.step.kind == "observe"
    course.give(1)
    course.go(-2)
    assert course.step.kind == "predict"
    with pytest.raises(ScenarioError, match="locked, as the run has been seen"):
        course.give(1)


def test_a_run_that_is_computed_for_a_lesson_that_was_left_has_not_been_seen() -> None:
    """It would lock the predictions of the lesson that is taken again."""
    notebook = Notebook()
    course = LessonCourse(lesson(), notebook)
    through(course, "run")
    run, before = course.step, course.progress
    course.leave()
    course.take(run, play(run))
    course.make_up()
    assert (notebook.of(course.lesson.name), course.outcomes) == (before, {})


def test_a_run_that_was_left_out_is_played_for_its_explanation() -> None:
    course = LessonCourse(lesson(), Notebook())
    course.go(1)
    course.give(27.5)
    through(course, "explain")
    assert course.measured == {}
    worked: list[object] = []
    panel = SimpleNamespace(_try=lambda act: act(), _make_up=worked.append, _enter=lambda: None)
    course.go(-1)
    LessonsPanel._go(cast(LessonsPanel, panel), course, 1)
    assert worked == [course]
    course.make_up()
    assert course.measured == {"way": "27.9 mm"}
    assert course.progress.answers[2].score == 1.0


def test_answers_are_right_within_their_tolerance_only() -> None:
    measurements = {"way": MeasuredNumber(10.0, "mm")}
    assert [score_number(NUMBER, given, measurements).points for given in (8.99, 9.0, 11.0, 11.01)] == [
        0.0,
        1.0,
        1.0,
        0.0,
    ]
    assert "off by 1.01 mm" in score_number(NUMBER, 11.01, measurements).feedback
    assert [score_choice(CHOICE, given).points for given in (1, 2)] == [0.0, 1.0]
    t = np.linspace(0.0, 1.0, 50)
    trace = Trace("run", LINE, t, np.sin(t))
    drawn = list(zip(t.tolist(), (np.sin(t) + 0.09).tolist(), strict=True))
    assert score_curve(CURVE, drawn, trace).points == 1.0
    assert score_curve(CURVE, [(at, value + 0.02) for at, value in drawn], trace).points == 0.0


def test_a_run_has_one_colour_in_all_pictures_of_its_lesson() -> None:
    for each in shipped_lessons().values():
        runs = [step.block.title for step in each.steps if isinstance(step.block, LessonRun)]
        colors = run_colors(each)
        assert len({colors[title] for title in runs}) == len(set(runs))
        assert MEASURED not in colors.values()  # that of the predictions
    line, t = PictureLine(signal="F.1", unit="N", title="force on the wall"), np.array([0.0, 1.0])
    traces = [Trace(title, line, t, t) for title in ("wall as believed", "softer wall")]
    colors = run_colors(shipped_lessons()["03-wall"])
    for step in (5, 9):
        run = LessonStep(step, step, "run", "", LessonRun("softer wall", 1.0, (line,), {}), None)
        drawn = outcome_html(run, traces, (), colors)
        assert re.findall(r'stroke="(var[^"]*)"', drawn) == [line_css(colors[trace.run]) for trace in traces]


def test_a_lesson_whose_goal_was_not_met_says_so_when_it_is_done() -> None:
    with_goal = shipped_lessons()["03-wall"]
    (goal,) = (step.number for step in with_goal.steps if isinstance(step.block, Goal))
    assert ">done, goal not met<" in _state(with_goal, LessonProgress(finished=True))
    assert ">done<" in _state(with_goal, LessonProgress(finished=True, goals=(goal,)))
    assert ">done<" in _state(shipped_lessons()["05-heavy-arm"], LessonProgress(finished=True))
    assert ">begun<" in _state(with_goal, LessonProgress(step=2))


def test_a_lesson_that_was_left_does_not_unlock_the_one_that_computes_now() -> None:
    panel = SimpleNamespace(_busy=None, _try=lambda act: act())
    first, second = threading.Event(), threading.Event()
    threads: list[threading.Thread] = []
    for goes_on in (first, second):
        LessonsPanel._work(cast(LessonsPanel, panel), lambda goes_on=goes_on: cast(None, goes_on.wait(60.0)))
        threads.append(cast(threading.Thread, panel._busy))
    first.set()
    threads[0].join(60.0)
    assert panel._busy is threads[1]
    second.set()
    threads[1].join(60.0)
    assert panel._busy is None


@pytest.mark.parametrize(
    ("question", "given"),
    [
        (CHOICE, 0), (CHOICE, 3), (CHOICE, "1"), (NUMBER, float("nan")), (NUMBER, "3"), (NUMBER, True),
        (CHOICE, True), (NUMBER, 1.75e308), (NUMBER, -1.1e12),
        (CURVE, [[0.0, 1.75e308], [1.0, 0.0]]), (CURVE, [[0.0, 0.0], [1.0, -1.1]]), (CURVE, [[0.0, 0.0], [1.1, 0.0]]),
        (CURVE, [[-0.1, 0.0], [1.0, 0.0]]), (CURVE, [[0.0, 10**400], [1.0, 0.0]]),
        pytest.param(CHOICE, 10**400, id="huge choice"), pytest.param(NUMBER, 10**400, id="huge number"),
        (CURVE, 3), (CURVE, [[0.0, 0.0]]), (CURVE, [[1.0, 0.0], [0.0, 0.0]]), (CURVE, [[0.0, 1e400], [1.0, 0.0]]),
        (CURVE, [[0.0, 0.0]] * 501), (CURVE, [[0.0, 0.0, 0.0], [1.0, 0.0]]),
    ],
)  # fmt: skip
def test_what_is_no_answer_is_refused(question: ChoiceQuestion | NumberQuestion | CurveQuestion, given: object) -> None:
    with pytest.raises(ScenarioError, match="answer: "):
        admitted(question, given)


def test_the_chosen_option_is_marked_by_its_score() -> None:
    gui = MagicMock()
    gui.add_button.side_effect = lambda *_, **__: MagicMock(icon=None)
    options = OptionAnswer(cast(Any, SimpleNamespace(gui=gui)), lambda _: None)
    step, course = LessonStep(2, 2, "question", "", CHOICE, None), cast(Any, SimpleNamespace(measured={}, open=False))
    for answer, icons in (
        (None, [None, None]),
        (Answer(1), ["point", None]),
        (Answer(1, 0.0, "what happens: b"), ["x", None]),
        (Answer(2, 1.0, "right"), [None, "check"]),
    ):
        options.show(step, answer, course)
        assert [button.icon for button in options._buttons[:2]] == icons
        assert [button.disabled for button in options._buttons[:2]] == [icon is None for icon in icons]


def test_another_lesson_begins_with_an_empty_answer_and_a_comma_of_three_digits_is_no_number() -> None:
    given, complaints = list[object](), list[str]()

    def add(*_: object, **__: object) -> Any:
        return MagicMock(value="")

    gui = SimpleNamespace(add_form=add, add_text=add, add_button=add)
    desk: Any = SimpleNamespace(gui=gui, complain=complaints.append)
    number = NumberAnswer(desk, given.append)
    course: Any = SimpleNamespace(words=ENGLISH, lesson=SimpleNamespace(name="one", steps=()), open=True)
    step = LessonStep(2, 2, "question", "", NUMBER, None)
    number.show(step, None, course)
    number._text.value = "1,000"
    number.show(step, None, course)
    assert number._text.value == "1,000"
    asyncio.run(number._on_lock(None))
    assert complaints == ["your answer: 1,000 can be read in two ways; allowed: 1.000 or 1000"]
    course.words = GERMAN
    number.show(step, None, course)
    for text, complaint in (
        ("1,250", "Antwort: 1,250 ist auf zwei Arten lesbar; erlaubt: 1,2500 oder 1250"),
        ("viel", "Antwort: 'viel'; erlaubt: eine Zahl wie 12,5"),
    ):
        number._text.value = text
        asyncio.run(number._on_lock(None))
        assert complaints.pop() == complaint
    for text, value in (("29,5", 29.5), ("−0,125", -0.125), ("1000", 1000.0), ("1,2500", 1.25)):
        number._text.value = text
        asyncio.run(number._on_lock(None))
        assert given.pop() == value
    number.show(step, Answer(12.5, 1.0, "right"), course)
    assert number._text.value == "12,5"
    course.lesson.name = "another"
    number.show(step, None, course)
    assert number._text.value == ""


@pytest.mark.parametrize("drawn", ["", "{", "[" * 100_000, '"\ud800"'], ids=["none", "cut", "deep", "no UTF-8"])
def test_what_is_no_drawn_line_is_said(drawn: str) -> None:
    complaints: list[str] = []
    desk = SimpleNamespace(complain=complaints.append)
    answer = SimpleNamespace(_field=SimpleNamespace(value=drawn), _desk=desk, _words=ENGLISH)
    asyncio.run(CurveAnswer._on_lock(cast(CurveAnswer, answer), None))
    assert complaints == ["your line: nothing is drawn yet; allowed: draw it on the axes, or use the arrow keys"]


@pytest.mark.parametrize("points", [POINTS, 80], ids=["every row", "thinned"])
def test_the_line_of_a_signal_that_has_no_value_for_a_while_has_a_gap_there(
    points: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The bound (20), while the true arm is outside the declared set."""
    monkeypatch.setattr("app.lessons.playing.POINTS", points)
    loop = ClosedLoop.from_scenario(load("ur5-hybrid"))
    for scaling in (1.15, 1.3, 1.15):
        loop.edit(edited(loop.system.scenario, "truth.link_scaling", scaling))
        for _ in range(100):
            loop.advance()
    trace = _trace(loop.system, loop.recording, PictureLine("s_bound", "mm/s", "bound"), "run")
    gap = trace.t[~np.isfinite(trace.values)]
    assert 0.099 < gap.min() < 0.107 < 0.19 < gap.max() < 0.205
    path = _path(_Frame(0.0, 0.3, -10.0, 100.0), np.column_stack([trace.t, trace.values]))
    assert path.count("M") == 2
    assert "nan" not in path
    assert np.isfinite(trace.at(np.linspace(0.0, 0.3, 50))).all()


def test_a_line_along_the_ends_of_its_rounded_axes_is_an_answer() -> None:
    drawn = [[0.0, 1.0 + 1e-6], [1.0 + 1e-6, -1.0]]
    assert admitted(CURVE, drawn) == [tuple(point) for point in drawn]


def test_the_run_on_the_page_is_the_run_that_is_measured_to_the_last_bit() -> None:
    """Edits happen at the same control periods, and the run ends where the lesson says."""
    (step,) = runs(lesson())
    runner = Runner(shipped()["ur5-impedance"])
    runner.start()
    try:
        runner.post(SetSpeed(5.0))
        runner.post(performance(step))
        until(lambda: runner.snapshot.phase == "paused" and runner.snapshot.end >= 0.9)
        seen = runner.snapshot
    finally:
        runner.close()
    assert seen.end == pytest.approx(1.0, abs=1e-9)
    assert seen.scenario.target_model.K_m[1] == 900.0
    measured = play(step)
    assert (seen.recording.signals(("q",))["q"][-1] == measured.q).all()
    assert seen.refusal is None
