"""Rigid surfaces that only push: each lost and met again by itself, against closed forms."""

from __future__ import annotations

import pickle
import re

import numpy as np
import pinocchio as pin
import pytest

from app.scenario.data import edited, load
from app.scenario.schema import Scenario
from app.simulation.assembly import assemble
from app.simulation.closed_loop import ClosedLoop
from app.simulation.compiled_run import CompiledRun
from app.simulation.system import System
from environments.acceleration import PlantState
from environments.contact import Contact
from environments.contact_kinds import CONTACTS
from environments.plant import Plant
from tests.support.surfaces import plane, to_third

H, HELD = 1e-3, 1e-9
PUSHES_ONLY = Contact(0.0, 0.0, 0.0, unilateral=True, friction_coulomb=0.0, friction_viscous=0.0)
WIDE = np.array([[0.2, 0.1, -1.0], [0.1, 1.0, 0.3], [1.0, -0.4, 0.5]])  # normals of planes
NARROW = np.array([[0.5, 0.1, -1.0], [-0.4, 0.5, -1.0], [0.1, -0.6, -1.0]])  # an impact on one lifts off another


def pulled(name: str, push: list[float], leaving: str = "flag", **fields: object) -> Scenario:
    """A scenario whose tool is pulled by a push (3,) N for a tenth of a second from t = 0.05 s on."""
    scenario, script = load(name), {"truth.push": push, "truth.push_start": 0.05, "truth.push_duration": 0.1}
    for path, value in {**script, "simulation.leaving_domain": leaving, **fields}.items():
        scenario = edited(scenario, path, value)
    return scenario


def run(scenario: Scenario, seconds: float) -> ClosedLoop:
    """A run of so many seconds, or until it stops."""
    loop = ClosedLoop.from_scenario(scenario)
    while loop.t < seconds - 0.5 * H and loop.stopped is None:
        loop.advance()
    return loop


@pytest.fixture(scope="module")
def system() -> System:
    """An arm with another payload and other links than the nominal ones."""
    return assemble(load("ur5-corner-rigid"))


def cornered(system: System, normals: np.ndarray) -> tuple[Plant, Plant, PlantState]:
    """The arm at rest in a corner of three oblique planes that only push, and the same arm without them."""
    p = system.nominal.evaluate(system.q_0, np.zeros(6)).p.copy()
    planes = tuple(plane(p, normal) for normal in normals)
    plant = Plant(system.robot, system.plant.truth, planes, CONTACTS["rigid"], 3 * (PUSHES_ONLY,))
    free = Plant(system.robot, system.plant.truth, planes, CONTACTS["free"], 3 * (PUSHES_ONLY,))
    return plant, free, plant.start(system.q_0, np.zeros(6), 0.0)


@pytest.mark.parametrize("engaged", [False, True])
def test_a_yielding_surface_that_would_have_to_pull_has_no_friction(system: System, *, engaged: bool) -> None:
    """The tool slides within the surface, pulled off it or pressed onto it."""
    contact = Contact(5.0, 30.0, 2e4, unilateral=True, friction_coulomb=0.0, friction_viscous=80.0)
    normal, depth, speed = np.array([0.0, 0.0, -1.0]), 1e-4, np.array([0.05, -0.02, 0.0])
    seen = system.nominal.evaluate(system.q_0, np.zeros(6))
    surface = (plane(seen.p - depth * normal, normal),)
    kinds = CONTACTS["mass-damper-spring"], CONTACTS["free"]
    plant, free = (Plant(system.robot, system.plant.truth, surface, kind, (contact,)) for kind in kinds)
    q_dot = np.linalg.pinv(seen.J_v) @ speed
    state, beside = (each.start(system.q_0, q_dot, 0.0) for each in (plant, free))
    push = 200.0 if engaged else -200.0
    tau = pin.rnea(plant.model, plant.data, system.q_0, q_dot, np.zeros(6)) + seen.J_v.T @ (push * normal)
    for each, arm in ((plant, state), (free, beside)):
        each._accelerate(arm, tau, 0.0)
    load, q_ddot = state.part("load"), state.views.q_ddot.copy()
    if not engaged:
        np.testing.assert_array_equal(load.wrench, 0.0)
        np.testing.assert_allclose(q_ddot, beside.views.q_ddot, rtol=1e-12)
        return
    force = load.multiplier[0]
    np.testing.assert_allclose(load.wrench[:3], force * normal + 80.0 * speed, rtol=1e-6)
    pressed = free.start(system.q_0, q_dot, 0.0)
    free._accelerate(pressed, tau - seen.J_v.T @ load.wrench[:3], 0.0)
    np.testing.assert_allclose(q_ddot, pressed.views.q_ddot, rtol=1e-9)
    moving = system.nominal.evaluate(system.q_0, q_dot)
    phi_ddot = normal @ (moving.J_v @ q_ddot + moving.J_v_dot @ q_dot)
    assert force == pytest.approx(5.0 * phi_ddot + 2e4 * depth, rel=1e-6)


def gradients(system: System, plant: Plant, q: np.ndarray) -> np.ndarray:
    """phi_dot of each plane per q_dot, (3, 6)."""
    estimate = system.nominal.evaluate(q, np.zeros(6))
    G = np.array([each.chart(estimate.p, 0.0).G[0] for each in plant.surfaces])
    return G @ estimate.J_v


def inertia(plant: Plant, q: np.ndarray) -> np.ndarray:
    """M (6, 6) of the true arm."""
    M = pin.crba(plant.model, plant.model.createData(), q)
    return np.triu(M) + np.triu(M, 1).T


@pytest.mark.parametrize("normals", [WIDE, NARROW])
def test_multipliers_and_accelerations_are_complementary_in_a_corner(system: System, normals: np.ndarray) -> None:
    """lambda >= 0, phi_ddot <= 0, lambda phi_ddot = 0, for torques that press and pull in all ways: at rest
    phi_ddot = a q_ddot."""
    plant, _, state = cornered(system, normals)
    q, rng, kept = state.views.q.copy(), np.random.default_rng(7), set()
    a, M = gradients(system, plant, q), inertia(plant, q)
    weight = pin.rnea(plant.model, plant.model.createData(), q, np.zeros(6), np.zeros(6)) + system.plant.truth.torque(
        np.zeros(6), 0.5 * H
    )
    for _ in range(80):
        after, tau = state.copy(), weight + a.T @ rng.normal(0.0, 20.0, 3)
        plant.advance(after, tau, 0.0, H)
        found, phi_ddot = after.views.load.multiplier, a @ after.views.q_ddot
        free_ddot = np.linalg.solve(M, tau - weight - a.T @ found)
        np.testing.assert_allclose(after.views.q_ddot, free_ddot, atol=1e-9)
        held = after.views.holding.held > 0
        assert (found >= 0.0).all()
        assert (phi_ddot <= 1e-9).all()
        np.testing.assert_allclose(found * phi_ddot, 0.0, atol=1e-8)
        assert (found[held] > 0.0).all()
        assert (found[~held] == 0.0).all()
        assert np.abs(after.views.load.phi[held]).max(initial=0.0) <= HELD
        assert (after.views.load.phi <= HELD).all()
        kept.add(tuple(held))
    assert len(kept) == 8


@pytest.mark.parametrize("normals", [WIDE, NARROW])
def test_an_impact_takes_the_speed_into_the_surfaces_and_no_more(system: System, normals: np.ndarray) -> None:
    """M (q_dot+ - q_dot-) = -a^T p with p >= 0, a q_dot+ <= 0 and p (a q_dot+) = 0: momentum along the surfaces is
    kept, no energy is won, and with one surface what is lost is (a q_dot-)^2 / (2 a M^-1 a^T)."""
    plant, free, state = cornered(system, normals)
    q, rng, met = state.views.q.copy(), np.random.default_rng(3), set()
    for _ in range(40):
        before = state.copy()
        towards = rng.normal(0.0, 0.2, 3)
        before.views.q_dot[:] = np.linalg.pinv(gradients(system, plant, q)) @ towards + rng.normal(0.0, 0.02, 6)
        before.views.holding.held[:] = 0
        flown, after, tau = before.copy(), before.copy(), np.zeros(6)
        free.advance(flown, tau, 0.0, H)
        plant.advance(after, tau, 0.0, H)
        reached = after.views.holding.held > 0
        met.add(tuple(reached))
        v, v_after, M = flown.views.q_dot, after.views.q_dot, inertia(plant, flown.views.q)
        every = gradients(system, plant, after.views.q)
        a = every[reached]
        p = np.linalg.lstsq(a.T, -M @ (v_after - v), rcond=None)[0] if reached.any() else np.zeros(0)
        np.testing.assert_allclose(M @ (v_after - v), -a.T @ p, atol=1e-12)
        assert (p > -1e-12).all()
        assert (a @ v_after < 1e-12).all()
        np.testing.assert_allclose(p * (a @ v_after), 0.0, atol=1e-12)
        lost = 0.5 * v @ M @ v - 0.5 * v_after @ M @ v_after
        assert lost >= -1e-15
        if reached.sum() == 1:
            assert lost == pytest.approx(float((a @ v)[0] ** 2 / (2 * a @ np.linalg.solve(M, a.T))[0, 0]), rel=1e-9)
        assert np.abs(after.views.load.phi[reached]).max(initial=0.0) <= HELD
        assert (after.views.load.phi <= HELD).all()
        assert (every @ v_after)[after.views.load.phi >= 0.0].max(initial=0.0) < 1e-12
        np.testing.assert_array_equal(after.views.holding.made == H, reached)
    assert len(met) >= 6


@pytest.mark.parametrize("integrator", ["leapfrog", "semi-implicit-euler", "rk4"])
def test_a_surface_is_left_where_it_would_have_to_pull_and_met_again(integrator: str) -> None:
    loop = run(pulled("ur5-constrained", [0.0, 0.0, 100.0], **{"simulation.integrator": integrator}), 0.9)
    rows, holding = loop.recording.stretch(), loop.state.arm.views.holding
    t, phi, touching = rows["t"], rows["phi"], rows["multiplier"] != 0.0
    assert loop.stopped is None
    (lost, made) = np.flatnonzero(np.diff(touching.astype(int))) + 1
    assert t[lost] == pytest.approx(0.05)
    assert (rows["multiplier"] >= 0.0).all()
    assert np.abs(phi[touching]).max() <= HELD
    assert phi.max() <= HELD
    assert phi.min() < -0.01
    assert phi[made] == pytest.approx(0.0, abs=HELD)
    assert loop.recording.at(loop.t)["multiplier"][0] == pytest.approx(20.0, abs=0.2)
    # the first period without contact: phi_ddot = (a M^-1 a^T) lambda with the lambda that would have been
    q, plant = rows["q"][lost], loop.system.plant
    a = gradients(loop.system, plant, q)[0]
    phi_ddot = a @ np.linalg.solve(inertia(plant, q), a) * holding.pull[0]
    factor = 1.0 if integrator == "semi-implicit-euler" else 0.5
    assert phi[lost + 1] == pytest.approx(factor * H**2 * phi_ddot, rel=2e-3)
    assert (holding.lost[0], holding.made[0]) == pytest.approx((t[lost], t[made]), abs=H)


def test_one_of_two_surfaces_is_lost_while_the_other_is_held() -> None:
    loop = run(pulled("ur5-corner-rigid", [0.0, -60.0, 0.0]), 1.5)
    rows, holding = loop.recording.stretch(), loop.state.arm.views.holding
    t, lost, made = rows["t"], holding.lost[1], holding.made[1]
    away = (t > lost + H) & (t < made - 1.5 * H)
    assert lost == pytest.approx(0.05, abs=H)
    assert made > lost + 0.2
    assert np.abs(rows["phi"][t < made]).max() <= HELD
    assert (rows["multiplier"][away] > 0.0).all()
    assert (rows["multiplier_2"][away] == 0.0).all()
    assert (rows["phi_2"][away] < 0.0).all()
    for number, name in enumerate(("multiplier", "multiplier_2")):
        phi = rows["phi" if number == 0 else "phi_2"]
        assert (rows[name] >= 0.0).all()
        assert np.abs(phi[rows[name] > 0.0]).max() <= HELD
        assert phi.max() <= HELD
    assert (holding.held[:2] == 1).all()
    # the impact lifts the first surface for a moment, no more
    assert (t[rows["multiplier"] == 0.0] < made + 0.01).all()
    last = loop.recording.at(loop.t)
    assert (last["multiplier"][0], last["multiplier_2"][0]) == pytest.approx((20.0, 10.0), abs=0.3)


def test_the_verdict_names_the_surface_and_the_instants_of_loss_and_impact() -> None:
    loop = run(pulled("ur5-corner-rigid", [0.0, -60.0, 0.0], **{"sensor.ideal": True}), 0.3)
    assert loop.standing.now.verdict == "nothing promised"
    assert loop.standing.now.because == (
        "contact with a rigid surface is missing: the second surface, lost at t = 0.0505 s"
    )
    assert np.isnan(loop.promise_record.bound)
    assert "contact lost, the second surface would have to pull (λ = -" in (loop.warning or "")
    while loop.t < 1.5:
        loop.advance()
    whole, found = loop.standing.run, {each.premise: each for each in loop.standing.findings}["contact"]
    made = loop.state.arm.views.holding.made[1]
    assert whole.verdict == "nothing promised"
    assert f"the second surface, lost at t = 0.0505 s, made again at t = {made:.4g} s" in whole.because
    assert found.holds
    assert found.failed == pytest.approx(0.051)
    assert loop.standing.now.verdict == "holds"
    assert loop.promise_record.since > made + H  # an impact breaks no promise, and none reaches over it
    assert np.isnan(loop.promise_record.broken)


@pytest.mark.parametrize("which", ["second", "third"])
def test_the_run_stops_where_leaving_the_domain_stops_it(which: str) -> None:
    scenario = pulled("ur5-corner-rigid", [0.0, -60.0, 0.0], leaving="stop", **{"sensor.ideal": False})
    loop = run(scenario if which == "second" else to_third(scenario), 0.5)
    assert (loop.stopped or "").startswith(f"t = 0.050 s: contact lost, the {which} surface would have to pull (λ = -")
    assert f"the {which} surface, lost at t = 0.0505 s" in loop.standing.run.because


def test_a_run_is_resumed_exactly_before_within_and_after_a_loss() -> None:
    """The wait without contact is short here: a weak force loop loses the surface as it begins."""
    scenario = edited(pulled("ur5-constrained", [0.0, 0.0, 0.0]), "target_model.K_f", [0.2, *5 * [0.0]])
    whole = run(scenario, 0.1)
    absent = np.flatnonzero(whole.recording.stretch()["multiplier"] == 0.0)
    assert 0 < len(absent) < 20
    for begun in (absent[0] - 1, absent[0], absent[0] + 1, absent[-1], absent[-1] + 1):
        first = run(scenario, begun * H)
        again = ClosedLoop.from_state(pickle.loads(pickle.dumps(first.state.copy())))
        compiled = ClosedLoop.from_state(first.state.copy())
        CompiledRun(compiled).advance(100 - begun)
        while again.t < 0.1 - 0.5 * H:
            again.advance()
        rest, resumed, engine = (each.recording.stretch() for each in (whole, again, compiled))
        for name, values in rest.items():
            np.testing.assert_array_equal(resumed[name], values[begun:])
        assert again.state.arm.data.tobytes() == whole.state.arm.data.tobytes()
        np.testing.assert_allclose(engine["phi"], rest["phi"][begun:], atol=1e-14)
        np.testing.assert_array_equal(engine["multiplier"] == 0.0, rest["multiplier"][begun:] == 0.0)


@pytest.mark.slow
def test_lost_contact_with_an_elastic_surface_is_said_with_its_instant() -> None:
    """The tool is pulled off by a hand."""
    push = {"truth.push_start": 0.5, "truth.push_duration": 0.2}
    loop = ClosedLoop.from_scenario(pulled("ur5-hybrid", [0.0, 0.0, 200.0], "stop", **push))
    while loop.t < 0.5:
        loop.step()
    assert loop.warning is None
    resumed = ClosedLoop.from_state(loop.state.copy())
    for each in (loop, resumed):
        while each.t < 0.7:
            each.step()
        lost = re.match(r"t = ([\d.]+) s: contact lost", each.warning or "")
        assert lost is not None, each.warning
        rows = each.recording.signals(("t", "multiplier"))
        first = rows["t"][(rows["multiplier"] == 0.0) & (rows["t"] >= 0.5)][0]
        assert float(lost[1]) == pytest.approx(first, abs=1.5e-3)
