"""`make bench`: every measurement, shown as it is made, and docs/performance.md from a complete run."""

from __future__ import annotations

from importlib import import_module
from typing import Annotated, Literal, get_args

import tyro

from benchmarks import machine, report
from benchmarks.effort import FULL, QUICK

Subject = Literal[
    "step", "page", "latency", "start", "compilation", "pacing", "preview", "background", "sweeps", "memory", "sessions"
]


def main(only: Annotated[tuple[Subject, ...], tyro.conf.arg(metavar="SUBJECT")] = (), quick: bool = False) -> None:
    """Measure, some twenty-five minutes in all; a complete run writes docs/performance.md.

    Args:
        only: these subjects, to look without writing
        quick: a short run, to look without writing; its numbers mean little
    """
    described = machine.describe()
    print(described, flush=True)
    tables = {}
    for subject in only or get_args(Subject):
        # imported here, where it is needed: the served process also loads this file, and its memory is measured
        tables[subject] = import_module(f"benchmarks.{subject}").measure(QUICK if quick else FULL)
        print(f"\n{tables[subject].markdown()}", flush=True)
    if only or quick:
        print(f"\nnot written to {report.WRITTEN.name}: not a complete run")
        return
    report.WRITTEN.write_text(report.page(described, tables), encoding="utf-8")
    print(f"\nwritten to {report.WRITTEN}")


if __name__ == "__main__":
    tyro.cli(main)
