"""README.md and the pages of docs/ as text, code spans, and commands that they show."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

ROOT = Path(__file__).parents[2]
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
COMMAND = re.compile(r"(\$ )?(\S*/)?(vsmrc|make|python3?) [\w-]")


@dataclass(frozen=True)
class Command:
    """One command of a page: words as a shell sees them, and the output shown below it. `in_prose`: it is part of a
    sentence."""

    words: tuple[str, ...]
    output: str = ""
    in_prose: bool = False

    def __str__(self) -> str:
        return shlex.join(self.words)


@dataclass(frozen=True)
class Page:
    """One Markdown file."""

    path: Path

    def __str__(self) -> str:
        return self.path.relative_to(ROOT).as_posix()

    @cached_property
    def text(self) -> str:
        return self.path.read_text(encoding="utf-8")

    @cached_property
    def prose(self) -> str:
        """All but the fenced blocks."""
        return FENCE.sub("", self.text)

    @cached_property
    def spans(self) -> list[str]:
        """What stands between backticks in the prose."""
        return [" ".join(span.split()) for span in re.findall(r"`([^`]+)`", self.prose)]

    @property
    def commands(self) -> Iterator[Command]:
        """From the blocks `sh` (a script) and `console` (commands after "$ ", output), and from the prose."""
        for language, block in FENCE.findall(self.text):
            if language == "sh":
                yield from (Command(words) for words in statements(block))
            elif language == "console":
                for shown in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]:
                    line, output = shown.split("\n", 1)
                    yield Command(tuple(shlex.split(line)), output)
        for span in self.spans:
            if COMMAND.match(span):
                yield Command(tuple(shlex.split(span)), in_prose=True)

    @property
    def hidden(self) -> list[str]:
        """Lines that look like commands in blocks that `commands` does not read."""
        blocks = [block for language, block in FENCE.findall(self.text) if language not in ("sh", "console")]
        lines = [*"\n".join(blocks).splitlines(), *re.findall(r"^    .*$", self.prose, re.MULTILINE)]
        return [line.strip() for line in lines if COMMAND.match(line.strip())]


def statements(script: str) -> Iterator[tuple[str, ...]]:
    """The commands of a shell script, each of which may go on over several lines within a quotation."""
    text = ""
    for line in script.splitlines():
        text += f"{line}\n"
        try:
            words = shlex.split(text, comments=True)
        except ValueError:  # a quotation that is still open
            continue
        text = ""
        if words:
            yield tuple(words)
    assert not text, f"a quotation without an end: {text}"


PAGES = [Page(path) for path in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))]
