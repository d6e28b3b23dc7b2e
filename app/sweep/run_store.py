"""Store of a sweep's runs: sweep.toml, and runs.parquet, a folder of Parquet files that are each there as a whole or
not at all. Rows that were computed since the last of these files wait in a journal, a line each, so that a process that
is killed loses what it had under way only."""

from __future__ import annotations

import errno
import fcntl
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from app.process.atomic_write import write_whole
from app.process.json_text import decode_json
from app.scenario.errors import ScenarioError
from app.storage.joint_kinds import units_of
from app.sweep.fingerprint import another_program, fingerprint
from app.sweep.plan import FILE, Sweep, SweepPlan, differences, differences_in_words, read, to_toml
from app.sweep.run_metrics import COLUMNS, REFUSED, RunMetrics, to_try_again
from app.sweep.titles import title_of, unit_of

PARTS, JOURNAL, LOCK = "runs.parquet", "journal.jsonl", ".lock"
ROWS = 2000  # of a part
NUMBERS = ("row", "point", "arm")  # columns


class _Coming(NamedTuple):
    """Part that is to be written next: its number, and the rows that wait for it in the journal. One object, so that
    both change at once: Ctrl-C may come between any two statements, and a part that was written already is then
    written again under its own name, never as a second one."""

    number: int
    rows: list[RunMetrics]


class RunStore:
    """Store of a sweep's runs: its folder, open for one process. Raises ScenarioError where the folder is of another
    sweep or another version of the program, or in use, and OSError.
    done: (count,) bool, whether each run is computed; not where it was ended by a fault, so that it is tried again."""

    def __init__(self, folder: Path, sweep: Sweep) -> None:
        self._folder = folder
        (folder / PARTS).mkdir(parents=True, exist_ok=True)
        self._lock = (folder / LOCK).open("w")
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            self._lock.close()
            raise ScenarioError(
                f"--out {folder}: another {sweep.noun} writes there now; allowed: another folder"
            ) from error
        try:
            self._take_up(sweep)
            self._schema = schema_of(sweep)
            self.done = np.zeros(SweepPlan(sweep).count, dtype=bool)
            for part in parts(folder):
                table = _read(part, self._schema, len(self.done), ["row", "stopped"])
                self.done[table["row"].to_numpy()] = [not to_try_again(each) for each in table["stopped"].to_pylist()]
            waiting = [row for row in journaled(folder, self._schema, len(self.done)) if not self.done[row["row"]]]
            self.done[[row["row"] for row in waiting]] = [not to_try_again(row.get("stopped")) for row in waiting]
            last = max((int(part.stem.rpartition("-")[2]) for part in parts(folder)), default=0)
            self._coming = _Coming(last + 1, waiting)
            self._journal = self._rewritten_journal()
        except BaseException:
            self._lock.close()
            raise

    def __enter__(self) -> RunStore:
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._journal)
        self._lock.close()

    def add(self, metrics: RunMetrics) -> None:
        """Keep the metrics of a run. Raises OSError where they cannot be written."""
        line = msgspec.json.encode(metrics) + b"\n"
        if os.write(self._journal, line) != len(line):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self._coming.rows.append(metrics)
        self.done[metrics["row"]] = not to_try_again(metrics.get("stopped"))
        if len(self._coming.rows) >= ROWS:
            self.flush()

    def flush(self) -> None:
        """Write the rows of the journal as a Parquet file. Raises OSError where it cannot be written."""
        number, rows = self._coming
        if not rows:
            return
        table = pa.Table.from_pylist(sorted(rows, key=lambda row: row["row"]), schema=self._schema)
        path = self._folder / PARTS / f"part-{number:06d}.parquet"
        write_whole(path, lambda file: pq.write_table(table, file))
        self._coming = _Coming(number + 1, [])
        before, self._journal = self._journal, self._rewritten_journal()
        os.close(before)

    @property
    def rows(self) -> list[RunMetrics]:
        """Metrics of all runs so far."""
        return [
            row for part in parts(self._folder) for row in _read(part, self._schema, len(self.done)).to_pylist()
        ] + self._coming.rows

    def _take_up(self, sweep: Sweep) -> None:
        path = self._folder / sweep.file
        if not path.exists():
            if parts(self._folder) or (self._folder / JOURNAL).exists():
                other = f"holds runs of something else (no {sweep.file})"
                raise ScenarioError(f"--out {self._folder}: {other}; allowed: a folder of its own")
            text = to_toml(sweep).encode()
            write_whole(path, lambda file: file.write(text))
            return
        if other := differences(read(path, type(sweep)), sweep):
            what = differences_in_words(other) or f"made by {another_program(sweep)}"
            raise ScenarioError(
                f"--out {self._folder}: holds another {sweep.noun} ({what}); allowed: a folder of its own"
            )

    def _rewritten_journal(self) -> int:
        """Descriptor of a new journal, which has the rows that wait."""
        lines = b"".join(msgspec.json.encode(row) + b"\n" for row in self._coming.rows)
        write_whole(self._folder / JOURNAL, lambda file: file.write(lines))
        return os.open(self._folder / JOURNAL, os.O_WRONLY | os.O_APPEND)


def journaled(folder: Path, schema: pa.Schema, count: int) -> list[RunMetrics]:
    """Rows of a folder's journal, without a last line that was cut off and lines that are no rows of a sweep with
    this schema and `count` of them."""
    path = folder / JOURNAL
    rows = []
    for line in path.read_bytes().split(b"\n") if path.exists() else []:
        try:
            row = decode_json(line, object)
        except ValueError:
            continue
        if isinstance(row, dict) and type(row.get("row")) is int and 0 <= row["row"] < count and _fits(row, schema):
            rows.append(row)
    return rows


def _fits(row: Mapping[str, object], schema: pa.Schema) -> bool:
    """Whether the values of a row are of the kinds of their columns."""
    return all(
        isinstance(row.get(field.name), str if pa.types.is_string(field.type) else int | float)
        for field in schema
        if row.get(field.name) is not None
    )


def _read(part: Path, schema: pa.Schema, count: int, columns: list[str] | None = None) -> pa.Table:
    """Columns of a part, by default all. Raises ScenarioError where it is damaged, or not of the sweep with this schema
    and number of runs."""
    remedy = "allowed: remove it, and its runs are made again"
    try:
        with pq.ParquetFile(part) as file:
            own = file.schema_arrow.remove_metadata().equals(schema.remove_metadata())
            table = file.read(columns if own else [])
    except (pa.ArrowInvalid, OSError) as error:
        raise ScenarioError(f"{part}: cannot be read as Parquet; {remedy}") from error
    if not own or not _numbered(table, count):
        raise ScenarioError(f"{part}: holds runs of something else; {remedy}")
    return table


def _read_another(part: Path, schema: pa.Schema, count: int, program: str) -> pa.Table:
    """Columns that a part of another version of the program shares with this one. Raises ScenarioError where it is
    damaged, or lacks what tells its runs apart; it need not be removed then, since only that version can make its runs
    again. program: words for that version."""
    lasting = [name for name in schema.names if name not in COLUMNS or name in NUMBERS]
    try:
        with pq.ParquetFile(part) as file:
            table = file.read()
        shared = [name for name in schema.names if name in table.column_names]
        table = table.select(shared).cast(pa.schema([schema.field(name) for name in shared]))
        if set(lasting) <= set(shared) and _numbered(table, count):
            return table
    except (pa.ArrowException, OSError):
        pass
    raise ScenarioError(
        f"{part}: cannot be read; it was computed by {program}; allowed: `vsmrc sweep plot` of that one"
    )


def _numbered(table: pa.Table, count: int) -> bool:
    """Whether the rows of a table are those of a sweep with this number of runs."""
    rows = table["row"].to_numpy()
    return bool(((rows >= 0) & (rows < count)).all())


def parts(folder: Path) -> Sequence[Path]:
    """Parquet files of a sweep's folder."""
    return sorted((folder / PARTS).glob("part-[0-9][0-9][0-9][0-9][0-9][0-9].parquet"))


def refusals(folder: Path) -> Counter[str]:
    """Reasons for which runs in the parts of a sweep's folder were refused, each with the number of these runs."""
    # of this column alone: there may be millions of rows
    ends = pq.ParquetDataset([str(part) for part in parts(folder)]).read(columns=["stopped"])["stopped"].value_counts()
    return Counter(
        {
            each["values"].removeprefix(REFUSED): each["counts"]
            for each in ends.to_pylist()
            if (each["values"] or "").startswith(REFUSED)
        }
    )


def column(name: str, kind: pa.DataType, unit: str, meaning: str) -> pa.Field:
    """Column of a table, with its unit and meaning."""
    return pa.field(name, kind, metadata={"unit": unit, "meaning": meaning})


def schema_of(sweep: Sweep) -> pa.Schema:
    """Schema of the table: the columns of every run and the varied fields, with units and meanings."""
    known = [
        column(
            name,
            pa.string() if each.word else pa.int64() if name in NUMBERS else pa.float64(),
            "1" if each.unit == "1" else each.unit_in(units_of(sweep.scenario)),
            each.whole_meaning,
        )
        for name, each in COLUMNS.items()
    ]
    varied = [
        column(
            axis.path,
            pa.float64() if axis.numeric else pa.string(),
            unit_of(axis.path, units_of(sweep.scenario)),
            f"varied field: {title_of(axis.path)}",
        )
        for axis in sweep.vary
    ]
    return pa.schema([*known[:3], *varied, *known[3:]])


def table_of(folder: Path) -> tuple[Sweep, dict[str, np.ndarray]]:
    """Sweep of a folder, and the columns of its runs so far, in the order of their rows. A column that another version
    of the program did not know has no values. Raises ScenarioError where there are no runs."""
    sweep = read(folder / FILE)
    schema, count = schema_of(sweep), SweepPlan(sweep).count
    own = sweep.program == fingerprint(sweep)
    # before the parts: a sweep that runs may move its rows into one meanwhile
    journal = journaled(folder, schema, count)
    tables = [
        _read(part, schema, count).cast(schema) if own else _read_another(part, schema, count, another_program(sweep))
        for part in parts(folder)
    ]
    tables += [schema.empty_table(), pa.Table.from_pylist(journal, schema=schema)]
    whole = pa.concat_tables(tables, promote_options="default").select(schema.names)
    if not len(whole):
        raise ScenarioError(f"{folder}: no runs yet; allowed: a folder in which `vsmrc sweep` has computed some")
    # the last row of each run: one that was ended by a fault and was tried again has several
    _, last = np.unique(whole["row"].to_numpy()[::-1], return_index=True)
    whole = whole.take(len(whole) - 1 - last)
    columns: dict[str, Any] = {name: whole[name].to_numpy() for name in whole.column_names}
    return sweep, columns
