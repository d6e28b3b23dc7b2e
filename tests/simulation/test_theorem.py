"""Theorem 1 against random arms: bounds (6), (7), (17) that are true, and reaching (18)-(20) that is kept."""

from __future__ import annotations

import msgspec
import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

from app.scenario.data import edited, from_plain, shipped, to_plain
from app.scenario.departures import Departure
from app.scenario.schema import Scenario
from app.session.headless_run import simulate
from app.simulation.assembly import assemble
from app.simulation.builders.environment_builder import truth_of
from app.simulation.system import System
from controllers.bounds import Equivalent, InertiaRange, required_gain
from controllers.nominal_model import ON_LINE
from controllers.reaching import ReachingCertificate, envelope, lyapunov_bound
from environments.truth import Truth
from tests.support.arms import lipschitz_of
from tests.support.cases import scenario_of

pytestmark = pytest.mark.slow  # long or many simulations

RHO, PAYLOAD, OFFSET, COULOMB, VISCOUS, PUSH = 0.2, 1.0, 0.05, 0.5, 0.3, 2.0
PLANTS = 350  # of each arm, 1,050 in all


def declared_system(robot: str) -> System:
    data = to_plain(scenario_of(robot, "hybrid", "elastic", "moving sphere"))
    data["declared"] = {
        "link_scaling": RHO, "payload_mass": PAYLOAD, "payload_offset": OFFSET, "coulomb": COULOMB,
        "viscous": VISCOUS, "disturbance": PUSH,
    }  # fmt: skip
    return assemble(from_plain(data))


def random_truth(system: System, random: np.random.Generator) -> Truth:
    """An arm inside the declared set, at its edge as often as within."""
    truth = Departure.inside(random, system.robot.n).truth(system.scenario.declared)
    return truth_of(msgspec.structs.replace(system.scenario, truth=truth), system.robot)


def perturbation(
    system: System, truth: Truth, state: tuple, q_eq_dot: np.ndarray, q_eq_ddot: np.ndarray
) -> tuple[float, list[float]]:
    """||Delta H r_eq_ddot + Delta C r_eq_dot + Delta G + Delta F_t + F_tilde|| from the true arm itself, and the norms
    of its parts: inertia, Coriolis, gravity, friction and disturbance."""
    q, q_dot, t = state
    model = truth.model(system.robot)
    data = model.createData()
    M, C = pin.crba(model, data, q).copy(), pin.computeCoriolisMatrix(model, data, q, q_dot).copy()
    G = pin.computeGeneralizedGravity(model, data, q)
    e, task = system.observe(q, q_dot, t)
    parts = ((M - e.M_hat) @ q_eq_ddot, (C - e.C_hat) @ q_eq_dot, G - e.G_hat, truth.torque(q_dot, t))
    forces = np.array(parts) @ task.J_q_inv
    return float(np.linalg.norm(forces.sum(axis=0))), np.linalg.norm(forces, axis=1).tolist()


def random_case(system: System, random: np.random.Generator) -> tuple[tuple, np.ndarray, np.ndarray]:
    n = system.robot.n
    q = system.q_0 + random.uniform(-0.1, 0.1, n)
    speed, push = 10 ** random.uniform(-2, 0.5), 10 ** random.uniform(-2, 1.5)
    state = (q, speed * random.standard_normal(n), random.uniform(0, 2))
    return state, speed * random.standard_normal(n), push * random.standard_normal(n)


def bounds_at(system: System, state: tuple, q_eq_dot: np.ndarray, q_eq_ddot: np.ndarray) -> tuple[list[float], float]:
    """The tight bounds of inertia, Coriolis, gravity, friction and disturbance, and the paper's of the whole, N."""
    q, q_dot, t = state
    e, task = system.observe(q, q_dot, t)
    u = system.controller.uncertainty
    r_eq_dot = task.J_q @ q_eq_dot + task.v_t
    r_eq_ddot = task.J_q @ q_eq_ddot + task.J_q_dot @ q_eq_dot + task.v_t_dot
    equivalent = Equivalent(r_eq_dot, r_eq_ddot, q_eq_dot, q_eq_ddot)
    tight, paper = (required_gain(kind, u, ON_LINE, e, task, q_dot, equivalent) for kind in ("tight", "paper"))
    return [tight.inertia, tight.coriolis, tight.gravity, tight.disturbance], sum(paper)


@pytest.mark.parametrize("robot", ["ur5", "panda", "planar3r"])
def test_no_arm_inside_the_declared_set_exceeds_the_bounds(robot: str) -> None:
    system, random = declared_system(robot), np.random.default_rng(0)
    tightness = []
    for _ in range(PLANTS):
        truth = random_truth(system, random)
        case = random_case(system, random)
        actual, parts = perturbation(system, truth, *case)
        tight, paper = bounds_at(system, *case)
        assert np.all(np.array(parts) <= np.array(tight) + 1e-12)
        assert actual <= sum(tight) <= paper
        tightness.append(actual / sum(tight))
    assert max(tightness) > 0.25  # the bound is one that arms come near to


@pytest.mark.parametrize("robot", ["ur5", "panda", "planar3r"])
def test_inertia_stays_in_its_range(robot: str) -> None:
    """Property 1 with k_r_low and k_r_high over Omega, and H_low <= H <= H_high at each state."""
    system, random = declared_system(robot), np.random.default_rng(1)
    constants = system.constants
    for _ in range(100):
        centre = constants.centres[random.integers(len(constants.centres))]
        away = random.standard_normal(system.robot.n)
        q = centre + constants.radius * random.uniform() * away / np.linalg.norm(away)
        assert constants.omega.depth(q[None])[0] >= 0.0
        model = random_truth(system, random).model(system.robot)
        e, task = system.observe(q, np.zeros_like(q), random.uniform(0, 2))
        H = task.J_q_inv.T @ pin.crba(model, model.createData(), q) @ task.J_q_inv
        eigenvalues = np.linalg.eigvalsh(H)
        assert constants.k_r_low <= eigenvalues[0]
        assert eigenvalues[-1] <= constants.k_r_high
        inertia = InertiaRange.at(system.controller.uncertainty, e, task)
        scale = eigenvalues[-1]
        assert np.linalg.eigvalsh(H - inertia.H_low)[0] >= -1e-9 * scale
        assert np.linalg.eigvalsh(inertia.H_high - H)[0] >= -1e-9 * scale


def test_an_arm_outside_the_declared_set_does_exceed_them() -> None:
    scenario = edited(scenario_of("ur5", "hybrid", "elastic", "plane"), "declared.viscous", 0.0)
    system, random = assemble(scenario), np.random.default_rng(2)
    heavy = Truth(np.full(6, 1.9), 0.0, np.zeros(3), 0.0, 0.0, 0.0, 0.0)
    exceeded = 0
    for _ in range(50):
        case = random_case(system, random)
        exceeded += perturbation(system, heavy, *case)[0] > sum(bounds_at(system, *case)[0])
    assert exceeded > 25


def test_estimates_along_the_reference_stay_within_their_deviation() -> None:
    """Remark 3: M_hat, C_hat, G_hat at (q_d, q_d_dot) differ from those at (q, q_dot) by no more than is declared."""
    system, random = declared_system("ur5"), np.random.default_rng(3)
    lipschitz = lipschitz_of(system)
    for _ in range(200):
        q = system.q_0 + random.uniform(-0.05, 0.05, 6)
        q_d = q + 10 ** random.uniform(-4, -1.5) * random.standard_normal(6)
        q_dot = random.standard_normal(6)
        q_d_dot = q_dot + 10 ** random.uniform(-3, -0.5) * random.standard_normal(6)
        d = lipschitz.deviation(float(np.linalg.norm(q - q_d)), q_dot, q_d_dot)
        here, there = system.nominal.evaluate(q, q_dot), system.nominal.evaluate(q_d, q_d_dot)
        assert np.linalg.norm(here.M_hat - there.M_hat, 2) <= d.delta_M
        assert np.linalg.norm(here.C_hat - there.C_hat, 2) <= d.delta_C
        assert np.linalg.norm(here.G_hat - there.G_hat) <= d.delta_G


def reaching(robot: str, seed: int, K_s: float, epsilon: float) -> Scenario:
    random = np.random.default_rng(seed)
    data = to_plain(shipped()["planar3r-hybrid" if robot == "planar3r" else "ur5-hybrid-reaching"])
    data["controller"] |= {
        "on_change": "watch",
        "K_s": K_s,
        "epsilon": epsilon,
        "layer": {"ur5": 0.006, "planar3r": 0.05}[robot],  # what 0.5 ms can hold still
        "period": 0.0005,
        "F_1": 20.0,
    }
    n = {"ur5": 6, "planar3r": 3}[robot]
    data["truth"]["link_scaling"] = (1.0 + 0.15 * random.uniform(-1, 1, n)).tolist()
    data["truth"] |= {"viscous": 0.2 * random.uniform(), "disturbance": 1.0 * random.uniform()}
    data["declared"] |= {"viscous": 0.2, "disturbance": 1.0}
    data["surface"]["origin"][2] -= 0.02
    data["simulation"]["duration"] = 0.6
    return from_plain(data)


@pytest.mark.parametrize("robot", ["ur5", "planar3r"])
@pytest.mark.parametrize(("K_s", "epsilon"), [(20.0, 1.0), (100.0, 5.0), (300.0, 20.0)])
def test_reaching_keeps_its_promise(robot: str, K_s: float, epsilon: float) -> None:
    for seed in range(3):
        loop, metrics = simulate(reaching(robot, seed, K_s, epsilon))
        first = loop.recording.rows()[0, loop.recording.columns["s_norm"]]
        assert first > loop.recording.rows()[0, loop.recording.columns["s_band"]]
        assert metrics.envelope_violation == 0.0
        assert metrics.reaching_time is not None
        assert 0.0 < metrics.reaching_time <= metrics.reaching_time_bound
        assert metrics.gain_condition_margin >= -1e-9


def test_below_the_gain_condition_nothing_is_promised() -> None:
    data = to_plain(reaching("ur5", 0, 20.0, 5.0))
    data["controller"] |= {"gain": "constant", "d": 0.5}
    data["truth"]["link_scaling"] = 1.6
    data["simulation"] |= {"bound_violation": "stop", "duration": 2.0}
    loop, metrics = simulate(from_plain(data))
    assert metrics.gain_condition_margin < 0
    assert loop.stopped is None  # where nothing is promised, nothing is broken
    assert metrics.promise.verdict == "nothing promised"
    failed = {finding.premise: finding.failed for finding in metrics.premises}
    assert failed["gain"] == failed["declared"] == 0.0
    s_norm = loop.recording.signals(("s_norm", "s_bound"))
    assert np.isnan(s_norm["s_bound"]).all()
    assert s_norm["s_norm"].max() > 0.3


def test_the_envelope_keeps_its_digits_where_K_s_is_almost_nothing() -> None:
    """Then V' = -c_2 sqrt(V), whose solution is a parabola."""
    c = ReachingCertificate(k_r_low=2.0, k_r_high=40.0, lambda_min_K_s=1e-15, epsilon=1.5, V_0=0.01)
    root = np.sqrt(c.V_0) - 0.5 * c.c_2 * (t := np.linspace(0.0, 0.5, 20))
    np.testing.assert_allclose([lyapunov_bound(c.bound, each) for each in t], root**2, rtol=1e-9)
    assert c.time_to(0.0) == pytest.approx(2.0 * np.sqrt(c.V_0) / c.c_2, rel=1e-9)
    assert c.t_r == pytest.approx(c.time_to(0.0), rel=1e-9)


def test_envelope_solves_the_comparison_equation() -> None:
    """(23), (24): V' = -c_1 V - c_2 sqrt(V), V = 0 at t_r (18)."""
    c = ReachingCertificate(k_r_low=2.0, k_r_high=30.0, lambda_min_K_s=50.0, epsilon=4.0, V_0=0.3)
    times = np.linspace(0.0, 0.98 * c.t_r, 30)
    solution = solve_ivp(
        lambda _, V: -c.c_1 * V - c.c_2 * np.sqrt(np.maximum(V, 0)), (0, times[-1]), [c.V_0], "DOP853", times,
        rtol=1e-11, atol=1e-14,
    )  # fmt: skip
    np.testing.assert_allclose(solution.y[0], [lyapunov_bound(c.bound, each) for each in times], rtol=1e-6)
    assert envelope(c.bound, c.t_r) == pytest.approx(0.0, abs=1e-9)
    assert envelope(c.bound, 0.999 * c.t_r) > 0
    np.testing.assert_allclose(envelope(c.bound, 0.0), np.sqrt(2 * c.V_0 / c.k_r_low))


def test_restart_with_s_removed_promises_no_reaching() -> None:
    scenario = edited(shipped()["ur5-hybrid-reaching"], "controller.on_change", "remove")
    _, metrics = simulate(edited(scenario, "simulation.duration", 0.2))
    assert metrics.reaching_time == 0.0
    assert metrics.reaching_time_bound == 0.0
