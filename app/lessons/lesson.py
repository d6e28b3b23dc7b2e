"""Lesson: a Markdown file in which each fenced block of TOML ends a step."""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass
from importlib import resources
from itertools import takewhile
from pathlib import Path
from typing import Any

import msgspec

from app.lessons.blocks import (
    KINDS,
    ChoiceQuestion,
    Content,
    CurveQuestion,
    Goal,
    Head,
    LessonRun,
    NumberQuestion,
    StartScenario,
)
from app.scenario.data import LARGEST, shipped, with_values
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.scenario.struct_refusals import struct_refusal
from environments.regular_file import read_regular
from parameters import allowed

FENCE = re.compile(r"^(`{3,})[ \t]*(\w*)[ \t]*$")
NAMED = re.compile(r"\{\{ *([a-z][a-z0-9_]*) *\}\}")  # a measured number in a text
FILE = "lesson"
MOST_STEPS = 60


class LessonError(ScenarioError):
    """Error of a lesson that cannot be used: one sentence with its file, line and reason."""


@dataclass(frozen=True)
class LessonStep:
    """Step of a lesson.
    number: from 1.
    line: number of the block's first line in the file.
    kind: of the block, such as "predict".
    text: Markdown above the block.
    scenario: in which the step takes place; None before the first scenario."""

    number: int
    line: int
    kind: str
    text: str
    block: Content
    scenario: Scenario | None

    @property
    def question(self) -> ChoiceQuestion | NumberQuestion | CurveQuestion | None:
        """Question of the step, None for none."""
        return self.block if isinstance(self.block, ChoiceQuestion | NumberQuestion | CurveQuestion) else None

    @property
    def run(self) -> LessonRun | None:
        """Run of the step, None for none."""
        return self.block if isinstance(self.block, LessonRun) else None

    @property
    def goal(self) -> Goal | None:
        """Goal of the step, None for none."""
        return self.block if isinstance(self.block, Goal) else None

    @property
    def ask(self) -> str:
        """Text in which the step asks something of a student, "" for none."""
        asking = self.question or self.goal
        return "" if asking is None else asking.ask

    @property
    def names_numbers(self) -> bool:
        """Whether the texts of the step contain measured numbers of runs before it."""
        options = self.block.options if isinstance(self.block, ChoiceQuestion) else ()
        return any(NAMED.search(text) for text in (self.text, self.ask, *options))


@dataclass(frozen=True)
class Lesson:
    """Lesson: its head and its steps.
    name: of its folder, followed by the language of a translation.
    source: name of its file, for messages."""

    name: str
    source: str
    head: Head
    steps: tuple[LessonStep, ...]

    def asks_before_run(self, step: LessonStep) -> bool:
        """Whether a question comes between this step and the next run, which a playing loop would answer."""
        later = takewhile(lambda each: not (each.run or each.goal), self.steps[step.number - 1 :])
        return any(each.question for each in later)

    def refusal(self, step: LessonStep, reason: str) -> LessonError:
        """Error at the block of a step."""
        return LessonError(f"{self.source}, line {step.line}: {reason}")


def read(text: str, name: str, source: str) -> Lesson:
    """Lesson from its file's text. Raises LessonError. name, source: as in `Lesson`."""
    head: Head | None = None
    steps: list[LessonStep] = []
    setting: Scenario | None = None
    for line, prose, kind, body in _blocks(text, source):
        block = _decoded(kind, body, source, line)
        if isinstance(block, Head):
            if head is not None or steps:
                raise LessonError(f"{source}, line {line}: lesson: a second one; allowed: one, at the beginning")
            head = block
            continue
        if head is None:
            raise LessonError(f"{source}, line {line}: {kind}: before the block lesson; allowed: after it")
        try:
            if isinstance(block, StartScenario):
                setting = with_values(_base(block.base), block.set)
            here = setting
            if isinstance(block, LessonRun | Goal):
                if setting is None:
                    raise ScenarioError(f"{kind}: before any scenario; allowed: after one")
                here = with_values(setting, block.set)
        except ScenarioError as error:
            raise LessonError(f"{source}, line {line}: {error}") from error
        steps.append(LessonStep(len(steps) + 1, line, kind, prose, block, here))
    if head is None:
        raise LessonError(f"{source}, line 1: no block lesson; allowed: one, at the beginning")
    if not steps or len(steps) > MOST_STEPS:
        raise LessonError(f"{source}, line 1: {len(steps)} steps; allowed: 1 to {MOST_STEPS}")
    return Lesson(name, source, head, tuple(steps))


def load_file(path: Path) -> Lesson:
    """Lesson from a lesson.md, or from the folder that holds one. Raises LessonError."""
    path = path / f"{FILE}.md" if path.is_dir() else path
    try:
        content = read_regular(path, LARGEST + 1)
        text = content.decode("utf-8-sig").replace("\r\n", "\n")
    except OSError as error:
        raise LessonError(f"lesson {str(path)!r:.200}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise LessonError(f"lesson {str(path)!r:.200}: it is no UTF-8 text; allowed: a text in UTF-8") from error
    if len(content) > LARGEST:
        raise LessonError(f"lesson {str(path)!r:.200}: over {LARGEST / 1e6:g} MB; allowed: less")
    return read(text, path.absolute().parent.name, str(path))


def shipped_lessons() -> dict[str, Lesson]:
    """The lessons of `static/lessons`, by name; a translation has its language behind its name, as in "walls.de"."""
    folder = resources.files("static").joinpath("lessons")
    found: dict[str, Lesson] = {}
    for each in sorted(folder.iterdir(), key=lambda entry: entry.name):
        if not each.is_dir():
            continue
        for file in sorted(each.iterdir(), key=lambda entry: (len(entry.name), entry.name)):
            if file.name.startswith(FILE) and file.name.endswith(".md"):
                name = each.name + file.name.removeprefix(FILE).removesuffix(".md")
                found[name] = read(file.read_text(encoding="utf-8"), name, f"{each.name}/{file.name}")
    return found


def load(name_or_file: str) -> Lesson:
    """A shipped lesson by name, or one from a file or folder. Raises LessonError."""
    path = Path(name_or_file)
    if not name_or_file:
        raise LessonError("lesson: an empty text; allowed: a lesson.md or the name of a lesson")
    if path.suffix == ".md" or path.is_dir():
        return load_file(path)
    lessons = shipped_lessons()
    if name_or_file not in lessons:
        named = allowed(name_or_file, lessons).replace("allowed: ", "allowed: a lesson.md or ", 1)
        raise LessonError(f"lesson {name_or_file!r:.200}: unknown; {named}")
    return lessons[name_or_file]


def _base(name: str) -> Scenario:
    scenarios = shipped()
    if name not in scenarios:
        raise ScenarioError(f"base: {name!r:.60}; {allowed(name, scenarios)}")
    return scenarios[name]


def _blocks(text: str, source: str) -> list[tuple[int, str, str, str]]:
    """Line, text above, kind and content of each fenced block of a known kind; other fences belong to the text."""
    found: list[tuple[int, str, str, str]] = []
    prose: list[str] = []
    lines = text.split("\n")
    at = 0
    while at < len(lines):
        fence = FENCE.match(lines[at])
        if fence is None:
            prose.append(lines[at])
            at += 1
            continue
        begun, mark, kind = at + 1, fence[1], fence[2]
        end = next((k for k in range(at + 1, len(lines)) if lines[k].strip() == mark), None)
        if end is None:
            raise LessonError(f"{source}, line {begun}: {kind or 'block'}: it has no end; allowed: {mark} on a line")
        if kind in KINDS:
            found.append((begun, "\n".join(prose).strip(), kind, "\n".join(lines[at + 1 : end])))
            prose = []
        elif kind:
            raise LessonError(f"{source}, line {begun}: block {kind!r:.40}; {allowed(kind, KINDS)}")
        else:
            prose += lines[at : end + 1]
        at = end + 1
    if "".join(prose).strip():
        raise LessonError(f"{source}, line {len(lines)}: text below the last block; allowed: above a block explain")
    return found


def _decoded(kind: str, body: str, source: str, line: int) -> Any:
    try:
        data = tomllib.loads(body)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise LessonError(f"{source}, line {line}: {kind}: not TOML: {error}") from error
    try:
        return msgspec.convert(data, KINDS[kind])
    except msgspec.ValidationError as error:
        raise LessonError(f"{source}, line {line}: {kind}: {struct_refusal(error, data, KINDS[kind])}") from error
    except RecursionError as error:
        raise LessonError(f"{source}, line {line}: {kind}: {error}") from error
