"""Command `vsmrc sweep`: many runs over ranges of fields and drawn arms."""

from __future__ import annotations

import math
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, get_args

import msgspec
import tyro

from app.cli.options import (
    ENGINES,
    Settings,
    braces,
    configured,
    folder_of,
    one_of,
    otherwise,
    require_until,
    require_workers,
    settings_of,
    typed,
    usually,
    written_to,
)
from app.cli.status import DONE
from app.process.terminal_text import say
from app.scenario.errors import ScenarioError

if TYPE_CHECKING:
    from app.sweep.cluster import Cluster
    from app.sweep.question import Sweep


def sweep(
    scenario: tyro.conf.Positional[str],
    folder: tyro.conf.Positional[Path | None] = None,
    /,
    *,
    vary: tyro.conf.UseAppendAction[tuple[str, ...]] = (),
    design: Annotated[
        str | None, tyro.conf.arg(metavar="{grid,latin,sobol}", help_behavior_hint=usually("grid"))
    ] = None,
    points: Annotated[int | None, tyro.conf.arg(help_behavior_hint=usually(0))] = None,
    draw: Annotated[int | None, tyro.conf.arg(help_behavior_hint=usually(0))] = None,
    corners: Annotated[tyro.conf.DisallowNone[bool | None], tyro.conf.arg(help_behavior_hint=usually(False))] = None,
    seed: Annotated[int | None, tyro.conf.arg(help_behavior_hint=usually(0))] = None,
    out: Path | None = None,
    duration: float | None = None,
    until: float | None = None,
    engine: Annotated[
        str | None, tyro.conf.arg(metavar=braces(ENGINES), help_behavior_hint=usually("compiled"))
    ] = None,
    workers: int | None = None,
    scheduler: str | None = None,
    dry_run: Annotated[tyro.conf.DisallowNone[bool | None], tyro.conf.arg(help_behavior_hint=usually(False))] = None,
    of: Annotated[str | None, tyro.conf.arg(help_behavior_hint=usually("motion_error"))] = None,
    within: float | None = None,
    show: Annotated[str | None, tyro.conf.arg(metavar="{share,median,worst}")] = None,
    over: tuple[str, ...] = (),
    kind: Annotated[str | None, tyro.conf.arg(name="as", metavar="{map,slices,scatter,parallel}")] = None,
    to: Annotated[str | None, tyro.conf.arg(metavar="{svg,pdf,png}")] = None,
    settings: Settings = (),
) -> int:
    """Simulate a scenario with many settings and true arms, on all cores; the same command goes on where it was
    stopped. `vsmrc sweep plot FOLDER` draws what was found.

    Args:
        scenario: a shipped scenario, a .toml file, or a sweep.toml; or the word plot
        folder: of a sweep, for plot
        vary: PATH=LOW:HIGH:COUNT, with :log behind for even steps of the logarithm, or PATH=VALUE,VALUE; PATH=LOW:HIGH
            for a design other than the grid
        design: the grid of all values, or so many points by a Latin hypercube or Sobol's sequence
        points: of such a design
        draw: true arms drawn inside the declared set, the same at every point
        corners: draw them at its corners
        seed: of arms and points
        out: folder for the runs; for plot, the file
        duration: simulated time of each run in s, instead of the scenario's
        until: when each run ends, s, before its duration, for which its constants are computed all the same
        engine: compiled, or pinocchio, whose digits differ by rounding
        workers: processes, instead of one for each core
        scheduler: tcp://HOST:PORT of a Dask scheduler, whose workers compute the runs (docs/scale.md)
        dry_run: only say what it would take
        of: for plot, the metric (docs/sweeps.md)
        within: for plot, a limit in SI units: the share of arms that keep it is shown
        show: for plot, what is shown of the arms of a point
        over: for plot, the fields that are the axes
        kind: for plot, the chart
        to: for plot, the form of the file, by default that of its name, or svg
    """
    of_question = (vary, draw, settings, points, duration, until, design, corners, seed, engine)
    if scenario == "plot":
        if typed(*of_question, workers, scheduler, dry_run):
            raise ScenarioError(
                "sweep plot: an option of a sweep; allowed: --of, --within, --show, --over, --as, --to and --out"
            )
        return _plot_sweep(folder, out, otherwise(of, "motion_error"), within, show, over, kind, to)
    if folder is not None:
        raise ScenarioError(f"sweep: {folder} behind a scenario; allowed: `vsmrc sweep plot FOLDER`")
    if typed(of, within, show, over, kind, to):
        raise ScenarioError(
            "sweep: --of, --within, --show, --over, --as or --to; allowed: for `vsmrc sweep plot FOLDER`"
        )
    from app.sweep import question, running
    from app.sweep.axes import axis_of, fitted
    from app.sweep.cluster import Cluster
    from app.sweep.fingerprint import another_program, fingerprint

    if Path(scenario).name == question.FILE:
        if typed(*of_question):
            raise ScenarioError(
                f"sweep: {scenario} is the whole question; allowed: without --vary, --draw, --seed, ..."
            )
        asked = question.read(Path(scenario))
        if asked.program != fingerprint(asked):
            raise ScenarioError(f"sweep: {scenario} was asked of {another_program(asked)}; allowed: ask it anew")
    else:
        chosen = configured(scenario, settings, duration)
        asked = question.Sweep(
            scenario=chosen,
            vary=tuple(fitted(axis_of(each), chosen) for each in vary),
            design=one_of("--design", otherwise(design, "grid"), get_args(question.Design)),
            points=otherwise(points, 0),
            draw=otherwise(draw, 0),
            corners=otherwise(corners, False),
            seed=otherwise(seed, 0),
            until=otherwise(until, 0.0),
            engine=one_of("--engine", otherwise(engine, "compiled"), ENGINES),
        )
        _require_effective(asked, settings, duration)
        asked = msgspec.structs.replace(asked, program=fingerprint(asked))
    for name, given in (("points", points), ("draw", draw), ("seed", seed)):
        if given is not None and given < 0:
            raise ScenarioError(f"--{name} {given}; allowed: 0 or more")
    require_until(until)
    require_workers(workers)
    if scheduler is not None and workers is not None:
        raise ScenarioError("--workers beside --scheduler; allowed: one of them: a cluster has workers of its own")
    count = question.SweepQuestion(asked).count
    folder = None if dry_run and out is None else folder_of("sweep", out)
    with Cluster(scheduler) if scheduler is not None else nullcontext(workers) as on:
        if dry_run or folder is None:
            print(running.estimated(asked, count, on))
            return DONE
        return _sweep_into(folder, asked, on)


def _require_effective(asked: Sweep, settings: Settings, duration: float | None) -> None:
    """Raise ScenarioError where a value that was typed would have no effect: of a field that is drawn or varied."""
    from app.sweep.question import DURATION, require_not_drawn

    given = dict(settings_of(settings))
    require_not_drawn(asked, given)
    for axis in asked.vary:
        if axis.path in given:
            raise ScenarioError(f"--set {axis.path}: it is varied, too; allowed: one of both")
        if axis.path == DURATION and duration is not None:
            raise ScenarioError(f"--duration {duration:g}: {DURATION} is varied, too; allowed: one of both")


def _sweep_into(out: Path, asked: Sweep, on: int | Cluster | None) -> int:
    from app.sweep import running
    from app.sweep.run_store import RunStore

    with written_to(out, "; what is there stays"), RunStore(out, asked) as store:
        count, left = len(store.done), int((~store.done).sum())
        if left < count:
            print(f"{count - left} of {count} runs are there already")
        if left:
            print(running.estimated(asked, left, on))
        try:
            failed = running.run(store, asked, on, show_progress=True)
        except KeyboardInterrupt:
            store.settle()  # for `vsmrc sweep plot`
            print(f"stopped with {int(store.done.sum())} of {count} runs; the same command goes on")
            raise
    print(f"{count} runs in {out}" + (f", {failed} of the last {left} stopped or refused" if failed else ""))
    return DONE


def _plot_sweep(
    folder: Path | None,
    out: Path | None,
    of: str,
    within: float | None,
    show: str | None,
    over: tuple[str, ...],
    kind: str | None,
    to: str | None,
) -> int:
    from app.export.formats import Format
    from app.process.atomic_write import write_whole
    from app.sweep import charts, points
    from app.sweep.fingerprint import another_program, fingerprint
    from app.sweep.run_store import table_of

    if folder is None:
        raise ScenarioError("sweep plot: no folder; allowed: the folder of a sweep")
    if within is not None and not math.isfinite(within):
        raise ScenarioError(f"--within {within}; allowed: a finite number")
    named = "" if out is None else out.suffix.lower().removeprefix(".")
    form: Format = one_of("--to", to or (named if named in get_args(Format) else "svg"), get_args(Format))
    if named and named != form:
        raise ScenarioError(f"--out {out}: a file of {form}; allowed: a name that ends in .{form}")
    view = points.SweepView(
        metric=of,
        within=within,
        statistic=None if show is None else one_of("--show", show, get_args(points.Statistic)),
        over=over,
        kind=None if kind is None else one_of("--as", kind, get_args(points.Kind)),
    )
    asked, columns = table_of(folder)
    if asked.program != fingerprint(asked):
        say(f"this sweep was computed by {another_program(asked)}: a figure may have had another meaning")
    path, drawn = out or folder / f"{of}.{form}", charts.chart(asked, columns, view, form)
    with written_to(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, lambda file: file.write(drawn))
    print(f"written: {path}")
    return DONE
