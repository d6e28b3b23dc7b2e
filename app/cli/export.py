"""Command `vsmrc export`: writes figures, data and playback of a run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, get_args

import tyro

from app.cli.options import (
    NO_DEFAULT_SHOWN,
    Default,
    EngineOption,
    Files,
    Settings,
    braces,
    configured,
    engine_of,
    note_unused,
    note_without_effect,
    one_of,
    require_folder,
    typed,
    use_own,
    written_to,
)
from app.cli.output import told
from app.cli.status import DONE, STOPPED
from app.export.figures import FigureOptions, inches_of
from app.export.formats import ALL_PLOTS, Format, Kind
from app.scenario.errors import ScenarioError, scenario_errors

if TYPE_CHECKING:
    from app.storage.recording_files import RecordedRun

KINDS_OF_FILES: tuple[Kind, ...] = get_args(Kind)
ON_PAPER: tuple[Kind, ...] = get_args(Format)
PLOTS: Default[tuple[str, ...]] = Default((ALL_PLOTS,))
TYPE_SIZE = Default(FigureOptions.type_size)
LETTERS, CAPTION = Default(FigureOptions.letters), Default(FigureOptions.caption)
START, END = Default(0.0), Default(math.inf)  # s


def export(
    run: tyro.conf.Positional[str],
    /,
    *,
    out: Path,
    to: Annotated[tuple[str, ...], tyro.conf.arg(metavar=f"{braces(KINDS_OF_FILES)} [...]")] = ("pdf",),
    plots: Annotated[tuple[str, ...], PLOTS.hint] = (),
    series: Annotated[tuple[str, ...], NO_DEFAULT_SHOWN] = (),
    width: Annotated[str | None, NO_DEFAULT_SHOWN] = None,
    height: Annotated[str | None, NO_DEFAULT_SHOWN] = None,
    type_size: Annotated[float | None, TYPE_SIZE.hint] = None,
    letters: Annotated[tyro.conf.DisallowNone[bool | None], LETTERS.hint] = None,
    caption: Annotated[tyro.conf.DisallowNone[bool | None], CAPTION.hint] = None,
    start: Annotated[float | None, START.hint] = None,
    end: Annotated[float | None, END.hint] = None,
    engine: EngineOption = None,
    use: Files = (),
    settings: Settings = (),
) -> int:
    """Make figures, data files and a 3-D playback, like the page's tab Export. The input is a recording, or a scenario,
    which is then simulated first.

    Args:
        run: a recording.npz from `vsmrc run` or from the page, a shipped scenario, or a .toml file
        out: folder for the files
        to: one or more kinds of files, such as csv svg: svg, pdf, png for figures; csv, npz for data; html for the 3-D
            playback; toml for the scenario
        plots: plots to draw: names of plots, titles of the page's plot tabs (docs/export.md), or all
        series: draw only these lines; use their names in the legends; type psi_1 for ψ₁; by default all of a plot
        width: width of a figure: single (column, 85 mm), double (180 mm), or a length such as
            120mm or 5in (40 to 600 mm); by default single for up to four plots
        height: height of a figure, such as 60mm (20 to 2000 mm); by default as much as its plots need
        type_size: size of the text in a figure, 4 to 24 pt
        letters: put (a), (b), … before the titles of the plots
        caption: print the numbers of the scenario below the figure
        start: start of the exported time range, s
        end: end of the exported time range, s
        engine: pinocchio, or compiled, which is faster; their results differ by rounding (docs/command-line.md)
        use: file with your own control law, surface or trajectory (docs/extending.md)
    """
    from app.dashboard.export import ExportedStretch, FigureChoice, write
    from app.dashboard.plots.paper_figures import plots_of

    kinds: list[Kind] = [one_of("--to", kind, KINDS_OF_FILES) for kind in to]
    _require_kinds(kinds, (*ON_PAPER, "html"), {"--plots": plots, "--series": series})
    _require_kinds(kinds, ON_PAPER, _look(width, height, type_size, letters, caption))
    _require_kinds(kinds, tuple(kind for kind in KINDS_OF_FILES if kind != "toml"), {"--start": start, "--end": end})
    begins, ends = _time_range(start, end)
    chosen = PLOTS.unless(tuple(ALL_PLOTS if each == "all" else each for each in plots))
    plots_of(chosen)  # before the simulation, which would be in vain
    figure = FigureChoice(chosen, series, _figure_options(width, height, type_size, letters, caption))
    require_folder(out)
    use_own(use)
    played = _recorded(run, engine, settings)
    if stopped := played.stopped:
        print(told(f"stopped: {stopped}"))
    with written_to(out):
        stretch = ExportedStretch(played.scenario, played.recording, begins, ends, stopped)
        for path in write(stretch, kinds, figure, out):
            print(f"written: {path}")
    return STOPPED if stopped and not run.endswith(".npz") else DONE


def _look(
    width: str | None, height: str | None, type_size: float | None, letters: bool | None, caption: bool | None
) -> dict[str, object]:
    """Options on the look of a figure on paper, by the flags that were typed."""
    return {
        "--width": width,
        "--height": height,
        "--type-size": type_size,
        "--letters" if letters else "--no-letters": letters,
        "--caption" if caption else "--no-caption": caption,
    }


def _figure_options(
    width: str | None, height: str | None, type_size: float | None, letters: bool | None, caption: bool | None
) -> FigureOptions:
    """Look of the figures. Raises ScenarioError."""
    with scenario_errors():
        if height in ("single", "double"):
            raise ValueError(f"--height {height!r}: the width of a column or a page; allowed: a length such as 60mm")
        wide, high = _inches("--width", width), _inches("--height", height)
        return FigureOptions(wide, high, TYPE_SIZE.unless(type_size), LETTERS.unless(letters), CAPTION.unless(caption))


def _time_range(start: float | None, end: float | None) -> tuple[float, float]:
    """First and last instant of the exported time range, s. Raises ScenarioError."""
    for option, instant in (("--start", start), ("--end", end)):
        if instant is not None and not (math.isfinite(instant) or (option, instant) == ("--end", math.inf)):
            raise ScenarioError(f"{option}: {instant:g}; allowed: an instant of the run in s")
    begins, ends = START.unless(start), END.unless(end)
    if begins > ends:
        raise ScenarioError(f"--start, --end: from {begins:g} to {ends:g} s; allowed: the start before the end")
    return begins, ends


def _recorded(run: str, engine: str | None, settings: Settings) -> RecordedRun:
    """Run of a file, or of a scenario that is simulated now."""
    from app.session import headless_run
    from app.storage.constants_store import kept_memory
    from app.storage.recording_files import RecordedRun, read_npz

    if not run.endswith(".npz"):
        scenario, by = configured(run, settings), engine_of(engine)
        note_unused(scenario)
        note_without_effect(settings, scenario)
        loop, _ = headless_run.simulate(scenario, engine=by, show_progress=True, memory=kept_memory())
        return RecordedRun(scenario, loop.recording, loop.stopped or "")
    if settings:
        raise ScenarioError("--set: a recording cannot be changed any more; allowed: with a scenario")
    if typed(engine):
        raise ScenarioError(f"--engine {engine}: a recording is not computed again; allowed: with a scenario")
    saved = read_npz(Path(run))
    note_unused(saved.scenario)
    return saved


def _require_kinds(kinds: list[Kind], takers: tuple[Kind, ...], options: Mapping[str, object]) -> None:
    """Raises ScenarioError for an option, by its flag, that was typed while none of the files to be made takes it."""
    given = [flag for flag, value in options.items() if typed(value)]
    if given and not set(takers).intersection(kinds):
        raise ScenarioError(f"{given[0]}: with --to {' '.join(kinds)}; allowed: with --to {', '.join(takers)}")


def _inches(flag: str, text: str | None) -> float | None:
    """Length of a flag in inches, None without one. Raises ValueError."""
    try:
        return None if text is None else inches_of(text)
    except ValueError as error:
        raise ValueError(f"{flag} {error}") from error
