"""Files of the response to a push: what the command writes, prints and refuses."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pytest

from app.cli.commands import execute
from app.dashboard.widgets.target_model.impedance_map import impedance_html
from app.export.printing import render
from app.export.response_files import figure_of, followed
from app.scenario.data import from_plain, load, to_plain, to_toml
from app.session.push_measurement import Measured
from app.simulation.assembly import assemble
from app.simulation.sampled_loop.sampled_stability import sampled_loop
from tests.support.svg import letters_of


@pytest.fixture
def known(tmp_path: Path) -> Path:
    """A scenario file of an arm that is known exactly, in free space."""
    data = to_plain(load("ur5-impedance"))
    data["truth"], data["declared"], data["contact"] = {}, {}, {"kind": "free"}
    data["target_model"] = {"M_m": [8.0] * 6, "B_m": [120.0] * 6, "K_m": [700.0] * 6, "K_f": [1.0] * 6}
    path = tmp_path / "known.toml"
    path.write_text(to_toml(from_plain(data)), encoding="utf-8")
    return path


@pytest.mark.slow  # long simulations
def test_the_table_has_target_sampled_loop_and_measured_points(
    known: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert execute(["response", str(known), "--out", str(tmp_path / "out"), "--measure", "4", "--chirp", "1", "9"]) == 0
    output = capsys.readouterr().out
    assert re.search("^along x.* about the axis of γ: within 10% of the target's impedance up to", output, re.MULTILINE)
    assert "measured: within " in output
    assert "force loop" not in output
    assert "poles of the target model at 9.35 1/s, damping 0.802" in output  # sqrt(700 / 8), 120 / (2 sqrt(700 8))
    with (tmp_path / "out" / "response.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    l = assemble(load("ur5-impedance")).layout.l
    for row in rows:
        s = 2j * np.pi * float(row["frequency [Hz]"])
        wanted = 8.0 * s + 120.0 + 700.0 / s
        near = {"target": 1e-4, "sampled": 0.05, "measured": 0.05}[row["kind"]]
        if float(row["frequency [Hz]"]) < 10.0:
            assert float(row["impedance [N·s/m] along x"]) == pytest.approx(abs(wanted), rel=near)
            assert float(row["phase [deg] along x"]) == pytest.approx(np.angle(wanted, deg=True), abs=90.0 * near)
            about = float(row["impedance [N·m·s/rad] about the axis of β"])
            assert about == pytest.approx(abs(wanted) * l**2, rel=near)
            assert float(row["smallest [N·m·s/rad]"]) == pytest.approx(abs(wanted) * l**2, rel=near)
    assert {row["kind"] for row in rows} == {"target", "sampled", "measured"}
    assert sum(row["kind"] == "measured" for row in rows) == 15  # the sine's and 14 of the chirp
    assert [row["passive"] for row in rows if row["kind"] == "target"] == ["yes"] * 200
    written = letters_of((tmp_path / "out" / "response.svg").read_bytes())
    assert "impedance along x" in written
    assert "turn about the axis of α under a step of 1 N·m" in written
    assert "poles, imaginary over real part" in written


def test_curves_of_the_force_loop_that_cross_do_not_change_places() -> None:
    """Two gains of which the larger falls below the other one, given with the largest first at each frequency."""
    frequency = np.geomspace(0.1, 100.0, 400)
    curves = np.stack([3.0 / (1.0 + 1j * frequency), 1.0 / (1.0 + 0.05j * frequency), np.zeros(400)], axis=1)
    largest_first = np.take_along_axis(curves, np.argsort(-np.abs(curves), axis=1), axis=1)
    assert not np.array_equal(largest_first, curves)
    np.testing.assert_array_equal(followed(largest_first), curves)


def test_the_force_loop_has_its_margins_and_a_table_of_gain_and_phase(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """At the crossing that is told the gain is 1, and the phase is the margin away from -180 degrees."""
    assert execute(["response", "ur5-hybrid", "--out", str(tmp_path)]) == 0
    pattern = r"gain margin (\S+), phase margin (\S+)°, delay margin (\S+) ms \(\S+ periods, at (\S+) Hz\)"
    margins = re.search(f"force loop: {pattern}", capsys.readouterr().out)
    assert margins is not None
    gain, phase, late, crossing = map(float, margins.groups())
    assert phase == pytest.approx(0.36 * late * crossing, rel=0.01)
    with (tmp_path / "force_loop.csv").open(encoding="utf-8") as file:
        rows = np.array([[float(cell) for cell in row] for row in list(csv.reader(file))[1:]])
    frequency, size, angle = rows.T
    assert np.interp(crossing, frequency, size) == pytest.approx(1.0, rel=0.02)
    assert np.interp(crossing, frequency, angle) == pytest.approx(phase - 180.0, abs=1.0)
    at = np.flatnonzero((angle[1:] < -180.0) & (angle[:-1] >= -180.0))[0]
    assert size[at + 1] < 1.0 / gain < size[at]
    assert "phase of the force loop" in letters_of((tmp_path / "response.svg").read_bytes())


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("ur5-motion", "--at", "-1"), "--at -1: allowed: 0 s or more"),
        (("ur5-motion", "--newtons", "0"), "--newtons 0: allowed: more than 0 N"),
        (("ur5-motion", "--newton-metres", "-2"), "--newton-metres -2: allowed: more than 0 N·m"),
        (("ur5-motion", "--measure", "400"), "--measure 400: Hz; allowed: 0.0167 to 250 Hz with this period"),
        (("ur5-motion", "--chirp", "9", "2"), "--chirp 9 2: Hz; allowed: the lower one first"),
        (
            ("ur5-motion", "--set", "truth.push_sweep_to=9"),
            "truth.push_sweep_to: 9 Hz without a frequency to begin with",
        ),
        (("ur5-motion-discontinuous",), "response: ur5-motion-discontinuous has none: the law chatters"),
    ],
)
def test_what_has_no_response_is_refused_in_a_sentence(
    arguments: tuple[str, ...], sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert execute(["response", *arguments, "--out", str(tmp_path)]) == 2
    errors = capsys.readouterr().err
    assert errors.startswith(f"vsmrc: {sentence}")
    assert errors.count("\n") == 1


@pytest.mark.parametrize(
    ("scenario", "forces", "moments"),
    [
        ("ur5-hybrid", 1, 0),
        ("ur5-constrained", 0, 0),
        ("planar2r-semicircle", 0, 0),
        ("ur5-motion", 0, 0),
        ("panda-align", 1, 3),
    ],
)
def test_the_page_draws_a_line_for_each_axis_that_yields_and_says_where_the_model_feels_no_force(
    scenario: str, forces: int, moments: int
) -> None:
    system = assemble(load(scenario))
    loop = sampled_loop(system, system.q_0, 0.0)
    response = loop.response
    assert response is not None
    admittance = response.admittance(np.array([2.0]))[0]
    html = impedance_html(response, [Measured(2.0, admittance)], "measured <here>")
    assert "nan" not in html
    assert "measured &lt;here&gt;" in html
    for what in ("measured", "sampled loop"):  # one line stands for those that lie upon each other
        named = [axis for title in re.findall(f"<title>{what} ([^<:]*)", html) for axis in title.split(", ")]
        assert sum(axis.startswith("along") for axis in named) == forces
        assert sum(axis.startswith("about the axis of") for axis in named) == moments
    assert html.count("<svg") == (forces > 0) + (moments > 0)
    assert "the target model feels no force, and the arm " in html
    figure = figure_of(loop, response, [], "")
    assert "inf" not in render(figure, "svg").decode()
    impedances = [chart for chart in figure.charts if chart.title.startswith("impedance")]
    assert sum("all directions" not in chart.title for chart in impedances) == forces + moments
    for chart in impedances:  # no color without a name
        assert {curve.color for curve in chart.curves} == {curve.color for curve in chart.curves if curve.listed}
