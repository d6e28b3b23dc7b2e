"""List of lessons, from which one is chosen."""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Mapping
from html import escape

import viser

from app.dashboard.widgets.chips import chip
from app.dashboard.widgets.fields.controls import Desk
from app.lessons.answers import LessonProgress, csv_of, json_of
from app.lessons.lesson import Lesson
from app.lessons.markup import inline_html
from app.lessons.words import words_of

LANGUAGES = {"en": "", "de": "Deutsch"}


class LessonList:
    """List of lessons, with the progress in each, and the answers as files."""

    def __init__(self, desk: Desk, lessons: dict[str, Lesson], open_lesson: Callable[[Lesson], None]) -> None:
        self._desk, self._open = desk, open_lesson
        self._titles = {_title(name, lesson): lesson for name, lesson in lessons.items()}
        self._folder = desk.gui.add_folder(None)
        with self._folder:
            desk.gui.add_html(
                '<div class="vs-lesson vs-prose"><p>Each lesson asks before it shows: predict, run it, look, '
                "and read why. Ten minutes each; the arm in the scene is yours all the time.</p></div>"
            )
            self._choice = desk.gui.add_dropdown("Lesson", tuple(self._titles), hint="They build on one another.")
            self._about = desk.gui.add_html("")
            self._begin = desk.gui.add_button("Begin")
            self._goal = desk.gui.add_button("", color="gray", visible=False)
            hint = "All answers so far, as a file; otherwise they stay on the server."
            self._files = desk.gui.add_button_group("Your answers", ("CSV", "JSON"), hint=hint)
            self._class_file = desk.gui.add_button("Answers of the class (CSV)", color="gray", visible=False)
        self._begin.on_click(self._on_begin)
        self._goal.on_click(self._on_goal)
        self._files.on_click(self._on_file)
        self._class_file.on_click(self._on_class_file)
        for title, lesson in self._titles.items():
            desk.gui.add_command(f"Lesson: {title}").on_trigger(self._begin_of(lesson))

    def _begin_of(self, lesson: Lesson) -> Callable[[object], Coroutine[None, None, None]]:
        async def begin(_: object) -> None:
            self._open(lesson)

        return begin

    async def _on_begin(self, _: object) -> None:
        lesson, notebook = self._titles[self._choice.value], self._desk.notebook
        if _ended(lesson, notebook.of(lesson.name)):
            notebook.note(lesson.name, LessonProgress())
        self._open(lesson)

    async def _on_goal(self, _: object) -> None:
        self._open(self._titles[self._choice.value])

    async def _on_file(self, event: viser.GuiEvent[viser.GuiButtonGroupHandle]) -> None:
        if event.client is None:
            return
        form, progress = event.target.value.lower(), self._desk.notebook.progress
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
        words = words_of(lesson.head.language)
        state, label, goal = "", words.begin, False
        if done is not None:
            scores = [answer.score for answer in done.answers.values() if answer.score is not None]
            result = f" {words.answers_right.format(f'{sum(scores):g}', len(scores))}" if scores else ""
            state = f"<p>{_state(lesson, done)}{result}</p>"
            label = words.go_on.format(done.step)
            if _ended(lesson, done):
                label, goal = words.again, done.step in _missed(lesson, done)
                state += f"<p>{words.deletes}</p>"
        content = (
            f'<div class="vs-lesson vs-prose"><p class="vs-dim" lang="{words.language}">'
            f"{words.minutes.format(words.number(f'{lesson.head.minutes:g}'))} {words.knows}</p>"
            f'<ul lang="{escape(lesson.head.language)}">{knows}</ul><div lang="{words.language}">{state}</div></div>'
        )
        if self._about.content != content:
            self._about.content = content
        self._begin.label = label
        if goal:
            self._goal.label, self._goal.hint = words.to_goal, words.to_goal_hint
        if self._goal.visible != goal:
            self._goal.visible = goal


def _ended(lesson: Lesson, progress: LessonProgress) -> bool:
    """Whether the lesson was gone through, and left at its last step."""
    return progress.finished and progress.step == len(lesson.steps)


def _missed(lesson: Lesson, progress: LessonProgress) -> set[int]:
    """Numbers of the goals that were not met."""
    return {step.number for step in lesson.steps if step.goal} - set(progress.goals)


def _state(lesson: Lesson, progress: LessonProgress) -> str:
    """Whether the lesson has been gone through, and whether its goals were met, as a chip."""
    words = words_of(lesson.head.language)
    if not progress.finished:
        return chip(words.begun, "vs-warn")
    goals = [step.number for step in lesson.steps if step.goal]
    missed = len(_missed(lesson, progress))
    if not missed:
        return chip(words.done, "vs-good")
    return chip(words.goal_missed if len(goals) == 1 else words.goals_missed.format(missed, len(goals)), "vs-warn")


def _title(name: str, lesson: Lesson) -> str:
    number = name.partition("-")[0].lstrip("0")
    language = LANGUAGES.get(lesson.head.language, lesson.head.language)
    return f"{number}. {lesson.head.title}" + (f" ({language})" if language else "")
