"""Figures as files: what was recorded, in words and colours that can be read, and the same again from the same run."""

from __future__ import annotations

import re
import struct

import numpy as np
import pytest

from app.dashboard.plots.charts import Setup
from app.dashboard.plots.paper_figures import figure_of, plots_of, title_and_unit
from app.dashboard.plots.plot_table import TABS
from app.dashboard.theme.colors import SERIES
from app.export.export_jobs import ExportJobs, FigureJob
from app.export.figures import Curve, Figure, FigureChart
from app.export.formats import ALL_PLOTS
from app.export.inks import CONTRAST, printed
from app.export.printing import render
from app.export.sheet import BINS, thinned
from app.scenario.caption import caption
from app.scenario.data import edited, load
from app.scenario.schema import Scenario
from app.scenario.units import CARTESIAN, JOINT
from app.session.snapshot import Snapshot
from app.simulation.assembly import assemble
from tests.support.svg import letters_of

pytestmark = pytest.mark.slow  # processes of its own

made = ExportJobs().made


def test_svg_is_the_same_again_and_its_words_are_text(snapshot: Snapshot) -> None:
    setup = Setup.of(snapshot, 0, 0)
    figure = figure_of(plots_of([ALL_PLOTS]), snapshot, setup, 0.2, 0.9)
    words = letters_of(render(figure, "svg"))
    for drawing in (plot.draw(setup) for tab in TABS.values() for plot in tab.plots):
        title, unit = title_and_unit(drawing.title if drawing else "")
        assert unit in words
        for word in re.findall(r"[a-z]{3,}", title):
            assert word in words
    assert "frequency [Hz]" in words
    assert "moving surface (ur5-hybrid-moving, edited): hybrid mode" in words
    few = figure_of(plots_of(["Overview"]), snapshot, setup, 0.2, 0.9)
    svg = render(few, "svg")
    assert made(FigureJob(few, "svg"), lambda _: None) == svg
    assert "dc:date" not in svg.decode()


def test_pdf_and_png_are_what_they_say(snapshot: Snapshot) -> None:
    figure = figure_of(plots_of(["Overview"]), snapshot, Setup.of(snapshot, 0, 0), 0.0, 1.0)
    pdf = render(figure, "pdf")
    assert pdf.startswith(b"%PDF-")
    assert b"CreationDate" not in pdf
    width, height = struct.unpack(">II", render(figure, "png")[16:24])
    assert width == int(300 * 85 / 25.4)
    assert height > width


def test_figure_draws_what_was_recorded(snapshot: Snapshot) -> None:
    setup = Setup.of(snapshot, 0, 0)
    figure = figure_of(plots_of(["Overview"]), snapshot, setup, 0.25, 0.75)
    rows = snapshot.recording.signals(("t", "e_r"), 0.25, 0.75)
    for i, curve in enumerate(figure.charts[0].curves):
        np.testing.assert_array_equal(curve.x, rows["t"])
        np.testing.assert_allclose(curve.y, 1e3 * rows["e_r"][:, i])
    with pytest.raises(ValueError, match="nothing recorded there"):
        figure_of(plots_of(["Overview"]), snapshot, setup, 5.0, 6.0)


def test_a_figure_stacks_terms_over_one_another(snapshot: Snapshot) -> None:
    setup = Setup.of(snapshot, 0, 2)
    chart = figure_of(plots_of(["Torque"]), snapshot, setup, 0.2, 0.9).charts[1]
    assert len(chart.areas) == 12
    top, bottom, total = chart.curves[6].y, chart.curves[12].y, chart.curves[-1].y
    np.testing.assert_allclose(top + bottom, total, atol=1e-9)
    listed = [curve.name for curve in chart.curves if curve.listed]
    assert listed == ["inertia", "Coriolis", "gravity", "Jᵀ F", "K_s s", "switching", "τ"]


def test_a_hostile_name_stays_text() -> None:
    curve = Curve("<b>&$x_1^", SERIES[0], np.arange(3.0), np.ones(3))
    svg = render(Figure((FigureChart("<script>", "mm", (curve,)),), "caption <script> $\\frac{"), "svg").decode()
    assert "<script>" not in svg
    assert "caption <script> $\\frac{" in letters_of(svg.encode())
    assert "<b>&$x_1^" in letters_of(svg.encode()).replace(" ", "")


def test_thinning_keeps_a_spike_and_the_ends() -> None:
    x = np.arange(100_000.0)
    y = np.sin(x / 5000.0)
    y[54_321] = 7.0
    few_x, few_y = thinned(x, y, BINS)
    assert len(few_x) <= 2 * BINS + 2
    assert few_y.max() == 7.0
    assert (few_x[0], few_x[-1]) == (0.0, 99_999.0)
    assert np.all(np.diff(few_x) > 0)
    np.testing.assert_array_equal(y[few_x.astype(int)], few_y)


def test_thinning_of_a_logarithmic_axis_keeps_what_is_wide_on_it() -> None:
    x = np.arange(1, 30_001) / 60.0  # a spectrum of one minute, Hz
    y = np.full(len(x), 1e-3)
    for peak in (0.2, 0.6, 0.8, 400.0):
        y[round(60 * peak) - 1] = 1.0
    few_x, few_y = thinned(x, y, BINS, logarithmic=True)
    assert len(few_x) <= 2 * BINS + 2
    assert few_x[few_y == 1.0] == pytest.approx([0.2, 0.6, 0.8, 400.0])
    assert (few_x[0], few_x[-1]) == (x[0], x[-1])


def test_printed_colours_can_be_seen_on_white_and_told_apart() -> None:
    colors = [np.array(printed(color)) for color in SERIES]
    for color in colors:
        linear = np.where(color <= 0.04045, color / 12.92, ((color + 0.055) / 1.055) ** 2.4)
        assert 1.05 / (linear @ (0.2126, 0.7152, 0.0722) + 0.05) >= CONTRAST
    # Machado, Oliveira and Fernandes (2009): what a person without the middle cones sees
    deuteranopia = np.array([[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]])
    seen = [deuteranopia @ color for color in colors]
    assert min(np.linalg.norm(a - b) for i, a in enumerate(seen) for b in seen[:i]) > 0.07


def test_caption_says_the_scenario_in_numbers() -> None:
    scenario = edited(edited(load("ur5-hybrid"), "truth.payload_mass", 1.5), "declared.payload_mass", 2.0)
    model = {"M_m": 10 * np.eye(2), "B_m": np.diag([632.5, 4]), "K_m": np.array([[2, 1], [1, 2.0]]), "K_f": np.eye(2)}
    text = caption(scenario, assemble(scenario).controller, model, CARTESIAN, 1.0, 9.0)
    for words in (
        "ur5-hybrid", "hybrid mode", "t = 1 to 9 s", "M_m = 10 I kg", "diag(632.5, 4) N·s/m", "[2 1; 1 2] N/m",
        "True arm: link scaling 1.15, payload mass 1.5 kg", "Declared: link scaling 0.15, payload mass 2 kg",
        "T = 1 ms", "K_e = 10000 N/m", "Force: constant, value 20 N", "F_1 = 10 1/s",
    ):  # fmt: skip
        assert words in text
    assert text.startswith("UR5 presses with 20 N, draws a circle (ur5-hybrid, edited): ")
    plain = caption(load("ur5-hybrid"), assemble(scenario).controller, model, CARTESIAN, 1.0, 9.0)
    assert plain.startswith("UR5 presses with 20 N, draws a circle (ur5-hybrid): ")
    moving = edited(scenario, "mode", "motion")
    assert caption(moving, assemble(scenario).controller, model, CARTESIAN, 1.0, 9.0).startswith(
        "Universal Robots UR5: motion, plane (ur5-hybrid, edited): "
    )
    joint = edited(moving, "task_space.kind", "joint")
    six = {name: 4.0 * np.eye(6) for name in model}
    assert "B_m = 4 I N·m·s/rad, K_m = 4 I N·m/rad, K_f" in caption(
        joint, assemble(scenario).controller, six, JOINT, 0.0, 1.0
    )
    free = caption(moving, assemble(scenario).controller, six, CARTESIAN, 0.0, 1.0)
    assert "K_m = 4 I N/m, K_f = 4 I." in free  # r has no angle
    assert "Force: " not in free  # none is asked for
    twisted = caption(moving, assemble(scenario).controller, six, CARTESIAN, 0.0, 1.0, angles=[3, 4, 5])
    assert "angles in r times ℓ = 0.15 m (their K_m ℓ² = 0.09 I N·m/rad)." in twisted
    assert "True arm: as believed" in caption(Scenario(), assemble(Scenario()).controller, model, CARTESIAN, 0.0, 1.0)
