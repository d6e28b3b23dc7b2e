"""Tables on the terminal, of which no letter is cut."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.markup import escape
from rich.measure import Measurement
from rich.table import Table

ENDLESS = 100_000  # columns


def show_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table on standard output. Where it is wider than the terminal each of its columns stands in a table of
    its own, beside the first one; a file or a pipe has lines of any length."""
    console = Console()
    whole = _table(head, rows)
    if not console.is_terminal or _width(whole, console) <= console.width:
        tables = [whole]
    else:
        tables = [_table((head[0], head[k]), [(row[0], row[k]) for row in rows]) for k in range(1, len(head))]
    for table in tables:
        Console(width=max(_width(table, console), console.width)).print(table)


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    table = Table(*map(escape, head))
    for row in rows:
        table.add_row(*map(escape, row))
    return table


def _width(table: Table, console: Console) -> int:
    """Columns that a table needs."""
    return Measurement.get(console, console.options.update(max_width=ENDLESS), table).maximum
