"""The page's plots as charts for paper."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from app.analysis.perturbation import PerturbationAnalysis
from app.analysis.spectrum import amplitude_spectrum
from app.analysis.thinning import BucketGrid
from app.dashboard.plots.charts import ChartLine, Drawing, Plot, Setup, Signals
from app.dashboard.plots.pinned_runs import PinnedChart, RunLook, laid_on, lines_of_run
from app.dashboard.plots.plot_table import TABS
from app.dashboard.widgets.fields.field_words import differences_in_words
from app.export.figures import FREQUENCY, TIME, Curve, Figure, FigureChart, FilledArea
from app.export.formats import ALL_PLOTS
from app.scenario.caption import caption, promised, stopped_at
from app.scenario.errors import ScenarioError
from app.scenario.units import SUBSCRIPTS
from app.session.snapshot import Snapshot
from app.simulation.recording import Epoch
from app.storage.recording_files import stopped_within
from parameters import allowed

EXAMINED = 300  # instants at which the true arm is analysed
_GREEK = {"phi": "φ", "psi": "ψ", "lambda": "λ", "alpha": "α", "beta": "β", "gamma": "γ", "theta": "θ", "tau": "τ"}
FEW = 6  # names of lines in a refusal
MOST_INSTANTS = 6  # changes of a run, by their instants, in a caption
BESIDE_PLAYBACK = ("Overview",)  # plots beside a 3-D playback
WIDTH = 0.6  # points of a line on paper for each of its pixels on the page


def plots_of(names: Sequence[str]) -> list[Plot]:
    """The plots of these names, each once: of a plot, of a tab of the page, or `ALL_PLOTS`. Raises ScenarioError."""
    by_name = {ALL_PLOTS: [plot for tab in TABS.values() for plot in tab.plots]}
    by_name |= {title: list(tab.plots) for title, tab in TABS.items()}
    by_name |= {plot.name: [plot] for plot in by_name[ALL_PLOTS]}
    if unknown := [name for name in names if name not in by_name]:
        raise ScenarioError(f"plots: {unknown[0]!r:.60}; {allowed(unknown[0], by_name)}")
    return list(dict.fromkeys(plot for name in names for plot in by_name[name]))


def figure_name(plots: Sequence[str], series: Sequence[str]) -> str:
    """Name of a figure of these plots and lines, "" for all: two figures of a run have two names."""
    return " ".join((*(() if tuple(plots) == (ALL_PLOTS,) else plots), *series))


def with_series(figure: Figure, names: Sequence[str], called: str = "series") -> Figure:
    """The figure with only the lines of these names in the legends, and only the charts that have one of them; the
    whole figure where there are no names. called: name of the choice in a refusal. Raises ScenarioError."""
    if not names:
        return figure
    there = dict.fromkeys(curve.name for chart in figure.charts for curve in chart.curves if curve.listed)
    known = {_plain(name): name for name in there}
    if unknown := [name for name in names if _plain(name) not in known]:
        raise ScenarioError(f"{called}: {unknown[0]!r:.60}; {allowed(unknown[0], there, most=FEW)}")
    chosen = {known[_plain(name)] for name in names}
    charts = (_chart_with(chart, chosen) for chart in figure.charts)
    return replace(figure, charts=tuple(chart for chart in charts if any(curve.listed for curve in chart.curves)))


def _plain(name: str) -> str:
    """Name as it can be typed: ‖s‖ is also ||s||, and ψ₁ psi_1."""
    stem, _, index = name.strip().partition("_")
    return (_GREEK.get(stem, stem) + index.translate(SUBSCRIPTS)).replace("||", "‖").casefold()


def _chart_with(chart: FigureChart, chosen: set[str]) -> FigureChart:
    """The chart with only the chosen lines, those of pinned runs beside them, and their areas; lines that bound such an
    area stay, but are not drawn."""
    curves = tuple(
        curve
        if chosen.intersection((curve.name, *curve.repeats))
        else replace(curve, listed=False, width=0.0, dotted=False)
        for curve in chart.curves
    )
    areas = tuple(
        area
        for area in chart.areas
        if any(chart.curves[k].name in chosen and chart.curves[k].color == area.color for k in (area.upper, area.lower))
    )
    if areas:
        return replace(chart, curves=curves, areas=areas)
    return replace(chart, curves=tuple(curve for curve in curves if curve.width > 0), areas=())


def figure_of(
    plots: Iterable[Plot],
    snapshot: Snapshot,
    setup: Setup,
    t_from: float,
    t_to: float,
    pinned: Sequence[PinnedChart] = (),
) -> Figure:
    """Figure of these plots over t_from <= t <= t_to (s), with the scenario in its caption. pinned: runs that are drawn
    behind. Raises ValueError when it is empty."""
    rows = snapshot.recording.stretch(t_from, t_to)
    t = rows["t"]
    laid = ((run, laid_on(run, float(t[0]), float(t[-1]), snapshot)) for run in pinned if len(t))
    there = [(run, signals) for run, signals in laid if signals is not None and len(signals["t"]) > 1]
    charts = tuple(chart for _, chart in _charts(plots, snapshot, setup, rows, [(r.look, s) for r, s in there]))
    angles = [i for i, each in enumerate(snapshot.coordinates) if each.metres_per_radian is not None]
    system, span = snapshot.system, (float(t[0]), float(t[-1]))
    text = caption(snapshot.scenario, system.controller, snapshot.matrices, system.units, *span, angles)
    changed = _changes(tuple(snapshot.recording.epochs), float(t[0]), float(t[-1]))
    drawn = {curve.name for chart in charts for curve in chart.curves if curve.dashes and curve.listed}
    behind = "".join(_pinned_sentence(run, snapshot) for run, _ in there if run.look.name in drawn)
    ended = f"{stopped_at(snapshot.stop)}. " if snapshot.stop and stopped_within(snapshot.recording, t_to) else ""
    return Figure(charts, f"{text} {changed}{ended}{behind}{promised(rows)}")


def _pinned_sentence(run: PinnedChart, snapshot: Snapshot) -> str:
    """Sentence, with a space behind it, on what is different in a pinned run."""
    return (
        f"{run.look.name}: {differences_in_words(snapshot.scenario, run.scenario, run.units) or 'the same scenario'}. "
    )


def _changes(epochs: Iterable[Epoch], t_from: float, t_to: float) -> str:
    """Sentence, with a space behind it, on the changes in t_from < t <= t_to (s); "" where there were none."""
    # a paused run is changed several times at one instant
    instants = list(dict.fromkeys(f"{epoch.t:.4g}" for epoch in tuple(epochs) if t_from < epoch.t <= t_to))
    if not instants:
        return ""
    at = (
        ", ".join(instants)
        if len(instants) <= MOST_INSTANTS
        else f"{instants[0]}, … ({len(instants)} times) … {instants[-1]}"
    )
    return f"Changed at t = {at} s: these numbers are those at the end; each line had those of its time. "


def plots_with_lines(snapshot: Snapshot, setup: Setup, t_from: float, t_to: float) -> list[str]:
    """Names of the plots that have a line to draw over t_from <= t <= t_to (s). Raises ValueError when nothing is
    recorded there."""
    rows = snapshot.recording.stretch(t_from, t_to)
    return [plot.name for plot, _ in _charts(plots_of([ALL_PLOTS]), snapshot, setup, rows)]


def _charts(
    plots: Iterable[Plot],
    snapshot: Snapshot,
    setup: Setup,
    rows: Signals,
    pinned: Sequence[tuple[RunLook, Signals]] = (),
) -> Iterator[tuple[Plot, FigureChart]]:
    """Plots that have a line to draw, among these, with their charts."""
    t = rows["t"]
    if len(t) < 2:
        raise ValueError("figure: nothing recorded there yet")
    openings = BucketGrid.over(float(t[0]), float(t[-1]), EXAMINED).openings(t)
    known = PerturbationAnalysis(snapshot.system).recorded(rows, tuple(snapshot.recording.epochs), openings)
    for plot in plots:
        if (drawing := plot.draw(setup)) is None:
            continue
        chart = _chart(plot, drawing, known, pinned)
        if any(np.isfinite(curve.y).any() for curve in chart.curves if curve.listed):
            yield plot, chart


def _chart(plot: Plot, drawing: Drawing, signals: Signals, pinned: Sequence[tuple[RunLook, Signals]]) -> FigureChart:
    title, unit = title_and_unit(drawing.title)
    # shades and marks of the page are its background; a line that only bounds a filled area has no width
    lines = [line for line in drawing.lines if not line.backdrop]
    own = [_curve(line, signals, drawing.floor, spectral=plot.spectral) for line in lines]
    behind = [
        curve
        for look, theirs in (() if plot.spectral else pinned)
        for curve in _behind([_curve(line, theirs, drawing.floor) for line in lines_of_run(drawing.lines, look)])
    ]
    shift = len(behind) - (len(drawing.lines) - len(lines))  # backdrops come first
    areas = tuple(FilledArea(area.upper + shift, area.lower + shift, area.color) for area in drawing.areas)
    floor, logarithmic = drawing.floor, drawing.floor is not None
    if logarithmic and any((curve.y == floor).any() for curve in own):  # there the value is smaller
        title = f"{title}, from {f'{floor:g} {unit}'.rstrip()} on"
    t = signals["t"]
    return FigureChart(
        title,
        unit,
        (*behind, *own),
        areas,
        FREQUENCY if plot.spectral else TIME,
        logarithmic,
        drawing.at_least,
        logarithmic_x=plot.spectral,
        # of all charts alike, also of one whose lines begin later
        x_range=None if plot.spectral else (float(t[0]), float(t[-1])),
    )


def _curve(line: ChartLine, signals: Signals, floor: float | None, *, spectral: bool = False) -> Curve:
    x, y = _course(line.values(signals), signals["t"], spectral=spectral)
    return Curve(
        line.name,
        line.color,
        x,
        y if floor is None else np.maximum(y, floor),
        line.dashed,
        WIDTH * line.width,
        line.listed and bool(np.isfinite(y).any()),
        dashes=tuple(length / line.width for length in line.dashes),
        repeats=line.repeats,
    )


def _behind(curves: Sequence[Curve]) -> list[Curve]:
    """Curves of a pinned run that has something to show in a chart, whose first one stands for it in the legend."""
    if not any(np.isfinite(curve.y).any() for curve in curves):
        return []
    return [replace(curve, listed=number == 0) for number, curve in enumerate(curves)]


def _course(values: np.ndarray, t: np.ndarray, *, spectral: bool) -> tuple[np.ndarray, np.ndarray]:
    """x and y of the known points of a line; y is nan where the line's quantity does not exist."""
    values = np.asarray(values, dtype=float)
    if spectral:
        spectrum = amplitude_spectrum(t, values[:, None])
        return spectrum.frequency, spectrum.amplitude[:, 0]
    known = ~np.isnan(values)
    absent = np.isinf(values[known])
    return t[known], np.where(absent, np.nan, values[known])


def title_and_unit(text: str) -> tuple[str, str]:
    """Title and unit of a text such as "force  [N]"; a title without brackets has no unit."""
    found = re.fullmatch(r"(.*?)\s*\[([^\]]*)\]\s*", text)
    title, unit = (found[1], found[2]) if found else (text, "")
    return " ".join(title.split()), unit
