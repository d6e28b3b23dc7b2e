"""Report docs/performance.md, which is written only after all benchmarks."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from string import Template

from app.process.markdown import Table

TEMPLATE = Path(__file__).with_name("report.md")
WRITTEN = Path(__file__).parents[1] / "docs" / "performance.md"


def page(machine: str, tables: Mapping[str, Table]) -> str:
    """Text of docs/performance.md. Raises KeyError when a table is missing."""
    shown = {name: table.markdown() for name, table in tables.items()}
    return Template(TEMPLATE.read_text(encoding="utf-8")).substitute(shown, machine=machine)
