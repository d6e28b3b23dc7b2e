"""Angles that go on over half a turn: coordinates around a cylinder or sphere, and turns of the tool. An angle of the
task space is known up to whole turns only, and no error may jump by one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from app.scenario.data import load, with_values
from app.scenario.schema import Scenario
from app.simulation.closed_loop import ClosedLoop
from app.simulation.compiled_run import CompiledRun
from app.simulation.sampled_loop.period_map import PeriodMap, Posture

MOST = 0.1  # m, of any error of the runs here; a turn has 0.9 m at least


def run(scenario: Scenario, seconds: float) -> tuple[ClosedLoop, dict[str, np.ndarray]]:
    loop = ClosedLoop.from_scenario(scenario)
    CompiledRun(loop).advance(round(seconds / loop.period))
    return loop, loop.recording.signals(("q", "r", "e_r", "s_norm"))


def changed(name: str, **fields: Any) -> Scenario:
    return with_values(load(name), {path.replace("__", "."): value for path, value in fields.items()})


def pushed_in_a_pipe(reference: float) -> Scenario:
    """A tool that presses down in a pipe, where it is pushed along the circumference."""
    surface = {"kind": "cylinder", "side": "inside", "radius": 0.3, "origin": [0.57249, 0.0, 0.4798]}
    return changed(
        "ur5-hybrid-impedance",
        surface=surface | {"reference": [0.0, 0.0, reference]},
        motion={"kind": "hold"},
        truth__push=[30.0, 0.0, 0.0],
        truth__push_start=0.3,
        truth__push_duration=0.3,
    )


def test_the_run_does_not_depend_on_where_the_angle_around_a_cylinder_is_counted_from() -> None:
    """With the reference up, the push moves the tool over the half turn."""
    (up, over), (down, within) = (run(pushed_in_a_pipe(reference), 0.8) for reference in (1.0, -1.0))
    assert np.abs(np.diff(over["r"][:, 1])).max() < 1e-3  # m a period; it jumped by 1.88 m
    assert over["r"][:, 1].min() < -0.3 * np.pi < over["r"][:, 1].max()
    np.testing.assert_allclose(over["q"], within["q"], atol=1e-7)
    for loop in (up, down):
        assert loop.standing.run.verdict != "broken"
        assert loop.standing.now.verdict == "holds"


@pytest.mark.parametrize("side", ["cylinder", "sphere"])
def test_a_path_crosses_the_half_turn(side: str) -> None:
    surface = {"kind": side, "side": "inside", "radius": 0.3, "origin": [0.572, 0.0, 0.478]}
    loop, rows = run(changed("ur5-hybrid", surface=surface, motion={"kind": "line", "displacement": [0.05, 0.0]}), 1.5)
    assert loop.standing.now.verdict == "holds"
    assert np.abs(rows["e_r"]).max() < MOST


@pytest.mark.parametrize("moment", [-6.0, 6.0])
def test_the_tool_turns_over_half_a_turn(moment: float) -> None:
    """It was turned to 3.05 rad; a moment one way diverged where the angle jumped, the other way did not."""
    turn = {"kind": "point-to-point", "displacement": [0.0, 0.0, 3.05], "duration": 1.0}
    loop, rows = run(
        changed(
            "ur5-impedance",
            contact__kind="free",
            motion={"kind": "hold"},
            rotation=turn,
            truth__push=[0.0, 0.0, 0.0],
            truth__push_moment=[0.0, 0.0, moment],
            truth__push_start=1.2,
        ),
        1.8,
    )
    l = loop.system.layout.l
    assert loop.stopped is None
    assert loop.standing.now.verdict == "holds"
    assert np.abs(np.diff(rows["r"], axis=0)).max() < 1e-2
    if moment < 0.0:
        assert rows["r"][:, 5].max() > np.pi * l


def test_a_turn_of_more_than_half_a_turn_is_followed() -> None:
    turn = {"kind": "point-to-point", "displacement": [0.0, 0.0, 3.3], "duration": 1.5}
    loop, rows = run(changed("ur5-motion", motion={"kind": "hold"}, rotation=turn), 1.6)
    assert loop.standing.run.verdict == "holds"
    assert rows["r"][-1, 5] - rows["r"][0, 5] == pytest.approx(3.3 * loop.system.layout.l, abs=2e-3)


@pytest.mark.parametrize("blended", [False, True], ids=["one model", "a blend begins and ends"])
def test_an_error_that_grows_beyond_half_a_turn_does_not_jump(blended: bool) -> None:
    """A moment turns the tool away from its path, slowly, while everything holds."""
    blend = {"to": {"B_m": [110.0] * 6}, "at": 2.56, "over": 0.04} if blended else {"at": 0.0}
    loop, rows = run(
        changed(
            "ur5-impedance-6d",
            contact={"kind": "free"},
            motion={"kind": "hold"},
            target_model__B_m=[100.0] * 6,
            target_model__K_m=[400.0] * 5 + [60.0],
            rotation={"kind": "line", "displacement": [0.0, 0.0, 1.2], "period": 4.0, "ramp": 0.5},
            declared__link_scaling=0.0,
            truth__link_scaling=1.0,
            truth__push=[0.0, 0.0, 0.0],
            truth__push_moment=[0.0, 0.0, 6.0],
            truth__push_start=0.5,
            truth__push_duration=20.0,
            truth__push_every=0.0,
            simulation__domain_radius=2.5,
            blend=blend,
        ),
        2.7,
    )
    beyond = np.abs(rows["e_r"][:, 5]) > np.pi * loop.system.layout.l
    assert beyond[2530:2690].all()
    assert [epoch.t for epoch in loop.recording.epochs] == pytest.approx([0.0, 2.56, 2.6] if blended else [0.0])
    assert np.abs(np.diff(rows["e_r"], axis=0)).max() < 1e-2
    assert rows["s_norm"].max() < 0.1
    assert loop.standing.run.verdict != "broken"


@pytest.mark.parametrize("kind", ["cylinder", "sphere"])
@pytest.mark.parametrize("name", ["ur5-motion", "ur5-impedance"])
def test_a_tool_in_the_middle_of_a_surface_is_an_arm_like_others(name: str, kind: str) -> None:
    """There no direction is the normal."""
    tool = ClosedLoop.from_scenario(load(name)).view().tool
    surface = {"kind": kind, "side": "inside", "radius": 0.3, "origin": tool.tolist()}
    loop, rows = run(changed(name, surface=surface, motion={"kind": "hold"}, truth__push=[0.0, 0.0, 0.0]), 0.1)
    assert loop.stopped is None
    assert np.isfinite(rows["q"]).all()


def test_an_arm_beside_a_hollow_surface_is_judged_as_one_that_touches_it() -> None:
    """A surface that only pushes has no stiffness for a tool that is off it; a spring that pulls has one on a curved
    surface, which swings the arm up."""
    growths = []
    for gap in (0.0, 0.06, 0.1):
        surface = {"kind": "cylinder", "side": "inside", "radius": 0.3, "origin": [0.572, 0.0, 0.481 - gap]}
        scenario = changed("ur5-impedance", surface=surface, motion={"kind": "hold"}, truth__push=[0.0, 0.0, 0.0])
        loop = ClosedLoop.from_scenario(scenario)
        system = loop.system
        at = Posture.of(system, system.q_0, 0.0)
        growths.append(float(np.abs(np.linalg.eigvals(PeriodMap(system, at).jacobian())).max()))
        CompiledRun(loop).advance(200)
        assert loop.standing.run.verdict == "holds", gap
    assert max(growths) < 1.0
    assert np.ptp(growths) < 1e-3


@pytest.mark.parametrize(
    ("name", "surface"),
    [
        ("ur5-impedance", {"kind": "formula", "text": "z - 0.165 - 0.005*sin(10*x - 2*t)"}),
        ("ur5-motion", {"kind": "formula"}),
    ],
)
def test_surfaces_that_do_not_come_back_end_no_promise_about_coordinates_that_are_not_on_them(
    name: str, surface: dict[str, Any]
) -> None:
    loop, _ = run(changed(name, surface=surface, truth__push=[0.0, 0.0, 0.0]), 0.3)
    assert loop.standing.run.verdict == "holds"
    assert loop.state.flagged is None
