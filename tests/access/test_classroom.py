"""Classroom: one answer of each browser, to the present question only, and nothing else."""

from __future__ import annotations

import pytest

from app.access.classroom import MOST, NEAR, POINTS, AnswerRefusal, ClassQuestion, Classroom, admitted

CHOICE = ClassQuestion(1, "choice", "?", options=("a", "b", "c"))
NUMBER = ClassQuestion(2, "number", "?", unit="mm")
CURVE = ClassQuestion(3, "curve", "?", low=-1.0, high=1.0)


def asked(question: ClassQuestion) -> Classroom:
    room = Classroom()
    room.ask(question)
    return room


def test_the_last_answer_of_a_browser_counts_and_only_once() -> None:
    room = asked(CHOICE)
    for browser, given in (("one", 1), ("two", 2), ("one", 3), ("one", 3)):
        room.give(browser, "198.51.100.1", 1, given)
    assert sorted(room.given) == [2, 3]
    assert (room.own("one"), room.own("two"), room.own("three")) == (3, 2, None)


def test_answers_stay_when_they_are_shown_and_go_with_the_next_question() -> None:
    room = asked(CHOICE)
    room.give("one", "", 1, 1)
    room.ask(ClassQuestion(1, "choice", "?", options=("a", "b", "c"), open=False, result="b"))
    assert room.given == (1,)
    with pytest.raises(AnswerRefusal, match="the answers were revealed"):
        room.give("two", "", 1, 1)
    room.ask(NUMBER)
    assert room.given == ()
    with pytest.raises(AnswerRefusal, match="this question is over"):
        room.give("two", "", 1, 1)
    room.ask(None)
    with pytest.raises(AnswerRefusal, match="this question is over"):
        room.give("two", "", 2, 1)


def test_neither_one_address_nor_all_together_fill_the_memory() -> None:
    room = asked(CHOICE)
    for number in range(NEAR):
        room.give(f"near {number}", "198.51.100.1", 1, 1)
    with pytest.raises(AnswerRefusal, match="answers: "):
        room.give("one more", "198.51.100.1", 1, 1)
    room.give("near 0", "198.51.100.1", 1, 2)  # who has answered may still change it
    for number in range(MOST - NEAR):
        room.give(f"far {number}", f"203.0.113.{number}", 1, 1)
    with pytest.raises(AnswerRefusal, match="answers: "):
        room.give("the last", "192.0.2.1", 1, 1)
    assert len(room.given) == MOST


@pytest.mark.parametrize(
    ("question", "given"),
    [
        (CHOICE, 0), (CHOICE, 4), (CHOICE, 1.5), (CHOICE, "1"), (CHOICE, True), (CHOICE, None), (CHOICE, [1]),
        (NUMBER, float("nan")), (NUMBER, float("inf")), (NUMBER, 1e13), (NUMBER, "3"), (NUMBER, False), (NUMBER, {}),
        pytest.param(CHOICE, 10**400, id="huge choice"), pytest.param(NUMBER, 10**400, id="huge number"),
        pytest.param(NUMBER, -(10**400), id="huge and negative"), (CURVE, [10**400] * POINTS),
        (CURVE, [0.0] * (POINTS - 1)), (CURVE, [0.0] * 10_000), (CURVE, [2.0] * POINTS), (CURVE, 0.0),
        (CURVE, [float("nan")] * POINTS), (CURVE, ["x"] * POINTS),
    ],
)  # fmt: skip
def test_what_is_no_answer_is_refused_in_a_sentence(question: ClassQuestion, given: object) -> None:
    with pytest.raises(AnswerRefusal, match="answer: ") as refused:
        admitted(question, given)
    assert len(str(refused.value)) < 200


def test_without_a_cookie_nobody_answers() -> None:
    with pytest.raises(AnswerRefusal, match="cookies"):
        asked(CHOICE).give("", "198.51.100.1", 1, 1)
    assert admitted(CHOICE, 2.0) == 2
    assert admitted(NUMBER, 3) == 3.0
    assert admitted(CURVE, [0] * POINTS) == [0.0] * POINTS
