"""The force sensor within the sampled loop, and the factor by which the force loop grows in a period."""

from __future__ import annotations

import math

import numpy as np
import pytest

from app.scenario.data import shipped
from app.simulation.assembly import assemble
from app.simulation.closed_loop import ClosedLoop
from app.simulation.sampled_loop.period_map import PeriodMap, Posture
from app.simulation.sampled_loop.sampled_force_loop import force_factor
from tests.support.pressing import H, changed, growth_per_period, pressing

pytestmark = pytest.mark.slow  # long or many simulations


@pytest.mark.parametrize("kind", ["elastic", "mass-damper-spring"])
@pytest.mark.parametrize("ideal", [False, True])
def test_every_sensor_is_judged(kind: str, ideal: bool) -> None:
    """An ideal sensor shows the force of now only where that depends on the torque: elsewhere it is as late as any."""
    fields = {"sensor__delay": 0.004, "sensor__cutoff": 100.0, "sensor__ideal": ideal, "contact__kind": kind}
    quick, late = (
        assemble(pressing("planar3r", 1e5, H, **fields | {"contact__M_e": 2.0} | given))
        for given in ({"sensor__delay": 0.0, "sensor__cutoff": 0.0}, {})
    )
    sees_delay = not (ideal and kind == "mass-damper-spring")
    assert (abs(growth_per_period(late) - growth_per_period(quick)) > 1e-6) == sees_delay
    size = len(PeriodMap(late, Posture.of(late, late.q_0, 0.0)).jacobian())
    assert size == 3 * 3 + 3 * (1 + 4) + 3 * (kind == "mass-damper-spring" and not ideal)


@pytest.mark.parametrize("M_m1", [5.0, 10.0, 30.0])
def test_the_closed_form_of_the_force_loop_is_an_eigenvalue_of_the_period(M_m1: float) -> None:
    scenario = changed(
        shipped()["ur5-constrained"], controller__law="computed-torque", target_model={"M_m": [M_m1] + [12.0] * 5},
        truth__link_scaling=1.0,
    )  # fmt: skip
    system = assemble(scenario)
    at = Posture.of(system, system.q_0, 0.0)
    values, factor = np.linalg.eigvals(PeriodMap(system, at).jacobian()), force_factor(system, at)
    assert np.abs(values - factor).min() < 1e-4 * abs(factor)


@pytest.mark.parametrize("M_m1", [2.5, 10.0])
@pytest.mark.parametrize(("cutoff", "delay"), [(20.0, 0.0), (50.0, 0.003), (0.0, 0.003)])
def test_a_low_pass_changes_the_factor_of_the_force_loop_and_a_delay_alone_does_not(
    M_m1: float, cutoff: float, delay: float
) -> None:
    """A low-pass of gain g makes 1 - g (1 - f) of the factor f; behind a delay, too, it is the fastest of several
    eigenvalues that belong to the force loop."""
    without = changed(
        shipped()["ur5-constrained"], controller__law="computed-torque", target_model={"M_m": [M_m1] + [12.0] * 5},
        truth__link_scaling=1.0,
    )  # fmt: skip
    plain, system = assemble(without), assemble(changed(without, sensor={"cutoff": cutoff, "delay": delay}))
    at = Posture.of(system, system.q_0, 0.0)
    f, factor = force_factor(plain, at), force_factor(system, at)
    if cutoff == 0.0:
        assert factor == pytest.approx(f, rel=1e-12)
        return
    gain = 1.0 - math.exp(-2 * math.pi * cutoff * 0.001)
    values = np.linalg.eigvals(PeriodMap(system, at).jacobian())
    if delay == 0.0:
        assert factor == pytest.approx(1.0 - gain * (1.0 - f), rel=1e-12)
        assert np.abs(values - factor).min() < 1e-4 * abs(factor)
    else:
        z = values[np.abs(np.abs(values) - factor).argmin()]
        assert z**3 * (z - 1.0 + gain) == pytest.approx(gain * f, rel=1e-2)


def test_a_force_loop_that_a_low_pass_calms_is_not_said_to_diverge() -> None:
    fields = {"controller__gain": "constant", "controller__d": 60.0, "truth__link_scaling": 1.0}
    scenario = changed(shipped()["ur5-constrained"], target_model={"M_m": [2.5] + [10.0] * 5}, **fields)
    factors = []
    for cutoff in (0.0, 20.0):
        loop = ClosedLoop.from_scenario(changed(scenario, sensor={"cutoff": cutoff}))
        for _ in range(400):
            loop.advance()
        last = loop.recording.at(loop.t)
        settles = loop.stopped is None and abs(last["multiplier"][0] - last["F_cd"][0]) < 0.1
        factors.append((loop.sampled.force_factor, settles, "force loop diverges" in (loop.warning or "")))
    assert [(abs(factor) < 1.0, settles, warned) for factor, settles, warned in factors] == [
        (False, False, True),
        (True, True, False),
    ]
