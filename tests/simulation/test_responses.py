"""Runs held to closed forms: (29), (42), the wall's steady force, and where the sampled loops break."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm

from app.analysis.steady_force import steady_force_error
from app.evidence.closed_form_runs import certain, changed, pressed
from app.scenario.data import edited, from_plain, shipped, to_plain, with_values
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.session.headless_run import simulate
from app.simulation.assembly import assemble
from app.simulation.closed_loop import ClosedLoop
from app.simulation.compiled_run import CompiledRun
from app.simulation.sampled_loop.period_map import Posture
from app.simulation.sampled_loop.sampled_force_loop import force_factor
from app.simulation.state import State
from app.simulation.system import System
from controllers.force_loop import force_loop_factors
from controllers.premises import Premise
from environments.truth import Truth
from tests.support.cases import scenario_of

pytestmark = pytest.mark.slow  # long or many simulations


@pytest.mark.parametrize(("K_m", "K_f"), [(2000.0, 1.0), (500.0, 1.0), (2000.0, 0.4)])
def test_steady_force_of_a_wall_under_impedance(K_m: float, K_f: float) -> None:
    """F_ss = K_e [K_f F_d + K_m (x_d - x_e)] / (K_m + K_f K_e), here with F_d = 0, whatever the arm weighs."""
    base = shipped()["ur5-impedance"]
    model = {"K_m": [K_m] * 6, "B_m": [2 * math.sqrt(10 * K_m)] * 6, "K_f": [K_f] * 6}
    scenario = changed(base, target_model=model, simulation={"duration": 4.0})
    scenario = changed(scenario, motion={"kind": "point-to-point", "displacement": [0.0, 0.0, -0.04], "duration": 1.0})
    loop, _ = simulate(scenario)
    last = loop.recording.at(loop.t)
    x_d, x_e, K_e = last["r_d"][2], 0.17, scenario.contact.K_e
    assert last["multiplier"][0] == pytest.approx(K_e * K_m * (x_e - x_d) / (K_m + K_f * K_e), rel=1e-4)


@pytest.mark.parametrize("law", ["vsmrc", "computed-torque", "pd-gravity"])
def test_the_foretold_force_is_that_of_a_law_without_a_sensor_too(law: str) -> None:
    """PD presses with the desired force, as with K_f = 1, whatever K_f is."""
    scenario = with_values(
        shipped()["ur5-hybrid"],
        {
            "controller.law": law, "controller.K_e_hat": 5000.0, "motion": {"kind": "hold"}, "truth": {},
            "declared": {}, "simulation.duration": 3.0, "target_model.K_m": (2000.0,) + (4000.0,) * 5,
            "target_model.K_f": ((3.0,) + (0.0,) * 5,) + ((0.0,) * 6,) * 5,
        },
    )  # fmt: skip
    loop = ClosedLoop.from_scenario(scenario)
    CompiledRun(loop).advance(3000)
    last = loop.recording.at(loop.t)
    error = last["multiplier"][0] - last["F_cd"][0]
    assert error == pytest.approx(steady_force_error(loop.system, last["r_d"], last["F_cd"], last["s"]), rel=1e-2)
    assert error == pytest.approx({"pd-gravity": 10.0 / 3.0}.get(law, 1.25), rel=1e-2)


@pytest.mark.parametrize("M_e", [0.0, 3.0])
def test_impedance_response_is_that_of_the_matrix_exponential(M_e: float) -> None:
    """(29): the error is of first order in the control period, and small."""
    errors = []
    for period in (0.002, 0.001, 0.0005):
        response = pressed(M_e, period)
        errors.append(response.error)
        assert np.ptp(response.exact) > 0.003
    assert errors[-1] < 5e-5
    assert 1.6 < errors[0] / errors[1] < 2.4
    assert 1.6 < errors[1] / errors[2] < 2.4


def test_moving_surface_error_obeys_the_target_model() -> None:
    """With s(0) = 0 the error of a tool at rest on a surface that begins to move is the free response of (8)."""
    base = certain(shipped()["ur5-hybrid-moving"])
    scenario = changed(
        base,
        motion={"kind": "hold"},
        controller={"period": 0.0005},
        surface={
            "kind": "plane", "origin": [0.0, 0.0, 0.17],
            "motion": {"direction": [1.0, 0.0, 0.0], "amplitude": 0.02, "frequency": 0.5},
        },
        simulation={"duration": 0.5},
    )  # fmt: skip
    loop, _ = simulate(scenario)
    record = loop.recording.signals(("t", "e_r", "e_r_dot"))
    along = int(np.argmax(np.abs(record["e_r_dot"][0])))
    A = np.array([[0.0, 1.0], [-400.0, -40.0]])
    start = np.array([record["e_r"][0, along], record["e_r_dot"][0, along]])
    exact = np.array([(expm(A * t) @ start)[0] for t in record["t"]])
    assert np.abs(start[1]) > 0.05
    assert np.abs(exact).max() > 5e-4
    np.testing.assert_allclose(record["e_r"][:, along], exact, atol=3e-5)


def on_rigid(M_m1: float, **sensor: object) -> tuple[ClosedLoop, float]:
    base = certain(shipped()["ur5-constrained"])
    scenario = changed(
        base,
        motion={"kind": "hold"},
        contact={"unilateral": False},
        force={"kind": "sinusoid", "value": 20.0, "amplitude": 0.01, "frequency": 2.0},  # something to grow from
        target_model={"M_m": [M_m1, 10, 10, 10, 10, 10]},
        sensor=sensor,
        simulation={"duration": 0.3},
    )
    loop, _ = simulate(scenario)
    record = loop.recording.signals(("multiplier", "F_cd"))
    return loop, float(np.abs(record["multiplier"] - record["F_cd"][:, 0])[-1])


def test_sampled_force_loop_diverges_where_its_factor_says() -> None:
    """The factor is 1 - h/M_m1 with the effective mass h = 1/(H^-1)_11, not H_11."""
    system = assemble(certain(shipped()["ur5-constrained"]))
    e, task = system.observe(system.q_0, np.zeros(6), 0.0)
    H = task.J_q_inv.T @ e.M_hat @ task.J_q_inv
    h = float(1.0 / np.linalg.inv(H)[0, 0])
    assert H[0, 0] > 1.1 * h
    model, normal = system.controller.model, np.eye(6)[0]
    one = normal[:, None]
    assert force_loop_factors(H, H, model, one, one, one, np.array([[np.inf]])) == pytest.approx(
        1 - h / model.M_m[0, 0]
    )
    stable, error = on_rigid(h / 1.9)
    assert stable.warning is None
    assert error < 1e-3
    unstable, error = on_rigid(h / 2.1)
    assert "sampled force loop diverges" in (unstable.warning or "")
    assert error > 1.0 or unstable.stopped is not None
    ideal, error = on_rigid(h / 2.1, ideal=True)
    assert ideal.stopped is None
    assert error < 1e-3


def test_constrained_force_and_surface() -> None:
    """(42): lambda = lambda_d, also when it varies, and phi = 0 at machine level."""
    base = shipped()["ur5-constrained"]
    scenario = changed(
        base,
        force={"kind": "sinusoid", "value": 20.0, "amplitude": 5.0, "frequency": 1.0},
        sensor={"ideal": True},
        contact={"friction_coulomb": 0.2},
        simulation={"duration": 2.0},
    )
    _, metrics = simulate(scenario)
    assert metrics.force_error_tail is not None
    assert metrics.constraint_violation is not None
    assert metrics.force_error_tail < 0.3
    assert metrics.constraint_violation < 1e-14


@pytest.mark.parametrize("kind", ["rigid", "mass-damper-spring"])
def test_contact_acceleration_obeys_the_law_of_the_surface(kind: str) -> None:
    """phi_ddot = 0 on a rigid surface, and lambda = M_e (phi_ddot + a_e) + B_e phi_dot + K_e phi (28) on a heavy one,
    with phi_ddot differenced along the motion of a tool that slides over a moving sphere."""
    mode = "constrained" if kind == "rigid" else "hybrid"
    data = to_plain(scenario_of("ur5", mode, kind, "moving sphere"))
    data["contact"] |= {"unilateral": False, "M_e": 2.0, "B_e": 5.0, "K_e": 3000.0}
    data["simulation"]["integrator"] = "semi-implicit-euler"  # which evaluates the acceleration at the state itself
    data["surface"]["motion"] = {"direction": [0.5, 0.3, 1.0], "amplitude": 0.1, "frequency": 1.0}
    system = assemble(from_plain(data))
    random, t = np.random.default_rng(0), 0.05
    q_dot = random.uniform(-1.0, 1.0, 6)
    state = system.plant.start(system.q_0 + 0.02, q_dot, t)
    tau = 20.0 * random.standard_normal(6)
    load = system.plant.respond(state, tau, t, 1e-3)
    before, after = state.copy().views, state.copy()
    system.plant.advance(after, tau, t, 1e-3)
    q_ddot = after.views.q_ddot

    def phi(h: float) -> float:
        q = before.q + h * before.q_dot + 0.5 * h * h * q_ddot
        return system.surface.chart(system.nominal.evaluate(q, q_dot).p, t + h).g[0]

    h = 1e-4
    phi_dot, phi_ddot = (phi(h) - phi(-h)) / (2 * h), (phi(h) - 2 * phi(0.0) + phi(-h)) / h**2
    assert abs(load.multiplier[0]) > 1.0
    if kind == "rigid":
        assert phi_dot == pytest.approx(0.0, abs=1e-6)
        assert phi_ddot == pytest.approx(0.0, abs=1e-4)
    else:
        p, moved = system.nominal.evaluate(before.q, q_dot).p, system.surface.motion.offset
        a_e = system.surface.chart(p, t).G[0] @ (moved(t + h) - 2 * moved(t) + moved(t - h)) / h**2
        expected = 2.0 * (phi_ddot + a_e) + 5.0 * phi_dot + 3000.0 * phi(0.0)
        assert load.multiplier[0] == pytest.approx(expected, abs=1e-3)


def test_lost_contact_and_singular_postures_stop_with_their_reason() -> None:
    pulled = changed(shipped()["ur5-constrained"], force={"kind": "step", "value": -5.0, "start": 10.0, "time": 0.1})
    loop, metrics = simulate(pulled)
    assert "contact lost" in (metrics.stopped or "")
    assert len(loop.recording) > 100
    stretched = changed(
        Scenario(),
        robot={"name": "planar2r"},
        motion={"kind": "point-to-point", "displacement": [0.2], "duration": 1.0},
        simulation={"sigma_min": 0.2},
    )
    loop, metrics = simulate(stretched)
    assert "nearly singular" in (metrics.stopped or "")
    flagged, metrics = simulate(edited(stretched, "simulation.leaving_domain", "flag"))
    assert metrics.stopped is None
    assert "nearly singular" in (flagged.warning or "")
    with pytest.raises(ScenarioError, match="cannot follow the reference"):
        assemble(changed(stretched, motion={"kind": "point-to-point", "displacement": [0.5]}))


@pytest.mark.parametrize("n", [2, 3, 6, 7])
@pytest.mark.parametrize("frequency", [0.0, 0.5])
def test_the_disturbance_has_its_norm_at_all_times(n: int, frequency: float) -> None:
    truth = Truth(np.ones(n), 0.0, np.zeros(3), 0.0, 0.0, 3.0, frequency)
    torques = np.array([truth.torque(np.zeros(n), t) for t in np.linspace(0.0, 2.0, 41)])
    np.testing.assert_allclose(np.linalg.norm(torques, axis=1), 3.0)


@pytest.mark.parametrize(
    ("force", "message"),
    [
        ({"kind": "constant", "value": -10.0}, "force.value: -10 N, but the surface only pushes"),
        ({"kind": "step", "value": 5.0, "start": -1.0}, "force.start: -1 N, but the surface only pushes"),
        ({"kind": "sinusoid", "value": 5.0, "amplitude": 20.0}, "force.amplitude: 20 N around 5 N"),
        ({"kind": "sinusoid", "value": -5.0, "amplitude": 2.0}, "force.value: -5 N"),
    ],
)
@pytest.mark.parametrize("kind", ["elastic", "mass-damper-spring"])
def test_a_force_that_a_pushing_surface_cannot_have_is_refused(
    kind: str, force: dict[str, object], message: str
) -> None:
    pulling = changed(shipped()["ur5-hybrid"], contact={"kind": kind, "unilateral": True}, force=force)
    with pytest.raises(ScenarioError, match=message) as refused:
        assemble(pulling)
    assert str(refused.value).endswith("or contact.unilateral = false")
    assemble(edited(pulling, "contact.unilateral", False))


def test_a_surface_out_of_reach_is_what_is_blamed() -> None:
    x, y, _ = shipped()["ur5-hybrid"].surface.origin
    far = changed(shipped()["ur5-hybrid"], surface={"kind": "plane", "origin": [x, y, -3.0]})
    with pytest.raises(ScenarioError, match=r"^surface: out of the arm's reach, 3\.\d+ m ahead of the tool at "):
        assemble(far)


def test_unilateral_surface_only_pushes_and_friction_only_opposes() -> None:
    base = changed(
        shipped()["ur5-hybrid"],
        surface={"kind": "plane", "origin": [0.0, 0.0, 0.16]},
        contact={"friction_coulomb": 0.3},
    )
    loop, _ = simulate(changed(base, simulation={"duration": 2.0}))
    record = loop.recording.signals(("multiplier", "phi", "F_true", "q", "q_dot"))
    assert record["multiplier"].min() == 0.0
    assert np.all(record["multiplier"][record["phi"] <= 0] == 0.0)
    velocity = np.array([
        loop.system.nominal.evaluate(q, v).J_v @ v for q, v in zip(record["q"], record["q_dot"], strict=True)
    ])  # fmt: skip
    rubbing = (record["F_true"][:, :2] * velocity[:, :2]).sum(axis=1)
    assert rubbing.min() >= 0.0
    assert rubbing.max() > 0.05


def test_integrators_agree_and_substeps_refine() -> None:
    base = changed(shipped()["ur5-hybrid"], simulation={"duration": 0.3})

    def final(integrator: str, substeps: int) -> np.ndarray:
        loop, _ = simulate(changed(base, simulation={"integrator": integrator, "substeps": substeps}))
        return loop.recording.rows()[-1, loop.recording.columns["q"]]

    exact = final("rk4", 16)
    coarse, fine = (np.abs(final("semi-implicit-euler", k) - exact).max() for k in (2, 8))
    assert 2.5 < coarse / fine < 6.0
    assert np.abs(final("rk4", 2) - exact).max() < 0.05 * fine


def test_robust_law_beats_its_baseline_and_estimates_may_be_taken_beforehand() -> None:
    scenario = changed(shipped()["ur5-motion"], simulation={"duration": 3.0})
    errors = {
        name: simulate(edited(scenario, f"controller.{field}", name))[1].motion_error_tail
        for field, name in (("law", "vsmrc"), ("law", "computed-torque"), ("estimates", "along-reference"))
    }
    assert errors["vsmrc"] < 5e-5
    assert errors["along-reference"] < 5e-5
    assert errors["computed-torque"] > 50 * errors["vsmrc"]


def test_promise_holds_with_each_of_the_other_smooth_switching_functions() -> None:
    base, rows = edited(shipped()["planar3r-hybrid"], "simulation.duration", 2.0), []
    for switching in ("rational", "tanh"):
        loop, metrics = simulate(edited(base, "controller.switching", switching))
        assert (metrics.promise.verdict, metrics.envelope_violation) == ("holds", 0.0)
        assert metrics.motion_error_tail < 2e-4
        rows.append(loop.recording.signals(("tau_switching",))["tau_switching"])
    assert np.abs(rows[0] - rows[1]).max() > 0.05 * np.abs(rows[0]).max()


def test_motion_control_is_judged_along_the_normal_of_a_surface_too() -> None:
    """It knows of no surface: the force of one, here some 20 N, pushes the arm off its path along the normal."""
    scenario = changed(
        shipped()["ur5-motion"],
        motion={"kind": "hold"},
        simulation={"duration": 1.0},
        controller={"law": "computed-torque"},
        contact={"kind": "elastic", "K_e": 5000.0},
        surface={"kind": "plane", "origin": [0.5, 0.1, 0.1855], "normal": [0.0, 0.0, 1.0]},
    )
    loop, metrics = simulate(scenario)
    last = loop.recording.at(loop.t)
    assert abs(last["e_r"][2]) > 5.0 * np.linalg.norm(last["e_r"][:2])
    assert metrics.motion_error_tail == pytest.approx(np.linalg.norm(last["e_r"][:3]), rel=1e-2)


def test_sensor_errors_show_up_in_the_force() -> None:
    base = changed(shipped()["planar3r-hybrid"], motion={"kind": "hold"}, simulation={"duration": 2.0})
    biased, _ = simulate(changed(base, sensor={"bias": [0.0, 0.0, -1.5]}))
    last = biased.recording.at(biased.t)
    assert last["multiplier"][0] == pytest.approx(20.0 - 1.5, abs=0.01)
    noisy = changed(base, sensor={"noise": 0.5, "cutoff": 50.0, "delay": 0.003})
    record = simulate(noisy)[0].recording.signals(("F", "F_true"))
    assert 0.05 < np.std((record["F"] - record["F_true"])[-500:]) < 0.3
    other = simulate(edited(noisy, "simulation.seed", 1))[0].recording.signals(("F",))
    assert not np.array_equal(other["F"], record["F"])


def after_a_reading(system: System, q_dot: np.ndarray) -> float:
    """Change of the force in the period after a reading, per change of that reading, at a velocity of the arm."""
    found, size = [], 1e-3
    for error in (-size, size):
        loop = ClosedLoop.from_system_and_state(system, State.at(system, system.q_0, q_dot, 0.0))
        loop.step()
        load = loop.state.arm.views.load
        before = load.multiplier[0]
        load.wrench[:] *= 1.0 + error
        loop.step()
        found.append(load.multiplier[0])
    return float((found[1] - found[0]) / (2 * size * before))


@pytest.mark.parametrize(("mode", "contact"), [("constrained", "rigid"), ("hybrid", "mass-damper-spring")])
def test_friction_moves_the_factor_of_the_force_loop_by_the_direction_of_slip(mode: str, contact: str) -> None:
    friction = 0.8
    scenario = changed(
        certain(scenario_of("ur5", mode, contact, "plane")),
        contact={"M_e": 5.0, "B_e": 50.0, "K_e": 5000.0, "unilateral": False, "friction_coulomb": friction},
        motion={"kind": "hold"},
        sensor={"noise": 0.0},
    )
    system = assemble(scenario)
    at = Posture.of(system, system.q_0, 0.0)
    e, normal, one = at.estimate, system.surface.chart(at.estimate.p, 0.0).G[0], np.eye(6)[:, :1]
    mass = np.array([[np.inf if contact == "rigid" else 5.0]])
    found = []
    for angle in np.linspace(0.0, 2 * np.pi, 8, endpoint=False):
        slip = np.array([np.cos(angle), np.sin(angle), 0.0])
        load = at.task.J_q_inv.T @ (e.J_v.T @ (normal + friction * slip))
        columns = one, load[:, None], one, mass
        (factor,) = force_loop_factors(at.H_hat, at.H_hat, system.controller.model, *columns)
        moving = np.linalg.solve(np.vstack([e.J_v, e.J_w]), np.concatenate([0.1 * slip, np.zeros(3)]))
        found.append(after_a_reading(system, moving))
        assert found[-1] == pytest.approx(factor, abs=2e-3)
    assert np.ptp(found) > 0.15
    assert force_factor(system, at) == pytest.approx(max(found, key=abs), rel=0.05)
    assert abs(force_factor(system, at)) >= max(np.abs(found)) - 2e-3


@pytest.mark.parametrize("friction", [0.0, 0.8])
def test_friction_breaks_a_force_loop_that_holds_without_it(friction: float) -> None:
    base = changed(
        certain(scenario_of("ur5", "constrained", "rigid", "plane")),
        contact={"unilateral": False, "friction_coulomb": friction},
        sensor={"noise": 0.0},
        motion={"kind": "line", "displacement": [0.1]},
        simulation={"duration": 0.2},
    )
    model = {"target_model.M_m": [3.5] + [10.0] * 5, "target_model.B_m": [100.0] + [400.0] * 5}
    loop, _ = simulate(with_values(base, model))
    factor = loop.sampled.premises[Premise.FORCE_LOOP]
    force = loop.recording.signals(("multiplier",))["multiplier"]
    swings = np.abs(np.diff(force[-50:])).max()
    assert (swings > 5.0) == (factor > 1.0) == (friction > 0.0)
    assert swings > 5.0 or swings < 1e-5
