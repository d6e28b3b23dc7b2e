"""Check that a refusal is one sentence."""

from __future__ import annotations


def one_sentence(error: BaseException) -> str:
    text = str(error)
    assert "\n" not in text
    assert "Traceback" not in text
    assert len(text) < 1200
    return text
