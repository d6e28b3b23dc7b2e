"""What changes within a period, over which the torque is held: references and pushes that jump."""

from __future__ import annotations

import pytest

from app.scenario.data import edited, shipped
from app.simulation.closed_loop import ClosedLoop
from app.simulation.compiled_run import CompiledRun


@pytest.mark.parametrize(
    ("name", "field", "value"),
    [
        ("ur5-hybrid", "force", {"kind": "step", "start": 10.0, "value": 50.0, "time": 0.2, "rise": 0.001}),
        ("ur5-motion", "motion", {"kind": "point-to-point", "displacement": [0.02], "duration": 0.001}),
        ("ur5-motion", "shift", {"by": [0.02, 0.0, 0.0], "duration": 0.001}),
    ],
)
def test_a_reference_that_moves_between_two_samples_ends_the_promise(name: str, field: str, value: object) -> None:
    """s jumps with it over bound and band, which is no fault of the law: the theorem is about a differentiable
    reference."""
    loop = ClosedLoop.from_scenario(edited(shipped()[name], field, value))
    CompiledRun(loop).advance(700)
    assert loop.standing.run.verdict == "nothing promised"
    assert [each.premise for each in loop.standing.findings if each.failed is not None] == ["held"]


@pytest.mark.parametrize("compiled", [True, False])
def test_the_band_follows_the_gain_at_once_when_a_push_begins(*, compiled: bool) -> None:
    """A push between two looks raises d by (17) five times: ||s|| left the band of the d before it."""
    scenario = edited(shipped()["ur5-impedance"], "contact.kind", "free")
    for field, value in (
        ("motion", {"kind": "hold"}),
        ("controller.switching", "discontinuous"),
        ("controller.F_1", 0.1),
        ("target_model.M_m", [3.0] * 6),
        ("target_model.B_m", [100.0] * 6),
        ("truth.push", [0.0, 200.0, 0.0]),
        ("truth.push_start", 0.201),
        ("truth.push_duration", 0.2),
        ("truth.push_every", 0.0),
    ):
        scenario = edited(scenario, field, value)
    loop = ClosedLoop.from_scenario(scenario)
    if compiled:
        CompiledRun(loop).advance(300)
    else:
        for _ in range(300):
            loop.step()
    assert loop.standing.run.verdict == "nothing promised"
    seen = loop.recording.signals(("d", "s_norm"))
    assert seen["d"][203] > 5.0 * seen["d"][200]
    assert seen["s_norm"].max() > 0.01
