"""Tables in Markdown that can also be read in a terminal."""

from __future__ import annotations

from typing import NamedTuple


class Table(NamedTuple):
    """A table: its first column is text, the others are numbers as they are to be shown."""

    header: tuple[str, ...]
    rows: list[tuple[str, ...]]

    def markdown(self) -> str:
        lines = [self.header, *self.rows]
        widths = [max(len(line[i]) for line in lines) for i in range(len(self.header))]
        shown = [" | ".join(_cell(line[i], widths[i], right=i > 0) for i in range(len(line))) for line in lines]
        rule = " | ".join("-" * (w - 1) + (":" if i else "-") for i, w in enumerate(widths))
        return "\n".join(f"| {line} |" for line in (shown[0], rule, *shown[1:]))


def _cell(text: str, width: int, *, right: bool) -> str:
    return text.rjust(width) if right else text.ljust(width)
