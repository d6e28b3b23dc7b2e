"""Tables in Markdown, and docs/performance.md, written only from a complete run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from string import Template
from typing import NamedTuple

TEMPLATE = Path(__file__).with_name("report.md")
WRITTEN = Path(__file__).parents[1] / "docs" / "performance.md"


class Table(NamedTuple):
    """The first column is text, the others are numbers as they are to be shown."""

    header: tuple[str, ...]
    rows: list[tuple[str, ...]]

    def markdown(self) -> str:
        """A table that also reads well in a terminal."""
        lines = [self.header, *self.rows]
        widths = [max(len(line[i]) for line in lines) for i in range(len(self.header))]
        shown = [" | ".join(_cell(line[i], widths[i], right=i > 0) for i in range(len(line))) for line in lines]
        rule = " | ".join("-" * (w - 1) + (":" if i else "-") for i, w in enumerate(widths))
        return "\n".join(f"| {line} |" for line in (shown[0], rule, *shown[1:]))


def page(machine: str, tables: Mapping[str, Table]) -> str:
    """The text of docs/performance.md. Raises KeyError when a table is missing."""
    shown = {name: table.markdown() for name, table in tables.items()}
    return Template(TEMPLATE.read_text(encoding="utf-8")).substitute(shown, machine=machine)


def _cell(text: str, width: int, *, right: bool) -> str:
    return text.rjust(width) if right else text.ljust(width)
