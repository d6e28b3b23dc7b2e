"""Command `vsmrc compare`: puts the metrics of runs side by side."""

from __future__ import annotations

import math
from typing import Annotated

import tyro

from app.cli.options import (
    NO_DEFAULT_SHOWN,
    EngineOption,
    Files,
    Settings,
    configured,
    engine_of,
    note_unused,
    note_without_effect,
    shown,
    use_own,
)
from app.cli.output import told
from app.cli.status import DONE, STOPPED
from app.cli.tables import show_table
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario

LEAST_PERIODS = 2  # of which metrics are
ROUNDING = 1e-9


def compare(
    scenarios: Annotated[tuple[str, ...], tyro.conf.Positional, NO_DEFAULT_SHOWN],
    /,
    *,
    last: Annotated[float | None, NO_DEFAULT_SHOWN] = None,
    duration: Annotated[float | None, NO_DEFAULT_SHOWN] = None,
    engine: EngineOption = None,
    use: Files = (),
    settings: Settings = (),
) -> int:
    """Simulate scenarios and print their metrics side by side, as the page's tab Runs does with pinned runs.

    --set, --duration and --use apply to every scenario. To compare two settings of one scenario, such as two control
    laws, write it with one of them (`vsmrc run ur5-hybrid --set controller.law=pd-gravity --out pd`) and compare that
    file with the other one (`vsmrc compare ur5-hybrid pd/scenario.toml`).

    Args:
        scenarios: one or more shipped scenarios or .toml files
        last: compute the metrics only over this many seconds at the end, instead of over the whole run
        duration: simulated time in s; by default the duration that each scenario sets
        engine: pinocchio, or compiled, which is faster; their results differ by rounding (docs/command-line.md)
        use: file with your own control law, surface or trajectory (docs/extending.md)
    """
    from app.analysis.metrics import ACCOUNT_METRICS, RUN_METRICS, account
    from app.session import headless_run
    from app.storage.constants_store import kept_memory

    if last is not None and not last > 0:
        raise ScenarioError(f"--last {last:g}: allowed: more than 0 s")
    if not scenarios:
        raise ScenarioError("compare: no scenario; allowed: one or more (see `vsmrc list`)")
    by = engine_of(engine)
    use_own(use)
    systems, accounts, runs, stopped = [], [], [], False
    chosen = [(name, configured(name, settings, duration)) for name in scenarios]
    for name, scenario in chosen:
        _require_rows(name, scenario, last)
    note_unused(*(scenario for _, scenario in chosen))
    note_without_effect(settings, *(scenario for _, scenario in chosen))
    for name, scenario in chosen:
        loop, metrics = headless_run.simulate(scenario, engine=by, show_progress=True, memory=kept_memory())
        since = -math.inf if last is None else loop.t - last - 0.5 * loop.period
        systems.append(loop.system)
        runs.append(metrics)
        accounts.append(account(loop.system, loop.recording, since, loop.t))
        if loop.stopped:
            stopped = True
            print(told(f"{name} stopped: {loop.stopped}"))
    rows = [
        (f"{metric.title} [{metric.units(systems)}]", *(shown(metric.of(each)) for each in accounts))
        for metric in ACCOUNT_METRICS
    ]
    if last is None:  # of the end of a run alone it would say nothing
        rows += [
            (f"{metric.title} [{metric.units(systems)}]", *(shown(metric.of(each)) for each in runs))
            for metric in RUN_METRICS
            if metric.field == "settling_time"
        ]
    show_table(("", *scenarios), rows)
    return STOPPED if stopped else DONE


def _require_rows(name: str, scenario: Scenario, last: float | None) -> None:
    """Raise ScenarioError where the metrics would be of fewer than two control periods, which have none, or of more
    than the run."""
    least, whole = LEAST_PERIODS * scenario.controller.period, scenario.simulation.duration
    if last is not None and last > whole * (1.0 + ROUNDING):
        raise ScenarioError(f"--last {last:g}: longer than the run of {name}; allowed: at most {whole:g} s")
    for option, seconds in (("--last", last), ("simulation.duration:", whole)):
        if seconds is not None and seconds < least * (1.0 - ROUNDING):
            raise ScenarioError(
                f"{option} {seconds:g}: fewer than two control periods of {name}; allowed: {least:g} s or more"
            )
