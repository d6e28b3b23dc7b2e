"""What the plots compute: stacks, phases, bounds, and what only the simulation knows."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pinocchio as pin
import pytest

from app.analysis.metrics import ACCOUNT_METRICS
from app.analysis.perturbation import DerivedSignals, PerturbationAnalysis
from app.analysis.steady_force import steady_force_error
from app.analysis.thinning import BucketGrid
from app.dashboard.plots.chart_frames import Frame
from app.dashboard.plots.charts import BUCKETS, Setup
from app.dashboard.plots.dock import Plots, Shown
from app.dashboard.plots.law_drawings import needed_stack, reaching_note, torque_stack
from app.dashboard.plots.paper_figures import figure_of, plots_of
from app.dashboard.plots.pinned_runs import compared_lines
from app.dashboard.plots.plot_table import TABS
from app.dashboard.transport.visible_parts import VisibleParts
from app.dashboard.view_options import Viewing
from app.scenario.data import edited, load, shipped
from app.session.preview import PreviewRun
from app.session.preview_messages import Preview, PreviewRequest
from app.session.snapshot import snapshot_of
from app.simulation.closed_loop import ClosedLoop
from controllers.laws.table import LAWS
from controllers.reaching import lyapunov_bound
from tests.support.plotted import ran, setup_of


def known(loop: ClosedLoop, t_from: float = 0.0) -> DerivedSignals:
    rows = loop.recording.stretch(t_from)
    grid = BucketGrid.over(t_from, loop.t, BUCKETS)
    return PerturbationAnalysis(loop.system).recorded(rows, tuple(loop.recording.epochs), grid.openings(rows["t"]))


@pytest.fixture(scope="module")
def hybrid() -> ClosedLoop:
    return ran(shipped()["ur5-hybrid"], 1.0)


def test_stacks_add_up_to_what_they_are_of(hybrid: ClosedLoop):
    rows = hybrid.recording.stretch()
    for joint in range(6):
        lines, areas = torque_stack(LAWS["vsmrc"].named_terms, joint)
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


def test_18_is_stated_only_where_it_promises() -> None:
    """A constant gain below (17) promises no reaching time: neither beside the plots, nor as a mark, nor ahead."""
    stated = {}
    for d in (1.0, 60.0):
        weak = edited(edited(shipped()["ur5-hybrid"], "controller.gain", "constant"), "controller.d", d)
        loop = ran(edited(weak, "controller.on_change", "watch"), 0.2)
        loop.edit(edited(loop.system.scenario, "controller.F_1", 40.0))
        preview_run = PreviewRun(PreviewRequest(1, loop.state.copy(), loop.system.scenario, 0.5))
        while loop.t < 1.5:
            loop.step()
        preview_run.advance(500)
        ahead = preview_run.preview()
        assert isinstance(ahead, Preview)
        assert 0.01 < loop.certificate.t_r < 1.2
        marked = known(loop)["promised"].any()
        stated[d] = ("s = 0 within" in reaching_note(snapshot_of(loop)), marked, ahead.metrics.reaching_time_promised)
    assert stated[1.0] == (False, False, None)
    assert stated[60.0] == (True, True, pytest.approx(loop.certificate.t_r))


def test_a_run_that_begins_anew_empties_the_plots_and_what_is_said_beside_them() -> None:
    weak = edited(edited(shipped()["ur5-hybrid"], "controller.gain", "constant"), "controller.d", 1.0)
    loop, texts = ran(weak, 0.1), list[SimpleNamespace]()
    gui = MagicMock()
    gui.add_html.side_effect = lambda content: texts.append(SimpleNamespace(content=content)) or texts[-1]
    plots = Plots(gui, VisibleParts(), Viewing(), nullcontext())
    plots.show(snapshot_of(loop), Shown(loop.t, 2.0), ["Guarantee"])
    assert any("the gain d = 1 N is below" in text.content for text in texts)
    loop.edit(edited(weak, "controller.d", 60.0))
    loop.reset()
    plots.show(snapshot_of(loop), Shown(loop.t, 2.0), ["Guarantee"])
    assert not any("the gain d = 1 N is below" in text.content for text in texts)
    assert any("not judged yet" in text.content for text in texts)


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
