"""Width of the boundary layer in a run: it counts that the gain by (17) grows with ||s||, and where there is none,
nothing is promised."""

from __future__ import annotations

import pytest

from app.simulation.closed_loop import ClosedLoop
from controllers.premises import Premise
from controllers.switching import layer_width
from tests.support.cases import short


@pytest.mark.parametrize("switching", ["rational", "tanh"])
def test_the_layer_of_a_run_counts_the_gain_that_grows_with_s(switching: str) -> None:
    loop = ClosedLoop.from_scenario(short("ur5-hybrid", controller__switching=switching))
    loop.step()
    table, check = (loop.state.evaluation.part(name) for name in ("table", "posture_check"))
    gains, share = loop.system.controller.gains, float(table.value[Premise.GAIN_BY_CHATTER])
    slope = share * check.H_min / loop.period
    expected = layer_width(gains.switching, gains.layer, check.d, slope, gains.epsilon)
    assert check.layer_width == pytest.approx(expected, rel=1e-9)
    assert expected > 1.01 * layer_width(gains.switching, gains.layer, check.d, 0.0, gains.epsilon)


def test_nothing_is_promised_where_the_rational_function_has_no_layer() -> None:
    fields = {"controller__switching": "rational", "controller__layer": 1.0}
    loop = ClosedLoop.from_scenario(short("ur5-hybrid", **fields))
    loop.step()
    assert loop.state.evaluation.part("posture_check").layer_width == float("inf")
    assert loop.standing.now.verdict == "nothing promised"
    assert "no ‖s‖ from which on a period takes from s" in loop.standing.now.because


def test_from_the_radius_on_a_period_takes_what_19_counts_on_though_the_gain_grows() -> None:
    """(b) of docs/theory.md with c = -1, where the robust term pushes s over zero, and d = d_0 + slope ||s||."""
    fields = {"controller__bounds": "paper", "controller__period": 0.001, "controller__K_s": [800.0] * 6}
    loop = ClosedLoop.from_scenario(short("ur5-motion-discontinuous", **fields))
    loop.step()
    table, check = (loop.state.evaluation.part(name) for name in ("table", "posture_check"))
    T, h, epsilon = loop.period, check.H_min, loop.system.controller.gains.epsilon
    share, K_s = float(table.value[Premise.GAIN_BY_CHATTER]), 800.0
    assert share > 0.3

    def taken(r: float) -> float:
        d = check.d + share * h / T * r
        least, most = K_s * r + check.d, 1.25 * K_s * r + 2.0 * d
        return min(A * (1.0 - 0.5 * T / h * A / r) for A in (least, most)) - 0.75 * (epsilon + K_s * r)

    assert taken(float(check.radius)) == pytest.approx(0.0, abs=1e-9)
    assert taken(1.03 * float(check.radius)) > 0.0
    assert taken(0.97 * float(check.radius)) < 0.0


@pytest.mark.parametrize(("share", "jumps"), [(1.98, True), (2.02, False)])
def test_a_jump_over_zero_counts_where_a_period_can_cross_half_of_the_layer(share: float, jumps: bool) -> None:
    """V_band of (d) with s_2 of (c) in docs/theory.md, whose gain grows with s. Heavy rotors make the inertia nearly
    that of every direction, otherwise the largest one would hide the jump."""
    rotors, fields = {"robot__rotor_inertia": [2.0] * 6}, {"controller__bounds": "paper", "controller__period": 0.004}

    def checked(layer: float) -> ClosedLoop:
        loop = ClosedLoop.from_scenario(short("ur5-joint", controller__layer=layer, **rotors, **fields))
        loop.step()
        return loop

    loop = checked(0.05)
    T, gains, check = loop.period, loop.system.controller.gains, loop.state.evaluation.part("posture_check")
    g = float(loop.state.evaluation.part("table").value[Premise.GAIN_BY_CHATTER])
    K = gains.K_s_largest + 0.25 * gains.K_s_smallest
    s_2 = T * check.d / (check.H_min * (1.0 - g) - 0.5 * T * K)
    assert s_2 > 1.03 * T * check.d / (check.H_min - 0.5 * T * K)
    assert check.H_max < 3.0 * check.H_min
    s_V = share * s_2
    found = checked(s_V).state.evaluation.part("posture_check")
    assert found.radius == pytest.approx(s_V)
    assert found.V_band == pytest.approx(0.5 * (4.0 * check.H_min if jumps else check.H_max) * s_V**2)


def test_nothing_is_promised_where_the_gain_grows_by_more_than_a_period_can_take() -> None:
    """Chattering feeds back 0.9 of d, and K_s takes 0.6 of s: each alone is allowed."""
    fields = {"controller__bounds": "paper", "controller__period": 0.0025, "controller__K_s": [800.0] * 6}
    loop = ClosedLoop.from_scenario(short("ur5-motion-discontinuous", **fields))
    loop.step()
    assert float(loop.state.evaluation.part("table").value[Premise.GAIN_BY_CHATTER]) < 1.0
    assert loop.standing.now.verdict == "nothing promised"
    assert "no ‖s‖ from which on a period takes from s" in loop.standing.now.because
