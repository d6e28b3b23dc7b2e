"""Response to a push as a linear system: against closed forms, and against sinusoidal pushes of whole runs."""

from __future__ import annotations

import re

import numpy as np
import pytest

from app.scenario.data import edited, from_plain, load, to_plain
from app.scenario.schema import Scenario
from app.session.push_measurement import Chirp, PushExperiment, deviation_sentence, not_linear
from app.simulation.assembly import assemble
from app.simulation.closed_loop import ClosedLoop
from app.simulation.sampled_loop.force_margin import ForceLoop
from app.simulation.sampled_loop.period_map import PeriodMap, Posture
from app.simulation.sampled_loop.push_response import (
    FORCE,
    MOMENT,
    PushResponse,
    along_axes,
    block,
    largest_and_smallest,
    passive,
)
from app.simulation.sampled_loop.sampled_stability import sampled_loop
from app.simulation.system import System
from environments.push import TimedPush


def known_arm(**controller: object) -> Scenario:
    """An arm that the controller knows exactly, in impedance mode, at rest in free space, with equal axes."""
    data = to_plain(edited(load("ur5-impedance"), "motion", "hold"))
    data["truth"], data["declared"] = {}, {}
    data["target_model"] = {"M_m": [8.0] * 6, "B_m": [120.0] * 6, "K_m": [700.0] * 6, "K_f": [1.0] * 6}
    data["contact"] = {"kind": "free"}
    data["controller"] |= controller
    return from_plain(data)


def response_of(scenario: Scenario) -> PushResponse:
    system = assemble(scenario)
    found = sampled_loop(system, system.q_0, 0.0).response
    assert found is not None
    return found


def test_the_target_is_the_impedance_of_mass_damper_and_spring() -> None:
    response, frequency = response_of(known_arm()), np.array([0.2, 1.5, 30.0])
    s = 2j * np.pi * frequency
    expected = np.abs(8.0 * s + 120.0 + 700.0 / s)
    target, length = response.target(frequency), np.array([1.0, 1.0, 1.0, *[response.l**2] * 3])
    assert along_axes(frequency, target) == pytest.approx(np.outer(expected, length), rel=1e-9)
    assert list(response.kinds) == [FORCE, MOMENT]
    for axes, unit in zip(response.kinds.values(), (1.0, response.l**2), strict=True):
        extremes = largest_and_smallest(frequency, block(target, axes))
        assert extremes == pytest.approx(np.outer(expected, np.ones(2)) * unit, rel=1e-9)
    assert [axis.words for axis in response.axes] == [
        *("along x", "along y", "along z"),
        *("about the axis of α", "about the axis of β", "about the axis of γ"),
    ]


def test_a_known_arm_has_the_targets_impedance_as_sampling_becomes_fine() -> None:
    """The difference is of first order in the control period."""
    frequency = np.array([0.3, 1.0, 4.0, 10.0])
    apart = []
    for period in (0.002, 0.001, 0.0005):
        response = response_of(known_arm(period=period))
        found, target = response.admittance(frequency), response.target(frequency)
        found, target = response.in_metres(found), response.in_metres(target)
        apart.append(np.abs(found - target).max() / np.abs(target).max())
    assert apart[1] / apart[0] == pytest.approx(0.5, abs=0.05)
    assert apart[2] / apart[1] == pytest.approx(0.5, abs=0.05)
    assert apart[2] < 0.01


def test_viscous_friction_along_a_surface_is_in_the_target_beside_the_sampled_loop() -> None:
    """(8) with its measured force: friction damps the two directions along the surface, and not that across."""
    pressed = edited(known_arm(period=0.0005), "contact", {"kind": "elastic", "K_e": 1e4, "friction_viscous": 90.0})
    system = assemble(pressed)
    loop = sampled_loop(system, system.q_0, 0.0)
    along, across = np.roots([8.0, 120.0 + 90.0, 700.0]), np.roots([8.0, 120.0, 700.0 + 1e4])
    for poles, times in ((along, 2), (across, 1)):
        for pole in poles:
            assert (np.abs(loop.model - pole) < 1e-6 * abs(pole)).sum() == times
            assert np.abs(loop.sampled - pole).min() < 0.04 * abs(pole)
    free = assemble(edited(pressed, "contact.friction_viscous", 0.0))
    assert np.abs(sampled_loop(free, free.q_0, 0.0).model - along[0]).min() > 1.0


def test_a_force_along_an_oblique_surface_is_not_read_as_its_normal_force() -> None:
    """A plane that lies oblique to the coordinates along it, as a typed surface may: of friction along it, and of a
    push along it, the law reads no normal force; model and sampled loop agree on both."""
    data = to_plain(edited(load("ur5-hybrid"), "motion", "hold"))
    data["truth"], data["declared"] = {}, {}
    data["controller"]["period"] = 0.0005
    data["surface"] = {"kind": "formula", "text": "z - 0.17 - 0.6*(x - 0.572)", "solid": "below"}
    pressed = from_plain(data)
    system, frequency = assemble(edited(pressed, "contact.friction_viscous", 60.0)), np.array([0.3, 1.0, 4.0])
    loop, smooth = (sampled_loop(each, each.q_0, 0.0) for each in (system, assemble(pressed)))
    np.testing.assert_allclose(loop.model, smooth.model, rtol=1e-9)
    assert loop.response is not None
    found, target = (
        loop.response.in_metres(each(frequency)) for each in (loop.response.admittance, loop.response.target)
    )
    assert np.abs(found - target).max() < 0.03 * np.abs(target).max()


@pytest.mark.slow  # long simulations
@pytest.mark.parametrize(
    ("scenario", "sensor"),
    [
        ("ur5-impedance", {}),
        ("ur5-impedance-6d", {}),
        ("ur5-impedance-6d", {"delay": 0.002, "moment_delay": 0.005, "cutoff": 60.0}),
        ("ur5-hybrid-impedance", {}),
        ("ur5-constrained", {}),
        ("panda-align", {}),
        ("planar3r-hybrid", {"delay": 0.003}),
    ],
)
def test_a_sinusoidal_push_on_the_whole_simulation_meets_the_predicted_admittance(
    scenario: str, sensor: dict[str, float]
) -> None:
    """Amplitude and phase of every axis, forces and moments, in a run with everything that the linear system leaves
    out."""
    data = to_plain(edited(load(scenario), "motion", "hold"))
    data["truth"] |= {"push": [0.0, 0.0, 0.0], "push_moment": [0.0, 0.0, 0.0], "coulomb": 0.0}
    data["sensor"] = sensor
    data["surface"].get("tilt", {})["amplitude"] = 0.0
    data["contact"] |= {"friction_coulomb": 0.0, "unilateral": False}  # kinks, which no linear system has
    data["shift"] = {}
    loop = ClosedLoop.from_scenario(from_plain(data))
    for _ in range(500):  # the force has settled
        loop.step()
    found = sampled_loop(loop.system, loop.state.arm.views.q.copy(), loop.t).response
    assert found is not None
    assert found.wrenches @ found.wrenches.T == pytest.approx(np.eye(len(found.axes)), abs=0.01)
    measured = PushExperiment(loop.state, found.axes).sine(5.0)
    predicted = found.admittance(np.array([measured.frequency]))[0]
    for axes in found.kinds.values():  # each kind against the largest entry of its own, then all together
        difference = (measured.admittance - predicted)[np.ix_(axes, axes)]
        assert np.abs(difference).max() <= 0.02 * np.abs(predicted[np.ix_(axes, axes)]).max() + 1e-9
    apart, predicted = found.in_metres(measured.admittance - predicted), found.in_metres(predicted)
    np.testing.assert_allclose(apart, 0.0, atol=0.02 * np.abs(predicted).max())


@pytest.mark.slow  # long simulations
def test_a_chirp_measures_mass_damper_and_spring_in_the_midst_of_a_motion() -> None:
    """The tool is on its way when the push begins, and the sensor is noisy: both cancel."""
    data = to_plain(known_arm())
    data["motion"] = {"kind": "circle", "radius": 0.05, "period": 3.0}
    data["sensor"] = {"noise": 0.2}
    loop = ClosedLoop.from_scenario(from_plain(data))
    for _ in range(300):
        loop.step()
    assert np.linalg.norm(loop.recording.at(loop.t)["r_dot"]) > 0.01
    sampled = sampled_loop(loop.system, loop.state.arm.views.q.copy(), loop.t).response
    assert sampled is not None
    points = PushExperiment(loop.state, sampled.axes).chirp(Chirp(low=0.3, high=40.0, seconds=6.0, points=9))
    frequency = np.array([point.frequency for point in points])
    assert frequency[[0, -1]] == pytest.approx([0.3, 40.0])
    s = 2j * np.pi * frequency
    expected = (s / (8.0 * s**2 + 120.0 * s + 700.0))[:, None, None] * np.eye(6)
    admittance = sampled.in_metres(np.array([point.admittance for point in points]))
    apart = np.abs(admittance - expected).max(axis=(1, 2)) / np.abs(s / (8.0 * s**2 + 120.0 * s + 700.0))
    assert apart.max() < 0.01
    predicted = sampled.in_metres(sampled.admittance(frequency))
    scale = np.abs(predicted).max(axis=(1, 2))[:, None, None]
    np.testing.assert_allclose(admittance / scale, predicted / scale, atol=0.001)
    assert "leaves out" not in deviation_sentence(points, sampled, not_linear(loop.state))


@pytest.mark.slow  # long simulations
def test_a_measurement_far_from_its_prediction_says_what_that_leaves_out() -> None:
    data = to_plain(known_arm())
    data["truth"] |= {"coulomb": 5.0}
    loop = ClosedLoop.from_scenario(from_plain(data))
    found = sampled_loop(loop.system, loop.state.arm.views.q.copy(), loop.t).response
    assert found is not None
    sentence = deviation_sentence([PushExperiment(loop.state, found.axes).sine(2.0)], found, not_linear(loop.state))
    assert sentence.endswith("leaves out: dry friction in the joints")


@pytest.mark.slow  # long simulations
def test_a_gain_by_17_that_grows_with_the_push_is_named_where_it_is_the_reason() -> None:
    """Without it the same push meets the prediction; the arm's weight, which is not known, makes s rest off zero."""
    errors, sentences = [], []
    for gain in ("theorem", "constant"):
        scenario = edited(edited(load("ur5-impedance-6d"), "controller.gain", gain), "controller.d", 60.0)
        loop = ClosedLoop.from_scenario(scenario)
        found = sampled_loop(loop.system, loop.state.arm.views.q.copy(), loop.t).response
        assert found is not None
        points = PushExperiment(loop.state, found.axes).chirp(Chirp(low=10.0, high=100.0, seconds=2.0, points=5))
        sentences.append(deviation_sentence(points, found, not_linear(loop.state)))
        errors.append(float(re.findall(r"within (\S+) %", sentences[-1])[0]))
    assert sentences[0].endswith("leaves out: the gain d by (17), which grows with the push")
    assert "leaves out" not in sentences[1]
    assert errors[1] < 0.1 < 5.0 < errors[0]


def test_a_chirp_goes_evenly_in_the_logarithm_from_one_frequency_to_the_other() -> None:
    """Counted by its zeros: in every half of an octave as many seconds."""
    push = TimedPush(np.array([2.0, 0.0, 0.0]), 1.0, 4.0, frequency=4.0, sweep_to=64.0)
    t = np.arange(1.0, 5.0, 1e-5)
    force = np.array([push.at(each)[0] for each in t])  # pyright: ignore[reportOptionalSubscript]
    assert push.at(5.0) is None
    assert np.abs(force).max() == pytest.approx(2.0, rel=1e-6)
    zeros = t[:-1][np.diff(np.signbit(force).astype(int)) != 0]
    frequency, middle = 0.5 / np.diff(zeros), 0.5 * (zeros[1:] + zeros[:-1])
    assert np.log2(frequency) == pytest.approx(2.0 + (middle - 1.0), abs=0.01)


def pressing(period: float, **sensor: float) -> Scenario:
    """An arm that the controller knows exactly, pressing on an elastic plane, with a linear robust term."""
    data = to_plain(edited(load("ur5-hybrid"), "motion", "hold"))
    data["truth"], data["declared"] = {}, {}
    data["contact"] |= {"friction_coulomb": 0.0, "friction_viscous": 0.0, "B_e": 0.0, "K_e": 9000.0}
    data["controller"] |= {"period": period, "gain": "constant", "d": 5.0, "A": -3.0}
    data["target_model"] = {
        "M_m": [5.0] * 6,
        "B_m": [400.0, *[200.0] * 5],
        "K_m": [0.0, *[900.0] * 5],
        "K_f": [1.0, *[0.0] * 5],
    }
    data["sensor"] = dict(sensor)
    return from_plain(data)


def force_loop_of(scenario: Scenario) -> tuple[ForceLoop, System, Posture]:
    system = assemble(scenario)
    found = sampled_loop(system, system.q_0, 0.0).force_loop
    assert found is not None
    return found, system, Posture.of(system, system.q_0, 0.0)


def opened_in_continuous_time(system: System, at: Posture, s: complex) -> complex:
    """Loop gain by (8), (10), (15) and (32): a reading u in place of the force K_e a^T e leaves a (u - K_e a^T e) to
    the robust term, so that s is not zero, and M_m (s - A) s is left in (8)."""
    controller, model = system.controller, system.controller.model
    a, K_e = at.across, system.plant.contact.K_e
    robust = controller.K_s + np.eye(len(at.q)) * controller.d / controller.layer
    left = model.M_m @ (s * np.eye(len(at.q)) - controller.compensator.A) @ np.linalg.solve(s * at.H_hat + robust, a)
    model_s = model.M_m * s**2 + model.B_m * s + model.K_m
    e = np.linalg.solve(model_s + K_e * left @ a.T, left - model.K_f @ a)
    return complex(K_e * (a.T @ e)[0, 0])


def test_the_opened_force_loop_is_that_of_the_equations_as_sampling_becomes_fine() -> None:
    frequency, apart = np.array([0.5, 2.0, 8.0, 20.0]), []
    for period in (0.001, 0.0005):
        loop, system, at = force_loop_of(pressing(period))
        expected = np.array([opened_in_continuous_time(system, at, 2j * np.pi * f) for f in frequency])
        found = loop.gains(frequency)
        assert found.shape == (4, 1)  # along the normal only
        apart.append(np.abs(found[:, 0] / expected - 1.0))
    assert apart[1] / apart[0] == pytest.approx(0.5, abs=0.06)
    assert apart[1].max() < 0.05


def test_margins_of_the_force_loop_are_where_it_becomes_unstable() -> None:
    """The delay margin against loops whose sensor is late, and phase against the crossing of the opened loop."""
    loop, _, _ = force_loop_of(pressing(0.001))
    margins = loop.margins
    assert margins is not None
    assert loop.growth(0.999 * margins.high) < 1.0 < loop.growth(1.001 * margins.high)
    assert margins.low == 0.0
    periods = margins.delay / 0.001
    assert 3.0 < periods < 90.0
    for late in (int(periods), int(periods) + 1):
        system = assemble(pressing(0.001, delay=0.001 * late))
        growth = np.abs(np.linalg.eigvals(PeriodMap(system, Posture.of(system, system.q_0, 0.0)).jacobian())).max()
        assert (growth > 1.0 + 1e-6) == (late > periods)
    value = loop.gains(np.array([margins.crossing]))[0, 0]
    assert abs(value) == pytest.approx(1.0, abs=1e-6)
    assert margins.phase == pytest.approx(2.0 * np.pi * margins.crossing * margins.delay, rel=1e-9)


def test_the_tool_yields_to_a_steady_push_as_mass_damper_and_spring() -> None:
    response = response_of(known_arm())
    times, sampled, target = response.step(3.0)
    a, b = np.roots([8.0, 120.0, 700.0]).astype(complex)
    expected = np.real(1.0 + (b * np.exp(a * times) - a * np.exp(b * times)) / (a - b)) / 700.0
    assert target[:, :3] == pytest.approx(np.outer(expected, np.ones(3)), abs=1e-9)
    assert target[:, 3:] == pytest.approx(np.outer(expected, np.ones(3)) / response.l**2, abs=1e-8)
    assert sampled[:, :3] == pytest.approx(target[:, :3], abs=0.01 / 700.0)
    assert sampled[:, 3:] == pytest.approx(target[:, 3:], abs=0.01 / 700.0 / response.l**2)


def test_a_sampled_loop_is_passive_where_no_push_gets_energy_from_it() -> None:
    """Against the energy that a push does: the least eigenvalue of the Hermitian part, by another way."""
    response = response_of(known_arm())
    frequency = np.geomspace(0.1, response.highest * 0.99, 60)
    admittance = response.admittance(frequency)
    random, least = np.random.default_rng(0), np.full(len(frequency), np.inf)
    for _ in range(3000):
        force = random.standard_normal(6) + 1j * random.standard_normal(6)
        force[3:] *= 0.3  # as an arm of that length would turn a force into a moment
        work = np.real(np.conj(force) @ admittance @ force) / np.real(np.conj(force) @ force)
        least = np.minimum(least, work)
    verdict = passive(admittance)
    assert not verdict[least < -1e-6 * np.abs(admittance).max()].any()
    assert passive(response.target(frequency)).all()
    assert verdict[frequency < 5.0].all()
