"""The report of the benchmark: complete, and only written when it is."""

from __future__ import annotations

import datetime
from pathlib import Path
from string import Template
from typing import get_args

import pytest

from benchmarks import __main__ as command
from benchmarks import mutations, report
from benchmarks.rounds import Whole, interleaved, ratio

TABLE = report.Table(("what", "µs"), [("a step", "14.5"), ("a longer name", "3")])


def test_every_subject_has_its_place_in_the_report() -> None:
    places = set(Template(report.TEMPLATE.read_text(encoding="utf-8")).get_identifiers())
    assert places == {"machine", *get_args(command.Subject)}


def test_a_partial_run_writes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(report, "WRITTEN", tmp_path / "performance.md")
    monkeypatch.setattr(command.machine, "describe", lambda: "a machine")
    monkeypatch.setattr(command, "import_module", lambda _: type("", (), {"measure": staticmethod(lambda _: TABLE)}))
    command.main(only=("step",))
    command.main(quick=True)
    assert not report.WRITTEN.exists()
    command.main()
    assert TABLE.markdown() in report.WRITTEN.read_text(encoding="utf-8")


def test_tables_read_well_as_text() -> None:
    assert TABLE.markdown().splitlines() == [
        "| what          |   µs |",
        "| ------------- | ---: |",
        "| a step        | 14.5 |",
        "| a longer name |    3 |",
    ]


def test_rounds_are_interleaved_and_ratios_taken_round_by_round() -> None:
    order: list[str] = []
    times = interleaved({name: lambda name=name: order.append(name) for name in "ab"}, rounds=2, steps=2)
    assert "".join(order) == "aabbaabb"
    assert [len(rounds) for rounds in times.values()] == [2, 2]
    together: list[int] = []
    interleaved({"whole": Whole(together.append)}, rounds=2, steps=3)
    assert together == [3, 3]
    assert ratio([1.0, 20.0, 3.0], [1.0, 10.0, 1.0]) == 2.0


def test_every_planted_mistake_fits_the_sources() -> None:
    assert mutations.misfits(mutations.table()) == []


def test_document_of_planted_mistakes_fits_their_table() -> None:
    assert mutations.PAGE.read_text(encoding="utf-8") == mutations.page()


def test_a_verdict_is_kept_beside_the_others_until_its_row_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = [mutations.Mutation(f"mistake {number}", "a.py", "old", "new") for number in range(3)]
    monkeypatch.setattr(mutations, "table", lambda: tuple(rows))
    monkeypatch.setattr(mutations, "KEPT", tmp_path / "kept.jsonl")
    monkeypatch.setattr(mutations, "PAGE", tmp_path / "page.md")

    def results() -> list[str]:
        lines = mutations.PAGE.read_text(encoding="utf-8").splitlines()
        return [line.split("|")[3].strip() for line in lines if "`a.py`" in line]

    for row, result in ((rows[0], mutations.CAUGHT), (rows[1], mutations.SURVIVED)):
        mutations.keep(mutations.Verdict(row, result, "test_a.py::test_b", datetime.date(2026, 1, 2)))
    assert results() == ["caught", "SURVIVED", "not run yet"]
    assert "Of 3 planted mistakes, **1 have not been run yet**" in mutations.PAGE.read_text(encoding="utf-8")
    rows[:2] = rows[0]._replace(first="another"), rows[1]._replace(new="other")
    mutations.keep(mutations.Verdict(rows[2], mutations.CAUGHT, "", datetime.date(2026, 1, 3)))
    assert results() == ["caught", "not run yet", "caught"]
