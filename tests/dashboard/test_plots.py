"""What the plots compute: thinning, spectrum, stacks, phases, what only the simulation knows, and pinned runs."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np
import pinocchio as pin
import pytest

from app.analysis.metrics import ACCOUNT_METRICS
from app.analysis.perturbation import DerivedSignals, PerturbationAnalysis
from app.analysis.spectrum import amplitude_spectrum, variation_rate
from app.analysis.steady_force import steady_force_error
from app.analysis.thinning import BucketGrid
from app.dashboard.plots.chart_frames import Frame
from app.dashboard.plots.chart_widget import MOST_SERIES
from app.dashboard.plots.charts import BUCKETS, ChartLine, Setup
from app.dashboard.plots.law_drawings import needed_stack, torque_stack
from app.dashboard.plots.line_values import column
from app.dashboard.plots.paper_figures import figure_of, plots_of, with_series
from app.dashboard.plots.pinned_runs import PinnedChart, compared_lines, laid_on, lines_of_run
from app.dashboard.plots.plot_table import TABS
from app.scenario.data import edited, load, shipped
from app.scenario.schema import Scenario
from app.session.arm_band import Band
from app.session.snapshot import snapshot_of
from app.session.timeline import Pinned
from app.simulation.closed_loop import ClosedLoop
from app.storage.session_index import PINS
from controllers.reaching import lyapunov_bound


def ran(scenario: Scenario, seconds: float) -> ClosedLoop:
    loop = ClosedLoop.from_scenario(scenario)
    while loop.t < seconds - 1e-9:
        assert loop.stopped is None, loop.stopped
        loop.step()
    return loop


def known(loop: ClosedLoop, t_from: float = 0.0) -> DerivedSignals:
    rows = loop.recording.stretch(t_from)
    grid = BucketGrid.over(t_from, loop.t, BUCKETS)
    return PerturbationAnalysis(loop.system).recorded(rows, tuple(loop.recording.epochs), grid.openings(rows["t"]))


@pytest.fixture(scope="module")
def hybrid() -> ClosedLoop:
    return ran(shipped()["ur5-hybrid"], 1.0)


def test_thinning_keeps_a_spike_of_one_sample_and_the_direction_of_a_ramp():
    t = np.arange(8000) * 1e-3
    spike = np.where(t == t[4711], 1.0, 0.0)
    thinned = BucketGrid.over(0.0, 8.0, BUCKETS).thin(t, np.stack([spike, t, -t], axis=1))
    assert np.nanmax(thinned[:, 0]) == 1.0
    assert len(thinned) <= 2 * BUCKETS + 2
    inside = np.isfinite(thinned[:, 1])
    assert np.all(np.diff(thinned[inside, 1]) > 0)
    assert np.all(np.diff(thinned[inside, 2]) < 0)


def test_what_is_drawn_stands_still_while_time_goes_on():
    t = np.arange(9000) * 1e-3
    wave = np.sin(40 * t)[:, None]
    now, later = (BucketGrid.over(end - 4.0, end, BUCKETS) for end in (8.0, 8.5))
    seen = dict(zip(now.times, now.thin(t[t < 8.0], wave[t < 8.0])[:, 0], strict=True))
    again = dict(zip(later.times, later.thin(t, wave)[:, 0], strict=True))
    shared = sorted(set(seen) & set(again))[:-2]  # the last bucket was not full
    assert len(shared) > 1.6 * BUCKETS
    assert [seen[x] for x in shared] == [again[x] for x in shared]


def test_buckets_without_rows_are_nan():
    thinned = BucketGrid.over(0.0, 1.0, 10).thin(np.array([0.31, 0.62]), np.array([[1.0], [2.0]]))
    assert np.isfinite(thinned[:, 0]).nonzero()[0].tolist() == [6, 7, 12, 13]


@pytest.mark.parametrize("frequency", [3.0, 17.3, 123.4, 480.0])
def test_spectrum_of_a_sine_has_its_amplitude_at_its_frequency(frequency: float):
    t = 5.0 + np.arange(4000) * 1e-3
    values = np.stack([7.0 + 2.5 * np.sin(2 * np.pi * frequency * t), 0.1 * t], axis=1)
    spectrum = amplitude_spectrum(t, values)
    peak = int(spectrum.amplitude[:, 0].argmax())
    assert spectrum.amplitude[peak, 0] == pytest.approx(2.5, rel=2e-3)
    assert spectrum.frequency[peak] == pytest.approx(frequency, abs=0.6 / 4.0)
    few = spectrum.thinned(60)
    assert len(few.frequency) <= 60
    assert few.amplitude[:, 0].max() == spectrum.amplitude[peak, 0]


def test_chattering_from_sample_to_sample_has_its_amplitude_at_half_the_sampling_rate():
    t = np.arange(4000) * 1e-3
    spectrum = amplitude_spectrum(t, 3.0 * (-1.0) ** np.arange(4000)[:, None])
    assert spectrum.frequency[-1] == pytest.approx(500.0)
    assert spectrum.amplitude.max() == spectrum.amplitude[-1, 0] == pytest.approx(3.0, rel=1e-3)


def test_spectrum_takes_only_what_is_evenly_sampled():
    t = np.concatenate([np.arange(50) * 0.02, 1.0 + np.arange(2000) * 1e-3])
    spectrum = amplitude_spectrum(t, np.sin(2 * np.pi * 50.0 * t)[:, None])
    assert spectrum.frequency[-1] == pytest.approx(500.0)
    assert spectrum.amplitude.max() == pytest.approx(1.0, rel=2e-3)
    assert len(amplitude_spectrum(t[:3], np.zeros((3, 1))).frequency) == 0


def test_total_variation_per_second_of_a_triangle():
    t = np.arange(2000) * 1e-3
    triangle = 0.5 - np.abs((5.0 * t) % 1.0 - 0.5)  # up and down 0.5 five times a second
    rate = variation_rate(t, triangle, 0.2)
    assert np.isnan(rate[:200]).all()
    np.testing.assert_allclose(rate[201:], 5.0, rtol=1e-2)


def test_stacks_add_up_to_what_they_are_of(hybrid: ClosedLoop):
    rows = hybrid.recording.stretch()
    for joint in range(6):
        lines, areas = torque_stack(joint)
        above, below = (max if up else min for up in (True, False))
        values = np.array([line.values(rows) for line in lines])
        top, bottom = values[len(lines) // 2], values[-1]
        np.testing.assert_allclose(top + bottom, rows["tau"][:, joint], atol=1e-9)
        assert np.all(above(top.min(), 0.0) >= 0.0)
        assert np.all(below(bottom.max(), 0.0) <= 0.0)
        assert all(np.all(values[area.upper] >= values[area.lower]) for area in areas)
    lines, areas = needed_stack()
    np.testing.assert_allclose(lines[-1].values(rows), rows["d_required"], rtol=1e-12)
    assert areas[-1].upper == len(lines) - 1


def test_nothing_bounds_s_under_a_law_without_a_sliding_surface():
    """Before and after a change of the law in one run; on the page and in an exported figure."""
    loop = ran(shipped()["ur5-hybrid"], 0.1)
    loop.edit(edited(loop.system.scenario, "controller.law", "pd-gravity"))
    while loop.t < 0.2:
        loop.step()
    seen = known(loop)
    baseline = seen["t"] > 0.1 - 1e-9
    for name in ("s_bound", "s_band", "V_bound", "V_limit"):
        assert np.isnan(seen[name][baseline]).all()
        assert np.isfinite(seen[name][~baseline]).all()
    assert not seen["reaching"][baseline].any()
    snapshot = snapshot_of(loop)
    figure = figure_of(plots_of(["Sliding"]), snapshot, Setup.of(snapshot, 0, 0), 0.0, 0.2)
    bounds = [curve for chart in figure.charts for curve in chart.curves if "(2" in curve.name]
    assert bounds
    assert all(curve.x[np.isfinite(curve.y)].max() < 0.1 for curve in bounds)
    drawn = [plot.draw(Setup.of(snapshot, 0, 0)) for plot in TABS["Sliding"].plots]
    frame = Frame(loop.t, 0.2, BucketGrid.over(0.0, loop.t, BUCKETS), seen)
    for drawing in drawn:
        assert drawing is not None
        x, *lines = frame.courses([line for line in drawing.lines if not line.backdrop])
        for line in lines:  # neither there, nor carried on level
            assert np.isfinite(line[x < -0.11]).all(), drawing.title
            assert np.isnan(line[x > -0.09]).all(), drawing.title
    begun_so = snapshot_of(ran(edited(shipped()["ur5-hybrid"], "controller.law", "pd-gravity"), 0.1))
    assert all(plot.draw(Setup.of(begun_so, 0, 0)) is None for plot in TABS["Sliding"].plots)
    overview = [plot.draw(Setup.of(begun_so, 0, 0)) for plot in TABS["Overview"].plots]
    assert not [
        line.name
        for drawing in overview
        if drawing
        for line in drawing.lines
        if "(" in line.name and "8" not in line.name
    ]
    assert "it has no bound" in TABS["Sliding"].note(snapshot)  # pyright: ignore[reportOptionalCall]


@pytest.mark.parametrize("name", ["ur5-hybrid", "ur5-constrained"])
def test_the_perturbation_is_what_moves_s_besides_the_law(name: str):
    """(22) in joint space, by the acceleration that the true arm had: an independent way to the same vector."""
    at_the_state = edited(shipped()[name], "simulation.integrator", "semi-implicit-euler")  # is the acceleration
    loop = ran(edited(edited(at_the_state, "truth.viscous", 0.4), "truth.payload_mass", 0.3), 0.4)
    rows, analysis = loop.recording.stretch(), PerturbationAnalysis(loop.system)
    scenario, h = loop.system.scenario, loop.system.scenario.controller.period
    model = loop.system.plant.truth.model(loop.system.robot)
    data = model.createData()
    for i in (150, 390):
        q, q_dot = rows["q"][i], rows["q_dot"][i]
        _, task = loop.system.observe(q, q_dot, rows["t"][i])
        behind = task.J_q_inv @ rows["s"][i]
        C = pin.computeCoriolisMatrix(model, data, q, q_dot).copy()
        M = pin.crba(model, data, q).copy()
        q_ddot = (rows["q_dot"][i + 1] - q_dot) / h
        moved = M @ (q_ddot - rows["q_eq_ddot"][i]) + C @ behind - rows["tau_linear"][i] - rows["tau_switching"][i]
        instant = analysis.at({key: rows[key][i] for key in rows}, loop.recording.epochs[-1])
        assert instant.perturbation == pytest.approx(np.linalg.norm(moved @ task.J_q_inv), rel=1e-3)
        assert pytest.approx(0.5 * behind @ M @ behind) == instant.V
    assert scenario.truth.viscous == 0.4


def test_no_perturbation_when_the_truth_is_what_the_controller_believes():
    exact = edited(shipped()["ur5-motion"], "truth", {"link_scaling": 1.0})
    seen = known(ran(exact, 0.3))
    assert np.nanmax(seen["perturbation"]) < 1e-6
    assert np.nanmin(seen["needed"][:, 0]) >= 0.0


def test_the_perturbation_stays_below_what_17_allows_for_and_v_below_24(hybrid: ClosedLoop):
    seen = known(hybrid)
    examined = np.isfinite(seen["perturbation"])
    assert examined.sum() >= BUCKETS - 1
    allowed = seen["d_required"] - seen["needed"][:, 5]
    assert np.all(seen["perturbation"][examined] < allowed[examined])
    assert np.all(seen["V"][examined] <= seen["V_band"][examined])
    assert seen["perturbation"][examined].max() > 0.5 * allowed.max()  # no idle bound


def test_past_rows_are_judged_by_the_truth_of_their_time():
    loop = ran(shipped()["ur5-motion"], 0.2)
    loop.edit(edited(loop.system.scenario, "truth", {"link_scaling": 1.0}))
    while loop.t < 0.4:
        loop.step()
    seen = known(loop)
    examined = np.isfinite(seen["perturbation"])
    before, after = examined & (seen["t"] < 0.2 - 1e-9), examined & (seen["t"] > 0.2 + 1e-9)
    assert seen["perturbation"][before].min() > 1.0
    assert seen["perturbation"][after].max() < 1e-6


def test_predicted_steady_force_is_where_the_force_settles():
    stiffer = edited(shipped()["ur5-hybrid"], "controller.K_e_hat", 5000.0)
    hybrid = ran(edited(stiffer, "target_model.K_m", [3000.0, 4000.0, 4000.0, 4000.0, 4000.0, 4000.0]), 3.0)
    impedance = shipped()["ur5-impedance"]
    lifted = [*impedance.surface.origin[:2], impedance.surface.origin[2] + 0.02]
    yielding = ran(edited(edited(impedance, "motion", "hold"), "surface.origin", lifted), 4.0)
    for loop, error in ((hybrid, 0.05), (yielding, 1e-3)):
        seen = known(loop, loop.t - 0.5)
        steady = seen["steady_force"][np.isfinite(seen["steady_force"])][-1]
        assert seen["multiplier"][-1] == pytest.approx(steady, abs=error)
    assert abs(known(hybrid, 2.5)["steady_force"][-1] - 20.0) > 1.0  # (37) leaves an error here


@pytest.mark.parametrize("name", ["ur5-hybrid", "ur5-constrained", "ur5-impedance"])
def test_predicted_steady_force_has_what_the_boundary_layer_leaves_where_a_is_not_zero(name: str):
    """(14): -M_m A s on the right of (8)."""
    still = edited(edited(shipped()[name], "motion", "hold"), "controller.A", -50.0)
    if name == "ur5-impedance":
        x, y, z = still.surface.origin
        still = edited(still, "surface.origin", [x, y, z + 0.02])
    loop = ran(edited(still, "sensor.ideal", True) if name == "ur5-constrained" else still, 2.0)
    seen = known(loop, loop.t - 0.2)
    steady = seen["steady_force"][np.isfinite(seen["steady_force"])][-1]
    without = loop.system.controller.model.M_m @ loop.system.controller.compensator.A @ seen["s"][-1]
    assert np.abs(without).max() > 0.5
    assert seen["multiplier"][-1] == pytest.approx(steady, abs=0.01)
    if loop.system.m:
        assert abs(steady - 20.0) > 0.5
        predicted = steady_force_error(loop.system, seen["r_d"][-1], seen["F_cd"][-1], seen["s"][-1])
        assert predicted == pytest.approx(seen["multiplier"][-1] - 20.0, abs=0.01)


def test_reaching_and_sliding_phases_and_their_marks():
    watching = edited(edited(shipped()["ur5-hybrid"], "controller.on_change", "watch"), "controller.F_1", 60.0)
    loop = ran(watching, 0.5)
    loop.edit(edited(watching, "force.value", 60.0))
    began = loop.t
    while loop.t < 1.5:
        loop.step()
    assert loop.reaching_time is not None
    assert 0.01 < loop.reaching_time < loop.certificate.t_r
    seen, t = known(loop), loop.recording.signals(("t",))["t"]
    reaching = t[(seen["reaching"] == 1.0) & (t >= began - 1e-9)]
    assert reaching[0] == pytest.approx(began)
    assert reaching[-1] == pytest.approx(began + loop.reaching_time - 1e-3, abs=1.1e-3)
    assert t[seen["measured"] == 1.0][-1] == pytest.approx(began + loop.reaching_time, abs=1.1e-3)
    promised = t[(seen["promised"] == 1.0) & (t > began)]
    if began + loop.certificate.t_r < loop.t:
        assert promised == pytest.approx([began + loop.certificate.t_r], abs=1.1e-3)
    late = t >= began - 1e-9
    promise = [lyapunov_bound(loop.certificate.bound, instant - began) for instant in t[late]]
    stands = np.isfinite(seen["V_bound"][late])
    first = len(stands) if stands.all() else int(np.argmin(stands))  # a promise that begins anew has another V_0
    assert first > 20
    np.testing.assert_allclose(seen["V_bound"][late][:first], promise[:first], atol=1e-12)
    grid = BucketGrid.over(0.0, loop.t, BUCKETS)
    assert np.nanmax(grid.thin(t, seen["measured"][:, None])) == 1.0


def setup_of(loop: ClosedLoop) -> Setup:
    return Setup.of(snapshot_of(loop), coordinate=0, joint=0)


def test_units_are_those_of_the_task_space():
    joint = ClosedLoop.from_scenario(edited(load("ur5-motion"), "task_space.kind", "joint"), 10)
    drawings = [plot.draw(setup_of(joint)) for tab in TABS.values() for plot in tab.plots]
    titles = [drawing.title for drawing in drawings if drawing is not None]
    assert not [title for title in titles if "mm" in title]
    assert {"tracking error  e_r  [mrad]", "sliding variable  ‖s‖  [mrad/s]", "s  [mrad/s]"} <= set(titles)
    cartesian = ClosedLoop.from_scenario(load("ur5-motion"), 10)
    units = {figure.field: figure.units([cartesian.system, joint.system]) for figure in ACCOUNT_METRICS}
    assert units["path_rms"] == "mm or mrad"
    assert units["effort"] == "N·m"
    assert units["gain_margin"] == "N or N·m"


@pytest.mark.parametrize("name", ["ur5-hybrid", "ur5-impedance", "planar2r-semicircle", "ur5-motion"])
def test_every_plot_has_finite_lines_of_one_length(name: str):
    loop = ran(shipped()[name], 0.5)
    rows = known(loop)
    frame = Frame(loop.t, 0.5, BucketGrid.over(0.0, loop.t, BUCKETS), rows, (rows, None))
    setup = setup_of(loop)
    assert {title for title, tab in TABS.items() if tab.choosers} == {"Tracking", "Torque"}
    for tab in TABS.values():
        drawings = [plot.draw(setup) for plot in tab.plots if not plot.spectral]
        assert any(drawing is not None for drawing in drawings)
        for drawing in filter(None, drawings):
            x, *lines = frame.courses(drawing.lines)
            assert len(lines) == len(drawing.lines) + 2 * len(compared_lines(drawing.lines))
            assert all(len(line) == len(x) for line in lines), drawing.title
            pinned, drawn = lines[: -len(drawing.lines)], lines[-len(drawing.lines) :]
            assert all(np.isfinite(line).all() for line in drawn), drawing.title
            first, second = pinned[: len(pinned) // 2], pinned[len(pinned) // 2 :]
            entry = len(first) > 1  # in the legend alone
            assert all(np.isfinite(line).any() for line in first[entry:]), drawing.title  # with gaps beyond its end
            assert not entry or np.isnan(first[0]).all()
            assert all(np.isnan(line).all() for line in second), drawing.title  # that one is not pinned
            assert np.all(np.diff(x) >= 0)
            assert (x[0] >= -0.5, x[-1]) == (True, 0.0)


def test_rotations_are_shown_as_angles(hybrid: ClosedLoop):
    setup, rows = setup_of(hybrid), hybrid.recording.stretch()
    rotations = TABS["Tracking"].plots[1].draw(setup)
    assert rotations is not None
    np.testing.assert_allclose(
        rotations.lines[0].values(rows), 1e3 * rows["e_r"][:, 3] / hybrid.system.coordinates[3].per_radian
    )
    followed = TABS["Tracking"].plots[2].draw(replace(setup, coordinate=4))
    assert followed is not None
    np.testing.assert_allclose(
        followed.lines[1].values(rows), 1e3 * rows["r"][:, 4] / hybrid.system.coordinates[3].per_radian
    )


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


def test_bounds_are_drawn_only_where_something_is_promised() -> None:
    """Under a constant gain that is too small nothing is, until the gain is by (17) again."""
    loop = ran(shipped()["ur5-hybrid"], 0.2)
    weak = edited(edited(loop.system.scenario, "controller.gain", "constant"), "controller.d", 1.0)
    loop.edit(weak)
    while loop.t < 0.4 - 1e-9:
        loop.step()
    promising = loop.recording.stretch(0.0, 0.199), loop.recording.stretch(0.21, 0.4)
    assert [bool(np.isfinite(rows["s_bound"]).any()) for rows in promising] == [True, False]
    loop.edit(shipped()["ur5-hybrid"])
    while loop.t < 0.6 - 1e-9:
        loop.step()
    rows, setup = known(loop), setup_of(loop)
    ahead = {name: loop.recording.stretch(0.21, 0.395)[name][::10] for name in loop.recording.columns}
    x_ahead = 0.01 * np.arange(1, len(ahead["t"]) + 1)
    grid, seen = BucketGrid.over(0.0, loop.t, BUCKETS), 0
    for plot in (plot for tab in TABS.values() for plot in tab.plots if not plot.spectral):
        drawing = plot.draw(setup)
        lines = (
            [line for line in drawing.lines if line.name.startswith(("bound (20)", "(20)", "(24)"))] if drawing else []
        )
        for line in lines:
            x, drawn = Frame(loop.t, 0.6, grid, rows).courses([line])
            inside, before, after = (x > -0.38) & (x < -0.22), x < -0.42, (x > -0.15) & (x <= 0.0)
            assert np.isnan(drawn[inside]).all(), line.name
            assert np.isfinite(drawn[before]).any()
            assert np.isfinite(drawn[after]).any()
            seen += 1
    assert seen >= 5
    overview = plots_of(["bound of s"])[0].draw(setup)
    assert overview is not None
    x, bound, norm = Frame(loop.t, 0.6, grid, rows, (), x_ahead, ahead).courses(overview.lines[:2])
    assert np.isnan(bound[x > 0.0]).all()
    np.testing.assert_allclose(norm[x > 0.0], 1e3 * ahead["s_norm"])
    figure = figure_of(plots_of(["reaching"]), snapshot_of(loop), setup, 0.0, loop.t)
    drawn_bound = next(curve for curve in figure.charts[0].curves if curve.name == "(20)")
    gap = (drawn_bound.x > 0.22) & (drawn_bound.x < 0.38)
    assert gap.any()
    assert np.isnan(drawn_bound.y[gap]).all()


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
                assert [line.color for line in lines[1:]] == [line.color for line in compared[1:]]
                looks = [(line.color, line.dashes) for line in lines[1:]]
                assert len(set(looks)) == len(looks)
            patterns.append({line.dashes for line in lines})
        assert not any(one & other for one, other in combinations(patterns, 2)), plot.name
        bands = sum(len(line.band) for line in drawing.lines)
        assert 1 + len(runs) * len(compared) + len(drawing.lines) + bands <= MOST_SERIES


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


def test_a_preview_goes_on_where_every_line_knows_what_lies_ahead(hybrid: ClosedLoop):
    rows = hybrid.recording.stretch()
    ahead = {name: values[::100] for name, values in rows.items()}
    frame = Frame(1.0, 1.0, BucketGrid.over(0.0, 1.0, 100), rows, (), np.arange(10) * 0.1 + 0.1, ahead)
    line = ChartLine("s", (0, 0, 0), column("s_norm"))
    x, drawn = frame.courses([line])
    assert x[-1] == pytest.approx(1.0)
    np.testing.assert_array_equal(drawn[-10:], ahead["s_norm"])
    x, _ = frame.courses([replace(line, foreseen=False)])
    assert x[-1] == 0.0


def test_a_preview_is_drawn_also_before_the_run_has_begun(hybrid: ClosedLoop):
    rows = hybrid.recording.stretch()
    ahead, nothing = ({name: values[part] for name, values in rows.items()} for part in (slice(0, 900, 100), slice(0)))
    frame = Frame(0.0, 1.0, BucketGrid.over(-1.0, 0.0, 100), nothing, (), np.arange(9) * 0.1 + 0.1, ahead)
    x, drawn = frame.courses([ChartLine("s", (0, 0, 0), column("s_norm"))])
    np.testing.assert_allclose(x[x > 0.0], np.arange(9) * 0.1 + 0.1)
    np.testing.assert_array_equal(drawn[x > 0.0], ahead["s_norm"])
    assert np.isnan(drawn[x <= 0.0]).all()


def test_a_band_is_drawn_ahead_only_as_quantiles_of_the_arms_that_still_run(hybrid: ClosedLoop):
    rows = hybrid.recording.stretch()
    begun, now = 0.9, 1.0
    ahead, later = np.arange(1, 11) * 0.1, np.arange(0, 13) * 0.1  # of the preview; of the band, from `begun` on
    arms = np.outer(np.arange(5.0), np.ones(13)) + later  # arm i has i + t
    arms[4, 5:] = np.nan  # and the last one stops
    signals = {"t": np.tile(begun + later, 5), "s_norm": arms.ravel()}
    band = Band(begun, 1.3, later, 5, signals, 1, "it left", whole=True)
    foreseen = {"t": now + ahead, "s_norm": 2.0 + ahead}
    frame = Frame(now, 1.0, BucketGrid.over(0.0, 1.0, 100), rows, (), ahead, foreseen, band, begun - now + later)
    line = ChartLine("s", (0, 0, 0), column("s_norm"), band=(0.0, 0.5, 1.0))
    x, shown = frame.courses([line])
    least, median, largest = frame.spread(x, [shown], [line])
    past = x <= 0.0
    for quantile in (least, median, largest):
        np.testing.assert_array_equal(quantile[past], shown[past])
    np.testing.assert_allclose(least[~past], 0.1 + ahead)
    np.testing.assert_allclose((median[~past][:3], largest[~past][:3]), (2.1 + ahead[:3], 4.1 + ahead[:3]))
    np.testing.assert_allclose((median[~past][5:], largest[~past][5:]), (1.6 + ahead[5:], 3.1 + ahead[5:]))
    short = replace(frame, band_ahead=-0.7 + later)  # it ends before the preview does, half a second ahead
    beyond = x > 0.55
    assert all((quantile[beyond] == shown[beyond]).all() for quantile in short.spread(x, [shown], [line]))
    assert (short.spread(x, [shown], [line])[0][~past & ~beyond] < shown[~past & ~beyond]).all()
    alone = replace(frame, band=None)
    assert all((quantile == shown).all() for quantile in alone.spread(x, [shown], [line]))
