"""Growth of (17) with q_dot, through the bounds of friction and of C_hat."""

from __future__ import annotations

import numpy as np
import pytest

from controllers.bounds import (
    Equivalent,
    GainInput,
    Uncertainty,
    _GainBounds,
    _GainDeviation,
    growth_with_speed,
    required_gain,
)
from controllers.nominal_model import Deviation
from kernels import kernel
from kernels.records import Record
from tests.controllers.test_bounds import DECLARED, Bounds, doubted, draw_state, law_for

STILL = Deviation(0.0, 0.0, 0.0, 0.0)


@kernel
def _growth(given, equivalent, found):
    found[0] = growth_with_speed(given[0], equivalent[0])


def growth(given: GainInput, equivalent: Equivalent) -> float:
    found = np.zeros(1)
    _growth(Record(given).data, Record(equivalent).data, found)
    return float(found[0])


@pytest.mark.parametrize("bounds", ["tight", "paper"])
@pytest.mark.parametrize("declared", [DECLARED, DECLARED._replace(viscous=0.0), DECLARED._replace(payload_offset=0.2)])
def test_no_change_of_the_speed_changes_the_gain_faster(bounds: Bounds, declared: Uncertainty) -> None:
    """s moves q_dot by J_q^-1 s; the Jacobians' rates stay."""
    system, random = doubted("ur5"), np.random.default_rng(4)
    u, n = law_for(system, declared, bounds).uncertainty, system.robot.n
    closest = 0.0
    for _ in range(30):
        q, q_dot, t = draw_state(system, random)
        estimate, task = system.observe(q, q_dot, t)
        q_eq_dot = q_dot + 0.1 * random.standard_normal(n)
        r_eq_dot = task.J_q @ q_eq_dot + task.v_t
        equivalent = Equivalent(r_eq_dot, random.standard_normal(n), q_eq_dot, random.standard_normal(n))

        def needed(speed: np.ndarray) -> float:
            return sum(required_gain(bounds, u, STILL, estimate, task, speed, equivalent))  # noqa: B023  # used at once

        given = GainInput(_GainBounds(u, tight=bounds == "tight"), _GainDeviation(STILL), estimate, task, q_dot)
        most = growth(given, equivalent)
        longest = task.J_q_inv @ np.linalg.svd(task.J_q_inv)[2][0]  # per m/s of s, as far as any
        for moved in (longest, -longest, task.J_q_inv @ random.standard_normal(n) / np.sqrt(n)):
            s = np.linalg.norm(task.J_q @ moved)
            rate = (needed(q_dot + 1e-4 * moved) - needed(q_dot)) / (1e-4 * s)
            assert rate <= most * (1.0 + 1e-6)
            closest = max(closest, rate / most)
    assert closest > 0.25  # no bound that is always far away


def test_a_deviation_of_the_estimates_counts() -> None:
    system, random = doubted("ur5"), np.random.default_rng(4)
    u = law_for(system, DECLARED, "tight").uncertainty
    q, q_dot, t = draw_state(system, random)
    estimate, task = system.observe(q, q_dot, t)
    equivalent = Equivalent.zeros(6)._replace(q_dot=np.ones(6))
    plain, along = (
        growth(GainInput(_GainBounds(u, tight=True), _GainDeviation(each), estimate, task, q_dot), equivalent)
        for each in (STILL, Deviation(0.0, 0.0, 0.0, 3.0))
    )
    assert along - plain == pytest.approx(3.0 * task.J_q_inv_norm**2 * np.sqrt(6.0))
