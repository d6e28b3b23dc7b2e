"""The page's plots as charts for paper."""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np

from app.analysis.perturbation import PerturbationAnalysis
from app.analysis.spectrum import amplitude_spectrum
from app.analysis.thinning import Grid
from app.dashboard.plots.charts import Drawing, Plot, Setup, Signals
from app.dashboard.plots.plot_table import TABS
from app.export.figures import FREQUENCY, TIME, Area, Chart, Curve, Figure
from app.export.formats import ALL_PLOTS
from app.scenario.caption import caption, promised
from app.scenario.schema import ScenarioError
from app.session.snapshot import Snapshot

EXAMINED = 300  # instants at which the true arm is looked at
WIDTH = 0.6  # points of a line on paper for each of its pixels on the page


def plots_of(tab: str) -> list[Plot]:
    """The plots of a tab of the page, or `ALL_PLOTS`. Raises ScenarioError."""
    if tab not in (ALL_PLOTS, *TABS):
        raise ScenarioError(f"plots: {tab!r}; allowed: {', '.join((ALL_PLOTS, *TABS))}")
    return [plot for title, row in TABS.items() if tab in (ALL_PLOTS, title) for plot in row.plots]


def figure_of(plots: Iterable[Plot], snapshot: Snapshot, setup: Setup, t_from: float, t_to: float) -> Figure:
    """Figure of these plots over t_from <= t <= t_to (s) with the scenario under them. Raises ValueError when it is
    empty."""
    recording = snapshot.recording
    rows = recording.stretch(t_from, t_to)
    t = rows["t"]
    if len(t) < 2:
        raise ValueError("figure: nothing recorded there yet")
    openings = Grid.over(float(t[0]), float(t[-1]), EXAMINED).openings(t)
    known = PerturbationAnalysis(snapshot.system).recorded(rows, tuple(recording.epochs), openings)
    charts = (_chart(plot, drawing, known) for plot in plots if (drawing := plot.draw(setup)) is not None)
    told = caption(snapshot.scenario, snapshot.system.controller, snapshot.matrices, float(t[0]), float(t[-1]))
    return Figure(tuple(charts), f"{told} {promised(rows)}")


def _chart(plot: Plot, drawing: Drawing, signals: Signals) -> Chart:
    title, unit = title_and_unit(drawing.title)
    # shades and marks of the page are its background; a line that only bounds a filled area has no width
    lines = [line for line in drawing.lines if not line.backdrop]
    floor = -np.inf if drawing.floor is None else drawing.floor
    courses = [_course(line.values(signals), signals["t"], spectral=plot.spectral) for line in lines]
    curves = tuple(
        Curve(
            line.name,
            line.color,
            x,
            np.maximum(y, floor),
            line.dashed,
            WIDTH * line.width,
            line.listed and bool(len(x)),
        )
        for line, (x, y) in zip(lines, courses, strict=True)
    )
    shift = len(drawing.lines) - len(lines)  # backdrops come first
    areas = tuple(Area(area.upper - shift, area.lower - shift, area.color) for area in drawing.areas)
    logarithmic = drawing.floor is not None
    x_label = FREQUENCY if plot.spectral else TIME
    return Chart(title, unit, curves, areas, x_label, logarithmic, drawing.at_least, logarithmic_x=plot.spectral)


def _course(values: np.ndarray, t: np.ndarray, *, spectral: bool) -> tuple[np.ndarray, np.ndarray]:
    """x and y of the known points of a line."""
    values = np.asarray(values, dtype=float)
    if spectral:
        spectrum = amplitude_spectrum(t, values[:, None])
        return spectrum.frequency, spectrum.amplitude[:, 0]
    known = np.isfinite(values)
    return t[known], values[known]


def title_and_unit(text: str) -> tuple[str, str]:
    """Title and unit of a text such as "force  [N]"; a title without brackets has no unit."""
    found = re.fullmatch(r"(.*?)\s*\[([^\]]*)\]\s*", text)
    title, unit = (found[1], found[2]) if found else (text, "")
    return " ".join(title.split()), unit
