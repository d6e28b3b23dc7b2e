"""Lessons panel: choose a lesson, and go through it step by step beside the running arm."""

from __future__ import annotations

import threading
from collections.abc import Callable, Coroutine, Mapping
from html import escape

import msgspec
import numpy as np
import structlog
import viser

from app.dashboard.plots.lesson_figures import figure_of_run, name_of_figure
from app.dashboard.theme.style import MARKS
from app.dashboard.transport.callback_errors import guarded
from app.dashboard.widgets.chips import chip
from app.dashboard.widgets.class_panel import ClassPanel
from app.dashboard.widgets.controls import Desk, FieldPlace, NumberField, SliderScale
from app.dashboard.widgets.file_delivery import FileDelivery
from app.dashboard.widgets.model_fields import DiagonalPlace
from app.dashboard.widgets.outcome_chart import outcome_html, pad_html
from app.export.export_jobs import FigureJob
from app.export.formats import Format
from app.lessons import blocks
from app.lessons.answers import Answer, LessonProgress, csv_of, json_of
from app.lessons.course import LessonCourse
from app.lessons.lesson import Lesson, LessonStep, shipped_lessons
from app.lessons.markup import html_of, inline_html
from app.lessons.measures import taken, unmet
from app.lessons.playing import last_q, performance, play
from app.scenario.schema import ScenarioError
from app.session.commands import Load, Pause, Play, Reset
from app.session.snapshot import Snapshot
from app.simulation.search_memory import Memory

log = structlog.get_logger()

MOST_OPTIONS = 5
FORMATS: dict[str, Format] = {"SVG": "svg", "PDF": "pdf", "PNG": "png"}
LANGUAGES = {"en": "", "de": "Deutsch"}
_KINDS = {
    "scenario": "the scene",
    "predict": "predict",
    "run": "run",
    "observe": "observe",
    "explain": "explained",
    "goal": "goal",
}


class LessonsPanel:
    """Lessons panel. Like the run that it changes, all pages of a session share the lesson that is open."""

    def __init__(self, desk: Desk) -> None:
        self._desk, gui = desk, desk.gui
        self._lessons = shipped_lessons()
        self._course: LessonCourse | None = None
        self._memory = Memory()
        self._delivery = FileDelivery()
        self._busy: threading.Thread | None = None
        self._draft: object = None
        self._shown: object = None
        self._entered = 0
        self._list = _List(desk, self._lessons, self._open)
        self._folder = gui.add_folder("Lesson", visible=False)
        with self._folder:
            self._head, self._text = gui.add_html(""), gui.add_html("")
            self._options = _Options(desk, self._answer)
            self._number = _NumberAnswer(desk, self._answer)
            self._pad = _Pad(desk, self._answer)
            self._class = ClassPanel(desk)
            self._run = gui.add_button("Run", visible=False, color="green")
            self._run.on_click(self._on_run)
            self._picture = gui.add_html("")
            self._figure = gui.add_button_group("Figure", tuple(FORMATS), visible=False, hint="This picture on white.")
            self._goal = _Goal(desk)
            self._next = gui.add_button("Next", hint="Key: J")
            self._back = gui.add_button("Back", color="gray", hint="Key: K")
            self._restore = gui.add_button(
                "Return to the lesson's scene", color="gray", hint="After playing freely: the step's scenario again."
            )
            self._leave = gui.add_button("Leave the lesson", color="gray", hint="It goes on from here next time.")
        self._next.on_click(self._on_next)
        self._back.on_click(self._on_back)
        self._restore.on_click(self._on_restore)
        self._leave.on_click(self._on_leave)
        self._figure.on_click(guarded(self._on_figure, desk.complain))
        gui.add_command("Lesson: next step", hotkey="J").on_trigger(self._on_next)
        gui.add_command("Lesson: step back", hotkey="K").on_trigger(self._on_back)

    # what the user does

    def _open(self, lesson: Lesson) -> None:
        self._course = LessonCourse(lesson, self._desk.notebook)
        if self._course.progress.finished and self._course.progress.step == len(lesson.steps):
            self._course.go(1 - len(lesson.steps))
        self._make_up(self._course)
        self._enter()

    async def _on_leave(self, _: object) -> None:
        self._close()

    def _close(self) -> None:
        self._course, self._desk.lock.fields = None, None
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
        form = FORMATS[event.target.value]
        figure = figure_of_run(course.lesson, run, outcome, course.traces(run), course.predictions(run))
        job = FigureJob(figure, form)
        name = name_of_figure(course.lesson, run, form)
        self._delivery.give(event, "Figure", name, lambda tell: self._desk.export_jobs.made(job, tell))

    def _go(self, course: LessonCourse, by: int) -> None:
        before = course.step.number
        self._try(lambda: course.go(by))
        if course.step.number != before:
            self._enter()
        elif by > 0:
            self._close()

    def _answer(self, given: object) -> None:
        if self._course is not None:
            course = self._course
            self._try(lambda: course.give(given))

    def _try(self, act: Callable[[], None]) -> None:
        """Call `act`, which changes the course; a refusal or a full disk becomes a sentence on the page."""
        try:
            act()
        except ScenarioError as error:
            self._desk.complain(str(error))
        except OSError as error:
            self._desk.complain(f"the progress of lessons cannot be saved: {error.strerror}; the lesson goes on")

    def _make_up(self, course: LessonCourse) -> None:
        if course.missing:
            self._work(lambda: course.make_up(self._memory))

    def _work(self, act: Callable[[], None]) -> None:
        """Call `act` in a thread of its own; until it returns, the step cannot be left."""

        def work() -> None:
            try:
                act()
            except ScenarioError as error:
                self._desk.complain(str(error))
            except Exception as error:
                log.error("fault", stage="a lesson", exc_info=error)
                self._desk.complain(f"the run of the lesson failed ({type(error).__name__}: {error})")
            finally:
                self._busy = None

        self._busy = threading.Thread(target=work, name="lesson", daemon=True)
        self._busy.start()

    def _enter(self, *, again: bool = False) -> None:
        """Load the scenario of the shown step where it needs one, and lock the other fields for a goal.
        again: load the scenario of any step."""
        course = self._course
        if course is None:
            return
        step, lock = course.step, self._desk.lock
        lock.fields = None
        begins = isinstance(step.block, blocks.StartScenario | blocks.Goal) or again
        if begins and step.scenario is not None:
            lock.post(Load(step.scenario))
            lock.post(Reset())
            lock.post(Play())
        elif isinstance(step.block, blocks.LessonRun) and step.scenario is not None:
            lock.post(Load(step.scenario))
            lock.post(Reset())
            lock.post(Pause())
        if isinstance(step.block, blocks.Goal):
            lock.fields = frozenset(_field(control.path) for control in step.block.controls)
        self._entered += 1

    # what the page shows

    def show(self, snapshot: Snapshot) -> None:
        course = self._course
        self._class.show(course, "" if course is None else _unit_of(course.step, course))
        self._list.show(self._desk.notebook.progress, visible=course is None)
        if self._folder.visible != (course is not None):
            self._folder.visible = course is not None
        if course is None:
            self._shown = None
            return
        step, answer = course.step, course.answer
        self._goal.show(step, course, snapshot, self._entered)
        playing = snapshot.phase == "running" and isinstance(step.block, blocks.LessonRun)
        of = (course.lesson.name, step.number, answer, course.progress, len(course.outcomes), self._busy, playing)
        if of == self._shown:
            return
        self._shown = of
        busy = self._busy is not None
        self._head.content = _head(course)
        self._text.content = _text(course)
        self._options.show(step, answer, course)
        self._number.show(step, answer, course)
        self._pad.show(step, answer, course)
        run = course.last_run
        self._show_run(step, course, busy=busy, playing=playing)
        seen = run is not None and not (run is step and playing) and run.number in course.outcomes
        self._picture.content = (
            outcome_html(run, course.traces(run), course.predictions(run)) + _notes(run, course, snapshot)
            if run is not None and seen
            else ""
        )
        self._figure.visible = bool(self._picture.content)
        last = step.number == len(course.lesson.steps)
        self._next.label = (
            "computing …" if busy else "Finish" if last else "Next" if course.ready else f"Skip: {_KINDS[step.kind]}"
        )
        self._next.disabled = busy
        self._next.color = None if course.ready else "gray"
        self._back.disabled = busy or step.number == 1

    def _show_run(self, step: LessonStep, course: LessonCourse, *, busy: bool, playing: bool) -> None:
        runs = isinstance(step.block, blocks.LessonRun)
        self._run.visible = runs
        if isinstance(step.block, blocks.LessonRun):
            again = step.number in course.outcomes
            seconds = f"{step.block.seconds:g} s"
            label = "Run again" if again else "Run"
            self._run.label = "running …" if playing and again else f"{label} ({seconds})"
            self._run.disabled = busy


def _field(path: str) -> str:
    """Dotted path of the scenario's field that a control changes: without the index of an entry."""
    field, _, last = path.rpartition(".")
    return field if last.isdecimal() else path


def _head(course: LessonCourse) -> str:
    lesson, step = course.lesson, course.step
    language, title = escape(lesson.head.language), escape(lesson.head.title)
    share = step.number / len(lesson.steps)
    return (
        f'<div class="vs-lesson" lang="{language}" data-step="{step.number}"><div class="vs-row"><b>{title}</b>'
        f'<span class="vs-dim vs-right">{step.number} of {len(lesson.steps)}</span></div>'
        f'<div class="vs-share"><i style="width: {share:.1%}"></i></div></div>'
    )


def _text(course: LessonCourse) -> str:
    """Text of the shown step as HTML; an explanation begins with the scores of the predictions."""
    step, measured = course.step, course.measured
    parts = []
    if step.number == 1:
        knows = "".join(f"<li>{inline_html(item)}</li>" for item in course.lesson.head.knows)
        parts.append(f'<p class="vs-dim">Afterwards you will know</p><ul>{knows}</ul>')
    if isinstance(step.block, blocks.Explain):
        parts += [_scored(of, answer, measured) for of, answer in course.explained()]
    parts.append(html_of(step.text, measured))
    if isinstance(step.block, blocks.Explain) and step.block.equation:
        parts.append(f'<p class="vs-dim">equation {escape(step.block.equation)} of the note</p>')
    if isinstance(step.block, blocks.ChoiceQuestion | blocks.NumberQuestion | blocks.CurveQuestion | blocks.Goal):
        parts.append(f'<p class="vs-question">{inline_html(step.block.ask, measured)}</p>')
    return f'<div class="vs-lesson vs-prose" lang="{escape(course.lesson.head.language)}">{"".join(parts)}</div>'


def _scored(step: LessonStep, answer: Answer, measured: dict[str, str]) -> str:
    if answer.score is None or step.question is None:
        return ""
    mark = chip("right", "vs-good") if answer.score >= 1.0 else chip("not so", "vs-warn")
    given = ""
    if isinstance(step.block, blocks.ChoiceQuestion) and isinstance(answer.given, int):
        given = inline_html(step.block.options[answer.given - 1], measured)
    verdict = "" if answer.verdict == "right" else inline_html(answer.verdict, measured)
    return f'<div class="vs-scored">{mark} <i>{given}</i> {verdict}</div>'


def _notes(run: LessonStep, course: LessonCourse, snapshot: Snapshot) -> str:
    """Notes on a run as HTML: a refused edit, an early stop, and changes by hand of the run in the scene."""
    outcome = course.outcomes[run.number]
    notes = []
    if outcome.refusal:
        notes.append(f"Refused: {outcome.refusal}")
    if outcome.stopped:
        notes.append(f"Stopped: {outcome.stopped}")
    if run is course.step and snapshot.phase != "running" and snapshot.scenario.name == _name_of(run):
        now = last_q(snapshot.recording)
        if len(now) and abs(snapshot.end - _ends(run)) < 1e-6 and not np.array_equal(now, outcome.q):
            notes.append("You changed this run while it went on: the picture shows it as the lesson describes it.")
    return "".join(f'<div class="vs-note">{escape(note)}</div>' for note in notes)


def _name_of(run: LessonStep) -> str:
    return "" if run.scenario is None else run.scenario.name


def _ends(run: LessonStep) -> float:
    return run.block.seconds if isinstance(run.block, blocks.LessonRun) else 0.0


class _List:
    """List of lessons, with the progress in each, and the answers as files."""

    def __init__(self, desk: Desk, lessons: dict[str, Lesson], open_lesson: Callable[[Lesson], None]) -> None:
        self._desk, self._lessons, self._open = desk, lessons, open_lesson
        self._titles = {_title(name, lesson): lesson for name, lesson in lessons.items()}
        self._folder = desk.gui.add_folder(None)
        with self._folder:
            desk.gui.add_html(
                '<div class="vs-lesson vs-prose"><p>Each lesson asks before it shows: commit yourself, run it, look, '
                "and read why. Ten minutes each; the arm on the left is yours all the time.</p></div>"
            )
            self._choice = desk.gui.add_dropdown("Lesson", tuple(self._titles), hint="They build on one another.")
            self._about = desk.gui.add_html("")
            self._begin = desk.gui.add_button("Begin")
            hint = "All answers so far, as a file; otherwise they stay on the server."
            self._files = desk.gui.add_button_group("Your answers", ("CSV", "JSON"), hint=hint)
            self._class_file = desk.gui.add_button("Answers of the class (CSV)", color="gray", visible=False)
        self._begin.on_click(self._on_begin)
        self._files.on_click(self._on_file)
        self._class_file.on_click(self._on_class_file)

    async def _on_begin(self, _: object) -> None:
        self._open(self._titles[self._choice.value])

    async def _on_file(self, event: viser.GuiEvent) -> None:
        if event.client is None:
            return
        form, progress = self._files.value.lower(), self._desk.notebook.progress
        text = csv_of(progress) if form == "csv" else json_of(progress)
        event.client.send_file_download(f"lessons.{form}", text.encode(), save_immediately=True)

    async def _on_class_file(self, event: viser.GuiEvent) -> None:
        if event.client is not None:
            event.client.send_file_download("class.csv", self._desk.classroom.csv().encode(), save_immediately=True)

    def show(self, progress: Mapping[str, LessonProgress], *, visible: bool) -> None:
        """Show the chosen lesson, and the progress in it."""
        if self._folder.visible != visible:
            self._folder.visible = visible
        if not visible:
            return
        self._class_file.visible = bool(self._desk.classroom.asked)
        lesson = self._titles[self._choice.value]
        done = progress.get(lesson.name)
        knows = "".join(f"<li>{inline_html(item)}</li>" for item in lesson.head.knows)
        state, label = "", "Begin"
        if done is not None:
            scores = [answer.score for answer in done.answers.values() if answer.score is not None]
            told = f"{sum(scores):g} of {len(scores)} answers right" if scores else "begun"
            state = f"<p>{chip('done', 'vs-good') if done.finished else chip('begun', 'vs-warn')} {told}</p>"
            label = "Take it again" if done.finished else f"Continue at step {done.step}"
        content = (
            f'<div class="vs-lesson vs-prose"><p class="vs-dim">{lesson.head.minutes:g} minutes. '
            f"Afterwards you will know</p><ul>{knows}</ul>{state}</div>"
        )
        if self._about.content != content:
            self._about.content = content
        if self._begin.label != label:
            self._begin.label = label


def _title(name: str, lesson: Lesson) -> str:
    number = name.partition("-")[0].lstrip("0")
    language = LANGUAGES.get(lesson.head.language, lesson.head.language)
    return f"{number}. {lesson.head.title}" + (f" ({language})" if language else "")


class _Options:
    """Buttons of a question with options."""

    def __init__(self, desk: Desk, answer: Callable[[object], None]) -> None:
        self._answer = answer
        self._folder = desk.gui.add_folder(None, visible=False)
        with self._folder:
            desk.gui.add_html('<i class="vs-options"></i>')
            self._buttons = [desk.gui.add_button("", visible=False) for _ in range(MOST_OPTIONS)]
        for number, button in enumerate(self._buttons, start=1):
            button.on_click(self._answering(number))

    def _answering(self, number: int) -> Callable[[object], Coroutine[None, None, None]]:
        async def on_click(_: object) -> None:
            self._answer(number)

        return on_click

    def show(self, step: LessonStep, answer: Answer | None, course: LessonCourse) -> None:
        options = step.block.options if isinstance(step.block, blocks.ChoiceQuestion) else ()
        self._folder.visible = bool(options)
        for number, button in enumerate(self._buttons, start=1):
            button.visible = number <= len(options)
            if number <= len(options):
                text = options[number - 1]
                for name, told in course.measured.items():
                    text = text.replace(f"{{{{{name}}}}}", told)
                chosen = answer is not None and answer.given == number
                button.label = f"{'ABCDE'[number - 1]}  {text}"
                button.color = None if chosen or answer is None else "gray"
                button.disabled = not chosen and not course.open


class _NumberAnswer:
    """Text field of a question for a number, and the button that locks the answer."""

    def __init__(self, desk: Desk, answer: Callable[[object], None]) -> None:
        self._desk, self._answer = desk, answer
        self._form = desk.gui.add_form(None, visible=False)
        with self._form:
            self._text = desk.gui.add_text("", "")
        self._lock = desk.gui.add_button("Lock my answer", visible=False, hint="It counts once, before the run.")
        self._text.on_update(self._on_text)
        self._lock.on_click(self._on_lock)
        self._step = 0

    async def _on_text(self, event: viser.GuiEvent) -> None:
        if event.client is not None and self._text.value.endswith(MARKS):
            self._text.value = self._text.value.rstrip("".join(MARKS))

    async def _on_lock(self, _: object) -> None:
        text = self._text.value.rstrip("".join(MARKS)).strip().replace(",", ".").replace("−", "-")
        try:
            self._answer(float(text))
        except ValueError:
            self._desk.complain(f"your answer: {text!r:.40} is not a number; allowed: such as 12.5")

    def show(self, step: LessonStep, answer: Answer | None, course: LessonCourse) -> None:
        asks = isinstance(step.block, blocks.NumberQuestion)
        self._form.visible = asks
        self._lock.visible = asks and course.open
        if not asks:
            return
        unit = _unit_of(step, course)
        self._text.label = f"your answer [{unit}]" if unit else "your answer"
        self._text.disabled = not course.open
        if answer is not None:
            self._text.value = f"{answer.given:g}"
        elif self._step != step.number:
            self._text.value = ""
        self._step = step.number


def _unit_of(step: LessonStep, course: LessonCourse) -> str:
    """Unit of the number that a question asks for, "" for other questions."""
    if not isinstance(step.block, blocks.NumberQuestion):
        return ""
    for each in course.lesson.steps:
        if isinstance(each.block, blocks.LessonRun) and step.block.measure in each.block.measures:
            return each.block.measures[step.block.measure].unit
    return ""


class _Pad:
    """Axes on which a curve is drawn; the page's script writes its points into a hidden text field."""

    def __init__(self, desk: Desk, answer: Callable[[object], None]) -> None:
        self._desk, self._answer = desk, answer
        self._html = desk.gui.add_html("", visible=False)
        self._field = desk.gui.add_text("", "", visible=False)
        self._lock = desk.gui.add_button("Lock my line", visible=False, hint="It counts once, before the run.")
        self._lock.on_click(self._on_lock)

    async def _on_lock(self, _: object) -> None:
        try:
            points = msgspec.json.decode(self._field.value or "null")
        except msgspec.DecodeError:
            points = None
        if not points:
            self._desk.complain("your line: nothing is drawn yet; allowed: draw it on the axes, or use the arrow keys")
        else:
            self._answer(points)

    def show(self, step: LessonStep, answer: Answer | None, course: LessonCourse) -> None:
        asks = isinstance(step.block, blocks.CurveQuestion)
        self._html.visible = self._field.visible = asks
        self._lock.visible = asks and course.open
        if not isinstance(step.block, blocks.CurveQuestion):
            self._html.content = ""
            self._field.value = ""
            return
        drawn = answer.given if answer is not None and isinstance(answer.given, list) else None
        content = pad_html(step.block, drawn)
        if self._html.content != content:  # sent again, the axes would lose the strokes that are being drawn
            self._html.content = content


class _Goal:
    """Sliders and conditions of a goal."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._rows: list[NumberField] = []
        self._of = 0
        self._folder = desk.gui.add_folder("Your controls", visible=False)
        self._state = desk.gui.add_html("")
        hint = "Key: R. What happens at the beginning, such as a push, happens again."
        self._anew = desk.gui.add_button("Try it from the beginning", visible=False, hint=hint)
        self._anew.on_click(self._on_anew)

    async def _on_anew(self, _: object) -> None:
        self._desk.lock.post(Reset())
        self._desk.lock.post(Play())

    def show(self, step: LessonStep, course: LessonCourse, snapshot: Snapshot, entered: int) -> None:
        goal = step.block
        visible = isinstance(goal, blocks.Goal)
        if self._folder.visible != visible:
            self._folder.visible = self._anew.visible = visible
        if not isinstance(goal, blocks.Goal):
            self._clear()
            return
        if self._of != entered:
            self._clear()
            with self._folder:
                self._rows = [
                    NumberField(
                        self._desk, _place(each), each.label, SliderScale(each.low, each.high, each.logarithmic)
                    )
                    for each in goal.controls
                ]
            self._of = entered
        for row in self._rows:
            row.show(snapshot)
        content = self._html(goal, course, snapshot)
        if self._state.content != content:
            self._state.content = content

    def _clear(self) -> None:
        for row in self._rows:
            row.remove()
        self._rows, self._of = [], 0
        if self._state.content:
            self._state.content = ""

    def _html(self, goal: blocks.Goal, course: LessonCourse, snapshot: Snapshot) -> str:
        if course.step.number in course.progress.goals:
            return f'<div class="vs-scored">{chip("reached", "vs-good")}</div>'
        longest = max((each.last or 0.0 for each in goal.measures.values()), default=0.0)
        since = snapshot.state.epoch.t
        if snapshot.end - since < longest:
            left = longest - (snapshot.end - since)
            return f'<div class="vs-note">The last {longest:g} s count: another {left:.1f} s to go.</div>'
        try:
            known = {
                name: taken(snapshot.system, snapshot.recording, snapshot.end, each)
                for name, each in goal.measures.items()
            }
            missed = unmet(goal.conditions, known)
        except ScenarioError as error:
            return f'<div class="vs-note">{escape(str(error))}</div>'
        if not missed:
            try:
                course.reached_goal()
            except OSError as error:
                self._desk.complain(f"the progress of lessons cannot be saved: {error.strerror}; the lesson goes on")
        return "".join(f'<div class="vs-scored">{chip("not yet", "vs-warn")} {escape(each)}</div>' for each in missed)


def _place(control: blocks.GoalSlider) -> FieldPlace:
    field, _, last = control.path.rpartition(".")
    return DiagonalPlace(field, int(last) - 1) if last.isdecimal() else FieldPlace(control.path)
