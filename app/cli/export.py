"""Command `vsmrc export`: writes figures, data and playback of a run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, get_args

import tyro

from app.cli.options import (
    ENGINES,
    Files,
    Settings,
    braces,
    configured,
    one_of,
    otherwise,
    typed,
    use_own,
    usually,
    written_to,
)
from app.cli.status import DONE, STOPPED
from app.export.formats import ALL_PLOTS, Format, Kind
from app.scenario.errors import ScenarioError, scenario_errors
from app.simulation.engines import Engine

KINDS_OF_FILES: tuple[Kind, ...] = get_args(Kind)
ON_PAPER: tuple[Kind, ...] = get_args(Format)


def export(
    run: tyro.conf.Positional[str],
    /,
    *,
    out: Path,
    to: Annotated[tuple[str, ...], tyro.conf.arg(metavar=braces(KINDS_OF_FILES))] = ("pdf",),
    plots: Annotated[tuple[str, ...], tyro.conf.arg(help_behavior_hint=usually(repr(ALL_PLOTS)))] = (),
    series: tuple[str, ...] = (),
    width: str | None = None,
    height: str | None = None,
    type_size: Annotated[float | None, tyro.conf.arg(help_behavior_hint=usually(7.0))] = None,
    letters: Annotated[tyro.conf.DisallowNone[bool | None], tyro.conf.arg(help_behavior_hint=usually(False))] = None,
    caption: Annotated[tyro.conf.DisallowNone[bool | None], tyro.conf.arg(help_behavior_hint=usually(True))] = None,
    start: Annotated[float | None, tyro.conf.arg(help_behavior_hint=usually(0.0))] = None,
    end: Annotated[float | None, tyro.conf.arg(help_behavior_hint=usually(math.inf))] = None,
    engine: Annotated[
        str | None, tyro.conf.arg(metavar=braces(ENGINES), help_behavior_hint=usually("pinocchio"))
    ] = None,
    use: Files = (),
    settings: Settings = (),
) -> int:
    """Make what the page's Export tab makes, from a recording or a scenario, which is simulated first.

    Args:
        run: a recording.npz of `vsmrc run` or of the page, a shipped scenario or a .toml file
        out: folder for the files
        to: svg, pdf, png: figures; csv, npz: data; html: 3-D playback; toml: scenario
        plots: what a figure shows: plots by their names, tabs of the page by their titles (docs/export.md), or all
        series: only these lines, by their names in the legends; psi_1 is ψ₁
        width: of a figure: single (85 mm) or double (180 mm) column, or a length such as 120mm or 5in
        height: of a figure, such as 60mm, instead of what its plots need
        type_size: of a figure's text, pt
        letters: (a), (b), … before the titles of the plots
        caption: the scenario's numbers below the figure
        start: first instant, s
        end: last instant, s
        engine: pinocchio; or compiled, faster, and its digits differ by rounding (docs/command-line.md)
        use: a file with a law, surface or trajectory of your own (docs/extending.md)
    """
    from app.dashboard.export import ExportedStretch, FigureChoice, write
    from app.dashboard.plots.paper_figures import plots_of
    from app.export.figures import TYPE, FigureOptions
    from app.session import headless_run
    from app.storage.constants_store import kept_memory
    from app.storage.recording_files import read_npz

    by: Engine = one_of("--engine", otherwise(engine, "pinocchio"), ENGINES)
    kinds: list[Kind] = [one_of("--to", kind, KINDS_OF_FILES) for kind in to]
    shown = {"--plots": plots, "--series": series}
    printed = {
        "--width": width,
        "--height": height,
        "--type-size": type_size,
        "--letters" if letters else "--no-letters": letters,
        "--caption" if caption else "--no-caption": caption,
    }
    _require_kinds(kinds, (*ON_PAPER, "html"), shown)
    _require_kinds(kinds, ON_PAPER, printed)
    _require_kinds(kinds, tuple(kind for kind in KINDS_OF_FILES if kind != "toml"), {"--start": start, "--end": end})
    chosen = plots or (ALL_PLOTS,)
    plots_of(chosen)  # before the simulation, which would be in vain
    with scenario_errors():
        wide, high = _inches("--width", width), _inches("--height", height)
        options = FigureOptions(
            wide, high, otherwise(type_size, TYPE), otherwise(letters, False), otherwise(caption, True)
        )
    use_own(use)
    status = DONE
    if run.endswith(".npz"):
        if settings:
            raise ScenarioError("--set: a recording cannot be changed any more; allowed: with a scenario")
        if typed(engine):
            raise ScenarioError(f"--engine {engine}: a recording is not computed again; allowed: with a scenario")
        scenario, recording = read_npz(Path(run))
    else:
        scenario = configured(run, settings)
        loop, _ = headless_run.simulate(scenario, engine=by, show_progress=True, memory=kept_memory())
        recording = loop.recording
        if loop.stopped:
            print(f"stopped: {loop.stopped}")
            status = STOPPED
    with written_to(out):
        stretch = ExportedStretch(scenario, recording, otherwise(start, 0.0), otherwise(end, math.inf))
        for path in write(stretch, kinds, FigureChoice(chosen, series, options), out):
            print(f"written: {path}")
    return status


def _require_kinds(kinds: list[Kind], takers: tuple[Kind, ...], options: Mapping[str, object]) -> None:
    """Raises ScenarioError for an option, by its flag, that was typed while none of the files to be made takes it."""
    given = [flag for flag, value in options.items() if typed(value)]
    if given and not set(takers).intersection(kinds):
        raise ScenarioError(f"{given[0]}: with --to {' '.join(kinds)}; allowed: with --to {', '.join(takers)}")


def _inches(flag: str, text: str | None) -> float | None:
    """Length of a flag in inches, None without one. Raises ValueError."""
    from app.export.figures import inches_of

    try:
        return None if text is None else inches_of(text)
    except ValueError as error:
        raise ValueError(f"{flag} {error}") from error
