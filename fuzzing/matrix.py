"""Fuzzing of numbers and matrices that somebody types or pastes, and of the values of `--set`."""

from contextlib import suppress

import numpy as np

from app.cli.options import setting
from app.dashboard.widgets.fields.matrix_text import read_back, read_matrix, written_rows
from app.process.terminal_text import printable
from app.scenario.errors import ScenarioError

SEEDS = (b"1, 2; 3, 4", b"[[1 2]\n[3 4]]", b"1e3 -0.5", b"contact.K_e=2e4", b"truth.push=[0,10,0]")
DICTIONARY = ("nan", "inf", "1e999", "[[", "]]", ";", "1_000")


def read(data: bytes) -> None:
    text = data.decode("utf-8", "surrogateescape")
    for n in (1, 2, 6):
        read_typed(text, n)


def read_typed(text: str, n: int) -> None:
    """Read a text as a matrix (n, n) and as a setting: it has finite numbers, or is refused. Raises AssertionError
    otherwise."""
    assert printable(text).isprintable()
    with suppress(ValueError):
        matrix = read_matrix(text, n)
        assert np.isfinite(matrix).all()
        assert (read_matrix(written_rows(matrix), n) == matrix).all()
    with suppress(ValueError):
        read_back(text)
    with suppress(ScenarioError):
        setting(text)
