"""The page's plots as charts for paper."""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np

from app.caption import caption
from app.dashboard.plots import TABS, Plot
from app.figures import Chart, Curve, Figure
from app.runner import Snapshot
from app.scenario import ScenarioError

ALL_PLOTS = "all plots"
WIDTH = 0.6  # points of a line on paper for each of its pixels on the page


def plots_of(tab: str) -> list[Plot]:
    """The plots of a tab of the page, or `ALL_PLOTS`. Raises ScenarioError."""
    if tab not in (ALL_PLOTS, *TABS):
        raise ScenarioError(f"plots: {tab!r}; allowed: {', '.join((ALL_PLOTS, *TABS))}")
    return [plot for title, plots in TABS.items() if tab in (ALL_PLOTS, title) for plot in plots]


def figure_of(plots: Iterable[Plot], snapshot: Snapshot, t_from: float, t_to: float) -> Figure:
    """These plots over t_from <= t <= t_to (s) with the scenario under them. Raises ValueError when that is empty."""
    plots = tuple(plots)
    names = tuple({"t", *(name for plot in plots for name in plot.signals)})
    signals = snapshot.recording.signals(names, t_from, t_to)
    t = signals["t"]
    if len(t) < 2:
        raise ValueError("figure: nothing recorded there yet")
    charts = tuple(_chart(plot, snapshot, signals) for plot in plots)
    return Figure(charts, caption(snapshot.scenario, snapshot.matrices, float(t[0]), float(t[-1])))


def _chart(plot: Plot, snapshot: Snapshot, signals: dict[str, np.ndarray]) -> Chart:
    title, unit = title_and_unit(plot.title)
    curves = tuple(
        Curve(line.name, line.color, signals["t"], line.values(signals), line.dashed, WIDTH * line.width)
        for line in plot.lines(snapshot)
    )
    return Chart(title, unit, curves, logarithmic=plot.logarithmic, at_least=plot.at_least)


def title_and_unit(text: str) -> tuple[str, str]:
    """ "force  [N]" is a title and its unit; a title without brackets has none."""
    found = re.fullmatch(r"(.*?)\s*\[([^\]]*)\]\s*", text)
    title, unit = (found[1], found[2]) if found else (text, "")
    return " ".join(title.split()), unit
