"""Metrics and derived signals of recordings, against the rows that they are about."""

from __future__ import annotations

import math
from pathlib import Path

import msgspec
import numpy as np
import pytest

from app.analysis.metrics import RUN_METRICS, TAIL, account, metrics_of, path_error, saturated, settling_time
from app.analysis.perturbation import PerturbationAnalysis
from app.scenario import own_code
from app.scenario.data import edited, load, shipped
from app.scenario.schema import Scenario
from app.session.changes import in_mode
from app.session.headless_run import simulate
from app.simulation.closed_loop import ClosedLoop
from app.simulation.compiled_run import CompiledRun
from app.simulation.recording import BLOCK
from app.storage.constants_store import kept_memory
from tests.support import law_of_s


@pytest.mark.parametrize("name", ["planar3r-hybrid", "ur5-motion"])
def test_the_end_of_a_run_and_the_same_stretch_have_the_same_figures(name: str) -> None:
    loop = ClosedLoop.from_scenario(shipped()[name], memory=kept_memory())
    while loop.t < 0.5 - 0.5 * loop.period:
        loop.advance()
    whole, t = metrics_of(loop), loop.recording.stretch()["t"]
    begin = t[-1] - TAIL * (t[-1] - t[0])
    end = account(loop.system, loop.recording, begin - 1e-9, t[-1] + 1e-9)
    assert end is not None
    rows = loop.recording.stretch(begin - 1e-9, t[-1] + 1e-9)
    assert end.residual_rms == pytest.approx(np.sqrt((rows["residual"] ** 2).sum(axis=1).mean()), rel=1e-12)
    for of_run, of_stretch in (
        ("target_model_residual_tail", "residual_rms"),
        ("motion_error_tail", "path_max"),
        ("force_error_tail", "force_max"),
        ("angle_error_tail", "angle_max"),
    ):
        one, other = msgspec.to_builtins(whole)[of_run], getattr(end, of_stretch)
        assert (one is None) == (other is None), of_run
        assert one is None or one == pytest.approx(other, rel=1e-12), of_run


def running(scenario: Scenario, seconds: float) -> ClosedLoop:
    loop = ClosedLoop.from_scenario(scenario, memory=kept_memory())
    while loop.t < seconds - 0.5 * loop.period:
        loop.advance()
    return loop


def pushed(push: tuple[float, float, float], **changes: object) -> Scenario:
    """An impedance that holds its place under a push without end."""
    scenario = edited(shipped()["ur5-impedance"], "motion", "hold")
    truth = {"push": push, "push_start": 0.0, "push_duration": 3600.0, "push_every": 0.0}
    for path, value in {**{f"truth.{name}": each for name, each in truth.items()}, **changes}.items():
        scenario = edited(scenario, path, value)
    return scenario


def test_an_error_along_the_normal_counts_where_nothing_is_touched() -> None:
    loop = running(pushed((0.0, 0.0, -30.0), **{"surface.origin": [0.0, 0.0, -0.5]}), 0.5)
    e_r = loop.recording.stretch()["e_r"][:, :3]
    assert metrics_of(loop).motion_error_tail == pytest.approx(np.linalg.norm(e_r, axis=1)[-100:].max(), rel=0.01)
    assert abs(e_r[-1, 2]) > 5e-3


@pytest.mark.parametrize("kind", ["plane", "sphere", "tilting"])
def test_an_error_along_the_normal_is_left_out_in_rows_with_a_contact_force(kind: str) -> None:
    """A push that lifts the tool off again and again; the normals of each row by the surface itself."""
    swung = pushed((20.0, 0.0, 60.0), **{"truth.push_frequency": 2.0})
    x, y, z = running(swung, 1e-3).recording.stretch()["tool"][0].tolist()
    surface = {
        "plane": {"kind": "plane", "origin": [x, y, z]},
        "tilting": {"kind": "plane", "origin": [x, y, z], "tilt": {"amplitude": 0.1, "frequency": 1.0}},
        "sphere": {"kind": "sphere", "origin": [x, y, z - 0.3], "radius": 0.3},
    }
    loop = running(edited(swung, "surface", surface[kind]), 1.0)
    record, system = loop.recording.stretch(), loop.system
    found = path_error(system, record)
    assert found is not None
    touched = record["multiplier"] != 0.0
    assert 0.1 < touched.mean() < 0.9
    for i in range(0, len(found), 7):
        error = record["e_r"][i, :3].copy()
        if touched[i]:
            n = system.charted.frame @ system.surface.chart(record["tool"][i], record["t"][i]).G[0]
            error -= n * (n @ error) / (n @ n)
        assert found[i] == pytest.approx(np.linalg.norm(error), abs=1e-7)


def test_the_largest_error_and_the_settling_time_are_of_all_rows() -> None:
    """A push in step with every so many rows: those rows alone would all be alike."""
    fast = {"contact.kind": "free", "truth.push_frequency": 10.0, "truth.link_scaling": 1.0}
    loop = running(pushed((0.0, 50.0, 0.0), **fast), 0.4 * 300 * 1e-3 * 25)
    e = np.linalg.norm(loop.recording.stretch()["e_r"][:, :3], axis=1)
    seen = account(loop.system, loop.recording, -np.inf, loop.t)
    assert seen is not None
    assert seen.path_max == e.max()
    assert seen.path_rms == pytest.approx(np.sqrt((e**2).mean()), rel=1e-12)
    assert metrics_of(loop).settling_time is None


def test_what_has_not_come_to_rest_where_it_is_wanted_has_no_settling_time() -> None:
    """A force that never comes about, a run that stopped, and numbers that are none."""
    loop, metrics = simulate(edited(shipped()["ur5-hybrid"], "surface.origin", [0.0, 0.0, -0.05]), until=1.0)
    assert metrics.force_error_tail == pytest.approx(20.0)
    assert loop.stopped is None
    assert metrics.settling_time is None
    touching = running(shipped()["ur5-hybrid"], 2.0)
    settled = metrics_of(touching).settling_time
    assert settled is not None
    assert 0.0 < settled < 1.9
    touching.fail("the loop", ValueError("planted"))
    assert metrics_of(touching).settling_time is None
    t = np.arange(100.0)
    assert settling_time(t, np.ones(100), 1e-6) == 0.0
    assert settling_time(t[:5], np.arange(5.0), 1e-6) == np.inf
    for odd in (np.nan, np.inf):
        assert settling_time(t, np.append(np.ones(99), odd), 1e-6) == np.inf


@pytest.mark.parametrize("law", ["computed-torque", "pd-gravity", "of-s"])
def test_a_law_that_reads_no_force_is_foretold_as_with_k_f_of_1(law: str) -> None:
    """The tool rests on the plane 2 cm deep; where the law settles is where the force is. Not so a law that reads z,
    which is told of the force."""
    own_code.use([Path(law_of_s.__file__)])
    lifted = shipped()["ur5-impedance"].surface.origin[2] + 0.02
    known = {"truth.push": [0.0, 0.0, 0.0], "truth.link_scaling": 1.0, "controller.law": law}
    place = {"surface.origin": [*shipped()["ur5-impedance"].surface.origin[:2], lifted]}
    loop = running(pushed((0.0, 0.0, 0.0), **known, **place, **{"target_model.K_f": 6 * [3.0]}), 4.0)
    rows = {name: values[-2:] for name, values in loop.recording.stretch().items()}
    derived = PerturbationAnalysis(loop.system).recorded(rows, tuple(loop.recording.epochs), np.arange(2))
    assert derived["steady_force"][-1] == pytest.approx(rows["multiplier"][-1], rel=1e-3)
    assert rows["multiplier"][-1] > 5.0


def test_rows_that_were_thinned_count_by_the_time_that_they_stand_for() -> None:
    """A run whose force swings with the noise of its sensor, kept whole and with a short memory: the quiet end is in
    full, so that figures by the number of rows would be those of the end."""
    scenario = edited(shipped()["planar3r-hybrid"], "sensor.noise", 0.5)
    whole, kept = (
        ClosedLoop.from_scenario(scenario, history, memory=kept_memory()) for history in (100_000, 2 * BLOCK)
    )
    for loop in (whole, kept):
        CompiledRun(loop).advance(8 * BLOCK)
    assert len(kept.recording.rows()) < 0.6 * len(whole.recording.rows())
    end = kept.recording.first, kept.t
    full, thinned = (account(loop.system, loop.recording, *end) for loop in (whole, kept))
    assert full is not None
    assert thinned is not None
    assert thinned.force_rms == pytest.approx(full.force_rms, rel=0.05)
    assert thinned.effort == pytest.approx(full.effort, rel=0.01)
    assert thinned.variation == pytest.approx(full.variation, rel=0.05)
    assert metrics_of(kept).torque_total_variation == pytest.approx(metrics_of(whole).torque_total_variation, rel=0.05)


def test_a_surface_in_the_way_of_motion_control_hides_no_error() -> None:
    """Motion control has no force to control: what it misses along the normal counts."""
    held = edited(in_mode(load("ur5-hybrid"), "motion"), "motion", "hold")
    loop = running(edited(held, "surface.origin", [0.0, 0.0, 0.19]), 0.3)
    late = loop.recording.stretch(0.8 * loop.t)
    e_r = late["e_r"][:, :3]
    assert (late["multiplier"] > 10.0).all()
    assert metrics_of(loop).motion_error_tail == pytest.approx(np.linalg.norm(e_r, axis=1).max(), rel=0.01)
    assert np.linalg.norm(e_r[:, :2], axis=1).max() < 0.9 * np.linalg.norm(e_r, axis=1).max()


def test_what_is_no_number_is_at_no_limit_and_is_not_shown() -> None:
    tau = np.array([[1.0, 2.0], [1.0, 5.0], [np.nan, 2.0], [np.nan, 5.0]])
    assert saturated({"tau": tau, "tau_applied": np.minimum(tau, 3.0)}).tolist() == [False, True, False, True]
    loop = running(edited(load("planar2r-semicircle"), "simulation.duration", 0.1), 0.01)
    metrics = metrics_of(loop)
    residual = next(each for each in RUN_METRICS if each.field == "target_model_residual_tail")
    assert residual.of(metrics) is not None
    for value in (math.nan, math.inf):
        assert residual.of(msgspec.structs.replace(metrics, target_model_residual_tail=value)) is None
