"""Section of the evidence: independent jobs, and the findings from their results."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from string import Template
from typing import Any, NamedTuple, TypeVar

from app.process.markdown import Table

T = TypeVar("T")


class Job(NamedTuple):
    """A function of a module and its arguments: it runs in another process, so both can be pickled.

    The same job always has the same result: random numbers come from a seed among its arguments.
    """

    function: Callable[..., Any]
    arguments: tuple[Any, ...] = ()


def of_kind(kind: type[T], results: Sequence[object]) -> list[T]:
    """Results of one class, among those of different jobs."""
    return [result for result in results if isinstance(result, kind)]


@dataclass(frozen=True)
class Findings:
    """Findings of a section's jobs: numbers and tables by their name in the section's text, figures (SVG) by the end of
    their file's name."""

    numbers: Mapping[str, str] = field(default_factory=dict)
    tables: Mapping[str, Table] = field(default_factory=dict)
    figures: Mapping[str, bytes] = field(default_factory=dict)


@dataclass(frozen=True)
class Section:
    """Section on one claim, or a family of them. Its prose is beside its module, in `<name>.md`.

    jobs(thin): one in so many of the cases, 1 for all.
    conclude: findings from their results, in the same order.
    needs: modules without which it cannot run, and how to get them.
    """

    name: str
    jobs: Callable[[int], Sequence[Job]]
    conclude: Callable[[Sequence[Any]], Findings]
    needs: Mapping[str, str] = field(default_factory=dict)

    def missing(self) -> tuple[str, ...]:
        """Commands that install the modules that are missing."""
        return tuple(remedy for module, remedy in self.needs.items() if find_spec(module) is None)

    def text(self, findings: Findings, pictures: str) -> str:
        """Text in Markdown, with the figures at `pictures`. Raises KeyError when the prose names a number that the
        findings lack."""
        tables = {name: table.markdown() for name, table in findings.tables.items()}
        figures = {f"{name}_figure": f"{pictures}/{self.name}-{name}.svg" for name in findings.figures}
        return Template(self._prose).substitute(findings.numbers, **tables, **figures)

    @property
    def heading(self) -> str:
        """First line of its prose."""
        return self._prose.splitlines()[0]

    @property
    def _prose(self) -> str:
        return Path(__file__).with_name(f"{self.name}.md").read_text(encoding="utf-8")
