"""The table of symbols says what the code has."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in (ROOT / "docs" / "symbols.md").read_text(encoding="utf-8").splitlines()
    if line.startswith("| ") and "`" in line
]


def test_table_is_there() -> None:
    assert len(ROWS) > 25
    assert all(len(row) == 6 for row in ROWS)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0])
def test_named_symbol_exists_with_its_equation(row: list[str]) -> None:
    _, code, _, _, equation, file = row
    source = (ROOT / file).read_text(encoding="utf-8")
    for name in re.findall(r"`(\w+)`", code):
        assert re.search(rf"\b{name}\b", source), f"{name} is not in {file}"
    numbers = re.findall(r"\((\d+)\)", equation)
    assert not numbers or any(f"({number})" in source for number in numbers), f"{file} names none of {equation}"
