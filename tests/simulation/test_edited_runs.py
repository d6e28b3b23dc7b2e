"""Edits of a running loop that must not move the arm, hide a lost contact, or let in a gain that feeds itself."""

from __future__ import annotations

import numpy as np
import pytest

from app.scenario.data import edited, load, shipped, with_values
from app.scenario.errors import ScenarioError
from app.simulation.closed_loop import ClosedLoop
from app.simulation.compiled_run import CompiledRun
from app.simulation.promise import premise_watch
from app.simulation.promise.premise_watch import GainFeedbackShares
from controllers.premises import Premise
from kernels.records import Record
from tests.support.faults import boom


def finding(loop: ClosedLoop, premise: str) -> float | None:
    """Instant at which a premise first failed, s; None where it never has."""
    return next((each.failed for each in loop.standing.findings_of_run if each.premise == premise), None)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("second.surface.origin", None),
        ("second.surface.normal", (0.2, 1.0, 0.0)),
        ("second.surface.motion.amplitude", 0.01),
    ],
)
def test_another_second_surface_begins_the_run_anew(path: str, value: object) -> None:
    """A rigid surface that moved in a running loop took the tool with it, and the promise was called broken."""
    loop = ClosedLoop.from_scenario(shipped()["ur5-corner-rigid"])
    CompiledRun(loop).advance(300)
    x, y, z = loop.system.scenario.second.surface.origin
    loop.edit(edited(loop.system.scenario, path, (x, y + 0.01, z) if value is None else value))
    assert loop.t == 0.0
    CompiledRun(loop).advance(300)
    steps = np.abs(np.diff(loop.recording.signals(("q",))["q"], axis=0))
    assert steps.max() < 2e-3
    assert loop.stopped is None
    assert loop.standing.run.verdict != "broken"


def test_a_bilateral_surface_that_is_not_touched_promises_nothing() -> None:
    fields = {
        "simulation.leaving_domain": "flag", "truth.push": (0.0, 0.0, 60.0), "truth.push_start": 0.1,
        "truth.push_duration": 0.05,
    }  # fmt: skip
    loop = ClosedLoop.from_scenario(with_values(shipped()["ur5-constrained"], fields))
    CompiledRun(loop).advance(140)
    assert loop.state.arm.views.holding.held[0] == 0
    loop.edit(edited(loop.system.scenario, "contact.unilateral", False))
    seen = []
    for _ in range(40):
        CompiledRun(loop).advance(10)
        seen.append((bool(loop.state.arm.views.holding.held[0]), loop.standing.now.verdict))
    assert not any(verdict == "holds" for held, verdict in seen if not held)
    assert seen[0][0] is False
    assert seen[-1] == (True, "holds")


@pytest.mark.parametrize("M_e", [0.0, 2.0])
def test_meeting_a_mass_ends_the_promise(M_e: float) -> None:
    """The surface's mass takes up the tool's speed at once: an impact, of which no premise is told otherwise."""
    scenario = with_values(
        shipped()["ur5-impedance"],
        {
            "contact.kind": "mass-damper-spring", "contact.M_e": M_e, "contact.K_e": 2000.0, "contact.B_e": 0.0,
            "simulation.substeps": 4, "surface.origin": (0.0, 0.0, 0.17), "truth": {}, "target_model": {},
            "motion": {"kind": "line", "displacement": [0.0, 0.0, -0.04], "period": 1.0, "ramp": 0.0},
            "controller.K_e_hat": 2000.0,
        },
    )  # fmt: skip
    loop = ClosedLoop.from_scenario(scenario)
    CompiledRun(loop).advance(2000)
    pressed = loop.recording.signals(("multiplier",))["multiplier"] > 0.0
    met = loop.recording.signals(("t",))["t"][np.flatnonzero(np.diff(pressed.astype(int)) == 1) + 1]
    assert len(met) >= 2
    failed = finding(loop, "contact")
    assert failed is None if M_e == 0.0 else failed == pytest.approx(met[0], abs=0.0015)
    assert (loop.standing.run.verdict == "holds") == (M_e == 0.0)


def test_a_blend_to_a_model_with_which_the_gain_runs_away_is_refused() -> None:
    blend = {"blend.to.B_m": (20000.0,) * 6, "blend.at": 0.3, "blend.over": 0.5, "simulation.duration": 3.0}
    with pytest.raises(ScenarioError, match=r"blend\.to: on the way to this target model.*runs away"):
        ClosedLoop.from_scenario(with_values(shipped()["ur5-motion"], blend))
    loop = ClosedLoop.from_scenario(shipped()["ur5-motion"])
    CompiledRun(loop).advance(100)
    with pytest.raises(ScenarioError, match=r"blend\.to: .*runs away"):
        loop.edit(with_values(loop.system.scenario, blend))
    assert not loop.system.scenario.blend.planned
    loop.edit(with_values(loop.system.scenario, blend | {"blend.to.B_m": (10000.0,) * 6}))
    assert loop.system.scenario.blend.planned


def test_a_blend_that_makes_force_and_gain_raise_each_other_is_refused() -> None:
    scenario = shipped()["ur5-corner-rigid"]
    M_m = np.diag([15.0, 15.0, *(10.0,) * 4])
    M_m[0, 1] = M_m[1, 0] = 11.0
    coupled = tuple(map(tuple, M_m.tolist()))
    with pytest.raises(ScenarioError, match=r"controller\.bounds: .*raise each other"):
        ClosedLoop.from_scenario(with_values(scenario, {"target_model.M_m": coupled}))
    with pytest.raises(ScenarioError, match=r"blend\.to: on the way to this target model.*raise each other"):
        ClosedLoop.from_scenario(with_values(scenario, {"blend.to.M_m": coupled, "blend.at": 0.3, "blend.over": 0.5}))


def test_an_edit_is_not_to_blame_for_what_it_does_not_raise() -> None:
    loop = ClosedLoop.from_scenario(shipped()["ur5-motion"])
    watch, value = loop.premise_watch, loop.state.evaluation.views.table.value
    value[Premise.GAIN_BY_CHATTER] = 1.5
    watch.require_bounded_gain(GainFeedbackShares(1.5, np.nan))
    with pytest.raises(ScenarioError, match="runs away"):
        watch.require_bounded_gain(GainFeedbackShares(1.2, np.nan))
    assert isinstance(loop.state.evaluation, Record)


@pytest.mark.parametrize("name", ["ur5-constrained", "ur5-corner-rigid"])
def test_the_reference_on_rigid_surfaces_does_not_depend_on_the_true_arm(name: str) -> None:
    """The arm is moved onto surfaces from a centimetre away, by the believed masses."""
    base = edited(load(name), "surface.origin", [0.0, 0.0, 0.17])
    light, heavy = (ClosedLoop.from_scenario(edited(base, "truth.payload_mass", m)) for m in (0.0, 5.0))
    assert np.abs(light.system.q_0 - light.system.robot.posture).max() > 1e-3
    for loop in (light, heavy):
        np.testing.assert_array_equal(loop.system.q_0, light.system.q_0)
        np.testing.assert_allclose(loop.state.arm.views.q, light.system.q_0, rtol=0.0, atol=1e-12)
        np.testing.assert_array_equal(loop.system.layout.R_ref, light.system.layout.R_ref)
    for _ in range(50):
        light.step()
    light.edit(edited(base, "truth.payload_mass", 5.0))
    for t in (0.05, 0.3):
        np.testing.assert_array_equal(light.system.reference(t).r_d, heavy.system.reference(t).r_d)


def test_an_edit_that_fails_half_way_leaves_the_loop_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    loop, twin = ClosedLoop.from_scenario(load("ur5-hybrid"), 1000), ClosedLoop.from_scenario(load("ur5-hybrid"), 1000)
    for _ in range(5):
        loop.step()
        twin.step()
    with monkeypatch.context() as patched:
        patched.setattr(premise_watch.SampledLoops, "at", boom)
        with pytest.raises(KeyError):
            loop.edit(edited(load("ur5-hybrid"), "controller.K_s", 70.0))
    for _ in range(50):
        loop.step()
        twin.step()
    np.testing.assert_array_equal(loop.recording.rows(), twin.recording.rows())
    assert len(loop.recording.epochs) == len(twin.recording.epochs)
