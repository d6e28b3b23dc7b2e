"""Limits of the promise: runs that once left the theorem's domain under all premises, and what each premise is now."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from app.scenario.data import from_plain, load, to_plain
from app.scenario.errors import UnboundedGain
from app.scenario.schema import Scenario
from app.simulation.closed_loop import ClosedLoop
from app.simulation.compiled_run import CompiledRun
from app.simulation.sampled_loop.sampled_stability import sampled_loop
from controllers.bounds import InertiaRange
from controllers.posture_check import _falling_from
from controllers.premises import Premise
from controllers.switching import SAMPLING_SHARE
from environments.integrators import IntegratorName
from tests.support.cases import changed, run, value


def viscous(rate: float, period: float) -> Scenario:
    """A known arm, declared to have viscous joints, whose torque chatters."""
    return changed(
        "ur5-motion",
        declared={"link_scaling": 0.0, "viscous": rate},
        truth={"link_scaling": 1.0},
        controller={"switching": "discontinuous", "epsilon": 5.0, "period": period},
    )


def test_a_gain_that_chatters_by_friction_is_part_of_the_feedback() -> None:
    loop = run(viscous(30.0, 1e-3), 1e-3)
    seen, check = loop.state.evaluation.part("seen"), loop.state.evaluation.part("posture_check")
    expected = 30.0 * seen.task.J_q_inv_norm**2 * loop.period / check.H_min
    assert value(loop, Premise.GAIN_BY_CHATTER) == pytest.approx(expected, rel=1e-9)
    with pytest.raises(UnboundedGain, match=r"chattering feeds .*, or a smaller declared\.viscous"):
        ClosedLoop.from_scenario(viscous(100.0, 2e-3))


@pytest.mark.parametrize("integrator", ["leapfrog", "semi-implicit-euler", "rk4"])
@pytest.mark.parametrize("engine", ["pinocchio", "compiled"])
def test_the_impulse_of_a_period_is_that_of_the_contact_force(integrator: IntegratorName, engine: str) -> None:
    """The tool meets the surface within the run; the sum of all impulses is the force's integral over time."""
    scenario = changed("ur5-hybrid", simulation={"integrator": integrator, "substeps": 3}, motion={"kind": "hold"})
    loop = ClosedLoop.from_scenario(scenario)
    forces, impulses = [loop.state.arm.views.load.wrench.copy()], []
    for _ in range(400):
        if engine == "compiled":
            CompiledRun(loop).advance(1)
        else:
            loop.step()
        forces.append(loop.state.arm.views.load.wrench.copy())
        impulses.append(loop.state.arm.views.impulse.copy())
    integral = loop.period * np.array([0.5 * (a + b) for a, b in pairwise(forces)])
    scale = np.abs(integral[:, 2]).max()
    assert scale > 0.0
    assert np.abs(np.array(impulses) - integral).max() < 0.02 * scale


def test_a_bounce_between_two_samples_counts() -> None:
    """The tool falls onto a stiff surface and has left it again at the next sample: both forces read are nearly equal,
    and s has jumped."""
    scenario = from_plain(
        {
            "mode": "motion",
            "robot": {"name": "planar2r"},
            "surface": {"kind": "plane", "origin": [0.0, 0.0, 0.1947978747626396], "normal": [0.0, 0.0, -1.0]},
            "contact": {"kind": "elastic", "K_e": 6555135.0, "B_e": 3276.0},
            "motion": {"kind": "line", "displacement": [0.0, -0.3], "period": 4.0, "ramp": 0.5},
            "controller": {"F_1": 0.001, "K_s": 140.0, "epsilon": 1.09, "layer": 0.04, "period": 0.001609},
            "simulation": {"duration": 2.0, "substeps": 100, "domain_radius": 0.3},
        }
    )
    loop = run(scenario, 0.75)
    assert np.isnan(loop.promise_record.broken)
    assert loop.state.evaluation.views.table.failed[Premise.HELD] == pytest.approx(0.6806, abs=2e-3)


def tilting(**tilt: Any) -> Scenario:
    """A rigid plane that tilts about the tool, which rests: its normal becomes that of a larger inertia."""
    system = ClosedLoop.from_scenario(load("ur5-constrained")).system
    p = system.observe(system.q_0, 0.0 * system.q_0, 0.0)[0].p
    return changed(
        "ur5-constrained",
        surface={"kind": "plane", "normal": [0.0, 0.0, -1.0], "origin": p.tolist(), "tilt": tilt},
        contact={"unilateral": False},
        motion={"kind": "hold"},
        declared={"link_scaling": 0.0},
        truth={"link_scaling": 1.0},
        target_model={"M_m": [4.118, *[10.0] * 5], "B_m": [100.0, *[400.0] * 5]},
    )


def test_the_force_loop_is_judged_again_while_a_surface_tilts() -> None:
    loop = ClosedLoop.from_scenario(tilting(amplitude=0.5, frequency=0.1, axis=[-0.64, -0.77, 0.0]))
    begun = value(loop, Premise.FORCE_LOOP)
    for _ in range(6):
        CompiledRun(loop).advance(200)
        fresh = sampled_loop(loop.system, loop.state.arm.views.q.copy(), loop.t).premises[Premise.FORCE_LOOP]
        assert value(loop, Premise.FORCE_LOOP) == pytest.approx(fresh, abs=0.03)
    assert abs(value(loop, Premise.FORCE_LOOP) - begun) > 0.1


def test_the_constants_know_every_tilt_of_a_plane() -> None:
    """The run lasts a hundredth of the tilt's period; H is in its range also much later."""
    base = changed(
        "ur5-hybrid",
        surface={"kind": "plane", "normal": [0.0, 0.0, -1.0], "origin": [0.57239, 0.10915, 0.17],
                 "tilt": {"amplitude": 0.5, "frequency": 0.05, "axis": [0.0, 1.0, 0.0]}},
        motion={"kind": "hold"},
        simulation={"duration": 0.2, "domain_radius": 0.03},
    )  # fmt: skip
    loop = ClosedLoop.from_scenario(base)
    constants, u = loop.system.constants, loop.system.controller.uncertainty
    for t in np.linspace(0.0, 20.0, 21):
        inertia = InertiaRange.at(u, *loop.system.observe(loop.system.q_0, 0.0 * loop.system.q_0, t))
        assert np.linalg.eigvalsh(inertia.H_low)[0] > constants.k_r_low
        assert np.linalg.eigvalsh(inertia.H_high)[-1] < constants.k_r_high


def test_nothing_is_promised_of_a_form_after_the_time_that_it_is_known_for() -> None:
    form = {"kind": "formula", "text": "z - 0.17 - 0.01*sin(x*4 + 0.3*t)", "origin": [0.0, 0.0, 0.0]}
    loop = ClosedLoop.from_scenario(
        changed("ur5-hybrid", surface=form, motion={"kind": "hold"}, simulation={"duration": 0.2})
    )
    CompiledRun(loop).advance(200)
    assert not loop.state.evaluation.views.table.failing[Premise.DOMAIN]
    CompiledRun(loop).advance(100)
    assert loop.state.evaluation.views.table.failing[Premise.DOMAIN]
    assert "searched up to simulation.duration only" in loop.standing.now.because
    assert loop.stopped is None


@pytest.mark.parametrize("switching", ["saturation", "discontinuous"])
def test_a_gain_that_rises_within_a_period_is_seen_in_that_period(switching: str) -> None:
    """A declared disturbance that may begin at once: the layer is too thin for it from that sample on."""
    scenario = changed(
        "ur5-motion",
        declared={"delta_f": "100*(1 + tanh(2000*(t - 0.5)))"},
        controller={"switching": switching, "epsilon": 20.0, "F_1": 0.001},
    )
    loop = run(scenario, 0.6)
    assert np.isnan(loop.promise_record.broken)
    check = loop.state.evaluation.part("posture_check")
    assert check.d_now > 100.0
    if switching == "saturation":
        assert loop.state.evaluation.views.table.failed[Premise.LAYER] <= 0.5 + loop.period


class _Gains:
    """Gains that `_falling_from` reads."""

    def __init__(self, K_s: float, epsilon: float) -> None:
        self.K_s_smallest, self.epsilon, self.reaching_share = K_s, epsilon, 1.0 - SAMPLING_SHARE


@pytest.mark.parametrize("d_0", [2.0, 5.0, 40.0])
@pytest.mark.parametrize("slope", [0.0, 300.0])
@pytest.mark.parametrize("K_s", [1.0, 100.0, 900.0])
def test_v_falls_from_the_radius_on_whatever_pushes_against_s(d_0: float, slope: float, K_s: float) -> None:
    """One period of a mass h under the robust terms, against every perturbation that (17) and the share allow."""
    h, T, epsilon, kept = 3.0, 1e-3, 2.0, 1.0 - SAMPLING_SHARE
    gains = _Gains(K_s, epsilon)
    ends = ((K_s, d_0), (K_s * (1.0 + SAMPLING_SHARE) + 2.0 * slope, 2.0 * d_0))
    radius = max(_falling_from.py_func(alpha, beta, T, h, gains) for alpha, beta in ends)
    worst = np.inf
    for r in radius * np.geomspace(1.0, 1e3, 200):
        d = d_0 + np.linspace(0.0, slope, 7)[:, None] * r
        largest = d - kept * epsilon + SAMPLING_SHARE * K_s * r
        pushes = np.linspace(0.0, 1.0, 101) * largest
        after = r - T / h * (K_s * r + d + pushes)  # those that help s back overshoot
        falls = 0.5 * h * (r**2 - after**2)
        worst = min(worst, (falls - T * r * kept * (epsilon + K_s * r)).min() / (T * r * epsilon))
    assert worst >= -1e-9

    inside = 0.9 * radius  # at one of the two ends it does not fall so fast there

    def kept_promise(alpha: float, beta: float) -> bool:
        A = alpha * inside + beta
        return A * (1.0 - 0.5 * T / h * A / inside) >= kept * (epsilon + K_s * inside)

    assert not all(kept_promise(*end) for end in ends)


def test_a_linear_gain_too_large_for_the_period_promises_nothing() -> None:
    gains = _Gains(2000.0, 2.0)
    assert _falling_from.py_func(2000.0, 5.0, 1e-3, 3.0, gains) == np.inf  # T K_s / h = 0.67
    assert np.isfinite(_falling_from.py_func(1400.0, 5.0, 1e-3, 3.0, _Gains(1400.0, 2.0)))


def test_a_model_that_is_unstable_at_any_period_is_not_blamed_on_sampling() -> None:
    """K_f1 is full, the model is stable against the believed stiffness and not against the true one."""
    matrices = {name: np.diag(entries) for name, entries in {
        "M_m": [12.0, 12.0, 10.0, 10.0, 10.0, 10.0], "B_m": [100.0, 100.0, 400.0, 400.0, 400.0, 400.0],
        "K_m": [0.0, 0.0, 4000.0, 4000.0, 4000.0, 4000.0], "K_f": [0.0] * 6,
    }.items()}  # fmt: skip
    matrices["M_m"][:2, :2] = [[12.68238679, 7.18320536], [7.18320536, 12.0666187]]
    matrices["B_m"][:2, :2] = [[107.83847557, -12.24734295], [-12.24734295, 101.00513249]]
    matrices["K_m"][:2, :2] = [[191.88501233, -129.66911054], [-129.66911054, 107.93194071]]
    matrices["K_f"][:2, :2] = [[2.18899502, 0.83030549], [0.83030549, 0.51136062]]
    data = to_plain(load("ur5-groove-moving"))
    data["surface"]["motion"]["amplitude"] = 0.0
    data["contact"]["K_e"], data["second"]["contact"]["K_e"] = 3421.0, 19756.0
    data["target_model"] = {name: matrix.tolist() for name, matrix in matrices.items()}
    data["controller"]["period"] = 1e-4
    warning = ClosedLoop.from_scenario(from_plain(data)).warning or ""
    growth = float(warning.split("multiplies a deviation by ")[1].split()[0])
    assert 1.0 < growth < 1.001  # as many digits as tell it from its limit
    assert "the target model itself is unstable against the true stiffness (a pole at 3.43 1/s)" in warning


@pytest.mark.parametrize("switching", ["discontinuous", "saturation"])
def test_a_target_model_too_fast_for_the_period_is_seen_in_free_motion_under_every_switching(switching: str) -> None:
    """Held over a period, the spring gains energy: a deviation grows by about 1 + (omega T)^2/4 - zeta omega T."""
    T, M, B, K = 0.004, 10.0, 2.0, 16000.0
    scenario = changed(
        "ur5-motion",
        declared={"link_scaling": 0.0},
        truth={"link_scaling": 1.0},
        controller={"switching": switching, "F_1": 0.001, "epsilon": 100.0, "layer": 0.1, "period": T},
        target_model={"K_m": [K] * 6, "B_m": [B] * 6},
        motion={"kind": "circle", "radius": 0.02, "period": 2.0, "axes": [0, 1], "ramp": 0.0},
        simulation={"duration": 2.2, "domain_radius": 0.5},
    )
    loop = run(scenario, 0.3)
    grows = 1.0 + K / M * T**2 / 4.0 - B / M * T / 2.0
    assert value(loop, Premise.SAMPLED_LOOP) == pytest.approx(grows, abs=5e-4)
    assert loop.standing.now.verdict == "nothing promised"
    assert "each control period multiplies a deviation by 1.00" in (loop.warning or "")
    calm = ClosedLoop.from_scenario(load("ur5-motion-discontinuous"))
    assert value(calm, Premise.SAMPLED_LOOP) < 1.0


def test_a_stated_bound_with_a_step_below_the_present_speed_feeds_the_gain() -> None:
    """At rest the arm goes on to chatter by the gain that only its chattering needs."""
    scenario = changed(
        "ur5-motion",
        declared={"link_scaling": 0.0, "delta_f": "1+300*(1+tanh(20*(speed-0.5)))"},
        truth={"link_scaling": 1.0},
        controller={"switching": "discontinuous", "F_1": 0.001, "epsilon": 20.0},
        motion={"kind": "point-to-point", "displacement": [0.15, 0.0, 0.0], "duration": 0.5},
    )
    loop = run(scenario, 1.0)
    row = loop.recording.stretch()
    assert row["d"][-1] > 20.0 * row["d"][0]
    assert value(loop, Premise.GAIN_BY_CHATTER) > 1.0
    assert loop.standing.now.verdict == "nothing promised"


@pytest.mark.parametrize("engine", ["pinocchio", "compiled"])
def test_premises_on_d_and_s_count_under_the_law_that_has_them(engine: str) -> None:
    loop = ClosedLoop.from_scenario(load("ur5-heavy"))
    assert not loop.system.controller.law.robust
    if engine == "compiled":
        CompiledRun(loop).advance(300)
    else:
        for _ in range(300):
            loop.advance()
    of_law = {"gain", "held", "layer", "gain_by_chatter", "gain_by_force"}
    assert of_law.isdisjoint(finding.premise for finding in loop.standing.findings_of_run)
    changed_at = loop.t
    loop.edit(changed("ur5-heavy", controller={"law": "vsmrc"}))
    for _ in range(50):
        loop.advance()
    found = {finding.premise: finding for finding in loop.standing.findings if finding.premise in of_law}
    assert {"gain", "held", "layer"} <= found.keys()
    assert [f.failed for f in found.values() if f.failed is not None and f.failed < changed_at] == []
    assert found["gain"].margin is not None
    assert found["gain"].margin >= -1e-9


@pytest.mark.parametrize("engine", ["pinocchio", "compiled"])
def test_the_promise_ends_one_period_after_q_has_left_omega(engine: str) -> None:
    """Regular posture checks are 40 periods apart; a push takes the arm out of Omega between two of them."""
    pushed = {"push": (300.0, 0.0, 0.0), "push_start": 0.205, "push_duration": 0.3}
    loop = ClosedLoop.from_scenario(changed("ur5-impedance", truth=pushed, simulation={"domain_radius": 0.1}))
    if engine == "compiled":
        CompiledRun(loop).advance(450)
    else:
        for _ in range(450):
            loop.advance()
    omega, rows = loop.system.constants.omega, loop.recording.signals(("t", "q"))
    outside = [omega.centre_near(q).distance > omega.radius for q in rows["q"]]
    left = outside.index(True)
    assert left % loop.premise_watch.every > 1  # no regular check
    failed = float(loop.state.evaluation.views.table.failed[Premise.DOMAIN])
    assert failed == pytest.approx(rows["t"][left + 1], abs=1e-9)
    assert str(loop.state.flagged).startswith(f"t = {rows['t'][left]:.3f} s: q has left Ω")
