"""Export by `vsmrc export`: the files of the page's Export tab, without a page."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

from app.dashboard.plots.charts import Setup
from app.dashboard.plots.paper_figures import (
    BESIDE_PLAYBACK,
    figure_name,
    figure_of,
    plots_of,
    plots_with_lines,
    with_series,
)
from app.dashboard.scene.standalone import standalone_html
from app.export.export_jobs import PLAYBACK_LIMIT, file_name
from app.export.figures import Figure, FigureOptions
from app.export.formats import ALL_PLOTS, Kind
from app.export.playback_frames import playback_frames
from app.export.printing import render
from app.process.atomic_write import write_whole
from app.scenario.errors import ScenarioError, scenario_errors
from app.scenario.schema import Scenario
from app.session.snapshot import as_recorded, snapshot_of
from app.simulation.assembly import assemble
from app.simulation.closed_loop import ClosedLoop
from app.simulation.recording import Recording
from app.storage.constants_store import kept_memory
from app.storage.recording_files import TooLarge, scenario_text, table, write_csv, write_npz
from parameters import allowed

ROUNDING = 1e-9  # s
OF_ONE_INSTANT: tuple[Kind, ...] = ("csv", "npz", "toml")  # figures and playback go from one instant to another


@dataclass(frozen=True)
class ExportedStretch:
    """Stretch of a run: the recorded rows with start <= t <= end (s).
    stopped: why the run stopped at its end, "" where it did not."""

    scenario: Scenario
    recording: Recording
    start: float
    end: float
    stopped: str = ""


@dataclass(frozen=True)
class FigureChoice:
    """Content and look of a figure.
    plots: names of plots, or of tabs of the page.
    series: names of lines in the legends, () for all."""

    plots: Sequence[str] = (ALL_PLOTS,)
    series: Sequence[str] = ()
    options: FigureOptions = field(default_factory=FigureOptions)

    @property
    def name(self) -> str:
        return figure_name(self.plots, self.series)


def write(stretch: ExportedStretch, kinds: Iterable[Kind], choice: FigureChoice, out: Path) -> Iterator[Path]:
    """Write files of these kinds to the folder `out`, which is created; yields the path of each. Raises ScenarioError
    and OSError."""
    kinds, typed = tuple(kinds), stretch
    # an instant that was typed need not be that of a row to the last bit
    stretch = replace(typed, start=typed.start - ROUNDING, end=typed.end + ROUNDING)
    rows = stretch.recording.signals(("t",), stretch.start, stretch.end)["t"]
    _require_rows(rows, typed, kinds)
    if not set(OF_ONE_INSTANT).issuperset(kinds):
        n = assemble(stretch.scenario).robot.n
        if stretch.recording.n != n:
            raise ScenarioError(f"recording: {stretch.recording.n} joints; allowed: {n}, as its scenario's arm has")
    out.mkdir(parents=True, exist_ok=True)
    for kind in kinds:
        content = choice.name if kind in ("svg", "pdf", "png", "html") else ""
        start = 0.0 if kind == "toml" else typed.start  # a scenario has no stretch
        path = out / file_name(stretch.scenario.name, float(rows[-1]), kind, content, start)
        try:
            _write(stretch, kind, choice, path)
        except TooLarge as error:
            raise ScenarioError(f"--to {kind}: {error}") from error
        yield path


def _require_rows(rows: np.ndarray, stretch: ExportedStretch, kinds: tuple[Kind, ...]) -> None:
    """Raise ScenarioError where files of these kinds need more rows than these, whose times are (N,) s."""
    drawn = [kind for kind in kinds if kind not in OF_ONE_INSTANT]
    if len(rows) > 1 or (len(rows) == 1 and not drawn):
        return
    where = f"from {stretch.start:g} s to {'the end' if stretch.end == math.inf else f'{stretch.end:g} s'}"
    if len(rows) == 1:
        raise ScenarioError(
            f"--to {drawn[0]}: one instant recorded {where}, t = {rows[0]:g} s; "
            f"allowed: two or more, or --to {', '.join(OF_ONE_INSTANT)}"
        )
    t = stretch.recording.signals(("t",))["t"]
    there = f"within {t[0]:g} to {t[-1]:g} s" if len(t) else "a recording with an instant"
    raise ScenarioError(f"--start, --end: nothing recorded {where}; allowed: {there}")


def _write(stretch: ExportedStretch, kind: Kind, choice: FigureChoice, path: Path) -> None:
    scenario, recording = stretch.scenario, stretch.recording
    with tqdm(total=1.0, bar_format="{desc} {percentage:3.0f} %", desc=path.name, leave=False, disable=None) as bar:

        def on_progress(fraction: float) -> None:
            bar.update(fraction - bar.n)

        match kind:
            case "svg" | "pdf" | "png":
                with scenario_errors():
                    content = render(_figure(stretch, choice), kind, choice.options)
                write_whole(path, lambda file: file.write(content))
            case "csv" | "npz":
                write_data = {"csv": write_csv, "npz": write_npz}[kind]
                rows = table(scenario, recording, stretch.start, stretch.end, stretch.stopped)
                write_whole(path, lambda file: write_data(rows, file, on_progress=on_progress))
            case "html":
                plots = BESIDE_PLAYBACK if choice.plots == (ALL_PLOTS,) else choice.plots
                figure = _figure(stretch, replace(choice, plots=plots))
                frames = playback_frames(scenario, recording, stretch.start, stretch.end)
                page = standalone_html(frames, PLAYBACK_LIMIT, on_progress, figure)
                write_whole(path, lambda file: file.write(page.encode()))
            case "toml":
                text = scenario_text(table(scenario, recording))
                write_whole(path, lambda file: file.write(text.encode()))


def _figure(stretch: ExportedStretch, choice: FigureChoice) -> Figure:
    """Figure of the stretch. Raises ScenarioError, and ValueError for an empty stretch."""
    snapshot = snapshot_of(ClosedLoop.from_scenario(stretch.scenario, history=1, memory=kept_memory()))
    if not stretch.recording.epochs:  # files of earlier versions do not hold the changes during the run
        stretch.recording.epochs.extend(snapshot.recording.epochs)
    snapshot = as_recorded(
        replace(snapshot, recording=stretch.recording, stop=stretch.stopped), stretch.start, stretch.end
    )
    setup = Setup.of(snapshot, 0, 0)
    figure = figure_of(plots_of(choice.plots), snapshot, setup, stretch.start, stretch.end)
    if not figure.charts:
        there = plots_with_lines(snapshot, setup, stretch.start, stretch.end)
        given = " ".join(choice.plots)
        raise ScenarioError(f"--plots {given!r:.60}: no line to draw in this run; {allowed(given, there)}")
    return with_series(figure, choice.series)
