"""Task coordinates of one's choice, and the desired motion of those that are angles."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from app.analysis.metrics import account
from app.scenario.data import edited, from_plain, load, to_plain
from app.scenario.errors import ScenarioError
from app.scenario.field_info import field_info
from app.scenario.schema import Scenario
from app.scenario.units import JOINT
from app.session.adaptation_sentence import adaptation_sentence
from app.session.changes import in_coordinates, in_mode, on_robot, possible, with_robot
from app.session.headless_run import simulate
from app.simulation.assembly import assemble
from app.simulation.closed_loop import ClosedLoop

TURN = (0.2, -0.15, 0.3)  # rad


def with_fields(scenario: Scenario, **sections: dict[str, object]) -> Scenario:
    data = to_plain(scenario)
    for name, fields in sections.items():
        data[name] = {**(data[name] if "kind" not in fields else {}), **fields}
    return from_plain(data)


def test_the_tool_turns_by_the_desired_angles_whatever_its_links_weigh() -> None:
    turning = {"kind": "point-to-point", "displacement": list(TURN), "duration": 1.0}
    loop, _ = simulate(with_fields(load("ur5-motion"), rotation=turning, simulation={"duration": 2.0}))
    robot, q = loop.system.robot, loop.recording.signals(("q",))["q"]
    data = robot.model.createData()

    def tool(q: np.ndarray) -> np.ndarray:
        pin.forwardKinematics(robot.model, data, q)
        return data.oMi[robot.tool_joint].rotation @ robot.tool_placement.rotation

    turned = tool(loop.system.q_0).T @ tool(q[-1])
    assert pin.rpy.matrixToRpy(turned) == pytest.approx(TURN, abs=2e-4)


@pytest.mark.parametrize("kind", ["line", "circle"])
def test_angles_follow_a_path_of_their_own_beside_the_positions(kind: str) -> None:
    path = {"kind": "line", "displacement": [0.0, 0.4], "period": 2.0, "ramp": 0.0}
    if kind == "circle":
        path = {"kind": "circle", "radius": 0.2, "axes": [0, 2], "period": 2.0, "ramp": 0.0}
    plain = load("ur5-motion")
    still, system = assemble(plain), assemble(with_fields(plain, rotation=path))
    for t in (0.0, 0.3, 1.1):
        r_d, before = system.reference(t).r_d, still.reference(t).r_d
        c, s = np.cos(np.pi * t), np.sin(np.pi * t)
        angles = (0.0, 0.2 * (1 - c), 0.0) if kind == "line" else (0.2 * (c - 1), 0.0, 0.2 * s)
        assert r_d - before == pytest.approx([0.0, 0.0, 0.0, *(system.layout.l * np.array(angles))], abs=1e-12)
        h = 1e-5
        differences = (system.reference(t + h).r_d - system.reference(t - h).r_d) / (2 * h)
        assert system.reference(t).r_d_dot == pytest.approx(differences, abs=1e-8)


def test_joints_of_ones_choice_take_the_place_of_the_tools_angles() -> None:
    scenario = edited(load("ur5-motion"), "task_space.supplemental", [4, 5, 6])
    loop = ClosedLoop.from_scenario(scenario)
    system = loop.system
    assert [c.name for c in system.coordinates] == ["x", "y", "z", "ℓ·q₄", "ℓ·q₅", "ℓ·q₆"]
    q, l = system.q_0 + 0.1, system.layout.l
    task = system.observe(q, np.zeros(6), 0.0)[1]
    assert task.r[3:] == pytest.approx(l * q[3:])
    assert task.J_q[3:] == pytest.approx(l * np.eye(6)[3:])
    for _ in range(500):
        loop.step()
    assert loop.stopped is None
    assert np.abs(loop.recording.signals(("e_r",))["e_r"][-100:]).max() < 1e-5
    with pytest.raises(ScenarioError, match=r"task_space.supplemental: 2 joints; allowed: 0 or 3 with this arm"):
        assemble(edited(scenario, "task_space.supplemental", [1, 2]))
    with pytest.raises(ScenarioError, match=r"task_space.supplemental: \[1, 1, 7\]; allowed: different numbers from 1"):
        assemble(edited(scenario, "task_space.supplemental", [1, 1, 7]))
    with pytest.raises(ScenarioError, match=r"or other joints in task_space.supplemental"):
        assemble(edited(scenario, "task_space.supplemental", [1, 2, 3]))  # which the positions determine


def test_the_elbow_swings_while_the_tool_presses() -> None:
    loop, metrics = simulate(load("panda-elbow"))
    assert [c.name for c in loop.system.coordinates][-1] == "ℓ·q₃"
    rows = loop.recording.signals(("t", "q", "F_c"))
    late = rows["t"] > 2.0
    q_3 = rows["q"][:, 2] - loop.system.q_0[2]
    period = loop.system.scenario.rotation.period  # pyright: ignore[reportAttributeAccessIssue]
    omega = 2 * np.pi / period
    expected = 0.15 * (1 - np.cos(omega * (rows["t"] - 0.5)))  # half of the ramp of 1 s later
    assert np.abs(q_3 - expected)[late].max() < 1e-3
    assert np.abs(rows["F_c"][late, 0] - 10.0).max() < 0.1
    assert metrics.motion_error_tail is not None
    assert metrics.motion_error_tail < 1e-4
    last = rows["t"] >= rows["t"][0] + 0.8 * (rows["t"][-1] - rows["t"][0])
    assert metrics.angle_error_tail is not None
    assert np.abs(q_3 - expected)[last].max() <= metrics.angle_error_tail < 2e-4  # the tool's angles are held beside it


def test_the_angle_error_is_that_of_the_planar_arms_sum_of_joints() -> None:
    """Pressed into a corner the tool only turns, by 0.1 (1 - cos) rad, which computed torque follows 8 mrad beside."""
    scenario = edited(load("planar3r-corner"), "controller.law", "computed-torque")
    loop, metrics = simulate(edited(scenario, "motion", "hold"))
    rows = loop.recording.signals(("t", "q"))
    turned = np.abs(rows["q"].sum(axis=1) - loop.system.q_0.sum())
    error = turned - 0.1 * (1 - np.cos(2 * np.pi / 4.0 * (rows["t"] - 0.5)))  # half of the ramp of 1 s later
    largest = np.abs(error[rows["t"] >= 0.8 * rows["t"][-1]]).max()
    assert largest > 5e-3
    assert metrics.angle_error_tail == pytest.approx(largest, rel=1e-6)
    assert metrics.motion_error_tail is None
    found = account(loop.system, loop.recording, 8.0, 10.0)
    assert found is not None
    assert (found.path_rms, found.path_max) == (None, None)
    assert found.angle_max == pytest.approx(largest, rel=1e-6)


@pytest.mark.parametrize("roll", [0.6, 0.5 * np.pi, np.pi])
def test_the_angle_of_a_planar_arm_is_about_the_worlds_axis_whatever_the_frame_of_its_tool(
    roll: float, tmp_path: Path
) -> None:
    text = (Path(__file__).parents[2] / "static" / "robots" / "planar3r.urdf").read_text()
    path = tmp_path / "rolled.urdf"
    path.write_text(text.replace('<origin xyz="0.15 0 0"/>', f'<origin xyz="0.15 0 0" rpy="{roll} 0 0"/>', 1))
    system = assemble(with_robot(edited(load("planar3r-hybrid"), "truth", {}), {"urdf": str(path)}))
    random, l = np.random.default_rng(3), system.layout.l
    for _ in range(5):
        moved, q_dot = random.uniform(-0.4, 0.4, 3), random.uniform(-1.0, 1.0, 3)
        task = system.observe(system.q_0 + moved, q_dot, 0.0)[1]
        assert task.r[2] / l == pytest.approx(-moved.sum(), abs=1e-9)  # every joint turns about -y
        assert task.r_dot[2] / l == pytest.approx(-q_dot.sum(), abs=1e-9)


def test_joints_and_planar_tools_that_only_move_have_no_angle_error() -> None:
    for scenario in (edited(load("ur5-motion"), "task_space.kind", "joint"), load("planar2r-semicircle")):
        _, metrics = simulate(edited(scenario, "simulation.duration", 0.05))
        assert metrics.angle_error_tail is None
        assert metrics.motion_error_tail is not None
    assert metrics.promise.verdict == "holds"


def test_cartesian_axes_are_turned_as_asked() -> None:
    turn = (0.3, -0.2, 0.5)
    scenario = edited(load("ur5-impedance"), "task_space.axes", list(turn))
    plain, turned = assemble(load("ur5-impedance")), assemble(scenario)
    q = plain.q_0
    at = [system.observe(q, np.zeros(6), 0.0)[1].r[:3] for system in (plain, turned)]
    assert Rotation.from_rotvec(turn).apply(at[1]) == pytest.approx(at[0])
    with pytest.raises(ScenarioError, match=r"task_space\.axes: .*; allowed for a planar arm"):
        assemble(from_plain({"robot": {"name": "planar3r"}, "task_space": {"axes": [0.1, 0.0, 0.0]}}))


def test_z_begins_as_given_where_it_is_kept() -> None:
    z_0 = [0.02, 0.0, -0.01, 0.0, 0.0, 0.0]
    kept = edited(edited(load("ur5-motion"), "controller.on_change", "watch"), "controller.z_0", z_0)
    loop = ClosedLoop.from_scenario(kept)
    loop.step()
    row = loop.recording.signals(("s", "z", "e_r", "e_r_dot"))
    gains = loop.system.controller.compensator
    assert row["z"][0] == pytest.approx(z_0)
    assert row["s"][0] == pytest.approx(row["e_r_dot"][0] + gains.F_1 @ row["e_r"][0] + gains.F_2 @ np.array(z_0))
    removed = ClosedLoop.from_scenario(edited(kept, "controller.on_change", "remove"))
    removed.step()
    assert removed.recording.signals(("s",))["s"][0] == pytest.approx(np.zeros(6), abs=1e-9)
    with pytest.raises(ScenarioError, match=r"controller.z_0: 2 values; allowed: 6"):
        assemble(edited(kept, "controller.z_0", [0.0, 0.0]))


def test_lengths_of_a_rotation_are_radians() -> None:
    assert (field_info("rotation.displacement").unit, field_info("rotation.radius").unit) == ("rad", "rad")
    assert (field_info("motion.displacement").unit, field_info("rotation.period").unit) == ("m", "s")


def test_another_arm_or_other_coordinates_keep_what_remains_of_a_rotation() -> None:
    swinging = load("panda-elbow")
    there = on_robot(swinging, "ur5")
    assert there.rotation.displacement == (0.0, 0.0, 0.0)  # pyright: ignore[reportAttributeAccessIssue]
    assert possible(there, lambda asked: ClosedLoop.from_scenario(asked).system).robot.n == 6
    in_joints = in_coordinates(in_mode(load("panda-elbow"), "motion"), "kind", "joint")
    assert in_joints.rotation.__struct_config__.tag == "hold"
    assert "rotation hold instead of line" in adaptation_sentence(swinging, in_joints, JOINT)
    with pytest.raises(ScenarioError, match=r"rotation\.kind: 'line'; allowed where r = q: 'hold'"):
        assemble(edited(edited(in_mode(swinging, "motion"), "rotation", "line"), "task_space.kind", "joint"))
