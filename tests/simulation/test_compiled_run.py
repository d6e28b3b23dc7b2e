"""Compiled runs against `ClosedLoop.step`: the same rows, and the same stop at the same period."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from app.scenario.data import edited, load, shipped, with_values
from app.scenario.schema import Scenario
from app.session.changes import blending_to
from app.simulation.closed_loop import ClosedLoop
from app.simulation.compiled_run import CompiledRun, obstacle
from app.simulation.period.compiled_period import INTEGRATOR_NUMBERS
from app.simulation.promise.premise_watch import PremiseWatch
from app.simulation.sampled_loop.sampled_stability import sampled_loop
from app.simulation.system import System
from app.simulation.warm_up import SILENT
from controllers.control_law import ControlLaw
from controllers.laws.table import fits_within
from controllers.premises import Premise
from environments import sensors
from environments.push import Grip
from kernels import inline
from parameters import Parameter
from tests.support.same_rows import require_same_rows

PERIODS, MANY = (70, 20, 60), (700, 300, 7000)  # compiled, by steps, and compiled again
CHIRP = {"truth.push_frequency": 30.0, "truth.push_sweep_to": 90.0}
TWIST = {"truth.push_moment": [1.0, -2.0, 1.5]}
PUSH = {"truth.push": [0.0, 30.0, 5.0], "truth.push_start": 0.03, "truth.push_duration": 0.02, "truth.push_every": 0.05}
SENSOR = {"sensor.noise": 0.5, "sensor.bias": [1.0, 2.0, 3.0], "sensor.delay": 0.003, "sensor.cutoff": 100.0}
MOMENTS = {"sensor.moment_delay": 0.002, "sensor.moment_noise": 0.02, "sensor.moment_bias": [0.1, 0.0, -0.2]}
SHAKEN = {"truth.disturbance": 5.0, "truth.disturbance_frequency": 20.0, "truth.coulomb": 1.0, "truth.viscous": 0.5}
OFF = PUSH | {"truth.push": [0.0, -40.0, 40.0], "truth.push_duration": 0.004, "simulation.leaving_domain": "flag"}
HEAVY = {"contact.kind": "mass-damper-spring", "contact.M_e": 1.0}
ROUGH = {"contact.unilateral": False, "contact.friction_coulomb": 0.2, "contact.friction_viscous": 5.0}
# what a scenario gets beside its own fields, of `ur5-hybrid` or of the scenario before the colon
CHANGES: dict[str, dict[str, object]] = {
    "substeps": {"simulation.substeps": 3},
    "euler": {"simulation.integrator": "semi-implicit-euler"},
    "rk4": {"simulation.integrator": "rk4", "simulation.substeps": 2, **PUSH, **SHAKEN},
    "heavy": HEAVY | ROUGH,
    "heavy, euler, ideal sensor": HEAVY | {"simulation.integrator": "semi-implicit-euler", "sensor.ideal": True},
    "heavy, rk4, pushed": HEAVY | PUSH | {"simulation.integrator": "rk4"},
    "heavy, ideal sensor": HEAVY | PUSH | {"sensor.ideal": True},
    "ur5-constrained: euler": {"simulation.integrator": "semi-implicit-euler", "simulation.substeps": 2},
    "ur5-constrained: rk4": {"simulation.integrator": "rk4"},
    "ur5-constrained: bilateral, pushed": ROUGH | PUSH | SENSOR,
    "ur5-constrained: ideal sensor": {"sensor.ideal": True},
    "noise": {"sensor.noise": 0.5},
    "delay": {"sensor.delay": 0.003},
    "low-pass": {"sensor.cutoff": 100.0, "sensor.bias": [1.0, 2.0, 3.0]},
    "ur5-impedance: pushed, noisy, late": PUSH | SENSOR,
    "ur5-impedance-6d: twisted, noisy, late": PUSH | CHIRP | TWIST | SENSOR | MOMENTS,
    "heavy, pushed and twisted": HEAVY | PUSH | TWIST | MOMENTS,
    "along the reference": {"controller.estimates": "along-reference", "controller.law": "vsmrc"},
    "computed torque": {"controller.law": "computed-torque"},
    "pd": {"controller.law": "pd-gravity"},
    "drives at their limits": {"truth.torque_limit": [30.0] * 6},
    "ur5-hybrid-reaching: sudden": {"controller.switching": "discontinuous"},
    "shaken until it stops": {"truth.disturbance": 200.0, "truth.torque_limit": [1.0] * 6},
    "ur5-constrained: let go and met again": {
        "simulation.leaving_domain": "flag",
        "target_model.K_f": [0.2, *[0.0] * 5],
    },
    "ur5-corner-rigid: pulled off, rk4": OFF | {"simulation.integrator": "rk4", "sensor.ideal": False},
    "ur5-corner-rigid: pulled off, ideal sensor": OFF,
    "ur5-constrained: pulled off until it stops": PUSH | {"truth.push": [0.0, 0.0, 400.0]},
}


def changed(name: str) -> Scenario:
    """The scenario of a row of `CHANGES`."""
    base, _, _ = name.rpartition(": ")
    scenario = load(base or "ur5-hybrid")
    for path, value in CHANGES[name].items():
        scenario = edited(scenario, path, value)
    return scenario


def scenarios() -> dict[str, Scenario]:
    """Every row of `CHANGES`, and blends."""
    base = load("ur5-hybrid")
    softer = edited(base, "target_model", {"B_m": [300.0, *[600.0] * 5], "K_m": [0.0, *[6000.0] * 5]})
    return {
        **{name: changed(name) for name in CHANGES},
        "blend": blending_to(base, softer, 0.03, 0.05),
        "blend without a beginning": blending_to(base, softer, 0.0, 0.02),
    }


def loops(scenario: Scenario, periods: tuple[int, int, int]) -> tuple[ClosedLoop, ClosedLoop]:
    """The run by steps, and the other, by turns compiled and by steps; no two of them share memory."""
    stepped, compiled = ClosedLoop.from_scenario(scenario), ClosedLoop.from_scenario(scenario)
    for _ in range(sum(periods)):
        stepped.advance()
    run = CompiledRun(compiled)
    first, between, last = periods
    run.advance(first)
    for _ in range(between):
        compiled.advance()
    run.advance(last)
    return stepped, compiled


@pytest.mark.parametrize("name", scenarios())
def test_compiled_run_has_the_rows_of_the_steps(name: str) -> None:
    stepped, compiled = loops(scenarios()[name], PERIODS)
    assert (stepped.stopped is not None) == name.endswith("until it stops")
    require_same_rows(stepped, compiled)


def test_both_lose_the_promise_where_surfaces_go_where_no_search_has_been() -> None:
    """Two planes move at frequencies that do not go together, and the run outlasts its duration."""
    scenario = with_values(
        load("ur5-corner"),
        {
            "motion": "hold",
            "surface.motion.amplitude": 0.003,
            "surface.motion.frequency": 0.5,
            "second.surface.motion.amplitude": 0.003,
            "second.surface.motion.frequency": 0.7,
            "second.surface.motion.direction": [0.0, 1.0, 0.0],
            "simulation.duration": 0.1,
        },
    )
    stepped, compiled = loops(scenario, (60, 20, 170))
    require_same_rows(stepped, compiled)
    for loop in (stepped, compiled):
        (found,) = [each for each in loop.standing.findings if each.premise == "domain"]
        assert found.failed == pytest.approx(0.12, abs=0.021)
        assert np.isnan(loop.recording.stretch()["s_bound"][-1])


@inline
def pid(given, out, x, x_dot):
    """PID with gravity: its state is the integral of e_r, of which it gets a copy."""
    model, J_q, n = given.gains.model, given.task.J_q, out.tau.shape[0]
    for i in range(n):
        x_dot[i] = out.e_r[i]
        pulled = given.parameters.k_i * x[i] - given.parameters.share * given.F[i]
        for k in range(n):
            pulled += model.K_m[i, k] * out.e_r[k] + model.B_m[i, k] * out.e_r_dot[k]
        x[i] = np.nan
        for j in range(n):
            out.terms.linear[j] -= J_q[i, j] * pulled
    for j in range(n):
        out.terms.gravity[j] = given.feedforward.G_hat[j]


@inline
def failing(given, out):
    out.d = 0.0
    if given.q[0] != 0.0:
        raise ValueError("it does not like this posture")


NUMBERS = (
    Parameter("k_i", 5e3, 0.0, 1e5, "N/(m·s)", "on the integral"),
    Parameter("share", 0.1, 0.0, 1.0, "1", "of F"),
)
PID = ControlLaw("pid", "PID", "PID", torque=pid, states=lambda n: n, parameters=NUMBERS)
FAILING = ControlLaw("failing", "failing", "It fails.", torque=failing)


@pytest.mark.slow  # it compiles what is of no use to another process
@pytest.mark.parametrize("name", ["ur5-hybrid", "ur5-constrained"])
def test_law_with_a_state_and_parameters_has_the_rows_of_the_steps(name: str) -> None:
    """Also where an ideal sensor asks the law again and again in one period."""
    scenario = edited(load(name), "sensor.ideal", name == "ur5-constrained")
    system = under(PID, scenario, {"k_i": 4000.0, "share": 0.05})
    assert not fits_within(PID)
    stepped, compiled = (ClosedLoop.from_system(system) for _ in range(2))
    run = CompiledRun(compiled)
    run.advance(70)
    for _ in range(20):
        compiled.advance()
    run.advance(60)
    for _ in range(150):
        stepped.advance()
    require_same_rows(stepped, compiled)
    np.testing.assert_allclose(compiled.state.x, stepped.state.x, rtol=1e-9, atol=1e-15)
    assert np.abs(stepped.state.x).max() > 0.0


@pytest.mark.slow
def test_the_sampled_loop_counts_the_state_of_a_law() -> None:
    """An integral so strong that the arm swings up: the growth of a period is that of the run."""
    system = under(PID, edited(load("ur5-motion"), "motion", "hold"), {"k_i": 1e5, "share": 0.0})
    growth = float(sampled_loop(system, system.q_0, 0.0).premises[Premise.SAMPLED_LOOP])
    assert growth > 1.001
    loop = ClosedLoop.from_system(system)
    CompiledRun(loop).advance(3000)
    errors = np.linalg.norm(loop.recording.stretch()["e_r"][:, :3], axis=1)
    earlier, later = errors[1500:2000].max(), errors[2500:].max()
    assert np.log(later / earlier) / 1000 == pytest.approx(np.log(growth), rel=0.1)


@pytest.mark.slow
def test_law_of_your_own_that_fails_is_named_with_its_line() -> None:
    loops = [ClosedLoop.from_system(under(FAILING, load("ur5-hybrid"), {})) for _ in range(2)]
    for _ in range(5):
        loops[0].advance()
    CompiledRun(loops[1]).advance(5)
    assert loops[0].stopped == loops[1].stopped
    assert "test_compiled_run.py, line " in (loops[1].stopped or "")


def test_a_posture_check_that_fails_stops_both(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_nearest: int) -> None:
        raise ValueError("no loop")

    stepped, compiled = (ClosedLoop.from_scenario(load("ur5-hybrid")) for _ in range(2))
    for loop in (stepped, compiled):
        monkeypatch.setattr(loop.premise_watch, "judge_posture", fail)
    stepped.advance()
    monkeypatch.setattr(PremiseWatch, "judged_station", -2)  # elsewhere, so that the first period is judged
    assert CompiledRun(compiled).advance(3) == 0
    assert compiled.stopped == stepped.stopped == "t = 0.000 s: the control law failed (no loop)"
    assert len(compiled.recording) == len(stepped.recording) == 0


def under(law: ControlLaw, scenario: Scenario, parameters: dict[str, float]) -> System:
    """System of the scenario with another law."""
    system = ClosedLoop.from_scenario(scenario).system
    return replace(system, controller=replace(system.controller, law=law, parameters=parameters))


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in shipped() if not name.endswith("discontinuous")])
def test_shipped_scenarios_have_the_rows_of_the_steps_for_eight_seconds(name: str) -> None:
    stepped, compiled = loops(load(name), MANY)
    assert stepped.stopped is None
    require_same_rows(stepped, compiled)


def test_a_discontinuous_law_chatters_as_much_in_both() -> None:
    stepped, compiled = (
        ClosedLoop.from_scenario(load("ur5-motion-discontinuous")),
        ClosedLoop.from_scenario(load("ur5-motion-discontinuous")),
    )
    CompiledRun(compiled).advance(2000)
    for _ in range(2000):
        stepped.advance()
    for signal in ("s_norm", "tau_switching", "e_r"):
        sizes = [np.sqrt(np.mean(loop.recording.stretch()[signal] ** 2)) for loop in (stepped, compiled)]
        assert sizes[1] == pytest.approx(sizes[0], rel=0.02), signal


def test_reader_continues_with_the_same_noise_after_any_number_of_readings() -> None:
    loop, other = (ClosedLoop.from_scenario(changed("ur5-impedance-6d: twisted, noisy, late")) for _ in range(2))
    CompiledRun(loop).advance(7)
    for _ in range(7):
        other.advance()
    F = np.array([1.0, -2.0, 3.0, 0.1, -0.2, 0.3])
    for _ in range(10):
        np.testing.assert_allclose(loop.state.reader.read(F), other.state.reader.read(F), rtol=0.0, atol=1e-11)


def test_obstacle_names_why_a_run_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    base = load("ur5-hybrid")
    held = ClosedLoop.from_scenario(base)
    assert obstacle(held) is None
    held.drag_tool(Grip((0.0, 0.0, 0.0)))
    assert obstacle(held) == "a hand holds the tool"

    system = ClosedLoop.from_scenario(base).system
    own = replace(system, controller=replace(system.controller, law=SILENT, parameters={}))
    with pytest.raises(ValueError, match=r"controller\.law: 'silent' is in plain numpy"):
        CompiledRun(ClosedLoop.from_system(own))

    class Clip(sensors.Bias):
        """A stage that the compiled run does not know."""

    monkeypatch.setattr(sensors, "STAGES", (Clip,))
    clipped = ClosedLoop.from_scenario(edited(base, "sensor.bias", [1.0, 0.0, 0.0]))
    assert obstacle(clipped) == "the force sensor has a stage that is known to the interpreter only"

    monkeypatch.delitem(INTEGRATOR_NUMBERS, "rk4")
    with pytest.raises(ValueError, match=r"simulation\.integrator: 'rk4' is known to the interpreter only"):
        CompiledRun(ClosedLoop.from_scenario(edited(base, "simulation.integrator", "rk4")))
