"""Refusals of plain data that are no struct of a kind."""

from __future__ import annotations

import tomllib

import msgspec
import pytest

from app.lessons.blocks import Head, LessonRun
from app.scenario.struct_refusals import struct_refusal

RUN = "title = 'a'\nseconds = 1\nshow = [{signal = 't', unit = 's', title = 'x'}]\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            f"{RUN}[measures.sound]\nunit = 's'\n[measures.wrong]\nunit = 's'\nstatistic = 'largst'",
            "measures.wrong.statistic: 'largst'; allowed: below, largest, last, least, mean, peak, rms, settles, span, "
            "variation; did you mean largest?",
        ),
        (f"second = 1\n{RUN}", "second: no such field; allowed: title, seconds, show, measures, set, edits, beside, "
         "refused, stops; did you mean seconds?"),
        ("title = 'a'\nseconds = 1", "show: missing; allowed: a value"),
        (RUN.replace("unit", "unt"), "show[0].unt: no such field; allowed: signal, unit, title; did you mean unit?"),
        (RUN.replace("1", "'x'"), "seconds: 'x'; allowed: a number"),
    ],
)  # fmt: skip
def test_a_block_is_refused_in_the_words_of_scenarios(text: str, message: str) -> None:
    data = tomllib.loads(text)
    with pytest.raises(msgspec.ValidationError) as refused:
        msgspec.convert(data, LessonRun)
    assert struct_refusal(refused.value, data, LessonRun) == message


def test_a_text_of_another_form_is_shown_its_form() -> None:
    data = {"title": "a", "minutes": 3, "knows": ["b"], "language": "english"}
    with pytest.raises(msgspec.ValidationError) as refused:
        msgspec.convert(data, Head)
    assert struct_refusal(refused.value, data, Head) == "language: 'english'; allowed: text of the form '^[a-z]{2}$'"
