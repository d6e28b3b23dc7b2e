"""Surfaces of one elastic body: what the tool feels of it on every set of its faces, against solutions found
otherwise."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import nnls

from app.analysis.metrics import metrics_of
from app.analysis.steady_force import steady_force_error
from app.scenario.caption import caption
from app.scenario.data import edited, from_plain, load, to_plain
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.session.changes import in_mode, possible, with_control, with_further
from app.simulation.assembly import assemble
from app.simulation.builders.controller_builder import believed_compliance, believed_stiffness, true_stiffness
from app.simulation.closed_loop import ClosedLoop
from app.simulation.compiled_run import CompiledRun
from app.simulation.sampled_loop.period_map import PeriodMap, Posture
from app.simulation.sampled_loop.sampled_force_loop import force_factor
from app.simulation.system import System
from environments.coupled_surfaces import EnvironmentMatrices
from environments.plant import Plant
from tests.support.arms import answered
from tests.support.same_rows import require_same_rows
from tests.support.surfaces import to_third

PAIRS = tuple(combinations(range(3), 2))
DIAGONALS = {"K_e": (3000.0, 2000.0, 2500.0), "B_e": (8.0, 5.0, 6.0), "M_e": (2.0, 1.0, 1.5)}
BESIDE = {"K_e": (900.0, -1300.0, 500.0), "B_e": (2.0, -3.0, 1.0), "M_e": (0.3, -0.5, 0.2)}
FURTHER = {"second": (0.3, 0.8, -0.5), "third": (0.9, -0.2, 0.1)}  # normals


def matrix(name: str, k: int = 3) -> np.ndarray:
    """A matrix (k, k) over the surfaces, written out once more."""
    whole = np.diag(DIAGONALS[name])
    for (i, j), entry in zip(PAIRS, BESIDE[name], strict=True):
        whole[i, j] = whole[j, i] = entry
    return whole[:k, :k]


def faces(k: int, kind: str, **fields: object) -> Scenario:
    """A UR5 between k oblique planes through its tool, all of one body, which only pushes."""
    data = to_plain(edited(load("ur5-corner"), "motion", "hold"))
    tool = assemble(edited(load("ur5-motion"), "motion", "hold")).reference(0.0).r_d[:3]
    for number, section in enumerate(("", "second", "third")[:k]):
        home = data[section] if section else data
        contact = {"kind": kind, **{name: numbers[number] for name, numbers in DIAGONALS.items()}}
        home["contact"] = contact
        normal = FURTHER.get(section, (0.0, 0.0, -1.0))
        home["surface"] = {"kind": "plane", "origin": tool.tolist(), "normal": list(normal)}
        home["force"] = {"kind": "constant", "value": 10.0}
    data["coupling"] = {name: list(entries) for name, entries in BESIDE.items()}
    data["coupling"]["K_e_hat"] = [1200.0, -800.0, 600.0]
    data["simulation"]["integrator"] = "semi-implicit-euler"  # which evaluates the acceleration at the state itself
    scenario = from_plain(data)
    for path, value in fields.items():
        scenario = edited(scenario, path, value)
    return scenario


def pressed(K_e: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """Forces lambda >= 0 with u = K_e^-1 lambda >= phi and one of the two an equality in each row: the least of
    1/2 lambda^T K_e^-1 lambda - lambda^T phi over lambda >= 0, by non-negative least squares."""
    L = np.linalg.cholesky(np.linalg.inv(K_e))
    return nnls(L.T, np.linalg.solve(L, phi))[0]


def measured(system: System, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """phi (k,) m of the surfaces at q, and gradients in joint space (k, n)."""
    tool = system.nominal.evaluate(q, np.zeros_like(q))
    charts = [each.chart(tool.p, 0.0) for each in system.surfaces]
    return np.array([at.g[0] for at in charts]), np.array([at.G[0] for at in charts]) @ tool.J_v


@pytest.mark.parametrize("k", [2, 3])
def test_an_elastic_body_carries_the_forces_of_least_energy(k: int) -> None:
    """Every set of faces is met, and one that the tool is not in where it was, but where the others have pushed it."""
    system, random, seen, bulged = assemble(faces(k, "elastic")), np.random.default_rng(2), set(), 0
    for _ in range(150):
        q = system.q_0 + random.uniform(-0.02, 0.02, 6)
        phi, _ = measured(system, q)
        expected = pressed(matrix("K_e", k), phi)
        found = system.plant.start(q, np.zeros(6), 0.0).read().load
        np.testing.assert_allclose(found.multiplier[:k], expected, atol=1e-9)
        np.testing.assert_allclose(found.phi[:k], phi, atol=1e-12)
        acts = expected > 0.0
        seen.add(tuple(acts.tolist()))
        bulged += int((acts != (phi > 0.0)).any())
    assert len(seen) == 2**k
    assert bulged > 2


@pytest.mark.parametrize("kind", ["elastic", "mass-damper-spring"])
@pytest.mark.parametrize("k", [2, 3])
def test_forces_are_those_of_virtual_work_of_the_faces_that_act(k: int, kind: str) -> None:
    """lambda = L^T (M_e L phi_ddot + B_e L phi_dot + K_e L phi) of those with a force, never negative, and u = L phi
    leaves the others without one; no other set would do for an elastic body."""
    system, random, seen = assemble(faces(k, kind)), np.random.default_rng(1), set()
    M_e, B_e, K_e = (matrix(name, k) if name != "M_e" or kind != "elastic" else np.zeros((k, k))
                     for name in ("M_e", "B_e", "K_e"))  # fmt: skip
    for _ in range(150):
        q_dot, tau = random.uniform(-0.3, 0.3, 6), 40.0 * random.standard_normal(6)
        state = system.plant.start(system.q_0 + random.uniform(-0.02, 0.02, 6), q_dot, 0.0)
        multipliers, q_ddot = answered(system, state, tau)
        q, h = state.views.q, 1e-4
        phi, gradient = measured(system, q)
        ahead, behind = (measured(system, q + t * q_dot + 0.5 * t * t * q_ddot)[0] for t in (h, -h))
        phi_dot, phi_ddot = gradient @ q_dot, (ahead - 2.0 * phi + behind) / h**2
        acts = np.flatnonzero(multipliers[:k])
        free = np.setdiff1d(np.arange(k), acts)
        L = np.zeros((k, len(acts)))
        L[acts, np.arange(len(acts))] = 1.0
        if len(free):
            L[free] = -np.linalg.inv(K_e[np.ix_(free, free)]) @ K_e[np.ix_(free, acts)]
        work = M_e @ L @ phi_ddot[acts] + B_e @ L @ phi_dot[acts] + K_e @ L @ phi[acts]
        np.testing.assert_allclose(multipliers[acts], L.T @ work, atol=2e-3)
        np.testing.assert_allclose((K_e @ L)[free], 0.0, atol=1e-9)
        assert (multipliers >= 0.0).all()
        assert (pressed(K_e, phi)[acts] > 0.0).all()  # of those that a body at rest would have
        seen.add(tuple(acts.tolist()))
    assert len(seen) == 2**k


def test_a_body_that_is_left_and_met_again_keeps_the_energy() -> None:
    """A frictionless arm without a law bounces in the corner: its energy and the body's, 1/2 lambda^T K_e^-1 lambda,
    stay together, since the force has no jump where a face is met or left."""
    system = assemble(faces(2, "elastic", **{"contact.B_e": 0.0, "second.contact.B_e": 0.0, "coupling.B_e": [0, 0, 0]}))
    plant = system.plant
    parts = (system.robot, plant.truth, system.surfaces, plant.nature, plant.contacts)
    exact = Plant(*parts, "rk4", 2, plant.face, plant.environment)
    state = exact.start(system.q_0, np.array([0.1, 0.3, -0.2, 0.1, 0.2, 0.1]), 0.0)
    model, data, energy, acts = exact.model, exact.model.createData(), [], []
    weight = pin.computeGeneralizedGravity(model, data, system.q_0)
    for step in range(1200):
        q, q_dot = state.views.q.copy(), state.views.q_dot.copy()
        force = state.read().load.multiplier[:2].copy()
        body = 0.5 * force @ np.linalg.solve(matrix("K_e", 2), force)
        arm = 0.5 * q_dot @ pin.crba(model, data, q) @ q_dot + pin.computePotentialEnergy(model, data, q)
        energy.append(arm + body - weight @ (q - system.q_0))
        acts.append(tuple((force > 0.0).tolist()))
        exact.advance(state, weight, 5e-4 * step, 5e-4)
    assert len(set(acts)) > 2
    assert np.ptp(energy) < 1e-6


@pytest.mark.parametrize(
    "fields",
    [
        {},
        {"simulation.integrator": "rk4", "truth.push": [0.0, -40.0, 40.0], "truth.push_start": 0.03},
        {"sensor.ideal": True, "simulation.integrator": "leapfrog", "truth.push": [5.0, -20.0, 30.0]},
    ],
)
@pytest.mark.parametrize(("k", "kind"), [(2, "elastic"), (3, "mass-damper-spring")])
def test_both_engines_have_the_same_rows(k: int, kind: str, fields: dict[str, object]) -> None:
    scenario = faces(k, kind, **{"simulation.substeps": 2, **fields})
    stepped, compiled = ClosedLoop.from_scenario(scenario), ClosedLoop.from_scenario(scenario)
    for _ in range(150):
        stepped.advance()
    CompiledRun(compiled).advance(150)
    require_same_rows(stepped, compiled, precision=1e-9)
    assert stepped.stopped is None


def test_a_diagonal_environment_is_not_touched() -> None:
    """Zeros beside the diagonals are the uncoupled world, and so is what is beside those of surfaces that there are
    not."""
    alone = edited(load("ur5-corner"), "coupling.K_e", [0.0, 700.0, 800.0])
    assert not assemble(alone).plant.environment.coupled
    assert not assemble(edited(load("ur5-hybrid"), "coupling.K_e", [5e4, 0.0, 0.0])).plant.environment.coupled
    rigid = edited(load("ur5-corner-rigid"), "coupling", {"K_e": [9e9, 0, 0], "K_e_hat": [9e9, 0, 0], "M_e": [9, 0, 0]})
    assert not assemble(rigid).plant.environment.coupled
    elastic = edited(load("ur5-corner"), "coupling.M_e", [50.0, 0.0, 0.0])
    assert not assemble(elastic).plant.environment.coupled  # elastic surfaces have no mass


def test_matrices_of_a_first_and_a_third_surface_without_a_second_one() -> None:
    scenario = with_further(faces(3, "elastic"), "second", "free")
    np.testing.assert_array_equal(true_stiffness(scenario), matrix("K_e")[np.ix_([0, 2], [0, 2])])
    np.testing.assert_array_equal(believed_stiffness(scenario), [[1e4, -800.0], [-800.0, 1e4]])
    np.testing.assert_allclose(believed_compliance(scenario) @ believed_stiffness(scenario), np.eye(2), atol=1e-12)
    plan = assemble(scenario).plan
    np.testing.assert_array_equal(plan.compliance[:2, :2], believed_compliance(scenario))


OUT = {(2, 1): (-0.006,), (3, 1): (-0.006, 0.006), (3, 2): (0.006,)}  # m, from where the tool stands


def following(k: int, p: int, **fields: object) -> Scenario:
    """The arm between k planes of one body of which it presses p, believed as it is, and follows the others, in and out
    of the body."""
    controls = {f"{section}.control": "path" for section in ("second", "third")[p - 1 : k - 1]}
    known = {"coupling.K_e_hat": BESIDE["K_e"], "second.K_e_hat": 2000.0, "third.K_e_hat": 2500.0}
    path = {"motion": "line", "motion.displacement": list(OUT[k, p]), "motion.period": 4.0}
    own = {"controller.K_e_hat": DIAGONALS["K_e"][0], "force.value": 12.0, "second.force.value": 7.0}
    return faces(k, "elastic", **(controls | known | own | path | fields))


@pytest.mark.parametrize(("k", "p"), [(2, 1), (3, 1), (3, 2)])
@pytest.mark.parametrize("unilateral", [True, False])
def test_pressing_one_face_and_following_another_of_the_same_body(k: int, p: int, *, unilateral: bool) -> None:
    """r_fd is where the body would bear f_nd while the tool is at r_pd: by least energy, or K_e r_fd = f_nd for faces
    that pull, too. Derivatives by differences, but where a face is met or left."""
    kept = {f"{section}contact.unilateral": unilateral for section in ("", "second.", "third.")[:k]}
    system, K_e = assemble(following(k, p, **kept)), matrix("K_e", k)
    f_nd, h, seen = np.array([12.0, 7.0])[:p], 1e-5, set()
    for t in np.linspace(0.0, 4.0, 41):
        at, before, after = (system.reference(float(t) + dt) for dt in (0.0, -h, h))
        force = pressed(K_e, at.r_d[:k]) if unilateral else K_e @ at.r_d[:k]
        np.testing.assert_allclose(force[:p], f_nd, atol=1e-9)
        np.testing.assert_array_equal(at.F_cd[:p], f_nd)
        if t > 0.0:
            np.testing.assert_allclose(at.r_d_dot, (after.r_d - before.r_d) / (2 * h), atol=1e-7)
            np.testing.assert_allclose(at.r_d_ddot, (after.r_d_dot - before.r_d_dot) / (2 * h), atol=1e-5)
        seen.add(tuple((force[p:] != 0.0).tolist()))
    assert len(seen) > 1 or not unilateral


def test_a_followed_face_is_met_and_left_without_a_force_error() -> None:
    """With the believed body the true one (36) holds, and with another one and K_m1 > 0 the steady force is
    predicted."""
    loop = ClosedLoop.from_scenario(following(2, 1, **{"simulation.integrator": "leapfrog"}))
    CompiledRun(loop).advance(4000)
    seen = loop.recording.signals(("t", "multiplier", "multiplier_2"))
    settled = seen["t"] > 1.0
    assert np.abs(seen["multiplier"][settled] - 12.0).max() < 0.1
    assert len(set((seen["multiplier_2"][settled] > 0.0).tolist())) == 2
    # where the face is met and left, r_d_dot jumps: nothing is promised of these two periods
    assert metrics_of(loop).promise.share > 0.998
    held = loop.recording.signals(("t", "held_error"))
    assert len(held["t"][held["held_error"] > 10.0]) == 2
    for depth in (0.004, -0.004):
        wrong = {"coupling.K_e_hat": [-500.0, 0.0, 0.0], "target_model.K_m": [900.0, 4000.0] + 4 * [4000.0]}
        resting = following(2, 1, **wrong, **{"motion.displacement": [0.0], "shift.by": [depth], "shift.duration": 0.5})
        loop = ClosedLoop.from_scenario(resting)
        CompiledRun(loop).advance(3000)
        last = loop.recording.at(loop.t)
        assert (last["multiplier_2"][0] > 0.0) == (depth > 0.0)
        predicted = steady_force_error(loop.system, last["r_d"], last["F_cd"], last["s"])
        assert predicted is not None
        assert abs(predicted) > 0.2
        assert last["multiplier"][0] - 12.0 == pytest.approx(predicted, abs=2e-3)


def test_the_force_loop_of_coupled_masses_has_its_factor() -> None:
    """The largest eigenvalue of the map from a reading of the force to the force in the period after it."""
    found = []
    for between in (-9.0, 0.0, 9.0):
        heavy = {"contact.M_e": 20.0, "second.contact.M_e": 12.0, "coupling.M_e": [between, 0.0, 0.0]}
        system = assemble(faces(2, "mass-damper-spring", **heavy, **{"truth.link_scaling": 1.0}))
        at = Posture.of(system, system.q_0, 0.0)
        own = np.linalg.eigvals(PeriodMap(system, at).jacobian()[-3:, -3:])  # of the load, which the next period reads
        found.append(force_factor(system, at))
        assert found[-1] == pytest.approx(own[np.argmax(np.abs(own))], rel=1e-4)
    assert np.ptp(found) > 0.05


def test_what_the_step_cannot_follow_is_named() -> None:
    stiff = edited(edited(load("ur5-corner-coupled"), "contact.K_e", 1e7), "second.contact.K_e", 1e7)
    assemble(stiff)
    with pytest.raises(ScenarioError, match=r"coupling\.K_e: 1\.9e\+07 N/m is too stiff for 1 step.*substeps >= 2"):
        assemble(edited(stiff, "coupling.K_e", [9e6, 0.0, 0.0]))
    M_e, B_e, K_e = EnvironmentMatrices.of(*(matrix(name) for name in ("M_e", "B_e", "K_e"))).acting((0, 2))
    kept = [0, 2]
    schur = matrix("K_e")[np.ix_(kept, kept)] - np.outer(matrix("K_e")[kept, 1], matrix("K_e")[1, kept]) / 2000.0
    np.testing.assert_allclose(K_e, schur, rtol=1e-12)
    for reduced, name in ((M_e, "M_e"), (B_e, "B_e")):
        L = np.array([[1.0, 0.0], -matrix("K_e")[1, kept] / 2000.0, [0.0, 1.0]])
        np.testing.assert_allclose(reduced, L.T @ matrix(name) @ L, rtol=1e-12)


@pytest.mark.parametrize(
    ("edits", "message"),
    [
        ({"coupling.K_e": [9000.0, 0.0, 0.0]}, "coupling.K_e: [9000.0, 0.0, 0.0] N/m makes K_e = [[10000.0, 9000.0]"),
        ({"coupling.K_e_hat": [8000.0, 0.0, 0.0]}, "allowed: entries with which it is symmetric positive definite"),
        ({"coupling.B_e": [1.0, 0.0, 0.0]}, "coupling.B_e: [1.0, 0.0, 0.0] N·s/m makes B_e = [[0.0, 1.0], [1.0, 0.0]]"),
        (
            {"contact.kind": "mass-damper-spring", "second.contact.kind": "mass-damper-spring", "contact.M_e": 1.0,
             "second.contact.M_e": 1.0, "coupling.M_e": [2.0, 0.0, 0.0]},
            "with the eigenvalue -1; allowed: entries with which it is symmetric positive semidefinite",
        ),
        ({"contact.K_e": 1.0}, "coupling.K_e: [2000.0, 0.0, 0.0] N/m makes K_e = [[1.0, 2000.0]"),
        ({"coupling.K_e": [1.0, 2.0]}, "coupling.K_e"),
    ],
)  # fmt: skip
def test_refusals_name_the_matrix(edits: dict[str, object], message: str) -> None:
    def built() -> System:
        scenario = load("ur5-corner-coupled")
        for path, value in edits.items():
            scenario = edited(scenario, path, value)
        return assemble(scenario)

    with pytest.raises(ScenarioError) as refused:
        built()
    assert message in str(refused.value)


def test_an_edit_of_what_couples_the_surfaces_reaches_the_plant_and_the_law() -> None:
    scenario = load("ur5-corner-coupled")
    before = assemble(scenario)
    after = assemble(edited(edited(scenario, "coupling.K_e", [-1000, 0, 0]), "coupling.K_e_hat", [500, 0, 0]), before)
    assert after.plant.environment.K_e[0, 1] == after.plant.environment.K_e[1, 0] == -1000.0
    assert np.linalg.inv(after.plan.compliance[:2, :2])[0, 1] == pytest.approx(500.0)
    elsewhere = edited(to_third(scenario), "coupling.K_e", [2000.0, 700.0, 0.0])
    assert assemble(elsewhere, before).plant.environment.K_e[0, 1] == 700.0


def test_changes_of_a_coupled_corner_that_are_made_with_one_choice() -> None:
    scenario = load("ur5-corner-coupled")
    followed = possible(with_control(scenario, "second.control", "path"), assemble)
    assert followed.plan.followed.sets == 1
    assert not possible(with_control(load("ur5-corner"), "second.control", "path"), assemble).plan.followed.sets
    assert possible(in_mode(scenario, "constrained"), assemble).plant.nature.rigid
    assert possible(in_mode(scenario, "impedance"), assemble).plant.environment.coupled
    assert not possible(with_further(scenario, "second", "free"), assemble).plant.environment.coupled
    loop = ClosedLoop.from_scenario(scenario)
    model = loop.system.controller.model
    matrices = {name: getattr(model, name) for name in ("M_m", "B_m", "K_m", "K_f")}
    assert "Coupling: K_e = (2000, 0, 0) N/m" in caption(
        scenario, loop.system.controller, matrices, loop.system.units, 0.0, 1.0
    )
