"""Predictions to be drawn over a line of a run's picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.lessons.answers import Answer
from app.lessons.blocks import CurveQuestion, LessonRun, NumberQuestion, PictureLine
from app.lessons.lesson import LessonStep
from app.lessons.measures import OVER_TIME, factor_of

LEVELS = ("mean", "largest", "least", "peak", "rms", "last")  # statistics that are values of the signal


@dataclass(frozen=True)
class Predicted:
    """Predictions for one line.
    courses: drawn curves, (N, 2) each, of t, s, and value, in the line's unit.
    levels: predicted values, in the line's unit.
    instants: predicted times of the run, s."""

    courses: tuple[np.ndarray, ...] = ()
    levels: tuple[float, ...] = ()
    instants: tuple[float, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.courses or self.levels or self.instants)


def predicted(run: LessonRun, line: PictureLine, answers: Sequence[tuple[LessonStep, Answer]]) -> Predicted:
    """Predictions for a line of a run: curves drawn for its signal, and numbers that are measured on its signal."""
    courses, levels, instants = [], [], []
    for step, answer in answers:
        question, given = step.block, answer.given
        if isinstance(question, CurveQuestion) and question.line.shows(line) and isinstance(given, list):
            courses.append(np.array(given))
        elif (
            isinstance(question, NumberQuestion) and isinstance(given, int | float) and question.measure in run.measures
        ):
            measure = run.measures[question.measure]
            if measure.signal == line.signal and measure.statistic in OVER_TIME:
                start, _ = measure.interval(run.seconds)
                instants.append(start + given / factor_of(measure.unit))
            elif measure.signal == line.signal and measure.unit == line.unit and measure.statistic in LEVELS:
                levels.append(float(given))
    return Predicted(tuple(courses), tuple(levels), tuple(instants))
