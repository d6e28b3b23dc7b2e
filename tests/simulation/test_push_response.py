"""Response to a push as a linear system: against closed forms, and against sinusoidal pushes of whole runs."""

from __future__ import annotations

import numpy as np
import pytest

from app.scenario.data import edited, from_plain, load, to_plain
from app.scenario.schema import Scenario
from app.simulation.closed_loop import ClosedLoop
from app.simulation.push_response import PushResponse, along_axes, largest_and_smallest, passive
from app.simulation.sampled_stability import sampled_loop
from app.simulation.system import assemble


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
    impedance = along_axes(response.target(frequency))
    assert impedance == pytest.approx(np.outer(expected, np.ones(3)), rel=1e-9)
    assert largest_and_smallest(response.target(frequency)) == pytest.approx(np.outer(expected, np.ones(2)), rel=1e-9)
    assert response.axes == ("x", "y", "z")


def test_a_known_arm_has_the_targets_impedance_as_sampling_becomes_fine() -> None:
    """The difference is of first order in the control period."""
    frequency = np.array([0.3, 1.0, 4.0, 10.0])
    apart = []
    for period in (0.002, 0.001, 0.0005):
        response = response_of(known_arm(period=period))
        found, target = response.admittance(frequency), response.target(frequency)
        apart.append(np.abs(found - target).max() / np.abs(target).max())
    assert apart[1] / apart[0] == pytest.approx(0.5, abs=0.05)
    assert apart[2] / apart[1] == pytest.approx(0.5, abs=0.05)
    assert apart[2] < 0.01


@pytest.mark.parametrize("scenario", ["ur5-impedance", "ur5-hybrid-impedance", "ur5-constrained", "planar3r-hybrid"])
def test_a_sinusoidal_push_on_the_whole_simulation_meets_the_predicted_admittance(scenario: str) -> None:
    """Amplitude and phase of every axis, in a run with everything that the linear system leaves out."""
    data = to_plain(edited(load(scenario), "motion", "hold"))
    data["truth"] |= {"push": [0.0, 0.0, 0.0], "coulomb": 0.0}
    data["contact"] |= {"friction_coulomb": 0.0, "unilateral": False}  # kinks, which no linear system has
    data["shift"] = {}
    base = from_plain(data)
    loop = ClosedLoop(base)
    for _ in range(500):  # the force has settled
        loop.step()
    found = sampled_loop(loop.system, loop.state.arm.views.q.copy(), loop.t).response
    assert found is not None
    frequency, h = 5.0, loop.period
    axes = found.directions
    assert axes @ axes.T == pytest.approx(np.eye(len(axes)))
    predicted = found.admittance(np.array([frequency]))[0]
    for column, along in enumerate(axes):
        pushed = to_plain(base)
        pushed["truth"] |= {
            "push": (2.0 * along).tolist(), "push_start": 0.5, "push_duration": 60.0, "push_frequency": frequency,
        }  # fmt: skip
        run = ClosedLoop(from_plain(pushed))
        for _ in range(2701):
            run.step()
        rows = run.recording.signals(("t", "tool", "F_push"))
        last = slice(2700 - 1000, 2700)  # five whole cycles
        wave = np.exp(-2j * np.pi * frequency * rows["t"][last])
        force = (rows["F_push"][last] @ along) @ wave
        speeds = np.diff(rows["tool"] @ axes.T, axis=0)[last] / h
        measured = (speeds.T @ wave) / force
        np.testing.assert_allclose(measured, predicted[:, column], atol=0.02 * np.abs(predicted).max())


def test_the_tool_yields_to_a_steady_push_as_mass_damper_and_spring() -> None:
    times, sampled, target = response_of(known_arm()).step(3.0)
    a, b = np.roots([8.0, 120.0, 700.0]).astype(complex)
    expected = np.real(1.0 + (b * np.exp(a * times) - a * np.exp(b * times)) / (a - b)) / 700.0
    assert target == pytest.approx(np.outer(expected, np.ones(3)), abs=1e-9)
    assert sampled == pytest.approx(target, abs=0.01 / 700.0)


def test_a_sampled_loop_is_passive_where_no_push_gets_energy_from_it() -> None:
    """Against the energy that a push does: the least eigenvalue of the Hermitian part, by another way."""
    response = response_of(known_arm())
    frequency = np.geomspace(0.1, response.highest * 0.99, 60)
    admittance = response.admittance(frequency)
    random, least = np.random.default_rng(0), np.full(len(frequency), np.inf)
    for _ in range(3000):
        force = random.standard_normal(3) + 1j * random.standard_normal(3)
        work = np.real(np.conj(force) @ admittance @ force) / np.real(np.conj(force) @ force)
        least = np.minimum(least, work)
    verdict = passive(admittance)
    assert not verdict[least < -1e-6 * np.abs(admittance).max()].any()
    assert passive(response.target(frequency)).all()
    assert verdict[frequency < 5.0].all()
