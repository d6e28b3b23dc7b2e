"""At which places of a run, and after which changes, its sampled loops are judged as premises."""

from __future__ import annotations

import numpy as np
import pytest

from app.scenario.data import edited
from app.simulation.assembly import assemble
from app.simulation.closed_loop import ClosedLoop
from app.simulation.compiled_run import CompiledRun
from app.simulation.omega.stations import APART, Stations
from app.simulation.sampled_loop.sampled_stability import sampled_loop
from controllers.premises import Premise
from environments.surfaces.cylinder import Cylinder
from environments.surfaces.form import SurfaceMotion
from environments.surfaces.plane import Plane
from environments.surfaces.sphere import Sphere
from environments.surfaces.table import Surface
from tests.support.cases import short

pytestmark = pytest.mark.slow  # long or many simulations


def judged_value(loop: ClosedLoop) -> float:
    (found,) = [finding for finding in loop.standing.findings if finding.premise == "sampled_loop"]
    assert found.value is not None
    return found.value


def test_the_sampled_loops_are_judged_along_the_way() -> None:
    """At stations along the reference, once each however often they are passed, and where the arm is off it."""
    loop = ClosedLoop.from_scenario(edited(short("ur5-motion"), "simulation.duration", 3.0))
    seen: dict[int, float] = {}
    for _ in range(3000):
        loop.step()
        judged = loop.state.judged
        assert judged.station is not None
        assert np.abs(loop.state.judged.q - loop.view().q).max() < 3 * APART
        value = seen.setdefault(judged.station, judged_value(loop))
        assert judged_value(loop) == value
    assert len(seen) >= 4
    assert value == sampled_loop(loop.system, judged.q, judged.t).premises[Premise.SAMPLED_LOOP]
    assert len(set(seen.values())) == len(seen)
    asked_late, fresh = loop.sampled, sampled_loop(loop.system, judged.q, judged.t)
    assert asked_late is loop.sampled  # of all that is drawn of it, nothing is computed twice
    assert asked_late.response is not None
    assert fresh.response is not None
    np.testing.assert_array_equal(asked_late.response.B, fresh.response.B)
    np.testing.assert_array_equal(asked_late.sampled, fresh.sampled)

    loop.edit(edited(loop.system.scenario, "truth.push", [0.0, 0.0, 4000.0]))
    while loop.state.judged.station is not None and loop.t < 4.0:
        loop.step()
    assert np.abs(loop.state.judged.q - loop.view().q).max() <= APART


def test_after_a_blend_the_sampled_loops_are_judged_anew() -> None:
    still = edited(short("ur5-impedance"), "motion", {"kind": "hold"})
    loop = ClosedLoop.from_scenario(edited(still, "blend", {"to": {"B_m": [200.0] * 6}, "at": 0.05, "over": 0.1}))
    before = judged_value(loop)
    while loop.t < 0.3:
        loop.step()
    judged = loop.state.judged
    assert judged_value(loop) == sampled_loop(loop.system, judged.q, judged.t).premises[Premise.SAMPLED_LOOP]
    assert judged_value(loop) != before


@pytest.mark.parametrize("compiled", [False, True], ids=["pinocchio", "compiled"])
def test_during_a_blend_the_sampled_loops_are_those_of_the_model_in_force(*, compiled: bool) -> None:
    """The force loop of the model at the end diverges, and that is said as soon as the one in force does."""
    still = edited(short("ur5-constrained"), "motion", {"kind": "hold"})
    blend = {"to": {"M_m": [2.0, *5 * [10.0]]}, "at": 0.0, "over": 4.0}
    loop, begun, factors = ClosedLoop.from_scenario(edited(still, "blend", blend)), 0.0, list[float]()
    while loop.t < 3.9 and loop.stopped is None:
        if compiled:
            CompiledRun(loop).advance(20)
        else:
            for _ in range(20):
                loop.advance()
        judged = loop.state.judged
        fresh = sampled_loop(loop.system, judged.q, judged.t)
        value = loop.state.evaluation.part("table").value[Premise.FORCE_LOOP]
        assert value == pytest.approx(fresh.premises[Premise.FORCE_LOOP], abs=0.15)
        factors.append(fresh.force_factor)
        if not begun and value >= 1.0:
            begun = loop.t
    assert factors[0] > 0.3
    assert min(factors) < -1.0
    assert 1.0 < begun < 3.0
    failed = loop.state.evaluation.part("table").failed[Premise.FORCE_LOOP]
    assert failed == pytest.approx(begun, abs=0.05)


@pytest.mark.parametrize("name", ["ur5-hybrid", "ur5-corner", "ur5-constrained", "ur5-corner-rigid"])
def test_sampled_loops_are_judged_anew_but_for_another_force(name: str) -> None:
    """What is asked of the force changes no sampled loop, so that a slider that moves it need not wait for them."""
    system = ClosedLoop.from_scenario(short(name)).system
    pressed = assemble(edited(edited(system.scenario, "force.value", 17.0), "second.force.value", 9.0), system)
    assert pressed.sampled_loops is system.sampled_loops
    known = system.sampled_loops[0]
    for other in (pressed, assemble(pressed.scenario)):
        found = sampled_loop(other, other.stations.q[0], float(other.stations.t[0]))
        np.testing.assert_array_equal(found.A, known.A)
        np.testing.assert_equal(dict(found.premises), dict(known.premises))
    for path, value in (
        ("controller.K_s", 70.0),
        ("contact.B_e", 3.0),
        ("truth.link_scaling", 1.1),
        ("sensor.delay", 0.002),
        ("simulation.substeps", 2),
        ("declared.link_scaling", 0.1),
    ):
        assert assemble(edited(system.scenario, path, value), system).sampled_loops == {}, path


def test_a_run_taken_up_before_a_blend_knows_nothing_of_the_model_within_it() -> None:
    """As a timeline takes it up, with the system of the instant that is left."""
    still = edited(short("ur5-impedance"), "motion", {"kind": "hold"})
    loop = ClosedLoop.from_scenario(edited(still, "blend", {"to": {"B_m": [200.0] * 6}, "at": 0.05, "over": 0.1}))
    begun, station = loop.state.copy(), loop.state.judged.station
    while loop.t < 0.1:
        loop.step()
    assert station is not None
    within = loop.system.sampled_loops[station] = sampled_loop(loop.system, begun.judged.q, begun.judged.t)
    again = ClosedLoop.from_state(begun, previous=loop.system)
    alone = sampled_loop(assemble(begun.scenario), begun.judged.q, begun.judged.t)
    np.testing.assert_array_equal(again.sampled.sampled, alone.sampled)
    assert np.abs(within.sampled - alone.sampled).max() > 0.1


def test_normals_that_turn_make_stations_of_their_own() -> None:
    """At five postures with the same joints."""
    angles = np.array([0.0, 0.05, 0.12, 0.2, 0.25])
    normals = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)[:, None, :]
    found = Stations.along(np.zeros((5, 3)), np.arange(5.0), normals)
    assert found.t.tolist() == [0.0, 2.0, 4.0]
    assert found.of.tolist() == [0, 0, 1, 1, 2]
    assert len(Stations.along(np.zeros((5, 3)), np.arange(5.0), normals[:, :0]).t) == 1


def test_a_curved_surface_that_moves_turns_its_normal_at_a_fixed_point() -> None:
    moving = SurfaceMotion(amplitude=0.02)
    assert [Surface.of(form).turning for form in (Plane(motion=moving), Cylinder(), Sphere())] == 3 * [False]
    assert all(Surface.of(form).turning for form in (Cylinder(motion=moving), Sphere(motion=moving)))
