"""Command `vsmrc sweep`: many runs over ranges of fields and drawn arms."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple, get_args

import msgspec
import tyro

from app.cli.options import (
    NO_DEFAULT_SHOWN,
    REPEATABLE,
    Default,
    EngineOption,
    Settings,
    configured,
    engine_of,
    folder_of,
    note_without_effect,
    one_of,
    require_until,
    require_workers,
    settings_of,
    typed,
    written_to,
)
from app.cli.output import told
from app.cli.status import BAD_INPUT, DONE, FAULT
from app.scenario.errors import ScenarioError
from app.scenario.number_text import counted

if TYPE_CHECKING:
    from app.sweep.cluster import Cluster
    from app.sweep.plan import Sweep

DESIGN, POINTS, DRAW, CORNERS, SEED = Default("grid"), Default(0), Default(0), Default(False), Default(0)
ENGINE = Default("compiled")


class _SweepOptions(NamedTuple):
    """Options that define a sweep, as they were typed, see `sweep`."""

    vary: tuple[str, ...]
    design: str | None
    points: int | None
    draw: int | None
    corners: bool | None
    seed: int | None
    duration: float | None
    until: float | None
    engine: str | None
    settings: Settings


def sweep(
    scenario: tyro.conf.Positional[str],
    /,
    *,
    vary: Annotated[tyro.conf.UseAppendAction[tuple[str, ...]], REPEATABLE] = (),
    design: Annotated[str | None, tyro.conf.arg(metavar="{grid,latin,sobol}"), DESIGN.hint] = None,
    points: Annotated[int | None, NO_DEFAULT_SHOWN] = None,
    draw: Annotated[int | None, DRAW.hint] = None,
    corners: Annotated[tyro.conf.DisallowNone[bool | None], CORNERS.hint] = None,
    seed: Annotated[int | None, SEED.hint] = None,
    out: Annotated[Path | None, NO_DEFAULT_SHOWN] = None,
    duration: Annotated[float | None, NO_DEFAULT_SHOWN] = None,
    until: Annotated[float | None, NO_DEFAULT_SHOWN] = None,
    engine: Annotated[EngineOption, ENGINE.hint] = None,
    workers: Annotated[int | None, NO_DEFAULT_SHOWN] = None,
    scheduler: Annotated[str | None, NO_DEFAULT_SHOWN] = None,
    dry_run: bool = False,
    settings: Settings = (),
) -> int:
    """Simulate a scenario with many settings and many true arms, on all cores. If you stop the sweep, the same command
    continues it. `vsmrc sweep plot FOLDER` draws the results.

    Args:
        scenario: a shipped scenario, a .toml file, or the sweep.toml of an earlier sweep
        vary: field to vary and its values: PATH=LOW:HIGH:COUNT (add :log for logarithmic steps) or PATH=VALUE,VALUE.
            With --design latin or sobol: PATH=LOW:HIGH, or PATH=LOW:HIGH:log.
        design: grid: all combinations of the values; latin: points of a Latin hypercube; sobol: points of a Sobol
            sequence
        points: number of points; required with --design latin or sobol, and only there
        draw: number of true arms, drawn at random inside the declared set; every point gets the same arms
            (where the declared set is varied, the same shares of it); 0: the scenario's own true arm
        corners: draw these arms at the corners of the declared set
        seed: seed of the random arms and points
        out: folder for the runs; required, except with --dry-run
        duration: simulated time of each run in s; by default the duration that the scenario sets
        until: end each run at this time, s, before its duration; the controller's constants are still computed for the
            whole duration
        engine: compiled or pinocchio; their results differ by rounding
        workers: number of processes; by default one for each core
        scheduler: tcp://HOST:PORT of a Dask scheduler, whose workers compute the runs (docs/scale.md)
        dry_run: do not run the sweep; only estimate its time and disk space
    """
    from app.sweep import plan
    from app.sweep.cluster import Cluster

    options = _SweepOptions(vary, design, points, draw, corners, seed, duration, until, engine, settings)
    request = _read(Path(scenario), options) if Path(scenario).name == plan.FILE else _request(scenario, options)
    require_workers(workers)
    if scheduler is not None and workers is not None:
        raise ScenarioError("--workers beside --scheduler; allowed: one of them: a cluster has workers of its own")
    count = plan.SweepPlan(request).count  # before a folder is made: a sweep may make no sense
    folder = None if dry_run and out is None else folder_of("sweep", out)
    with Cluster(scheduler) if scheduler is not None else nullcontext(workers) as on:
        return _estimate(folder, request, count, on) if dry_run or folder is None else _sweep_into(folder, request, on)


def _read(path: Path, options: _SweepOptions) -> Sweep:
    """Sweep of a sweep.toml. Raises ScenarioError, also where another option defines a sweep."""
    from app.sweep import plan
    from app.sweep.fingerprint import another_program, fingerprint

    if typed(*options):
        raise ScenarioError(f"sweep: {path} is the whole question; allowed: without --vary, --draw, --seed, ...")
    request = plan.read(path)
    if request.program != fingerprint(request):
        raise ScenarioError(f"sweep: {path} was asked of {another_program(request)}; allowed: ask it anew")
    return request


def _request(scenario: str, options: _SweepOptions) -> Sweep:
    """Sweep of a scenario. Raises ScenarioError."""
    from app.sweep import plan
    from app.sweep.axes import axis_of, fitted, require_uncounted
    from app.sweep.fingerprint import fingerprint

    for name, given in (("points", options.points), ("draw", options.draw), ("seed", options.seed)):
        if given is not None and given < 0:
            raise ScenarioError(f"--{name} {given}; allowed: 0 or more")
    if options.points is not None and DESIGN.unless(options.design) == "grid":
        raise ScenarioError(f"--points: {options.points} in a grid; allowed: with --design latin or sobol")
    require_until(options.until)
    chosen = configured(scenario, options.settings, options.duration)
    design = one_of("--design", DESIGN.unless(options.design), get_args(plan.Design))
    for each in options.vary:
        require_uncounted(each, design)
    request = plan.Sweep(
        scenario=chosen,
        vary=tuple(fitted(axis_of(each), chosen) for each in options.vary),
        design=design,
        points=POINTS.unless(options.points),
        draw=DRAW.unless(options.draw),
        corners=CORNERS.unless(options.corners),
        seed=SEED.unless(options.seed),
        until=options.until or 0.0,
        engine=engine_of(options.engine, ENGINE),
    )
    _require_effective(request, options)
    note_without_effect(options.settings, chosen, varied={axis.path for axis in request.vary})
    if options.corners is False and not request.draw:
        raise ScenarioError("--no-corners: no arm is drawn; allowed: with --draw")
    if options.seed is not None and not request.draw and request.design == "grid":
        raise ScenarioError(
            f"--seed {options.seed}: nothing is drawn; allowed: with --draw, or --design latin or sobol"
        )
    return msgspec.structs.replace(request, program=fingerprint(request))


def _require_effective(request: Sweep, options: _SweepOptions) -> None:
    """Raise ScenarioError where a value that was typed would have no effect: of a field that is drawn or varied."""
    from app.sweep.plan import DURATION, require_not_drawn

    given = dict(settings_of(options.settings))
    require_not_drawn(request, given)
    for axis in request.vary:
        if without := next((path for path in given if f"{path}.".startswith(f"{axis.path}.")), None):
            whole = "it" if without == axis.path else axis.path
            raise ScenarioError(f"--set {without}: {whole} is varied, too; allowed: one of both")
        if axis.path == DURATION and options.duration is not None:
            raise ScenarioError(f"--duration {options.duration:g}: {DURATION} is varied, too; allowed: one of both")


def _estimate(out: Path | None, request: Sweep, count: int, on: int | Cluster | None) -> int:
    """Say what the runs of a sweep that are not there yet would take."""
    import numpy as np

    from app.sweep import plan, running
    from app.sweep.run_store import RunStore

    left = np.arange(count)
    if out is not None and (out / plan.FILE).exists():
        with written_to(out, "; what is there stays"), RunStore(out, request) as store:
            left = np.flatnonzero(~store.done)
        print(f"{count - len(left)} of {count} runs are there already")
    print(running.estimated(request, left, on))
    return DONE


def _sweep_into(out: Path, request: Sweep, on: int | Cluster | None) -> int:
    """Compute the runs that are not in the folder yet."""
    import numpy as np

    from app.sweep import running
    from app.sweep.run_store import RunStore, refusals

    with written_to(out, "; what is there stays"), RunStore(out, request) as store:
        count, left = len(store.done), np.flatnonzero(~store.done)
        if len(left) < count:
            print(f"{count - len(left)} of {count} runs are there already")
        if len(left):
            print(running.estimated(request, left, on))
        try:
            failed = running.run(store, request, on, show_progress=True)
        except KeyboardInterrupt:
            store.flush()  # for `vsmrc sweep plot`
            print(f"stopped with {int(store.done.sum())} of {count} runs; the same command goes on")
            raise
        refused, ended = refusals(out), int((~store.done).sum())
    without = f", {failed} of the last {len(left)} stopped or refused" if failed else ""
    print(f"{counted(count, 'run')} in {out}{without}")
    if ended:
        print(f"{ended} of {count} runs were ended by a fault (column stopped); the same command tries them again")
        return FAULT
    if not refused:
        return DONE
    (reason, times), everything = refused.most_common(1)[0], refused.total() == count
    print(f"{refused.total()} of {count} runs were refused, {times} of them for: {told(reason)}")
    return BAD_INPUT if everything else DONE
