"""Classroom of a session: the question that its lecturer asks, and the answers of everybody who has the link."""

from __future__ import annotations

from typing import Literal, TypeGuard

import msgspec
from msgspec import Struct, field

Given = int | float | list[float]
LARGEST = 1e12  # size of a number: pictures of larger ones overflow
POINTS = 25  # of a drawn curve, evenly over its axis of time
MOST, NEAR = 400, 200  # answers to a question in all, and from one address: a class may sit behind one


class ClassQuestion(Struct, frozen=True):
    """Question to a class.

    number: a later one is larger.
    ask, options: HTML; unit: of a number.
    language: of ask, options and axis, a code as in HTML.
    start, end, low, high, axis: of the axes on which a curve is drawn.
    open: whether answers are still taken.
    result: HTML of the answer, once it is revealed.
    """

    number: int
    kind: Literal["choice", "number", "curve"]
    ask: str
    options: tuple[str, ...] = ()
    unit: str = ""
    start: float = 0.0
    end: float = 1.0
    low: float = 0.0
    high: float = 1.0
    axis: str = ""
    open: bool = True
    result: str = field(default="", name="told")  # as it is called in messages and files
    language: str = "en"


class AnswerRefusal(ValueError):
    """An answer that is not taken: one sentence."""


class Classroom:
    """Present question of a session, and the answers to it: one for each browser, of which the last counts."""

    def __init__(self) -> None:
        self.question: ClassQuestion | None = None
        self._answers: dict[str, tuple[str, Given]] = {}

    def ask(self, question: ClassQuestion | None) -> None:
        """Ask a question, or None for no question; a question that is asked already keeps its answers."""
        if question is None or self.question is None or question.number != self.question.number:
            self._answers = {}
        self.question = question

    @property
    def number(self) -> int:
        """Number of the present question, 0 without one."""
        return 0 if self.question is None else self.question.number

    @property
    def given(self) -> tuple[Given, ...]:
        """All answers to the present question."""
        return tuple(given for _, given in self._answers.values())

    def own(self, browser: str) -> Given | None:
        """Answer of a browser to the present question."""
        return self._answers[browser][1] if browser in self._answers else None

    def give(self, browser: str, address: str, number: object, given: object) -> None:
        """Take the answer of a browser at an address to the question of this number. Raises AnswerRefusal."""
        question = self.question
        if not browser:
            raise AnswerRefusal("cookies: none; allowed: with cookies, so that nobody counts twice")
        if question is None or type(number) is not int or number != question.number:
            raise AnswerRefusal("answer: this question is over; allowed: to the present one")
        if not question.open:
            raise AnswerRefusal("answer: the answers were revealed; allowed: before that")
        if browser not in self._answers:
            near = sum(known == address for known, _ in self._answers.values()) if address else 0
            if len(self._answers) >= MOST or near >= NEAR:
                raise AnswerRefusal(
                    f"answers: {len(self._answers)}; allowed: at most {MOST}, and {NEAR} of one address"
                )
        self._answers[browser] = (address, admitted(question, given))


def is_number(given: object) -> TypeGuard[int | float]:
    """Whether what a page sent is a number of an allowed size."""
    return isinstance(given, int | float) and not isinstance(given, bool) and abs(given) <= LARGEST


def admitted(question: ClassQuestion, given: object) -> Given:
    """Answer that a page sent, checked against its question. Raises AnswerRefusal for one that does not fit."""
    if question.kind == "choice":
        if not is_number(given) or given not in range(1, len(question.options) + 1):
            raise AnswerRefusal(f"answer: {given!r:.40}; allowed: 1 to {len(question.options)}")
        return int(given)
    if question.kind == "number":
        if not is_number(given):
            raise AnswerRefusal(f"answer: {given!r:.40}; allowed: a number of at most {LARGEST:g} in size")
        return float(given)
    try:
        values = msgspec.convert(given, list[float])
    except msgspec.ValidationError as error:
        raise AnswerRefusal(f"answer: {error}; allowed: {POINTS} numbers") from error
    if len(values) != POINTS:
        raise AnswerRefusal(f"answer: {len(values)} values; allowed: {POINTS}")
    for value in values:
        if not question.low <= value <= question.high:
            raise AnswerRefusal(f"answer: {value:g}; allowed: {question.low:g} to {question.high:g}")
    return values
