"""How anything is refused."""

from __future__ import annotations


def one_sentence(error: BaseException) -> str:
    said = str(error)
    assert "\n" not in said
    assert "Traceback" not in said
    assert len(said) < 1200
    return said
