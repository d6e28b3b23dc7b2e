"""The lecturer's desk: which question of a lesson a class is asked, and what it has answered."""

from __future__ import annotations

import csv
import io
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from app.access.classroom import ClassQuestion, Given
from app.lessons.blocks import Choice, Curve, Number
from app.lessons.kept_file import KeptFile
from app.lessons.lesson import Step
from app.lessons.markup import inline_html

Send = Callable[[ClassQuestion | None], None]
Complain = Callable[[str], None]
FILE = "class.json"


@dataclass(frozen=True)
class Asked:
    """A question as it was asked: lesson, step, and the answers to it so far."""

    lesson: str
    step: int
    question: ClassQuestion
    answers: tuple[Given, ...] = ()


@dataclass(frozen=True)
class KeptClass:
    """Class as it is kept: all questions with their answers, and whether the last one is asked now."""

    asked: tuple[Asked, ...]
    asks: bool


class ClassDesk:
    """Desk of one session. Closed, unless the session's gateway has a class; used by several threads."""

    def __init__(self) -> None:
        self._send: Send | None = None
        self._file: KeptFile[KeptClass] | None = None
        self._complain: Complain = _silent
        self._lock = threading.Lock()
        self.asked: tuple[Asked, ...] = ()
        self._asks = False

    @property
    def is_open(self) -> bool:
        """Whether a class can be asked."""
        return self._send is not None

    def keep_in(self, folder: Path, complain: Complain) -> str:
        """Take up the class that a folder has, if there is none yet, and keep it there from now on. Returns a sentence
        where it cannot be read, else "". complain: told where it cannot be written."""
        self._file, self._complain = KeptFile(folder / FILE, KeptClass, "the class's answers"), complain
        kept, problem = self._file.read()
        with self._lock:
            if kept is not None and not self.asked:
                self.asked, self._asks = kept.asked, kept.asks
            self._keep()
        return problem

    def open(self, send: Send, asked: int = 0) -> None:
        """Have questions sent to the class by this function; the kept one goes on if it is that of this number, which
        is asked there still, and is over otherwise."""
        self._send = send
        with self._lock:
            self._asks = self._asks and self.asked[-1].question.number == asked
            self._keep()
        if asked:
            send(None if self.present is None else self.present.question)

    @property
    def present(self) -> Asked | None:
        """The question that the class is asked now."""
        return self.asked[-1] if self.asked and self._asks else None

    def ask(self, lesson: str, step: Step, unit: str, measured: Mapping[str, str]) -> None:
        """Ask the class the question of a step, also again."""
        question = question_of(step, len(self.asked) + 1, unit, measured)
        with self._lock:
            self.asked, self._asks = (*self.asked, Asked(lesson, step.number, question)), True
            self._keep()
        self._tell(question)

    def reveal(self, told: str) -> None:
        """End the answers to the present question, and show everybody what is told (HTML)."""
        with self._lock:
            if (present := self.present) is None:
                return
            question = msgspec.structs.replace(present.question, open=False, told=told)
            self.asked = (*self.asked[:-1], replace(present, question=question))
            self._keep()
        self._tell(question)

    def rest(self) -> None:
        """Ask nothing for now."""
        if self._asks:
            with self._lock:
                self._asks = False
                self._keep()
            self._tell(None)

    def take(self, number: int, answers: tuple[Given, ...]) -> None:
        """Take up all answers to the question of this number."""
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
                told = " ".join(f"{value:g}" for value in given) if isinstance(given, list) else f"{given:g}"
                rows.writerow([each.lesson, each.step, each.question.number, each.question.kind, told])
        return file.getvalue()

    def _keep(self) -> None:
        if self._file is None or not self.asked:
            return
        try:
            self._file.write(KeptClass(self.asked, self._asks))
        except OSError as error:
            self._complain(f"the class's answers cannot be saved: {error.strerror}; the class goes on")

    def _tell(self, question: ClassQuestion | None) -> None:
        if self._send is not None:
            self._send(question)


def _silent(_: str) -> None:
    """Nobody to complain to: no folder, so nothing can fail."""


def question_of(step: Step, number: int, unit: str, measured: Mapping[str, str]) -> ClassQuestion:
    """Question to a class of a lesson's step. Raises ValueError where it has none."""
    block = step.block
    if not isinstance(block, Choice | Number | Curve):
        raise ValueError(f"step {step.number} asks nothing")
    ask = inline_html(block.ask, measured)
    match block:
        case Choice(options=options):
            texts = tuple(inline_html(option, measured) for option in options)
            return ClassQuestion(number, "choice", ask, options=texts)
        case Number():
            return ClassQuestion(number, "number", ask, unit=unit)
        case Curve(line=line):
            return ClassQuestion(
                number,
                "curve",
                ask,
                start=block.start,
                end=block.end,
                low=block.low,
                high=block.high,
                axis=f"{line.title} [{line.unit}]",
            )
