"""Figures of a lesson's runs on paper: the lines of a run, those of the runs beside it, and the predictions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from app.dashboard.theme.colors import MEASURED, SERIES, Rgb
from app.export.export_jobs import plain_name
from app.export.figures import Curve, Figure, FigureChart
from app.lessons.answers import Answer
from app.lessons.blocks import LessonRun, PictureLine
from app.lessons.lesson import Lesson, LessonStep
from app.lessons.playing import LessonOutcome, Trace
from app.lessons.predictions import predicted
from app.lessons.words import LessonWords, words_of
from app.scenario.caption import in_one_line

_FREE = (SERIES[0], *SERIES[2:])  # without SERIES[1], whose orange is too near to that of the predictions


def run_colors(lesson: Lesson) -> dict[str, Rgb]:
    """Colours of the lesson's runs by title, the same in all its pictures."""
    titles = dict.fromkeys(run.title for step in lesson.steps if (run := step.run))
    return {title: _FREE[number % len(_FREE)] for number, title in enumerate(titles)}


def figure_of_run(
    lesson: Lesson,
    step: LessonStep,
    outcome: LessonOutcome,
    traces: Sequence[Trace],
    answers: Sequence[tuple[LessonStep, Answer]],
) -> Figure:
    """Figure of a run, with a chart for each line that it shows, and in the caption its measured numbers, and why it
    stopped."""
    run = step.run
    assert run is not None
    colors, words = run_colors(lesson), words_of(lesson.head.language)
    charts = tuple(
        _chart(run, line, [each for each in traces if each.line.shows(line)], answers, colors, words)
        for line in run.show
    )
    text = ", ".join(
        f"{run.measures[name].title or name.replace('_', ' ')} {value.text(words.language)}"
        for name, value in outcome.measurements.items()
    )
    caption = f"{lesson.head.title}: {run.title}." + (f" {words.measured}: {text}." if text else "")
    ended = f" {words.stopped.format(in_one_line(outcome.stopped))}." if outcome.stopped else ""
    return Figure(charts, f"{caption}{ended}", decimal=words.decimal)


def name_of_figure(lesson: Lesson, step: LessonStep, extension: str) -> str:
    """File name of the figure of a run: letters, digits, dots and dashes only."""
    assert step.run is not None
    return f"{plain_name(f'{lesson.name}-{step.number}-{step.run.title}')}.{extension}"


def _chart(
    run: LessonRun,
    line: PictureLine,
    traces: Sequence[Trace],
    answers: Sequence[tuple[LessonStep, Answer]],
    colors: Mapping[str, Rgb],
    words: LessonWords,
) -> FigureChart:
    curves = []
    for number, trace in enumerate(traces):
        last = number == len(traces) - 1
        curves.append(Curve(trace.run, colors[trace.run], trace.t, trace.values, width=1.2 if last else 0.8))
    found = predicted(run, line, answers)
    ends = np.array([0.0, max(float(trace.t[-1]) for trace in traces)])
    values = np.concatenate([trace.values for trace in traces])
    low, high = np.nanmin(values), np.nanmax(values)
    courses = [
        *found.courses,
        *(np.column_stack([ends, [level, level]]) for level in found.levels),
        *(np.array([[t, low], [t, high]]) for t in found.instants if ends[0] <= t <= ends[1]),
    ]
    for number, course in enumerate(courses):
        t, value = course.T
        curves.append(Curve(words.predicted, MEASURED, t, value, dashed=True, listed=number == 0))
    return FigureChart(line.title, line.unit, tuple(curves))
