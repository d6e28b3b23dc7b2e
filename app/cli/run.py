"""Command `vsmrc run`: simulates a scenario without a screen."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import tyro

from app.cli.options import (
    NO_DEFAULT_SHOWN,
    Default,
    EngineOption,
    Files,
    Settings,
    configured,
    engine_of,
    loaded,
    note_unused,
    note_without_effect,
    require_folder,
    settings_of,
    shown,
    typed,
    use_own,
    written_to,
)
from app.cli.output import told
from app.cli.status import BROKEN, DONE, STOPPED, UNPROMISED
from app.process.terminal_text import print_line
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.simulation.engines import Engine

if TYPE_CHECKING:
    from app.analysis.metrics import Metrics
    from app.simulation.closed_loop import ClosedLoop

BLEND_AT, BLEND_OVER = Default(0.0), Default(2.0)  # s
LAW = "law"  # premise that the law is (25)
TITLE = 40  # letters of a metric's name, before its value


def run(
    scenario: Annotated[tyro.conf.Positional[str | None], NO_DEFAULT_SHOWN] = None,
    /,
    *,
    out: Path,
    from_: Annotated[Path | None, tyro.conf.arg(name="from"), NO_DEFAULT_SHOWN] = None,
    row: Annotated[int | None, NO_DEFAULT_SHOWN] = None,
    duration: Annotated[float | None, NO_DEFAULT_SHOWN] = None,
    blend_to: Annotated[str | None, NO_DEFAULT_SHOWN] = None,
    blend_at: Annotated[float | None, BLEND_AT.hint] = None,
    blend_over: Annotated[float | None, BLEND_OVER.hint] = None,
    strict: bool = False,
    engine: EngineOption = None,
    use: Files = (),
    settings: Settings = (),
) -> int:
    """Simulate a scenario without a screen. Writes recording.npz, metrics.json and scenario.toml.

    Args:
        scenario: a shipped scenario (see `vsmrc list`) or a .toml file
        out: folder for the files
        from_: repeat a run of a sweep: the folder of the sweep, instead of a scenario
        row: number of the run of that sweep, counted from 0
        duration: simulated time in s; by default the duration that the scenario sets
        blend_to: change gradually to the target model of this scenario; see also the fields of `blend`
        blend_at: when this change starts, s
        blend_over: how long this change takes, s
        strict: exit with status 4 if the theorem's promise was broken, with 5 if nothing was promised
        engine: pinocchio, or compiled, which is faster; their results differ by rounding (docs/command-line.md)
        use: file with your own control law, surface or trajectory (docs/extending.md)
    """
    from app.session import headless_run
    from app.storage.constants_store import kept_memory

    require_folder(out)
    use_own(use)
    if from_ is not None:
        _require_as_it_was(
            {
                f"the scenario {scenario!r:.60}": scenario,
                "--set": settings,
                "--duration": duration,
                "--blend-to": blend_to,
                "--engine": engine,
                "--use": use,
            }
        )
        if row is None:
            raise ScenarioError("--from: without --row; allowed: --from FOLDER --row N")
        chosen, by, until = _of_sweep(from_, row)
    elif row is not None:
        raise ScenarioError(f"--row {row} without --from; allowed: --from FOLDER --row N")
    elif scenario is None:
        raise ScenarioError("run: no scenario; allowed: one (see `vsmrc list`), or --from FOLDER --row N")
    else:
        chosen, by, until = configured(scenario, settings, duration), engine_of(engine), 0.0
    _require_one_blend(blend_to, settings)
    chosen = _blending(chosen, blend_to, blend_at, blend_over)
    note_unused(chosen)
    note_without_effect(settings, chosen)
    loop, metrics = headless_run.simulate(chosen, until=until, engine=by, show_progress=True, memory=kept_memory())
    try:
        with written_to(out):  # first: whoever reads what is printed may be in no hurry
            headless_run.write(loop, metrics, out)
    finally:  # on a full disk this is all that is left of the run
        _print_run(metrics, loop)
    print(f"written to {out}")
    return _status(metrics, loop, strict=strict)


def _require_as_it_was(others: Mapping[str, object]) -> None:
    """Raise ScenarioError where anything else is typed with --from. others: values of the options, by their names."""
    if other := next((name for name, value in others.items() if typed(value)), None):
        raise ScenarioError(f"--from: with {other}; allowed: the same run again, as it was")


def _status(metrics: Metrics, loop: ClosedLoop, *, strict: bool) -> int:
    """Exit status of the run. strict: whether it says how the promise went."""
    if strict and metrics.promise.verdict != "holds":
        return BROKEN if metrics.promise.verdict == "broken" else UNPROMISED
    return STOPPED if loop.stopped else DONE


def _print_run(metrics: Metrics, loop: ClosedLoop) -> None:
    _print_metrics(metrics, loop)
    _print_promise(metrics)
    _print_notes(loop)


def _print_notes(loop: ClosedLoop) -> None:
    """Print what else a reader of the run's numbers has to know."""
    from app.analysis.metrics import untouched_sentences

    for sentence in untouched_sentences(loop.system, loop.recording):
        print(told(f"note: {sentence}"))
    for violation in loop.standing.outsiders:
        print(told(f"the true arm is outside the declared set: {violation}"))
    if loop.warning:
        print(told(f"flagged: {loop.warning}"))


def _require_one_blend(blend_to: str | None, settings: Settings) -> None:
    """Raises ScenarioError for a setting of the blend that `--blend-to` would undo."""
    if blend_to is not None and (both := [path for path, _ in settings_of(settings) if path.split(".")[0] == "blend"]):
        raise ScenarioError(f"--set {both[0]}: --blend-to sets it, too; allowed: one of both")


def _blending(scenario: Scenario, to: str | None, at: float | None, over: float | None) -> Scenario:
    """The scenario, going over to the target model of the one named `to`, if there is one."""
    from app.session.changes import blending_to

    if to is not None:
        begins, end = BLEND_AT.unless(at), scenario.simulation.duration
        if begins >= end:
            raise ScenarioError(f"--blend-at {begins:g}: the run ends at {end:g} s; allowed: an instant before")
        return blending_to(scenario, loaded(to), begins, BLEND_OVER.unless(over))
    if typed(at, over):
        raise ScenarioError("--blend-at or --blend-over without --blend-to; allowed: with a scenario to go over to")
    return scenario


def _of_sweep(folder: Path, row: int) -> tuple[Scenario, Engine, float]:
    """Scenario, engine and end (s, 0 for the scenario's) of a run of a sweep."""
    from app.sweep import plan
    from app.sweep.fingerprint import another_program, fingerprint
    from app.tune.plan import Tuning

    if (folder / Tuning.file).exists() and not (folder / plan.FILE).exists():
        raise ScenarioError(
            f"--from {folder}: holds runs of `vsmrc tune`, which cannot be repeated; allowed: the folder of a sweep"
        )
    sweep = plan.read(folder / plan.FILE)
    if sweep.program != fingerprint(sweep):
        print_line(f"this sweep was computed by {another_program(sweep)}: digits may differ")
    whole = plan.SweepPlan(sweep)
    return whole.scenario(whole.row(row)), sweep.engine, sweep.until


def _print_metrics(metrics: Metrics, loop: ClosedLoop) -> None:
    from app.analysis.metrics import RUN_METRICS
    from app.scenario.units import listed

    system = loop.system
    for metric in RUN_METRICS:
        value = metric.of(metrics)
        unit = "" if value is None else metric.units([system])
        print(f"{metric.title:{TITLE}s} {shown(value)} {unit}".rstrip())
    variation = shown(None)
    if np.isfinite(metrics.torque_total_variation).any():
        variation = listed(map(shown, metrics.torque_total_variation), "N·m/s", system.robot.slides, between="  ")
    print(f"{'torque variation, per joint':{TITLE}s} {variation}")
    if system.controller.law.robust:
        for line in _sampling(loop):
            print(line)
    if metrics.stopped is not None:
        print(told(f"{'stopped':{TITLE}s} {metrics.stopped}"))


def _sampling(loop: ClosedLoop) -> Iterator[str]:
    """Lines on the two numbers that sampling adds to the theorem: the band, and w of the premise on it."""
    record, units = loop.recording.stretch(), loop.system.units
    for title, signal, factor, unit in (
        ("w while the torque is held, largest", record["held_error"], 1.0, units.force),
        ("band of ‖s‖, largest where promised", record["s_band"], 1e3, units.rate),
    ):
        known = signal[np.isfinite(signal)]  # no band where nothing is promised
        value = f"{shown(factor * float(known.max()))} {unit}" if len(known) else shown(None)
        yield f"{title:{TITLE}s} {value}"


def _print_promise(metrics: Metrics) -> None:
    """The verdict on the theorem's promise, and each premise that failed."""
    from app.scenario.caption import percent

    promise = metrics.promise
    print(told(f"{'promise':{TITLE}s} {promise.verdict}: {promise.because}"))
    print(f"{'promised share of the run':{TITLE}s} {percent(promise.share)} %")
    for finding in metrics.premises:
        if finding.failed is None:
            continue
        if finding.premise == LAW:
            print(f"premise failed at {finding.failed:.4g} s: {finding.title}")
        else:
            unit = "" if finding.margin is None else finding.unit
            print(
                f"premise failed at {finding.failed:.4g} s: {finding.title}, least margin {shown(finding.margin)} "
                f"{unit}".rstrip()
            )
