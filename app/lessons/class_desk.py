"""The lecturer's desk: which question of a lesson a class is asked, and what it has answered."""

from __future__ import annotations

import csv
import io
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import msgspec

from app.access.classroom import ClassQuestion, Given
from app.lessons.blocks import Choice, Curve, Number
from app.lessons.lesson import Step
from app.lessons.markup import inline_html

Send = Callable[[ClassQuestion | None], None]


@dataclass(frozen=True)
class Asked:
    """A question as it was asked: lesson, step, and the answers to it so far."""

    lesson: str
    step: int
    question: ClassQuestion
    answers: tuple[Given, ...] = ()


class ClassDesk:
    """Desk of one session. Closed, unless the session's gateway has a class; used by several threads."""

    def __init__(self) -> None:
        self._send: Send | None = None
        self._lock = threading.Lock()
        self.asked: tuple[Asked, ...] = ()
        self._asks = False

    @property
    def is_open(self) -> bool:
        """Whether a class can be asked."""
        return self._send is not None

    def open(self, send: Send) -> None:
        """Have questions sent to the class by this function."""
        self._send = send

    @property
    def present(self) -> Asked | None:
        """The question that the class is asked now."""
        return self.asked[-1] if self.asked and self._asks else None

    def ask(self, lesson: str, step: Step, unit: str, measured: Mapping[str, str]) -> None:
        """Ask the class the question of a step, also again."""
        question = question_of(step, len(self.asked) + 1, unit, measured)
        with self._lock:
            self.asked, self._asks = (*self.asked, Asked(lesson, step.number, question)), True
        self._tell(question)

    def reveal(self, told: str) -> None:
        """End the answers to the present question, and show everybody what is told (HTML)."""
        with self._lock:
            if (present := self.present) is None:
                return
            question = msgspec.structs.replace(present.question, open=False, told=told)
            self.asked = (*self.asked[:-1], replace(present, question=question))
        self._tell(question)

    def rest(self) -> None:
        """Ask nothing for now."""
        if self._asks:
            self._asks = False
            self._tell(None)

    def take(self, number: int, answers: tuple[Given, ...]) -> None:
        """Take up all answers to the question of this number."""
        with self._lock:
            self.asked = tuple(
                replace(each, answers=answers) if each.question.number == number else each for each in self.asked
            )

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

    def _tell(self, question: ClassQuestion | None) -> None:
        if self._send is not None:
            self._send(question)


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
