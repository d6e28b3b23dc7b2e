"""Command `vsmrc compare`: puts the figures of runs side by side."""

from __future__ import annotations

import math
from typing import Annotated

import tyro
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from app.cli.options import ENGINES, Files, Settings, braces, configured, one_of, shown, use_own
from app.cli.status import DONE, STOPPED
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.simulation.engines import Engine

LEAST_PERIODS = 2  # of which figures are
ROUNDING = 1e-9


def compare(
    scenarios: Annotated[tuple[str, ...], tyro.conf.Positional],
    /,
    *,
    last: float | None = None,
    duration: float | None = None,
    engine: Annotated[str, tyro.conf.arg(metavar=braces(ENGINES))] = "pinocchio",
    use: Files = (),
    settings: Settings = (),
) -> int:
    """Simulate scenarios and put their figures side by side, as the tab Runs does with pinned runs.

    Args:
        scenarios: shipped scenarios or .toml files
        last: how much of the end counts, in s, instead of the whole run
        duration: simulated time in s, instead of the scenarios'
        engine: pinocchio; or compiled, faster, and its digits differ by rounding (docs/command-line.md)
        use: a file with a law, surface or trajectory of your own (docs/extending.md)
    """
    from app.analysis.metrics import FIGURES, account
    from app.session import headless_run
    from app.storage.constants_store import kept_memory

    if last is not None and not last > 0:
        raise ScenarioError(f"--last {last:g}: allowed: more than 0 s")
    if not scenarios:
        raise ScenarioError("compare: no scenario; allowed: one or more (see `vsmrc list`)")
    by: Engine = one_of("--engine", engine, ENGINES)
    use_own(use)
    systems, accounts, stopped = [], [], False
    chosen = [(name, configured(name, settings, duration)) for name in scenarios]
    for name, scenario in chosen:
        _require_rows(name, scenario, last)
    for name, scenario in chosen:
        loop, _ = headless_run.simulate(scenario, engine=by, show_progress=True, memory=kept_memory())
        since = -math.inf if last is None else loop.t - last - 0.5 * loop.period
        systems.append(loop.system)
        accounts.append(account(loop.system, loop.recording, since, loop.t))
        if loop.stopped:
            stopped = True
            print(f"{name} stopped: {loop.stopped}")
    table = Table("", *(escape(name) for name in scenarios))
    for figure in FIGURES:
        table.add_row(escape(f"{figure.title} [{figure.units(systems)}]"), *(shown(figure.of(a)) for a in accounts))
    Console().print(table)
    return STOPPED if stopped else DONE


def _require_rows(name: str, scenario: Scenario, last: float | None) -> None:
    """Raise ScenarioError where the figures would be of fewer than two control periods, which have none."""
    least = LEAST_PERIODS * scenario.controller.period
    for option, seconds in (("--last", last), ("simulation.duration:", scenario.simulation.duration)):
        if seconds is not None and seconds < least * (1.0 - ROUNDING):
            raise ScenarioError(
                f"{option} {seconds:g}: fewer than two control periods of {name}; allowed: {least:g} s or more"
            )
