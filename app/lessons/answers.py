"""Answers to a lesson's questions: their scores, the file that keeps them, and their CSV and JSON."""

from __future__ import annotations

import csv
import io
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from msgspec import Struct, field

from app.access.classroom import LARGEST, is_number
from app.lessons.blocks import ChoiceQuestion, CurveQuestion, NumberQuestion
from app.lessons.kept_file import KeptFile
from app.lessons.measures import MeasuredNumber
from app.lessons.playing import Trace
from app.lessons.words import ENGLISH, LessonWords
from app.scenario.errors import ScenarioError

Given = int | float | list[tuple[float, float]]
FILE = "lessons.json"


class Answer(Struct, frozen=True):
    """Answer to the question of a step.
    given: number of the chosen option, from 1; a number; or a curve as (t, value) points.
    score: 1 for a right answer, 0 for a wrong one; None until it is scored.
    feedback: how far the answer was off, in words."""

    given: Given
    score: float | None = None
    feedback: str = field(default="", name="verdict")  # as notebooks of earlier versions call it


class LessonProgress(Struct, frozen=True):
    """Progress in one lesson.
    step: number of the shown step.
    answers: by number of their step.
    goals: numbers of the steps whose goals were reached.
    finished: whether the last step has been shown.
    seen: number of the last step whose run has been seen, 0 for none."""

    step: int = 1
    answers: dict[int, Answer] = {}
    goals: tuple[int, ...] = ()
    finished: bool = False
    seen: int = 0


@dataclass(frozen=True)
class Score:
    """Score of an answer: points, 1 or 0, and feedback, how far the answer was off, in words."""

    points: float
    feedback: str


def score_choice(question: ChoiceQuestion, given: int, words: LessonWords = ENGLISH) -> Score:
    """Score of a chosen option. given: its number, from 1."""
    right = question.options[question.right - 1]
    return Score(1.0, "right") if given == question.right else Score(0.0, words.what_happens.format(right))


def score_number(
    question: NumberQuestion,
    given: float,
    measurements: Mapping[str, MeasuredNumber],
    words: LessonWords = ENGLISH,
) -> Score:
    """Score of a predicted number. Raises ScenarioError where nothing was measured."""
    if question.measure not in measurements:
        raise ScenarioError(f"measure {question.measure!r:.40}: not measured before")
    measured = measurements[question.measure]
    off = abs(given - measured.value)
    predicted, within, apart = (
        MeasuredNumber(number, measured.unit).text(words.language) for number in (given, question.tolerance, off)
    )
    found = measured.text(words.language)
    if off <= question.tolerance:
        return Score(1.0, words.number_right.format(predicted, found, within))
    return Score(0.0, words.number_wrong.format(predicted, found, apart))


def score_curve(
    question: CurveQuestion, given: list[tuple[float, float]], trace: Trace, words: LessonWords = ENGLISH
) -> Score:
    """Score of a drawn curve, by its RMS distance to the measured one."""
    t = np.linspace(question.start, question.end, 200)
    drawn = np.interp(t, *np.array(given).T)
    off = float(np.sqrt(np.mean((drawn - trace.at(t)) ** 2)))
    distance, within = (
        MeasuredNumber(number, question.line.unit).text(words.language) for number in (off, question.tolerance)
    )
    if off <= question.tolerance:
        return Score(1.0, words.line_right.format(distance))
    return Score(0.0, words.line_wrong.format(distance, within))


def admitted(question: ChoiceQuestion | NumberQuestion | CurveQuestion, given: object) -> Given:
    """Answer that a page sent or a file kept, checked against its question. Raises ScenarioError where it does not
    fit."""
    match question:
        case ChoiceQuestion():
            if not isinstance(given, int) or isinstance(given, bool) or not 1 <= given <= len(question.options):
                raise ScenarioError(f"answer: {given!r:.40}; allowed: 1 to {len(question.options)}")
            return given
        case NumberQuestion():
            if not is_number(given):
                raise ScenarioError(f"answer: {given!r:.40}; allowed: a number of at most {LARGEST:g} in size")
            return float(given)
        case CurveQuestion():
            try:
                points = msgspec.convert(given, list[tuple[float, float]])
            except msgspec.ValidationError as error:
                raise ScenarioError(f"answer: {error}; allowed: points of t and value") from error
            t = [point[0] for point in points]
            if not 2 <= len(points) <= 500 or not np.isfinite(points).all() or sorted(t) != t:
                raise ScenarioError(f"answer: {len(points)} points; allowed: 2 to 500, from left to right")
            start, end, low, high = question.start, question.end, question.low, question.high
            if not all(_within(at, start, end) and _within(value, low, high) for at, value in points):
                raise ScenarioError(
                    f"answer: points off the axes; allowed: t from {start:g} to {end:g}, value from {low:g} to {high:g}"
                )
            return points


def _within(value: float, low: float, high: float) -> bool:
    room = 1e-3 * (high - low)  # a page has the ends of its axes rounded
    return low - room <= value <= high + room


def csv_of(progress: Mapping[str, LessonProgress]) -> str:
    """CSV of all answers, a row each."""
    file = io.StringIO()
    rows = csv.writer(file, lineterminator="\n")
    rows.writerow(["lesson", "step", "answer", "score", "verdict"])
    for lesson, of in progress.items():
        for step, answer in sorted(of.answers.items()):
            score = "" if answer.score is None else f"{answer.score:g}"
            rows.writerow([lesson, step, _plain(answer.given), score, answer.feedback])
        rows.writerows([lesson, step, "goal", "1", "reached"] for step in of.goals)
    return file.getvalue()


def _plain(given: Given) -> str:
    if isinstance(given, int | float):
        return exact(given)
    return " ".join(f"{exact(t)},{exact(value)}" for t, value in given)


def exact(number: float) -> str:
    """All digits of a number, without a point where it is whole."""
    return repr(int(number)) if float(number).is_integer() else repr(float(number))


def json_of(progress: Mapping[str, LessonProgress]) -> str:
    """JSON of all progress."""
    return msgspec.json.format(msgspec.json.encode(dict(progress))).decode() + "\n"


class Notebook:
    """Progress in all lessons, kept in a folder if there is one. Safe to use from several threads."""

    def __init__(self) -> None:
        self._file: KeptFile[dict[str, LessonProgress]] | None = None
        self._lock = threading.Lock()
        self.progress: dict[str, LessonProgress] = {}

    def keep_in(self, folder: Path) -> str:
        """Read the progress that a folder holds, and write it there from now on. Returns a sentence where the file
        cannot be read, else ""."""
        file = KeptFile(folder / FILE, dict[str, LessonProgress], "the progress in lessons")
        with self._lock:
            kept, problem = file.read()
            self.progress = (kept or {}) | self.progress
            self._file = file
        return problem

    def of(self, lesson: str) -> LessonProgress:
        """Progress in a lesson."""
        return self.progress.get(lesson, LessonProgress())

    def note(self, lesson: str, progress: LessonProgress) -> None:
        """Replace the progress in a lesson, in memory."""
        with self._lock:
            self.progress = {**self.progress, lesson: progress}

    def save(self) -> None:
        """Write the progress to the folder, if there is one. Raises OSError where it cannot be written."""
        with self._lock:
            if self._file is not None:
                self._file.write(self.progress)
