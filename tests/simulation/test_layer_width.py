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
    slope = share * check.H_min / loop.period / (1.0 - share)
    expected = layer_width(gains.switching, gains.layer, check.d, slope, gains.epsilon)
    assert check.layer_width == pytest.approx(expected, rel=1e-9)
    assert expected > 1.01 * layer_width(gains.switching, gains.layer, check.d, 0.0, gains.epsilon)


def test_nothing_is_promised_where_the_rational_function_has_no_layer() -> None:
    fields = {"controller__switching": "rational", "controller__layer": 1.0}
    loop = ClosedLoop.from_scenario(short("ur5-hybrid", **fields))
    loop.step()
    assert loop.state.evaluation.part("posture_check").layer_width == float("inf")
    assert loop.standing.now.verdict == "nothing promised"
    assert "must be below 2" in loop.standing.now.because
