"""A hand on the tool, and the desired motion moved: closed forms, determinism, and what is recorded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from app.scenario.data import edited, from_toml, shipped, to_toml
from app.scenario.schema import Scenario
from app.session.changes import PUSH, PUSH_LASTS
from app.session.commands import DragTool, Edit, Pause, PushNow
from app.session.runner import Runner
from app.simulation.closed_loop import ClosedLoop
from app.simulation.signals import SIGNALS
from environments.push import Grip, TimedPush
from environments.shift import SmoothShift

FORCE = np.array([3.0, -8.0, 5.0])


def impedance(**changes: object) -> Scenario:
    """An impedance in free air that holds still; the true arm is the nominal one unless changed."""
    scenario = shipped()["ur5-impedance"]
    free = {"contact.kind": "free", "motion": "hold", "truth.link_scaling": 1.0}
    for path, value in (free | changes).items():
        scenario = edited(scenario, path, value)
    return scenario


def run(loop: ClosedLoop, seconds: float) -> None:
    for _ in range(round(seconds / loop.system.scenario.controller.period)):
        loop.step()
        assert loop.stopped is None


@pytest.mark.parametrize(("law", "scaling"), [("computed-torque", 1.0), ("vsmrc", 1.15)])
def test_an_impedance_yields_to_a_push_as_its_stiffness_says(law: str, scaling: float) -> None:
    """A force P on the tool is measured as -P, so that (8) comes to rest at e_r = K_m^-1 K_f P.

    Computed torque has nothing that would hide a wrong force on the plant; the robust law would.
    """
    push = {"truth.push": FORCE.tolist(), "truth.push_start": 0.1, "truth.push_duration": 10.0}
    loop = ClosedLoop.from_scenario(impedance(**{"controller.law": law, "truth.link_scaling": scaling, **push}))
    run(loop, 1.5)
    last = loop.recording.at(loop.t)
    model = loop.system.controller.model
    np.testing.assert_allclose(last["F"], -FORCE, atol=1e-12)
    np.testing.assert_allclose(
        last["e_r"][:3], (np.linalg.solve(model.K_m, model.K_f) @ np.r_[FORCE, 0, 0, 0])[:3], rtol=1e-3
    )


def test_motion_control_does_not_yield_and_comes_to_no_harm() -> None:
    scenario = edited(edited(shipped()["ur5-motion"], "truth.push", FORCE.tolist()), "truth.push_start", 0.05)
    loop = ClosedLoop.from_scenario(scenario)
    run(loop, 0.3)
    record = loop.recording.signals(("e_r", "F_push", "s_norm", "s_bound", "s_band"))
    assert record["F_push"].any()
    assert np.abs(record["e_r"][:, :3]).max() < 2e-4  # an impedance of this stiffness would yield 2.5e-3
    assert (record["s_norm"] <= record["s_bound"] + record["s_band"]).all()


def test_a_hand_on_a_wall_is_felt_beside_the_wall() -> None:
    """Force control presses a hand's force more than it was told to, as with a real wrist sensor."""
    loop = ClosedLoop.from_scenario(shipped()["ur5-hybrid"])
    run(loop, 1.0)
    view = loop.view()
    n = loop.system.surface.chart(view.tool, loop.t).G[0]
    loop.drag_tool(Grip(tuple(view.tool + n), limit=5.0))
    run(loop, 1.5)
    last = loop.recording.at(loop.t)
    np.testing.assert_allclose(last["F_push"] @ n, 5.0, rtol=1e-2)
    assert last["F_c"][0] == pytest.approx(20.0, abs=0.1)
    assert last["F_true"] @ n == pytest.approx(20.0 + last["F_push"] @ n, abs=0.1)


@pytest.mark.parametrize("ideal", [False, True])
def test_a_push_along_a_rigid_surface_and_into_it(ideal: bool) -> None:
    scenario = edited(edited(shipped()["ur5-constrained"], "sensor.ideal", ideal), "motion", "hold")
    loop = ClosedLoop.from_scenario(scenario)
    run(loop, 0.5)
    view = loop.view()
    n = loop.system.surface.chart(view.tool, loop.t).G[0]
    loop.drag_tool(Grip(tuple(view.tool + n), stiffness=500.0, limit=4.0))
    run(loop, 0.5)
    last = loop.recording.at(loop.t)
    assert abs(last["phi"]) < 1e-9
    assert last["F_c"][0] == pytest.approx(last["F_cd"][0], abs=0.05)
    assert last["multiplier"] == pytest.approx(last["F_cd"][0] + 4.0, abs=0.05)


def beside(p: np.ndarray, y: float) -> tuple[float, float, float]:
    return p[0], p[1] + y, p[2]


def pushed_about(loop: ClosedLoop) -> np.ndarray:
    """Take hold, pull on, let go; every row."""
    p = loop.view().tool
    run(loop, 0.05)
    loop.drag_tool(Grip(beside(p, 0.02)))
    run(loop, 0.05)
    loop.drag_tool(Grip(beside(p, 0.2), 800.0, 30.0))
    run(loop, 0.05)
    loop.drag_tool(None)
    run(loop, 0.05)
    return loop.recording.rows()


def test_the_same_hand_leaves_the_same_rows() -> None:
    rows = [pushed_about(ClosedLoop.from_scenario(impedance())) for _ in range(2)]
    assert np.array_equal(rows[0], rows[1])
    push = rows[0][:, ClosedLoop.from_scenario(impedance()).recording.columns["F_push"]]
    size = np.linalg.norm(push, axis=1)
    assert not size[:50].any()
    assert size[50:150].all()
    assert not size[150:].any()
    assert size[100] == pytest.approx(30.0)
    assert size.max() <= 30.0 + 1e-9


def test_a_run_resumed_under_a_hand_and_a_shift_goes_on_exactly() -> None:
    loop = ClosedLoop.from_scenario(impedance())
    run(loop, 0.1)
    loop.drag_tool(Grip(beside(loop.view().tool, 0.03)))
    loop.edit(edited(loop.system.scenario, "shift.by", [0.02, 0.01]))
    run(loop, 0.1)
    twin = ClosedLoop.from_state(loop.state.copy())
    free = ClosedLoop.from_state(replace(loop.state.copy(), grip=None))
    for one in (loop, twin, free):
        run(one, 0.1)
    mine, its = loop.recording.rows(0.2), twin.recording.rows()
    assert np.array_equal(mine, its)
    assert not free.recording.signals(("F_push",))["F_push"].any()


def test_rows_hold_what_their_names_say() -> None:
    loop = ClosedLoop.from_scenario(impedance())
    run(loop, 0.02)
    loop.drag_tool(Grip((9.0, 9.0, 9.0), limit=7.0))
    before = loop.view()
    loop.step()
    last = loop.recording.at(loop.t)
    assert sum(len(np.atleast_1d(v)) for v in last.values()) == loop.recording.width
    assert list(last) == [signal.name for signal in SIGNALS]
    assert np.linalg.norm(last["F_push"]) == pytest.approx(7.0)
    np.testing.assert_array_equal(last["F"], -last["F_push"])
    np.testing.assert_allclose(last["tool"], before.tool)
    np.testing.assert_allclose(last["q"], before.q)
    terms = ("inertia", "coriolis", "gravity", "force", "linear", "switching")
    np.testing.assert_allclose(sum(last[f"tau_{term}"] for term in terms), last["tau"])
    np.testing.assert_allclose(np.linalg.norm(last["s"]), last["s_norm"])


def test_pause_and_a_new_run_let_go() -> None:
    runner = Runner(impedance())
    grip = Grip((0.0, 0.0, 1.0))
    loop = runner._loop
    for command in (Pause(),):
        runner.post(DragTool(grip))
        runner._obey(runner._queued())
        assert loop.grip == grip
        runner.post(command)
        runner._obey(runner._queued())
        assert loop.grip is None
    loop.drag_tool(grip)
    loop.reset()
    assert loop.grip is None


def test_what_no_hand_can_do_is_refused() -> None:
    with pytest.raises(ValueError, match=r"push\.anchor"):
        Grip((0.0, np.nan, 0.0))
    with pytest.raises(ValueError, match=r"push\.stiffness: -1; allowed"):
        Grip((0.0, 0.0, 0.0), stiffness=-1.0)
    with pytest.raises(ValueError, match=r"push\.limit"):
        Grip((0.0, 0.0, 0.0), limit=np.inf)


def test_a_timed_push_is_part_of_the_scenario() -> None:
    scenario = impedance(**{"truth.push": [1.0, 2.0, 3.0], "truth.push_duration": 0.25})
    assert from_toml(to_toml(scenario)) == scenario
    push = TimedPush(np.array([1.0, 2.0, 3.0]), 1.0, 0.25)
    assert [push.at(t) is not None for t in (0.99, 1.0, 1.2, 1.25)] == [False, True, True, False]
    again = TimedPush(np.array([1.0, 2.0, 3.0]), 1.0, 0.25, 2.0)
    acting = {0.99: False, 1.0: True, 1.25: False, 2.99: False, 3.0: True, 3.24: True, 3.25: False, 101.0: True}
    assert {t: again.at(t) is not None for t in acting} == acting


@pytest.mark.parametrize(("duration", "every"), [(0.05, 0.0), (0.01, 0.0), (0.001, 0.1), (0.005, 0.3)])
def test_a_push_acts_in_as_many_periods_as_it_lasts(duration: float, every: float) -> None:
    """The instants of a run are rounded, those of an epoch that began at any of them twice."""
    push = TimedPush(np.array([1.0, 2.0, 3.0]), 0.1, duration, every)
    for begins in (0.0, 0.037):
        acts = np.array([push.at(begins + 0.001 * k) is not None for k in range(10_000)])
        starts = np.flatnonzero(np.diff(acts.astype(int)) == 1)
        lasting = np.flatnonzero(np.diff(acts.astype(int)) == -1) - starts[: np.count_nonzero(np.diff(acts * 1) == -1)]
        assert len(starts) == (1 if every == 0.0 else len(np.arange(0.1, begins + 9.9999, every)))
        assert (lasting == round(duration / 0.001)).all()


def test_push_now_begins_the_scenarios_push_or_one_sideways_and_the_run_goes_on() -> None:
    runner = Runner(shipped()["ur5-hybrid"])
    loop = runner._commanded.timeline.loop
    run(loop, 0.2)
    runner.post(PushNow())
    runner._obey(runner._queued())
    assert loop.t == pytest.approx(0.2)
    run(loop, PUSH_LASTS + 0.1)
    record = loop.recording.signals(("t", "F_push"))
    pushed = record["t"][record["F_push"].any(axis=1)]
    assert (pushed[0], pushed[-1]) == pytest.approx((0.2, 0.2 + PUSH_LASTS), abs=0.002)
    assert record["F_push"].max(axis=0) == pytest.approx((0.0, PUSH, 0.0))
    runner.post(Edit("truth.push", [0.0, 0.0, -5.0]))
    runner.post(PushNow())
    runner._obey(runner._queued())
    assert loop.system.scenario.truth.push_start == pytest.approx(loop.t)
    assert loop.system.scenario.truth.push == (0.0, 0.0, -5.0)


def test_a_shift_keeps_two_derivatives_wherever_it_is_turned() -> None:
    first = SmoothShift.fresh(np.array([0.1, 0.0, -0.2]), 1.0)
    second = first.turned(0.4, np.array([-0.1, 0.05, 0.0]), 0.7)
    for old, new in zip(first.evaluate(0.4), second.evaluate(0.4), strict=True):
        np.testing.assert_allclose(new, old, atol=1e-12)
    for t in (0.41, 0.7, 1.05):
        h = 1e-5
        now, back, ahead = (second.evaluate(t + dt) for dt in (0.0, -h, h))
        np.testing.assert_allclose((ahead.value - back.value) / (2 * h), now.rate, atol=1e-7)
        np.testing.assert_allclose((ahead.rate - back.rate) / (2 * h), now.acceleration, atol=1e-6)
    for t in (1.1, 5.0):
        rest = second.evaluate(t)
        np.testing.assert_allclose(rest.value, second.end, atol=1e-12)
        assert not rest.rate.any()
        assert not rest.acceleration.any()


def test_a_shift_moves_the_target_without_a_jump_and_stays_in_omega() -> None:
    loop = ClosedLoop.from_scenario(shipped()["ur5-hybrid"])
    run(loop, 2.0)
    loop.edit(edited(loop.system.scenario, "shift.by", [0.06, -0.04]))
    loop.edit(edited(loop.system.scenario, "controller.layer", 0.011))
    run(loop, 1.6)
    record = loop.recording.signals(("r_d", "e_r", "s_norm", "s_bound", "s_band"))
    jumps = np.abs(np.diff(record["r_d"], n=3, axis=0))  # of the acceleration, times T^2
    assert jumps.max() < 1e-7
    base = ClosedLoop.from_scenario(shipped()["ur5-hybrid"]).system.reference(3.0).r_d
    moved = loop.system.reference(3.0).r_d - base
    np.testing.assert_allclose(moved, [0.0, 0.06, -0.04, 0.0, 0.0, 0.0], atol=1e-9)
    assert np.abs(record["e_r"][:, 1:3]).max() < 2e-4
    assert loop.warning is None
    loop.edit(edited(loop.system.scenario, "mode", "hybrid"))
    assert loop.system.scenario.shift.by == (0.06, -0.04)
