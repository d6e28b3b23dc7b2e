"""Section of the evidence: independent jobs, and the findings from their results."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from string import Template
from typing import Any, NamedTuple, TypeVar

from app.process.markdown import Table
from app.scenario.number_text import with_powers

T = TypeVar("T")


class Job(NamedTuple):
    """Job: a function of a module and its arguments, both picklable, since the job runs in another process.

    The same job always has the same result: seeds of random numbers are among its arguments.
    """

    function: Callable[..., Any]
    arguments: tuple[Any, ...] = ()


def of_kind(kind: type[T], results: Sequence[object]) -> list[T]:
    """Results of one class, picked from the results of different jobs."""
    return [result for result in results if isinstance(result, kind)]


@dataclass(frozen=True)
class Findings:
    """Findings of a section.
    numbers, tables: by their names in the section's prose.
    figures: SVG, by the end of their file's name."""

    numbers: Mapping[str, str] = field(default_factory=dict)
    tables: Mapping[str, Table] = field(default_factory=dict)
    figures: Mapping[str, bytes] = field(default_factory=dict)


@dataclass(frozen=True)
class EvidenceSection:
    """Section of the evidence, on one claim or a family of claims. Its prose is in `<name>.md` beside its module.

    jobs: returns the jobs for one in `thin` of the cases.
    conclude: returns the findings from the results, in the order of the jobs.
    needs: commands that install the modules without which the section cannot run, by module.
    """

    name: str
    jobs: Callable[[int], Sequence[Job]]
    conclude: Callable[[Sequence[Any]], Findings]
    needs: Mapping[str, str] = field(default_factory=dict)

    def missing(self) -> tuple[str, ...]:
        """Commands that install the modules that are missing."""
        return tuple(remedy for module, remedy in self.needs.items() if find_spec(module) is None)

    def text(self, findings: Findings, pictures: str) -> str:
        """Text of the section in Markdown. pictures: folder of the figures. Raises KeyError where the prose names a
        number that the findings lack."""
        tables = {name: _with_powers(table).markdown() for name, table in findings.tables.items()}
        figures = {f"{name}_figure": f"{pictures}/{self.name}-{name}.svg" for name in findings.figures}
        return Template(with_powers(self._prose)).substitute(
            {name: with_powers(number) for name, number in findings.numbers.items()}, **tables, **figures
        )

    @property
    def heading(self) -> str:
        """Heading: the first line of the prose."""
        return self._prose.splitlines()[0]

    @property
    def _prose(self) -> str:
        return Path(__file__).with_name(f"{self.name}.md").read_text(encoding="utf-8")


def _with_powers(table: Table) -> Table:
    """Table whose numbers have powers of ten, not exponents."""
    header, *rows = (tuple(map(with_powers, line)) for line in (table.header, *table.rows))
    return Table(header, rows)
