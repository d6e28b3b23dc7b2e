"""Runs that once swung up on surfaces under a promise: on one of two faces, by friction, where a normal has turned."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from app.scenario.data import load, to_plain
from app.scenario.schema import Scenario
from app.simulation.closed_loop import ClosedLoop
from controllers.premises import Premise
from tests.support.cases import changed, run, value


def sheared(block: list[list[float]], rest: float) -> list[list[float]]:
    """Matrix of six coordinates with this block of the first two."""
    matrix = np.diag([0.0, 0.0] + [rest] * 4)
    matrix[:2, :2] = block
    return matrix.tolist()


def test_a_loop_that_swings_up_on_one_of_two_pressed_faces_gets_no_promise() -> None:
    """Both together hold it; as soon as the second one is left, it bounces to and fro between them for ever."""
    faces = changed(
        "ur5-corner",
        motion={"kind": "hold"},
        contact={"K_e": 6900.0},
        controller={"K_e_hat": 11456.0, "epsilon": 40.0, "layer": 0.1, "F_1": 10.0},
        second=to_plain(load("ur5-corner"))["second"]
        | {
            "contact": {"kind": "elastic", "K_e": 2764.0},
            "K_e_hat": 2764.0,
            "force": {"kind": "constant", "value": 0.0},
        },
        target_model={
            "M_m": sheared([[11.83, -2.39], [-2.39, 6.13]], 10.0),
            "B_m": sheared([[276.9, -199.4], [-199.4, 243.1]], 400.0),
            "K_m": sheared([[124.4, -0.27], [-0.27, 86.9]], 4000.0),
            "K_f": sheared([[0.166, -0.511], [-0.511, 3.76]], 0.0),
        },
        simulation={"duration": 6.0, "domain_radius": 0.4},
    )
    loop = run(faces, 5.0)
    speeds, _ = np.split(np.abs(loop.recording.stretch()["e_r_dot"]), [2], axis=1)
    t = loop.recording.stretch()["t"]
    assert speeds[t > 3.5].max() > 10.0 * speeds[(t > 3.0) & (t < 3.4)].max()  # it leaves the second face at 3.3 s
    assert value(loop, Premise.SAMPLED_LOOP) == pytest.approx(np.exp(6.5e-3), abs=5e-4)
    assert loop.standing.run.verdict == "nothing promised"
    assert run(load("ur5-corner"), 0.2).standing.now.verdict == "holds"


@pytest.mark.parametrize("mu", [0.0, 0.5])
def test_coulomb_friction_lets_a_model_with_coupled_stiffness_flutter_and_that_is_foreseen(mu: float) -> None:
    """Friction pulls along the slip by mu K_e per metre of penetration; K_m brings that back into the normal."""
    K_m = np.diag([4000.0, 2000.0, 1000.0, 2000.0, 2000.0, 2000.0])
    K_m[0, 2] = K_m[2, 0] = 800.0
    loop = run(
        changed(
            "ur5-impedance",
            motion={"kind": "point-to-point", "displacement": [0.25, 0.0, -0.015], "duration": 6.0},
            surface=to_plain(load("ur5-impedance"))["surface"] | {"origin": [0.0, 0.0, 0.18]},
            contact=to_plain(load("ur5-impedance"))["contact"] | {"K_e": 3000.0, "friction_coulomb": mu},
            target_model={"M_m": [10.0] * 6, "B_m": [10.0, 100.0, 10.0, 300.0, 300.0, 300.0], "K_m": K_m.tolist()},
            truth={"push": [0.0, 0.0, 0.0], "push_every": 0.0},
            controller={"epsilon": 60.0, "layer": 0.1, "K_e_hat": 3000.0},
            simulation={"domain_radius": 0.3, "duration": 8.0},
        ),
        4.0,
    )
    stretch = loop.recording.stretch()
    swing = [
        float(np.abs(stretch["e_r_dot"][(stretch["t"] > t - 0.5) & (stretch["t"] <= t), 2]).max()) for t in (2.5, 4.0)
    ]
    assert loop.standing.now.verdict == ("nothing promised" if mu else "holds")
    if mu:
        growth = value(loop, Premise.SAMPLED_LOOP)
        assert np.log(growth) / loop.period == pytest.approx(np.log(swing[1] / swing[0]) / 1.5, rel=0.35)
    else:
        assert swing[1] < swing[0] < 0.02


def in_a_pipe(displacement: float, **motion: Any) -> Scenario:
    """A tool held in a pipe of 6 cm, with a light model along x and a late reading: stable at the lowest place only."""
    tool = ClosedLoop.from_scenario(load("ur5-impedance")).view().tool
    path = {"kind": "point-to-point", "displacement": [displacement, 0.0, 0.0], "duration": 2.0}
    centre = [float(tool[0]), float(tool[1]), float(tool[2]) + 0.06]
    return changed(
        "ur5-impedance",
        surface={"kind": "cylinder", "side": "inside", "radius": 0.06, "origin": centre, "motion": motion},
        contact={"kind": "elastic", "K_e": 2e4},
        motion=path if displacement else {"kind": "hold"},
        sensor={"delay": 0.003},
        target_model={"M_m": [0.8] + 5 * [10.0], "B_m": [10.0] + 5 * [300.0], "K_m": 3 * [1000.0] + 3 * [2000.0]},
        controller={"epsilon": 600.0, "layer": 0.8, "K_e_hat": 2e4},
        truth={"push": [0.0, 0.0, 0.0], "push_every": 0.0},
        simulation={"domain_radius": 0.4, "duration": 4.0},
    )


@pytest.mark.parametrize(
    ("displacement", "motion", "sound"),
    [
        (0.0, {}, True),
        (-0.035, {}, False),
        (0.0, {"direction": [1.0, 0.0, 0.0], "amplitude": 0.04, "frequency": 0.08}, False),
    ],
    ids=["at the lowest place", "along the wall", "the pipe moves"],
)
def test_the_loop_is_judged_where_the_normal_of_a_curved_surface_has_turned_to(
    displacement: float, motion: dict[str, Any], sound: bool
) -> None:
    """Between two postures that are near to each other in the joints, the normal turns by 40°; there the arm rattled
    under "holds"."""
    loop = run(in_a_pipe(displacement, **motion), 3.5)
    speed = np.abs(loop.recording.signals(("e_r_dot",), 2.5)["e_r_dot"]).max()
    assert (speed < 0.02) == sound
    assert (loop.standing.run.verdict == "holds") == sound
    assert (value(loop, Premise.SAMPLED_LOOP) < 1.0) == sound
