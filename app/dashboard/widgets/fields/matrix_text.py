"""Numbers, lists and matrices as text that people type and paste."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np


def written(value: Any) -> str:
    """Text of a value: a number, numbers separated by commas, or rows of a matrix separated by semicolons; "" for
    None."""
    if value is None:
        return ""
    if isinstance(value, tuple | list):
        rows = any(isinstance(v, tuple | list) for v in value)
        return ("; " if rows else ", ").join(written(v) for v in value)
    return f"{value:.6g}"


def read_back(text: str) -> int | float | list[Any]:
    """Value of a text, the inverse of `written`; a whole number without a point becomes an int. Raises ValueError."""
    rows = [[number(part.strip()) for part in row.split(",")] for row in text.split(";")]
    if all(len(row) == 1 for row in rows):
        rows = [[row[0] for row in rows]]
    if len(rows) > 1:
        return rows
    return rows[0] if len(rows[0]) > 1 else rows[0][0]


def require_point(text: str) -> None:
    """Raise ValueError for a text such as 2,5 in a field that holds one number: a decimal comma, or two numbers."""
    if re.fullmatch(r"[+-]?\d+,\d+", text):
        point, two = text.replace(",", "."), text.replace(",", ", ")
        raise ValueError(f"'{text}' has a comma without a space; allowed: {point} for one number, '{two}' for two")


def number(text: str) -> int | float:
    """Number in a text. Raises ValueError."""
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f"{text!r:.60} is not a number; allowed: such as 12, -0.5 or 3e4") from None
    return int(value) if re.fullmatch(r"[+-]?\d{1,15}", text) else value


def written_rows(matrix: np.ndarray) -> str:
    """Text of a matrix as lines of numbers, with all digits: `read_matrix` returns the same matrix."""
    return "\n".join(" ".join(_exact(float(entry)) for entry in row) for row in matrix)


def _exact(entry: float) -> str:
    return repr(int(entry)) if entry.is_integer() and abs(entry) < 1e15 else repr(entry)


def read_matrix(text: str, n: int) -> np.ndarray:
    """Matrix (n, n) of a pasted text: rows end with a newline, semicolon or bracket, numbers with blanks or commas; n
    numbers in one row or one column are a diagonal. Raises ValueError with a sentence."""
    lines = [line for line in re.split(r"[\n;\]\)]+", re.sub(r"[\[\(]", " ", text)) if line.strip(" \t\r,")]
    rows = [[_finite(part) for part in re.split(r"[\s,]+", line.strip(" \t\r,"))] for line in lines]
    widths = [len(row) for row in rows]
    if widths in ([n], [1] * n):
        return np.diag(np.concatenate(rows).astype(float))
    if widths == [n] * n:
        return np.array(rows, dtype=float)
    found = "nothing" if not rows else f"{len(rows)} row(s) of {_several(widths)} number(s)"
    raise ValueError(f"{found}; allowed: {n} numbers for a diagonal, or {n} rows of {n} numbers")


def _several(widths: list[int]) -> str:
    return " or ".join(str(width) for width in sorted(set(widths)))


def _finite(text: str) -> float:
    value = float(number(text))
    if not math.isfinite(value):
        raise ValueError(f"{text!r:.60} is not a finite number; allowed: such as 12, -0.5 or 3e4")
    return value
