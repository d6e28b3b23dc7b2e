"""Figures for paper: size, letters, type, symbols and greys as asked for, and nothing that the page does not draw."""

from __future__ import annotations

import itertools
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg

from app.dashboard.plots.charts import Setup
from app.dashboard.plots.paper_figures import figure_of, plots_of, with_series
from app.dashboard.plots.plot_table import TABS
from app.dashboard.theme.colors import SERIES
from app.export.figures import DOUBLE, SINGLE, Curve, Figure, FigureChart, FigureOptions, FilledArea, inches_of
from app.export.formats import ALL_PLOTS
from app.export.inks import inks_of
from app.export.lettering import runs, wrapped
from app.export.printing import STYLE, drawn, render
from app.export.sheet import BINS, SMALL, TITLE, looks_of
from app.scenario.data import edited, load
from app.scenario.errors import ScenarioError
from app.session.snapshot import Snapshot, snapshot_of
from app.simulation.closed_loop import ClosedLoop
from tests.support.svg import letters_of


def size_of(svg: bytes) -> tuple[float, float]:
    """Width and height of a figure, mm."""
    root = ElementTree.fromstring(svg)
    return (
        float(root.attrib["width"].removesuffix("pt")) / 72 * 25.4,
        float(root.attrib["height"].removesuffix("pt")) / 72 * 25.4,
    )


def test_a_figure_has_the_size_letters_and_type_that_were_asked_for(snapshot: Snapshot) -> None:
    figure = figure_of(plots_of(["Overview", "torques"]), snapshot, Setup.of(snapshot, 0, 0), 0.2, 0.9)
    plain = render(figure, "svg", FigureOptions(width=SINGLE))
    asked = render(
        figure, "svg", FigureOptions(inches_of("180mm"), inches_of("12 cm"), 9.0, letters=True, caption=False)
    )
    assert size_of(plain)[0] == pytest.approx(85, abs=0.1)
    assert size_of(asked) == pytest.approx((180, 120), abs=0.1)
    assert "(a)" not in letters_of(plain)
    for letter in "abcde":
        assert f"({letter})" in letters_of(asked)
    assert "hybrid mode" in letters_of(plain)
    assert "hybrid mode" not in letters_of(asked)
    sizes = set(re.findall(rb"(?:font: |font-size: )(?:bold )?([\d.]+)px", asked))
    assert {round(float(size), 2) for size in sizes} >= {round(9.0 * SMALL, 2), round(9.0 * TITLE, 2)}
    with pytest.raises(ValueError, match=r"^height: 50 mm; allowed: at least \d+ mm"):
        render(figure, "svg", FigureOptions(height=inches_of("50")))
    with pytest.raises(ValueError, match=r"^width: 40 mm; allowed: at least \d+ mm for these plots with type of 16 pt"):
        render(figure, "svg", FigureOptions(width=inches_of("40"), type_size=16.0))


@pytest.mark.slow
def test_nothing_of_a_figure_leaves_the_paper_or_another_text(snapshot: Snapshot) -> None:
    figure = figure_of(plots_of([ALL_PLOTS]), snapshot, Setup.of(snapshot, 0, 0), 0.2, 0.9)
    with pytest.raises(ValueError, match="width: 40 mm") as refused:
        drawn(figure, FigureOptions(inches_of("40"), type_size=14.0))
    least = inches_of(str(refused.value).split("at least ")[1].split(" mm")[0])
    for width, type_size in ((SINGLE, 6.0), (SINGLE, 10.0), (DOUBLE, 8.0), (least, 14.0)):
        canvas = drawn(figure, FigureOptions(width, type_size=type_size, letters=True))
        canvas.dpi = 600  # the letters' widths are rounded to pixels
        renderer = FigureCanvasAgg(canvas).get_renderer()
        texts = [text for text in canvas.texts if text.get_text().strip()]
        boxes = [text.get_window_extent(renderer) for text in texts]
        for text, box in zip(texts, boxes, strict=True):
            assert box.x0 >= 0
            assert box.x1 <= canvas.bbox.x1, text.get_text()
            assert box.y0 >= 0
        for one, other in itertools.combinations(boxes, 2):
            wide = min(one.x1, other.x1) - max(one.x0, other.x0)
            high = min(one.y1, other.y1) - max(one.y0, other.y0)
            assert not (wide > 0.02 * canvas.dpi and high > 0.02 * canvas.dpi)


def test_symbols_are_set_as_mathematics_and_no_markup_is_left(snapshot: Snapshot) -> None:
    figure = figure_of(plots_of([ALL_PLOTS]), snapshot, Setup.of(snapshot, 0, 0), 0.2, 0.9)
    svg = render(figure, "svg", FigureOptions(letters=True))
    letters = letters_of(svg)
    assert not re.search(r"[$\\_]", letters)
    assert b"$" not in svg
    italic = {
        tspan.text
        for tspan in ElementTree.fromstring(svg).iter("{http://www.w3.org/2000/svg}tspan")
        if "oblique" in tspan.attrib.get("style", "") or "italic" in tspan.attrib.get("style", "")
    }
    assert {"e", "r", "s", "d", "τ", "M", "m", "K", "ψ"} <= italic
    assert not {"N", "I"} & italic  # a unit, and the identity


@pytest.mark.parametrize(
    ("text", "symbols"),
    [
        ("gain d against what (17) needs", ["$d$"]),
        ("a circle of 5 m, B_m = diag(632.5, 4) N·s/m and 20 N", ["$B_{m}$"]),
        ("‖s‖ ≤ V = ½ sᵀH s", ["$s$", "$V$", r"$s^{\mathrm{T}}$", "$H$", "$s$"]),
        ("ℓ·α, ψ₁, t [s]", ["$ℓ$", "$α$", r"$ψ_{1}$", "$t$"]),
        ("(a) ė over M_hat", [r"$\dot{e}$", r"$\hat{M}$"]),
        ("$x_1^ and own_name \\frac{", []),
    ],
)
def test_letters_that_are_symbols_are_told_from_words_and_units(text: str, symbols: list[str]) -> None:
    assert [run.text for run in runs(text) if run.mathematics] == symbols


def test_every_axis_has_three_numbers_at_least() -> None:
    x = np.linspace(0.0, 1.0, 20)
    ends = [(0.0, 0.0123), (0.0, 8.4), (0.0, 29.7), *((-2.6, high) for high in np.arange(1.0, 1.2, 0.02))]
    charts = tuple(FigureChart("", "N", (Curve("a", (0, 0, 0), x, low + (high - low) * x),)) for low, high in ends)
    for axes in drawn(Figure(charts, ""), FigureOptions()).axes:
        least, most = axes.get_ylim()
        assert sum(least <= tick <= most for tick in axes.get_yticks()) >= 3, (least, most)


@pytest.mark.parametrize(
    ("low", "high"), [(572.3899, 572.3921), (-572.3921, -572.3899), (999.9999, 1000.0009), (0.0, 8.4), (1e6, 1.00001e6)]
)
def test_numbers_of_an_axis_differ_as_its_ticks_do(low: float, high: float) -> None:
    curve = Curve("a", (0, 0, 0), np.linspace(0.0, 1.0, 20), np.linspace(low, high, 20))
    with rc_context(STYLE):
        canvas = drawn(Figure((FigureChart("", "mm", (curve,)),), ""), FigureOptions())
        canvas.draw_without_rendering()
    least, most = canvas.axes[0].get_ylim()
    ticks = [tick for tick in canvas.axes[0].yaxis.get_major_ticks() if least <= tick.get_loc() <= most]
    places = np.array([tick.get_loc() for tick in ticks])
    texts = [tick.label1.get_text().replace("−", "-") for tick in ticks]
    assert len(set(texts)) == len(texts) >= 3
    plain = [text.isascii() for text in texts]  # others have a power of ten
    numbers = [float(text) for text in texts if text.isascii()]
    np.testing.assert_allclose(numbers, places[plain], rtol=0.0, atol=0.02 * np.diff(places)[0])
    assert min(tick.label1.get_window_extent().x0 for tick in ticks) > canvas.axes[0].yaxis.label.get_window_extent().x1


@pytest.mark.parametrize("rows", [BINS + 7, 10_000])
def test_a_filled_area_reaches_as_far_as_its_edges_do(rows: int) -> None:
    """A term that changes its sign at every instant, stacked above and below zero."""
    t, term = np.arange(rows) / 1000.0, 30.0 * (-1.0) ** np.arange(rows)
    edges = (np.zeros(rows), np.maximum(term, 0.0), np.minimum(term, 0.0))
    curves = tuple(Curve(str(number), SERIES[number], t, edge, width=0.0) for number, edge in enumerate(edges))
    areas = FilledArea(1, 0, SERIES[1]), FilledArea(0, 2, SERIES[2])
    axes = drawn(Figure((FigureChart("", "N", curves, areas),), ""), FigureOptions()).axes[0]
    for area, (low, high) in zip(axes.collections, ((0.0, 30.0), (-30.0, 0.0)), strict=True):
        corners = np.vstack([path.vertices for path in area.get_paths()])
        assert len(corners) < 4 * BINS + 10
        np.testing.assert_allclose(corners.min(axis=0), (0.0, low))
        np.testing.assert_allclose(corners.max(axis=0), (t[-1], high))


def test_a_filled_area_ends_where_an_edge_has_no_point() -> None:
    """A run that stopped on a torque that is no number: its term has no last point, the sum of the others has one."""
    t = np.arange(82) / 1000.0
    edges = Curve("sum", SERIES[0], t, np.zeros(82)), Curve("term", SERIES[1], t[:-1], np.ones(81))
    axes = drawn(Figure((FigureChart("", "N", edges, (FilledArea(1, 0, SERIES[1]),)),), ""), FigureOptions()).axes[0]
    corners = np.vstack([path.vertices for area in axes.collections for path in area.get_paths()])
    np.testing.assert_allclose((corners.min(axis=0), corners.max(axis=0)), ((0.0, 0.0), (t[-2], 1.0)))


@pytest.mark.parametrize(
    ("high", "numbers"), [(1e4, {"1", "100", "10000"}), (1e6, {"10⁰", "10²", "10⁴", "10⁶"}), (5e6, {"10⁰", "10²"})]
)
def test_numbers_of_a_logarithmic_axis_have_one_form(high: float, numbers: set[str]) -> None:
    curve = Curve("a", (0, 0, 0), np.linspace(0.0, 1.0, 20), np.geomspace(1.0, high, 20))
    axes = drawn(Figure((FigureChart("", "N", (curve,), logarithmic=True),), ""), FigureOptions()).axes[0]
    low, top = axes.get_ylim()
    shown = {axes.yaxis.get_major_formatter()(tick) for tick in axes.get_yticks() if low <= tick <= top}
    assert numbers <= shown
    assert len({bool(set(number) & set("⁰¹²³⁴⁵⁶⁷⁸⁹")) for number in shown}) == 1, shown


def test_lines_of_a_chart_differ_in_grey(snapshot: Snapshot) -> None:
    figure = figure_of(plots_of([ALL_PLOTS]), snapshot, Setup.of(snapshot, 0, 0), 0.2, 0.9)
    for chart in figure.charts:
        inks = inks_of(chart)
        greys = sorted(0.2126 * r**2.2 + 0.7152 * g**2.2 + 0.0722 * b**2.2 for r, g, b in inks.values())
        lightness = [116 * grey ** (1 / 3) - 16 for grey in greys]
        assert all(grey <= 0.31 for grey in greys)
        assert all(b - a > 4.5 for a, b in itertools.pairwise(lightness))
        looks = looks_of(chart)
        solid = [curve for curve in chart.curves if curve.listed and not curve.dashed]
        if len(solid) > 3 and not chart.areas:
            assert len({str(look["linestyle"]) for look in looks}) > 3


def test_a_figure_shows_only_the_lines_that_were_asked_for(snapshot: Snapshot) -> None:
    figure = figure_of(plots_of(["Overview", "Torque"]), snapshot, Setup.of(snapshot, 0, 0), 0.2, 0.9)
    chosen = with_series(figure, ["||s||", "tau_2", "gravity"])
    listed = [[curve.name for curve in chart.curves if curve.listed] for chart in chosen.charts]
    assert listed == [["‖s‖"], ["τ₂"], ["gravity"]]
    (area, *_) = chosen.charts[2].areas
    assert chosen.charts[2].curves[area.upper].name == "gravity"
    with pytest.raises(ScenarioError, match=r"series: 'grvity'; allowed: .*; did you mean gravity\?"):
        with_series(figure, ["grvity"])


def test_what_the_page_does_not_draw_the_figure_does_not_either() -> None:
    """Under computed torque s has no bound; when the law is swapped, the lines end there and begin there."""
    loop = ClosedLoop.from_scenario(edited(load("ur5-hybrid"), "controller.law", "computed-torque"), 3000)
    for _ in range(300):
        loop.advance()
    shown = figure_of(plots_of([ALL_PLOTS]), snapshot_of(loop), Setup.of(snapshot_of(loop), 0, 0), 0.0, 1.0)
    names = {curve.name for chart in shown.charts for curve in chart.curves}
    assert not {"‖s‖", "(20)", "bound (20) + band", "needed (17)", "V"} & names
    assert "Theorem 1 promises nothing here" in shown.caption


def test_a_gap_of_a_line_stays_a_gap() -> None:
    y = np.where(np.abs(np.arange(3000.0) - 1500) < 500, np.nan, 1.0)
    gap = Curve("‖s‖", SERIES[0], np.arange(3000.0), y)
    full = Curve("d", SERIES[1], np.arange(3000.0), np.ones(3000))
    paths = [
        len(drawn(Figure((FigureChart("", "", (curve,)),), ""), FigureOptions()).axes[0].lines) for curve in (gap, full)
    ]
    assert paths == [2, 1]


def test_the_page_on_exports_names_every_plot() -> None:
    text = (Path(__file__).parents[2] / "docs" / "export.md").read_text(encoding="utf-8")
    plots = dict(re.findall(r"^\| (\w+) \| ([\w ,]+) \|$", text.partition("The plots by name")[2], re.MULTILINE))
    assert {tab: names for tab, names in plots.items() if tab != "tab"} == {
        title: ", ".join(plot.name for plot in tab.plots) for title, tab in TABS.items()
    }


@pytest.mark.parametrize("width", np.arange(0.5, 2.5, 0.1))
def test_a_unit_stays_with_its_number_and_is_no_symbol(width: float) -> None:
    text = "origin (0, 0, 0.17) m. Contact: K_e = 10000 N/m. Motion: circle, radius 0.05 m, period 4 s, T = 1 ms."
    lines = wrapped(text, width, 7.0)
    assert " ".join(lines) == text
    assert not [line for line in lines if line.startswith(("m.", "N/m", "m,", "s,", "ms"))]
