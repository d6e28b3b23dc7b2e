"""Command `vsmrc lesson`: lists, checks and plays lessons."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from app.cli.options import NO_DEFAULT_SHOWN, one_of, require_folder, written_to
from app.cli.status import BAD_INPUT, DONE, STOPPED
from app.process.terminal_text import printable
from app.scenario.errors import ScenarioError


def lesson(
    action: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="{list,check,run}")],
    lessons: Annotated[tuple[str, ...], tyro.conf.Positional, NO_DEFAULT_SHOWN] = (),
    /,
    *,
    figures: Annotated[Path | None, NO_DEFAULT_SHOWN] = None,
) -> int:
    """List the lessons, check them, or simulate their runs without a screen.

    Args:
        action: list: show all lessons; check: test a lesson: simulate its runs, score its reference answers and its
            wrong answers, and check its texts; run: simulate the runs and print what they measure
        lessons: names of shipped lessons, or lesson.md files; check without a name checks all shipped lessons
        figures: with run: folder for an SVG figure of each run
    """
    from app.dashboard.plots.lesson_figures import figure_of_run, name_of_figure
    from app.export.printing import render
    from app.lessons.answers import Notebook
    from app.lessons.blocks import LessonRun
    from app.lessons.checking import check
    from app.lessons.course import LessonCourse
    from app.lessons.lesson import load as load_lesson
    from app.lessons.lesson import shipped_lessons
    from app.lessons.playing import play, runs
    from app.process.atomic_write import write_whole
    from app.storage.constants_store import kept_memory

    actions = ("list", "check", "run")
    doing = one_of("lesson", action, actions)
    if lessons and doing == "list":
        raise ScenarioError(f"lesson list: {lessons[0]!r:.60}; allowed: no name, it lists all lessons")
    if figures is not None and doing != "run":
        raise ScenarioError(f"lesson {doing}: --figures {figures}; allowed: with `lesson run`")
    if figures is not None:
        require_folder(figures, "--figures")
    if doing == "list":
        for name, each in shipped_lessons().items():
            print(f"{name:24s} {each.head.minutes:3.0f} min  {each.head.title}")
        return DONE
    if not lessons and doing == "run":
        raise ScenarioError("lesson run: no lesson; allowed: one or more (see `vsmrc lesson list`)")
    memory, problems, stopped = kept_memory(), 0, False
    for each in [load_lesson(name) for name in lessons or shipped_lessons()]:
        print(printable(f"{each.name}: {each.head.title}"))
        if doing == "check":
            checked = check(each, memory)
            problems += len(checked.problems)
            for problem in checked.problems:
                print(f"  {printable(problem)}")
            print(f"  about {checked.minutes:.0f} minutes, {len(checked.measurements)} numbers measured")
        else:
            course = LessonCourse(each, Notebook())
            for step in runs(each):
                outcome = play(step, memory)
                course.take(step, outcome)
                text = ", ".join(f"{name} = {value}" for name, value in outcome.measurements.items())
                if isinstance(step.block, LessonRun):  # a lesson may mean it
                    stopped |= bool(outcome.stopped and not step.block.stops)
                    stopped |= bool(outcome.refusal and not step.block.refused)
                ended = " ".join(filter(None, (outcome.refusal, outcome.stopped)))
                print(f"  {printable(getattr(step.block, 'title', ''))}: {text}  {printable(ended)}".rstrip())
                if figures is not None:
                    drawn = figure_of_run(each, step, outcome, course.traces(step), ())
                    path = figures / name_of_figure(each, step, "svg")
                    with written_to(figures, flag="--figures"):
                        figures.mkdir(parents=True, exist_ok=True)
                        write_whole(path, lambda file, drawn=drawn: file.write(render(drawn, "svg")))
                    print(f"  written: {path}")
    return BAD_INPUT if problems else STOPPED if stopped else DONE
