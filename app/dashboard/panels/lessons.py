"""Lessons panel: choose a lesson, and go through it step by step beside the running arm."""

from __future__ import annotations

import threading
from collections.abc import Callable
from html import escape
from typing import ClassVar

import numpy as np
import structlog
import viser

from app.dashboard.plots.lesson_figures import figure_of_run, name_of_figure, run_colors
from app.dashboard.transport.callback_errors import Fault, guarded
from app.dashboard.widgets.chips import chip
from app.dashboard.widgets.fields.controls import Desk
from app.dashboard.widgets.fields.field_words import refusal_in_words
from app.dashboard.widgets.lesson.class_panel import ClassPanel
from app.dashboard.widgets.lesson.lesson_answers import (
    CurveAnswer,
    GoalControls,
    NumberAnswer,
    OptionAnswer,
    answer_unit,
)
from app.dashboard.widgets.lesson.lesson_list import LessonList
from app.dashboard.widgets.lesson.outcome_chart import outcome_html
from app.dashboard.widgets.page.file_delivery import FileDelivery
from app.export.export_jobs import FigureJob
from app.export.formats import FIGURE_FORMATS
from app.lessons import blocks
from app.lessons.answers import Answer
from app.lessons.course import LessonCourse
from app.lessons.lesson import Lesson, LessonStep, shipped_lessons
from app.lessons.markup import html_of, inline_html
from app.lessons.playing import last_q, performance, play
from app.lessons.words import ENGLISH
from app.scenario.data import field_of
from app.scenario.errors import ScenarioError
from app.session.commands import Load, Pause, Play, Reset
from app.session.snapshot import Snapshot
from app.simulation.omega.search_memory import Memory

log = structlog.get_logger()


class LessonsPanel:
    """Lessons panel. Like the run that it changes, all pages of a session share the lesson that is open."""

    holds: ClassVar = "lessons, exercises, class"

    def __init__(self, desk: Desk) -> None:
        self._desk, gui = desk, desk.gui
        self._lessons = shipped_lessons()
        self._course: LessonCourse | None = None
        self._memory = Memory()
        self._delivery = FileDelivery()
        self._busy: threading.Thread | None = None
        self._shown: object = None
        self._entered = 0
        self._list = LessonList(desk, self._lessons, self._open)
        self._folder = gui.add_folder("Lesson", visible=False)
        with self._folder:
            self._head, self._text = gui.add_html(""), gui.add_html("")
            self._options = OptionAnswer(desk, self._answer)
            self._number = NumberAnswer(desk, self._answer)
            self._pad = CurveAnswer(desk, self._answer)
            self._class = ClassPanel(desk)
            self._run = gui.add_button("Run", visible=False, color="green")
            self._run.on_click(self._on_run)
            self._picture = gui.add_html("")
            self._figure = gui.add_button_group("Figure", tuple(FIGURE_FORMATS), visible=False)
            self._goal = GoalControls(desk)
            self._next = gui.add_button("")
            self._back, self._restore, self._leave = (gui.add_button("", color="gray") for _ in range(3))
        self._next.on_click(self._on_next)
        self._back.on_click(self._on_back)
        self._restore.on_click(self._on_restore)
        self._leave.on_click(self._on_leave)
        self._figure.on_click(guarded(self._on_figure, desk.complain))
        gui.add_command("Lesson: next step", hotkey="J").on_trigger(self._on_next)
        gui.add_command("Lesson: step back", hotkey="K").on_trigger(self._on_back)

    # what the user does

    def _open(self, lesson: Lesson) -> None:
        self._leave_course()
        course = self._course = LessonCourse(lesson, self._desk.notebook)
        self._desk.lock.words = course.words
        self._make_up(course)
        self._enter()

    async def _on_leave(self, _: object) -> None:
        self._close()

    def _leave_course(self) -> None:
        if self._course is not None:
            self._course.leave()
            self._busy = None  # what it computes is not waited for

    def _close(self) -> None:
        self._leave_course()
        self._course, self._desk.lock.fields = None, None
        self._desk.lock.words = ENGLISH
        self._desk.classroom.rest()

    async def _on_next(self, _: object) -> None:
        if self._course is not None and self._busy is None:
            self._go(self._course, 1)

    async def _on_back(self, _: object) -> None:
        if self._course is not None and self._busy is None:
            self._go(self._course, -1)

    async def _on_restore(self, _: object) -> None:
        self._enter(again=True)

    async def _on_run(self, _: object) -> None:
        course = self._course
        if course is None or self._busy is not None or not isinstance(course.step.block, blocks.LessonRun):
            return
        step = course.step
        self._desk.lock.post(performance(step))
        if step.number not in course.outcomes:
            self._work(lambda: course.take(step, play(step, self._memory)))

    # synchronous, unlike the other callbacks: it waits for a file in a thread of viser's pool

    def _on_figure(self, event: viser.GuiEvent[viser.GuiButtonGroupHandle]) -> None:
        course = self._course
        if course is None or (run := course.last_run) is None or (outcome := course.outcomes.get(run.number)) is None:
            return
        form = FIGURE_FORMATS[event.target.value]
        figure = figure_of_run(course.lesson, run, outcome, course.traces(run), course.predictions(run))
        job = FigureJob(figure, form)
        name = name_of_figure(course.lesson, run, form)
        self._delivery.give(event, "Figure", name, lambda on_progress: self._desk.export_jobs.made(job, on_progress))

    def _go(self, course: LessonCourse, by: int) -> None:
        before = course.step.number
        self._try(lambda: course.go(by))
        if course.step.number != before:
            if isinstance(course.step.block, blocks.Explain) or course.step.names_numbers:  # of runs that were skipped
                self._make_up(course)
            self._enter()
        elif by > 0:
            self._close()

    def _answer(self, given: object) -> None:
        if self._course is not None:
            course = self._course

            def give() -> None:
                course.give(given)
                self._desk.withdraw_complaint()

            self._try(give)

    def _try(self, act: Callable[[], None]) -> None:
        """Call `act`, which changes the course; a refusal or a full disk becomes a sentence on the page."""
        try:
            act()
        except ScenarioError as error:
            self._desk.complain(str(error))
        except OSError as error:
            self._desk.complain(Fault(f"the progress of lessons cannot be saved: {error.strerror}; the lesson goes on"))

    def _make_up(self, course: LessonCourse) -> None:
        if course.missing:
            self._work(lambda: course.make_up(self._memory))

    def _work(self, act: Callable[[], None]) -> None:
        """Call `act` in a thread of its own; until it returns, the step cannot be left."""

        def work() -> None:
            try:
                self._try(act)
            except Exception as error:
                log.error("fault", stage="a lesson", exc_info=error)
                self._desk.complain(Fault(f"the run of the lesson failed ({type(error).__name__}: {error})"))
            finally:
                # after "Leave the lesson", another lesson may be computing by now
                if self._busy is threading.current_thread():
                    self._busy = None

        self._busy = threading.Thread(target=work, name="lesson", daemon=True)
        self._busy.start()

    def _enter(self, *, again: bool = False) -> None:
        """Load the scenario of the shown step where it needs one, and lock the other fields for a goal. A run rests at
        its beginning: nobody sees it before the prediction unless he or she plays it.
        again: load the scenario of any step."""
        course = self._course
        if course is None:
            return
        step, lock = course.step, self._desk.lock
        lock.fields = None
        begins = step.run or step.goal or again or isinstance(step.block, blocks.StartScenario)
        if begins and step.scenario is not None:
            lock.post(Load(step.scenario))
            lock.post(Reset())
            lock.post(Pause() if step.run or course.lesson.asks_before_run(step) else Play())
        if goal := step.goal:
            lock.fields = frozenset(field_of(control.path) for control in goal.controls)
        self._entered += 1

    # what the page shows

    def show(self, snapshot: Snapshot) -> None:
        course = self._course
        self._class.show(course, "" if course is None else answer_unit(course.step, course))
        self._list.show(self._desk.notebook.progress, visible=course is None)
        if self._folder.visible != (course is not None):
            self._folder.visible = course is not None
        if course is None:
            self._shown = None
            return
        step, answer = course.step, course.answer
        self._goal.show(step, course, snapshot, self._entered)
        performing = snapshot.performing and step.run
        playing = course.words.phases[snapshot.phase] if performing else ""
        of = (course.lesson.name, step.number, answer, course.progress, len(course.outcomes), self._busy, playing)
        if of == self._shown:
            return
        self._shown = of
        busy = self._busy is not None
        self._folder.label = course.words.lesson
        self._head.content = _head(course)
        self._text.content = _text(course, computing=busy)
        self._options.show(step, answer, course)
        self._number.show(step, answer, course)
        self._pad.show(step, answer, course)
        run = course.last_run
        self._show_run(step, course, busy=busy, playing=playing)
        seen = run is not None and not (run is step and playing) and run.number in course.outcomes
        self._picture.content = (
            outcome_html(run, course.traces(run), course.predictions(run), run_colors(course.lesson), course.words)
            + _notes(run, course, snapshot)
            if run is not None and seen
            else ""
        )
        self._figure.visible = bool(self._picture.content)
        last = step.number == len(course.lesson.steps)
        words = course.words
        self._next.label = (
            words.computing if busy else words.finish if last else words.next if course.ready else words.skip[step.kind]
        )
        self._back.label = words.back
        self._restore.label = words.restore
        self._leave.label = words.leave
        self._figure.label = words.figure
        self._next.hint, self._back.hint = words.key.format("J"), words.key.format("K")
        self._restore.hint, self._leave.hint = words.restore_hint, words.leave_hint
        self._figure.hint = words.figure_hint
        self._next.disabled = busy
        self._next.color = None if course.ready else "gray"
        self._back.disabled = busy or step.number == 1

    def _show_run(self, step: LessonStep, course: LessonCourse, *, busy: bool, playing: str) -> None:
        run = step.run
        self._run.visible = run is not None
        if run is not None:
            again = step.number in course.outcomes
            label = course.words.of_run(run.title, run.seconds, again=again)
            self._run.label = playing if playing and again else label
            self._run.disabled = busy


def _head(course: LessonCourse) -> str:
    lesson, step = course.lesson, course.step
    language, title = escape(lesson.head.language), escape(lesson.head.title)
    fraction = step.number / len(lesson.steps)
    return (
        f'<div class="vs-lesson" lang="{language}" data-step="{step.number}"><div class="vs-row"><b>{title}</b>'
        f'<span class="vs-dim vs-right">{course.words.place.format(step.number, len(lesson.steps))}</span></div>'
        f'<div class="vs-share"><i style="width: {fraction:.1%}"></i></div></div>'
    )


def _text(course: LessonCourse, *, computing: bool) -> str:
    """Text of the shown step as HTML; an explanation begins with the scores of the predictions. computing: whether the
    missing runs are being computed."""
    step, measured, words = course.step, course.measured, course.words
    lang = f'lang="{words.language}"'
    parts = []
    if step.number == 1:
        knows = "".join(f"<li>{inline_html(item)}</li>" for item in course.lesson.head.knows)
        parts.append(f'<p class="vs-dim" {lang}>{words.knows}</p><ul>{knows}</ul>')
    if isinstance(step.block, blocks.Explain):
        parts += [_scored(of, answer, course) for of, answer in course.explained()]
    parts.append(html_of(step.text, measured))
    if computing and course.missing and step.names_numbers:
        parts.append(f'<p class="vs-dim" {lang}>{words.missing}</p>')
    if isinstance(step.block, blocks.Explain) and step.block.equation:
        cited = words.equations if "," in step.block.equation else words.equation
        parts.append(f'<p class="vs-dim" {lang}>{cited.format(escape(step.block.equation))}</p>')
    if step.ask:
        parts.append(f'<p class="vs-question">{inline_html(step.ask, measured)}</p>')
    return f'<div class="vs-lesson vs-prose" lang="{escape(course.lesson.head.language)}">{"".join(parts)}</div>'


def _scored(step: LessonStep, answer: Answer, course: LessonCourse) -> str:
    """Score of an answer as HTML: words of the program, and in it the options, which are the lesson's own text."""
    if answer.score is None or step.question is None:
        return ""
    words, given, feedback = course.words, "", inline_html(answer.feedback)
    mark = chip(words.right, "vs-good") if answer.score >= 1.0 else chip(words.wrong, "vs-warn")
    if isinstance(step.block, blocks.ChoiceQuestion) and isinstance(answer.given, int):
        chosen, right = (
            f'<span lang="{escape(course.lesson.head.language)}">{inline_html(option, course.measured)}</span>'
            for option in (step.block.options[answer.given - 1], step.block.options[step.block.right - 1])
        )
        given = f"{words.given} <i>{chosen}</i>."
        feedback = "" if answer.score >= 1.0 else words.what_happens.format(right)
    return f'<div class="vs-scored" lang="{words.language}">{mark} {given} {feedback[:1].upper()}{feedback[1:]}</div>'


def _notes(run: LessonStep, course: LessonCourse, snapshot: Snapshot) -> str:
    """Notes on a run as HTML: a refused edit, an early stop, and changes by hand of the run in the scene."""
    outcome, words = course.outcomes[run.number], course.words
    notes = []
    if outcome.refusal:
        notes.append(words.refused.format(_english(refusal_in_words(outcome.refusal))))
    if outcome.stopped:
        notes.append(words.stopped.format(_english(outcome.stopped)))
    if run is course.step and snapshot.phase != "running" and snapshot.scenario.name == _name_of(run):
        now = last_q(snapshot.recording)
        if len(now) and abs(snapshot.end - _ends(run)) < 1e-6 and not np.array_equal(now, outcome.q):
            notes.append(words.changed_run)
    return "".join(f'<div class="vs-note" lang="{words.language}">{note}</div>' for note in notes)


def _english(sentence: str) -> str:
    """Sentence of the simulation, which is in English in every lesson, as HTML."""
    return f'<span lang="en">{escape(sentence)}</span>'


def _name_of(run: LessonStep) -> str:
    return "" if run.scenario is None else run.scenario.name


def _ends(step: LessonStep) -> float:
    return step.run.seconds if step.run else 0.0
