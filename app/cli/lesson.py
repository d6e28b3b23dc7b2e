"""Command `vsmrc lesson`: lists, checks and plays lessons."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from app.cli.options import NO_DEFAULT_SHOWN, one_of, require_folder, written_to
from app.cli.output import told
from app.cli.status import BAD_INPUT, DONE, STOPPED
from app.process.terminal_text import printable
from app.scenario.errors import ScenarioError
from app.scenario.number_text import counted

if TYPE_CHECKING:
    from app.export.figures import Figure
    from app.lessons.lesson import Lesson

Names = Annotated[tuple[str, ...], tyro.conf.Positional, NO_DEFAULT_SHOWN]


def lesson(
    action: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="{list,check,run}")], lessons: Names = (), /
) -> int:
    """List the lessons, check them, or simulate their runs without a screen. `vsmrc lesson run --help` lists the
    options of one of these.

    Args:
        action: list: show all lessons; check: test a lesson: simulate its runs, score its reference answers and its
            wrong answers, and check its texts; run: simulate the runs and print what they measure
        lessons: names of shipped lessons, or lesson.md files; list takes none
    """
    del lessons  # the command of a known action is called in place of this one
    return ACTIONS[one_of("lesson", action, tuple(ACTIONS))]()


def lesson_list() -> int:
    """Show all lessons, with their minutes and titles."""
    from app.lessons.lesson import shipped_lessons

    for name, each in shipped_lessons().items():
        print(f"{name:24s} {each.head.minutes:3.0f} min  {each.head.title}")
    return DONE


def lesson_check(lessons: Names = (), /) -> int:
    """Test lessons: simulate their runs, score their reference answers and their wrong answers, and check their texts.

    Args:
        lessons: names of shipped lessons, or lesson.md files; without a name, all shipped lessons
    """
    from app.lessons.lesson import load as load_lesson
    from app.lessons.lesson import shipped_lessons

    return _check([load_lesson(name) for name in lessons or shipped_lessons()])


def lesson_run(lessons: Names = (), /, *, figures: Annotated[Path | None, NO_DEFAULT_SHOWN] = None) -> int:
    """Simulate the runs of lessons without a screen, and print what they measure.

    Args:
        lessons: one or more names of shipped lessons, or lesson.md files
        figures: folder for an SVG figure of each run
    """
    from app.lessons.lesson import load as load_lesson

    if figures is not None:
        require_folder(figures, "--figures")
    if not lessons:
        raise ScenarioError("lesson run: no lesson; allowed: one or more (see `vsmrc lesson list`)")
    return _run([load_lesson(name) for name in lessons], figures)


ACTIONS: dict[str, Callable[..., int]] = {"list": lesson_list, "check": lesson_check, "run": lesson_run}


def _check(lessons: Sequence[Lesson]) -> int:
    """Print the problems of each lesson and what it measures. Returns the exit status."""
    from app.lessons.checking import check
    from app.storage.constants_store import kept_memory

    memory, problems = kept_memory(), 0
    for lesson in lessons:
        print(printable(f"{lesson.name}: {lesson.head.title}"))
        checked = check(lesson, memory)
        problems += len(checked.problems)
        for problem in checked.problems:
            print(f"  {told(problem)}")
        minutes = counted(round(checked.minutes), "minute")
        print(f"  about {minutes}, {counted(len(checked.measurements), 'number')} measured")
    return BAD_INPUT if problems else DONE


def _run(lessons: Sequence[Lesson], figures: Path | None) -> int:
    """Simulate the runs of each lesson, print what they measure, and draw each into the folder, if one is given.
    Returns the exit status."""
    from app.dashboard.plots.lesson_figures import figure_of_run, name_of_figure
    from app.lessons.answers import Notebook
    from app.lessons.course import LessonCourse
    from app.lessons.playing import play, runs
    from app.storage.constants_store import kept_memory

    memory, stopped = kept_memory(), False
    for lesson in lessons:
        print(printable(f"{lesson.name}: {lesson.head.title}"))
        course = LessonCourse(lesson, Notebook())
        for step in runs(lesson):
            outcome = play(step, memory)
            course.take(step, outcome)
            text = ", ".join(f"{name} = {value}" for name, value in outcome.measurements.items())
            if run := step.run:  # a lesson may mean it
                stopped |= bool(outcome.stopped and not run.stops)
                stopped |= bool(outcome.refusal and not run.refused)
            ended = " ".join(filter(None, (outcome.refusal, outcome.stopped)))
            print(f"  {printable(getattr(step.block, 'title', ''))}: {text}  {told(ended)}".rstrip())
            if figures is not None:
                path = figures / name_of_figure(lesson, step, "svg")
                _write_figure(figure_of_run(lesson, step, outcome, course.traces(step), ()), path)
                print(f"  written: {path}")
    return STOPPED if stopped else DONE


def _write_figure(figure: Figure, path: Path) -> None:
    """Write a figure as SVG, in a folder that need not be there."""
    from app.export.printing import render
    from app.process.atomic_write import write_whole

    with written_to(path.parent, flag="--figures"):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, lambda file: file.write(render(figure, "svg")))
