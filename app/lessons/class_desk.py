"""Class desk: the questions of lessons that a lecturer has asked the class, and its answers."""

from __future__ import annotations

import csv
import io
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from app.access.classroom import ClassQuestion, Given
from app.lessons.answers import exact
from app.lessons.blocks import ChoiceQuestion, CurveQuestion, NumberQuestion
from app.lessons.kept_file import KeptFile
from app.lessons.lesson import LessonStep
from app.lessons.markup import inline_html

Send = Callable[[ClassQuestion | None], None]
Complain = Callable[[str], None]
FILE = "class.json"


@dataclass(frozen=True)
class AskedQuestion:
    """Question that a class was asked: name of its lesson, number of its step, and the answers so far."""

    lesson: str
    step: int
    question: ClassQuestion
    answers: tuple[Given, ...] = ()


@dataclass(frozen=True)
class KeptClass:
    """Content of a class's file.
    asked: all questions with their answers, in the order in which they were asked.
    asks: whether the class is asked the last of them now."""

    asked: tuple[AskedQuestion, ...]
    asks: bool


class ClassDesk:
    """Class desk of one session; open where the session's gateway has a class. Safe to use from several threads."""

    def __init__(self) -> None:
        self._send: Send | None = None
        self._file: KeptFile[KeptClass] | None = None
        self._complain: Complain = _silent
        self._lock = threading.Lock()
        self.asked: tuple[AskedQuestion, ...] = ()
        self._asks = False

    @property
    def is_open(self) -> bool:
        """Whether a class can be asked."""
        return self._send is not None

    def keep_in(self, folder: Path, complain: Complain) -> str:
        """Read the questions and answers that a folder holds, unless some were asked already, and write them there
        from now on. Returns a sentence where the file cannot be read, else "".
        complain: gets a sentence where the file cannot be written."""
        self._file, self._complain = KeptFile(folder / FILE, KeptClass, "the class's answers"), complain
        kept, problem = self._file.read()
        with self._lock:
            if kept is not None and not self.asked:
                self.asked, self._asks = kept.asked, kept.asks and bool(kept.asked)
            self._keep()
        return problem

    def open(self, send: Send, asked: int = 0) -> None:
        """Open the desk.
        send: sends a question to the class, or None to end the last one.
        asked: number of the question that the gateway still asks, 0 for none; a question that was read from the file
        goes on if it has this number."""
        self._send = send
        with self._lock:
            self._asks = self._asks and self.asked[-1].question.number == asked
            self._keep()
        if asked:
            send(None if self.present is None else self.present.question)

    @property
    def present(self) -> AskedQuestion | None:
        """Question that the class is asked now, None for none."""
        return self.asked[-1] if self.asked and self._asks else None

    def ask(self, lesson: str, step: LessonStep, unit: str, measured: Mapping[str, str], language: str = "en") -> None:
        """Ask the class the question of a step; a step may be asked several times. unit, measured, language: as in
        `question_of`."""
        question = question_of(step, len(self.asked) + 1, unit, measured, language)
        with self._lock:
            self.asked, self._asks = (*self.asked, AskedQuestion(lesson, step.number, question)), True
            self._keep()
        self._send_question(question)

    def last_of(self, lesson: str, step: int) -> AskedQuestion | None:
        """Question of a step as it was asked last, None where it was not."""
        return next((each for each in reversed(self.asked) if (each.lesson, each.step) == (lesson, step)), None)

    def reveal(self, result: str) -> None:
        """Accept no more answers to the present question, and show the class its result. result: the result, HTML."""
        with self._lock:
            if (present := self.present) is None:
                return
            question = msgspec.structs.replace(present.question, open=False, result=result)
            self.asked = (*self.asked[:-1], replace(present, question=question))
            self._keep()
        self._send_question(question)

    def rest(self) -> None:
        """Ask nothing for now."""
        if self._asks:
            with self._lock:
                self._asks = False
                self._keep()
            self._send_question(None)

    def take(self, number: int, answers: tuple[Given, ...]) -> None:
        """Replace the answers to the question of this number."""
        with self._lock:
            self.asked = tuple(
                replace(each, answers=answers) if each.question.number == number else each for each in self.asked
            )
            self._keep()

    def csv(self) -> str:
        """CSV of all answers of the class, a row each."""
        file = io.StringIO()
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["lesson", "step", "asked", "kind", "answer"])
        for each in self.asked:
            for given in each.answers:
                answer = " ".join(map(exact, given)) if isinstance(given, list) else exact(given)
                rows.writerow([each.lesson, each.step, each.question.number, each.question.kind, answer])
        return file.getvalue()

    def _keep(self) -> None:
        if self._file is None or not self.asked:
            return
        try:
            self._file.write(KeptClass(self.asked, self._asks))
        except OSError as error:
            self._complain(f"the class's answers cannot be saved: {error.strerror}; the class goes on")

    def _send_question(self, question: ClassQuestion | None) -> None:
        if self._send is not None:
            self._send(question)


def _silent(_: str) -> None:
    """Complaint of a desk without a folder: there is none, as nothing is written."""


def question_of(
    step: LessonStep, number: int, unit: str, measured: Mapping[str, str], language: str = "en"
) -> ClassQuestion:
    """Question of a lesson's step as a class is asked it. Raises ValueError for a step without a question.
    number: of the question. unit: of a number that is asked for. measured: numbers as text, for the question's text.
    language: of the lesson."""
    block = step.block
    if not isinstance(block, ChoiceQuestion | NumberQuestion | CurveQuestion):
        raise ValueError(f"step {step.number} asks nothing")
    ask = inline_html(block.ask, measured)
    match block:
        case ChoiceQuestion(options=options):
            texts = tuple(inline_html(option, measured) for option in options)
            return ClassQuestion(number, "choice", ask, options=texts, language=language)
        case NumberQuestion():
            return ClassQuestion(number, "number", ask, unit=unit, language=language)
        case CurveQuestion(line=line):
            return ClassQuestion(
                number,
                "curve",
                ask,
                start=block.start,
                end=block.end,
                low=block.low,
                high=block.high,
                axis=f"{line.title} [{line.unit}]",
                language=language,
            )
