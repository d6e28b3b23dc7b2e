"""Lines of pinned runs in the plots, on the page and in figures."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
import viser

from app.analysis.thinning import BucketGrid
from app.dashboard.plots.chart_frames import Frame
from app.dashboard.plots.chart_widget import MOST_SERIES, ChartWidget
from app.dashboard.plots.charts import ChartLine, Setup
from app.dashboard.plots.line_values import column
from app.dashboard.plots.paper_figures import figure_of, plots_of, with_series
from app.dashboard.plots.pinned_runs import PinnedChart, compared_lines, laid_on, lines_of_run
from app.dashboard.plots.plot_table import TABS
from app.scenario.data import edited, shipped
from app.session.snapshot import snapshot_of
from app.session.timeline import Pinned
from app.simulation.closed_loop import ClosedLoop
from app.storage.session_index import PINS
from environments.robots import MOST_JOINTS
from tests.support.plotted import ran, setup_of


@pytest.fixture(scope="module")
def hybrid() -> ClosedLoop:
    return ran(shipped()["ur5-hybrid"], 1.0)


def test_a_pinned_run_is_laid_on_the_shown_ones_time_and_has_gaps_where_it_has_no_values(hybrid: ClosedLoop):
    rows = hybrid.recording.stretch()
    late = {"t": rows["t"][:400] + 0.3, "sigma_min": 7.0 + rows["t"][:400]}
    line = ChartLine("", (0, 0, 0), column("sigma_min"), compared=True)
    frame = Frame(1.0, 1.0, BucketGrid.over(0.0, 1.0, 100), rows, (late,))
    x, pinned, shown = frame.courses([line])
    inside = (x > -0.69) & (x < -0.31)
    np.testing.assert_allclose(pinned[inside], 7.0 + 0.7 + x[inside], atol=0.01)
    outside = (x < -0.71) | (x > -0.29)
    assert np.isnan(pinned[outside]).all()
    assert np.isfinite(shown).all()


def test_pinned_run_in_other_coordinates_shows_only_shared_signals(hybrid: ClosedLoop) -> None:
    def laid(name: str) -> Mapping[str, np.ndarray]:
        signals = laid_on(PinnedChart.of(pinned_of(ran(shipped()[name], 0.05))), 0.0, 0.05, snapshot_of(hybrid))
        assert signals is not None
        return signals

    alike, elsewhere, joints = (laid(name) for name in ("ur5-hybrid", "ur5-impedance", "ur5-joint"))
    for name in ("F_c", "e_r", "s_norm", "multiplier"):
        assert np.isfinite(alike[name]).all()
    for name, known in (("F_c", False), ("e_r", False), ("s_norm", True), ("multiplier", True), ("tau", True)):
        assert np.isfinite(elsewhere[name]).all() == known, name
    for name, known in (("e_r", False), ("s_norm", False), ("d", False), ("tau", True), ("t", True)):
        assert np.isfinite(joints[name]).all() == known, name


def pinned_of(loop: ClosedLoop, place: int = 0, name: str = "") -> Pinned:
    return Pinned(place + 1, loop.system, loop.recording, loop.t, name, place)


def test_of_a_pinned_runs_line_both_coordinate_and_run_can_be_read(hybrid: ClosedLoop) -> None:
    """The coordinate by its colour, the run by its dashes, which no other run and no line of the shown run has."""
    runs = [PinnedChart.of(pinned_of(hybrid, place)).look for place in range(PINS)]
    for plot in (plot for tab in TABS.values() for plot in tab.plots):
        drawing = plot.draw(setup_of(hybrid))
        compared = compared_lines(drawing.lines) if drawing else []
        if drawing is None or not compared:
            continue
        patterns = [{line.series().get("dash") for line in drawing.lines}]
        for run in runs:
            lines = lines_of_run(drawing.lines, run)
            assert [line.name for line in lines if line.listed] == [run.name]
            if len(compared) == 1:
                assert lines[0].color == run.color
            else:
                # by its name the page hides it together with the shown run's
                assert [(line.name, line.color) for line in lines[1:]] == [
                    (own.name, own.color) for own in compared[1:]
                ]
                looks = [(line.color, line.dashes) for line in lines[1:]]
                assert len(set(looks)) == len(looks)
            patterns.append({line.dashes for line in lines})
        assert not any(one & other for one, other in combinations(patterns, 2)), plot.name


@pytest.mark.parametrize("name", ["ur5-hybrid", "ur5-joint"])
def test_no_chart_has_more_series_than_a_page_knows(name: str, viser_server: viser.ViserServer) -> None:
    """Also of an arm with the most joints, with three surfaces and as many pinned runs as there may be."""
    loop = ran(shipped()[name], 0.05)
    few = setup_of(loop)
    of_joints = {each: (getattr(few, each) * MOST_JOINTS)[:MOST_JOINTS] for each in ("coordinates", "joints", "slides")}
    setup = replace(few, **of_joints, normal=3, surfaces=3, touching=True, twisted=True)
    runs = [PinnedChart.of(pinned_of(loop, place)).look for place in range(PINS)]
    most = 0
    for plot in (plot for tab in TABS.values() for plot in tab.plots):
        chart = ChartWidget(viser_server.gui, plot)
        chart.clear(setup, runs)
        most = max(most, len(chart._handle.series))
    assert most == MOST_SERIES


def test_a_figure_draws_pinned_runs_as_the_page_does(hybrid: ClosedLoop) -> None:
    """With their names, and of a longer run what lies within the figure's time."""
    soft = ran(edited(shipped()["ur5-hybrid"], "target_model.K_m", [0.0, *[500.0] * 5]), 0.6)
    elsewhere = ran(shipped()["planar2r-semicircle"], 0.1)
    runs = (pinned_of(soft, 0, "soft"), pinned_of(hybrid, 1), pinned_of(elsewhere, 2))
    pinned, snapshot, setup = tuple(map(PinnedChart.of, runs)), snapshot_of(hybrid), setup_of(hybrid)
    plots = plots_of(["tracking error", "bound of s", "torques"])
    figure = figure_of(plots, snapshot, setup, 0.2, 0.8, pinned)
    errors, sliding, torques = figure.charts
    assert [curve.name for curve in errors.curves if curve.listed][:3] == ["soft", "run 2", setup_name(setup)]
    _, *of_soft = [curve for curve in errors.curves if "soft" in (curve.name, *curve.repeats)]
    rows = soft.recording.stretch(0.2, 0.8)
    for i, curve in enumerate(of_soft):
        np.testing.assert_array_equal(curve.x, rows["t"])
        np.testing.assert_array_equal(curve.y, 1e3 * rows["e_r"][:, i])
        own = next(c for c in errors.curves if c.listed and c.name == curve.repeats[0])
        assert (curve.color, curve.dashes != own.dashes) == (own.color, True)
    norms = {curve.name: curve for curve in sliding.curves}
    assert sliding.logarithmic
    assert list(norms) == ["soft", "run 2", "bound (20) + band", "‖s‖"]
    np.testing.assert_array_equal(norms["soft"].y, np.maximum(1e3 * rows["s_norm"], 1e-2))
    np.testing.assert_array_equal(norms["run 2"].y, norms["‖s‖"].y)
    assert not any(curve.dashes for curve in torques.curves)  # which the page does not compare, either
    assert re.search(r" soft: [^.:]*: 0, 500, 500, 500, 500, 500 N/m\. ", figure.caption)
    assert "run 2: the same scenario. " in figure.caption
    assert "run 3" not in figure.caption
    chosen = with_series(figure, [setup_name(setup)])
    assert [curve.repeats[:1] for curve in chosen.charts[0].curves if curve.dashes and not curve.listed] == [
        (setup_name(setup),)
    ] * 2
    alone = figure_of(plots, snapshot, setup, 0.2, 0.8)
    for chart, other in zip(figure.charts, alone.charts, strict=True):
        assert [c.name for c in chart.curves if not c.dashes] == [c.name for c in other.curves]


def setup_name(setup: Setup) -> str:
    """Name of the first coordinate's line."""
    drawing = plots_of(["tracking error"])[0].draw(setup)
    assert drawing is not None
    return drawing.lines[0].name
