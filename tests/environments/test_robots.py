"""Arms: those of the catalogue, those of any URDF, and the files that are refused, each in a sentence."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ElementTree
from io import BytesIO
from itertools import combinations
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yourdfpy

from app.dashboard.scene.arm_parts import parts
from app.dashboard.view_options import FINE
from app.scenario.data import edited, from_toml, shipped, to_toml
from app.scenario.errors import ScenarioError
from app.session.changes import with_robot
from app.simulation.assembly import assemble
from app.simulation.closed_loop import ClosedLoop
from app.storage import uploaded_urdfs
from environments import robots, urdf
from environments.catalogue import CATALOGUE
from environments.robots import Robot, RobotError
from environments.working_posture import LENGTH, Tool
from tests.support.arms import arm

BENT = Path(__file__).parents[1] / "support" / "robots" / "bent3r.urdf"
TEXT = BENT.read_text(encoding="utf-8")


def tool_of(robot: Robot, q: np.ndarray) -> pin.SE3:
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    return data.oMi[robot.tool_joint] * robot.tool_placement


@pytest.mark.parametrize("name", [*CATALOGUE, "bent3r"])
def test_tool_is_where_another_reader_of_the_urdf_puts_it(name: str) -> None:
    robot = robots.load(name) if name in CATALOGUE else robots.load("", urdf=str(BENT))
    file = BytesIO(ElementTree.tostring(urdf.read(robot.urdf)))
    other = yourdfpy.URDF.load(file, load_meshes=False, filename_handler=lambda fname: fname)
    random = np.random.default_rng(1)
    offset = np.eye(4)
    offset[:3, 3] = robot.tool_offset
    for _ in range(5):
        q = random.uniform(
            np.maximum(robot.model.lowerPositionLimit, -3), np.minimum(robot.model.upperPositionLimit, 3)
        )
        other.update_cfg(robot.locked | dict(zip(robot.joint_names, q, strict=True)))
        T_base_tool = other.get_transform(robot.tool_frame) @ offset
        np.testing.assert_allclose(tool_of(robot, q).homogeneous, T_base_tool, atol=1e-6)


@pytest.mark.parametrize("name", CATALOGUE)
def test_working_posture_is_away_from_limits_and_singularities(name: str) -> None:
    system = arm(name)
    robot = system.robot
    assert (robot.posture - robot.model.lowerPositionLimit).min() > 0.4
    assert (robot.model.upperPositionLimit - robot.posture).min() > 0.4
    J_q = system.observe(robot.posture, np.zeros(robot.n), 0.0)[1].J_q
    assert np.linalg.svd(J_q, compute_uv=False)[-1] > 0.04
    assert len(robot.supplemental) == (1 if robot.n == 7 else 0)
    assert (robot.model.armature > 0.0).all()
    if robot.geometry == "pose":  # the tool points at the ground: z, but for the Z1, whose tool points along x
        down = tool_of(robot, robot.posture).rotation[2, 0 if name == "z1" else 2]
        assert down == pytest.approx(-1.0, abs=1e-3)


def test_urdf_gets_tool_frame_posture_and_limits_where_none_are_given() -> None:
    robot = robots.load("", urdf=str(BENT))
    assert (robot.title, robot.geometry, robot.tool_frame) == ("bent3r", "position", "tip")
    assert robot.frames == ("upper", "fore", "flange", "tip")
    assert robot.joint_names == ["turn", "shoulder", "elbow"]
    assert (robot.model.lowerPositionLimit[0], robot.model.upperPositionLimit[0]) == (-2 * np.pi, 2 * np.pi)
    tool = Tool(robot.model, robot.tool_joint, robot.tool_placement, robot.geometry)
    chosen = np.linalg.svd(tool.jacobian(robot.posture), compute_uv=False)[-1]
    random = np.random.default_rng(5)
    low, high = robot.model.lowerPositionLimit, robot.model.upperPositionLimit
    others = [np.linalg.svd(tool.jacobian(q), compute_uv=False)[-1] for q in random.uniform(low, high, (200, 3))]
    assert chosen > np.quantile(others, 0.9)
    assert (low < robot.posture).all()
    assert (robot.posture < high).all()
    assert np.array_equal(robot.posture, robots.load("", urdf=str(BENT)).posture)


def test_jacobian_of_the_search_is_the_derivative_of_the_tool_point() -> None:
    robot = robots.load("", urdf=str(BENT), tool_offset=(0.05, -0.02, 0.1))
    tool = Tool(robot.model, robot.tool_joint, robot.tool_placement, robot.geometry)
    q, h = np.array([0.4, -0.7, 1.1]), 1e-6
    columns = [tool_of(robot, q + h * e).translation - tool_of(robot, q - h * e).translation for e in np.eye(3)]
    np.testing.assert_allclose(tool.jacobian(q), np.array(columns).T / (2 * h), atol=1e-8)


def test_arms_with_free_joints_get_supplemental_coordinates_that_make_J_q_regular() -> None:
    panda = str(robots.robot_data_root() / "panda_description" / "urdf" / "panda.urdf")
    system = assemble(with_robot(shipped()["ur5-motion"], {"urdf": panda}))
    assert (system.robot.tool_frame, len(system.robot.supplemental)) == ("panda_hand_tcp", 1)
    J_q = system.observe(system.q_0, np.zeros(7), 0.0)[1].J_q
    assert np.linalg.svd(J_q, compute_uv=False)[-1] > 0.04


def chain(joints: list[tuple[str, tuple[float, float, float], str, float, float]]) -> str:
    """URDF of an arm of equal bodies. joints: kind, place in the link before, axis, lower and upper limit of each."""
    body = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    links = "".join(f'<link name="l{i}">{body}</link>' for i in range(len(joints) + 1))
    between = "".join(
        f'<joint name="j{i}" type="{kind}"><parent link="l{i}"/><child link="l{i + 1}"/>'
        f'<origin xyz="{x} {y} {z}"/><axis xyz="{axis}"/>'
        f'<limit lower="{lower}" upper="{upper}" effort="50" velocity="3"/></joint>'
        for i, (kind, (x, y, z), axis, lower, upper) in enumerate(joints)
    )
    return f'<robot name="chain">{links}{between}</robot>'


def completed(tool: Tool, q: np.ndarray, joints: tuple[int, ...]) -> float:
    """Smallest singular value of the Jacobian at q (n,) with the rates of these joints, times a length, below it."""
    return float(np.linalg.svd(np.vstack([tool.jacobian(q), LENGTH * np.eye(len(q))[list(joints)]]))[1][-1])


def test_free_joints_of_a_planar_arm_are_supplemented_by_joints_that_are_independent(tmp_path: Path) -> None:
    """The three joints that self-motion moves most move together here: with them J_q is nearly singular."""
    lengths = (0.0, 0.064, 0.306, 0.265, 0.060, 0.302)
    (path := tmp_path / "arm.urdf").write_text(
        chain([("revolute", (0.0, 0.0, length), "0 1 0", -3.1, 3.1) for length in lengths])
    )
    arm = {"urdf": str(path), "tool_offset": [0.0, 0.0, 0.256]}  # the last link, and a tool of 20 cm
    system = assemble(edited(with_robot(shipped()["ur5-motion"], arm), "motion", "hold"))
    robot, q = system.robot, system.q_0
    tool = Tool(robot.model, robot.tool_joint, robot.tool_placement, robot.geometry)
    assert (robot.geometry, tool.free) == ("planar", 3)
    least = [completed(tool, q, joints) for joints in combinations(range(6), 3)]
    assert completed(tool, q, robot.supplemental) == max(least)
    J_q = system.observe(q, np.zeros(6), 0.0)[1].J_q
    assert np.linalg.svd(J_q, compute_uv=False)[-1] == pytest.approx(max(least), rel=1e-6)
    assert max(least) > 0.05


@pytest.mark.parametrize("name", ["panda", "xarm7"])
def test_one_free_joint_is_the_one_that_self_motion_moves_most(name: str) -> None:
    own = robots.load(name)
    for robot in (own, robots.load("", urdf=str(own.urdf))):
        tool = Tool(robot.model, robot.tool_joint, robot.tool_placement, robot.geometry)
        assert tool.free == 1
        moved = np.abs(np.linalg.svd(tool.jacobian(robot.posture))[2][-1])
        assert tool.supplemental(robot.posture) == (int(moved.argmax()),)


TURN, SHORT = ("revolute", (0.3, 0.0, 0.0), "0 0 1", -2.0, 2.0), ("prismatic", (0.25, 0.0, 0.0), "0 0 1", 0.101, 0.104)
SLIDES = [("prismatic", (0.1, 0.0, 0.1), axis, 0.001, 0.004) for axis in ("1 0 0", "0 1 0", "0 0 1")]


@pytest.mark.parametrize("joints", [[TURN, TURN, SHORT], SLIDES])
def test_a_working_posture_lies_within_the_shortest_stroke(
    joints: list[tuple[str, tuple[float, float, float], str, float, float]], tmp_path: Path
) -> None:
    (path := tmp_path / "arm.urdf").write_text(chain(joints))
    found = robots.load("", urdf=str(path))
    assert (found.posture >= found.model.lowerPositionLimit).all()
    assert (found.posture <= found.model.upperPositionLimit).all()
    given = robots.load("", urdf=str(path), posture=tuple(found.posture.tolist()))
    assert np.array_equal(found.posture, given.posture)
    turning = np.array([not slides for slides in found.slides])
    assert np.array_equal(found.posture[turning], found.posture[turning].round(2))


def test_another_arm_brings_what_depends_on_it_and_can_be_saved() -> None:
    scenario = edited(edited(shipped()["ur5-hybrid"], "controller.K_s", [50.0] * 6), "truth.link_scaling", [1.1] * 6)
    scenario = with_robot(
        edited(scenario, "target_model.M_m", [10.0] * 6), {"posture": [0.1, -1.2, 1.8, -2.2, -1.6, 0.0]}
    )
    own = with_robot(scenario, {"urdf": os.path.relpath(BENT)})
    assert own.robot.urdf == str(BENT)
    assert (own.title, own.controller.K_s, own.truth.link_scaling, own.robot.posture) == ("bent3r", 50.0, 1.0, None)
    assert from_toml(to_toml(own)) == own
    loop = ClosedLoop.from_scenario(own)
    for _ in range(2000):
        loop.step()
    assert loop.stopped is None
    assert loop.view().force[2] == pytest.approx(-20.0, abs=0.3)
    moved = with_robot(own, {"posture": [0.5, 0.3, 1.5], "tool_offset": [0.0, 0.0, 0.05]})
    system = assemble(moved)
    tool = system.observe(system.q_0, np.zeros(3), 0.0)[0].p
    assert abs(loop.system.surface.chart(tool, 0.0).g[0]) > 0.05  # from where the surface was
    assert abs(system.surface.chart(tool, 0.0).g[0]) < 0.03
    assert with_robot(moved, {"tool_frame": "flange"}).robot.posture is None
    assert with_robot(moved, {"name": "z1"}).robot.urdf is None


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"posture": [0.0, 1.0]}, "robot.posture: 2 values given; allowed: 3, one for each joint of this arm"),
        (
            {"posture": [0.0, 90, 1.0]},
            "robot.posture: 90 rad for joint 'shoulder'; allowed: -1.8 to 1.8 rad; 90° are 1.571 rad",
        ),
        ({"tool_frame": "hand"}, "robot.tool_frame: no frame 'hand' in bent3r.urdf; allowed: upper, fore, flange, tip"),
        ({"tool_frame": "upper"}, "bent3r.urdf has 2 joints to its tool; allowed: 3 or more, or 2 or more that"),
        ({"tool_frame": "fore"}, "in no posture can its joints move the tool in all directions"),
        ({"tool_frame": "base"}, "robot.tool_frame: 'base' is moved by 0 joints"),
        ({"rotor_inertia": [0.1, -0.1, 0.1]}, "robot.rotor_inertia: [0.1, -0.1, 0.1] has a negative entry"),
        ({"rotor_inertia": []}, "robot.rotor_inertia: 0 "),
        ({"legs": 2}, "robot.legs: no such field; allowed: name, urdf"),
        ({"tool_offset": [1.0]}, "robot.tool_offset"),
    ],
)
def test_wrong_fields_of_the_robot(changes: dict[str, object], message: str) -> None:
    own = with_robot(shipped()["ur5-hybrid"], {"urdf": str(BENT)})
    with pytest.raises(ScenarioError) as refusal:
        assemble(with_robot(own, changes))
    assert message in str(refusal.value)
    assert "\n" not in str(refusal.value)


def without(tag: str) -> str:
    """The URDF without every element of this name."""
    root = ElementTree.fromstring(TEXT)
    for parent in list(root.iter()):
        for child in parent.findall(tag):
            parent.remove(child)
    return ElementTree.tostring(root, encoding="unicode")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\x89PNG\r\n", "not XML in UTF-8"),
        (TEXT.encode("utf-16"), "not XML in UTF-8"),
        ("", "not XML"),
        ("<robot", "not XML"),
        ("<mujoco/>", "its root is <mujoco>"),
        ("<robot name='r'/>", "0 links"),
        (" " * 5_000_001, "larger than 5 MB"),
        ('<!DOCTYPE r [<!ENTITY a "b">]>' + TEXT.partition("?>")[2], "has a DOCTYPE or an entity"),
        ("<robot>" * 5000 + "</robot>" * 5000, "nested at most 32 deep"),
        ("<robot>" + "<link/>" * 60_000 + "</robot>", "at most 50000 XML elements"),
        ("<robot>" + "".join(f"<link name='{i}'/>" for i in range(301)) + "</robot>", "301 links"),
        ('<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:include filename="/etc/passwd"/></robot>', "xacro"),
        (TEXT.replace("package://nobody_has_this", "http://example.com"), "is elsewhere on the network"),
        (TEXT.replace('mass value="3.0"', 'mass value="-3.0"'), "link 'column' has the mass -3 kg"),
        (TEXT.replace('mass value="3.0"', 'mass value="nan"'), "value = 'nan'; allowed: 1 finite number"),
        (TEXT.replace('mass value="3.0"', f'mass value="0.{"0" * 197}1e300"'), "value has 204 characters; allowed: "),
        (TEXT.replace('mass value="3.0"', 'mass value="2e6"'), "'2e6'; allowed: 1 finite number(s) of at most 1e+06"),
        (TEXT.replace('mass value="3.0"', 'mass value="3.0 kg"'), "value = '3.0 kg'; allowed: 1 finite number(s)"),
        (TEXT.replace('xyz="0 0 0.3"/><axis', f'xyz="0 0 0.{"0" * 200}1e302"/><axis'), "xyz has 211 characters"),
        (TEXT.replace('mass value="3.0"', 'mass value="0"'), "joint 'turn' moves a body of mass 0 kg"),
        (TEXT.replace('izz="0.01"', 'izz="-0.01"'), "link 'column': its inertia has the eigenvalue -0.01"),
        (TEXT.replace('ixz="0.001"', 'ixz="0.1"'), "link 'upper': its inertia has the eigenvalue -0.0"),
        (without("inertial"), "joint 'turn' moves a body of mass 0 kg"),
        (TEXT.replace('parent link="base"', 'parent link="tip"'), "its joints close a loop"),
        (TEXT.replace('<link name="tip"/>', '<link name="tip"/><link name="x"/>'), "both have no parent; allowed: one"),
        (TEXT.replace('parent link="base"', 'parent link="nowhere"'), "has no such parent link: 'nowhere'"),
        (TEXT.replace('child link="upper"', 'child link="column"'), "link 'column' has two parents"),
        (TEXT.replace('name="elbow"', 'name="shoulder"'), "two joints are called 'shoulder'"),
        (TEXT.replace('link name="tip"', 'link name="fore"'), "two links are called 'fore'"),
        (TEXT.replace('"continuous"', '"floating"'), "joint 'turn' is of type 'floating'; allowed: revolute"),
        (TEXT.replace('axis xyz="0 0 1"', 'axis xyz="0 0 0"'), "joint 'turn' has the axis 0 0 0"),
        (TEXT.replace('xyz="0 0 0.3"/><axis', 'xyz="0 0 1e999"/><axis'), "xyz = '0 0 1e999'; allowed: 3 finite"),
        (TEXT.replace('upper="1.8"', 'upper="-2"'), "joint 'shoulder' has the limits -1.8 to -2"),
        (without("limit"), "joint 'shoulder' has no limit"),
        (TEXT.replace('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><mimic joint="turn"/>'), "mimics another one"),
        (TEXT.replace("revolute", "fixed"), "no link that 2 to 8 joints move"),
        (TEXT.replace('axis xyz="0 1 0"', 'axis xyz="0 0 1"'), "in no posture can its joints move the tool"),
    ],
)  # fmt: skip
def test_wrong_files_are_refused_in_a_sentence(content: str | bytes, message: str, tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(RobotError) as refusal:
        robots.load("", urdf=str(path))
    assert message in str(refusal.value)
    assert "arm.urdf" in str(refusal.value)
    assert "\n" not in str(refusal.value)
    assert len(str(refusal.value)) < 500


def test_a_loop_beside_the_tree_is_refused() -> None:
    loop = """<link name="a"/><link name="b"/>
      <joint name="ab" type="fixed"><parent link="a"/><child link="b"/></joint>
      <joint name="ba" type="fixed"><parent link="b"/><child link="a"/></joint></robot>"""
    with pytest.raises(RobotError, match="close a loop"):
        urdf.parse(TEXT.replace("</robot>", loop).encode(), "loop.urdf")


def test_more_joints_than_eight_are_refused() -> None:
    links = "".join(
        f'<link name="l{i}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>'
        for i in range(10)
    )
    joints = "".join(
        f'<joint name="j{i}" type="continuous"><parent link="l{i}"/><child link="l{i + 1}"/><origin xyz="0 0 0.2"/>'
        f'<axis xyz="{i % 2} {(i + 1) % 2} 0"/></joint>'
        for i in range(9)
    )
    path = BENT.with_name("nine.urdf")
    root = urdf.parse(f'<robot name="nine">{links}{joints}</robot>'.encode(), path.name)
    full = robots._model(root, path)
    with pytest.raises(RobotError, match="'l9' is moved by 9 joints"):
        robots._chain(full, "l9", path)
    assert robots._farthest(robots._tool_frames(full), path) == "l7"


def test_meshes_are_read_from_the_package_or_the_folder_of_the_urdf_only(tmp_path: Path) -> None:
    inside, outside = tmp_path / "pack" / "meshes" / "a.stl", tmp_path / "secret.stl"
    own = tmp_path / "pack" / "urdf" / "parts" / "b.STL"
    for file in (inside, outside, own, own.with_name("passwd")):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("solid")
    (tmp_path / "pack" / "meshes" / "link.stl").symlink_to(outside)
    (tmp_path / "pack" / "package.xml").write_text("<package/>")
    arm = tmp_path / "pack" / "urdf" / "arm.urdf"
    assert urdf.mesh_file(arm, "package://pack/meshes/a.stl") == inside
    assert urdf.mesh_file(arm, "parts/b.STL") == own
    for name in (
        "package://pack/../secret.stl", f"package://{tmp_path.name}/secret.stl", "package://pack/meshes/link.stl", "package://other/meshes/a.stl",
        "../meshes/a.stl", str(outside), f"file://{outside}", "parts/passwd", "parts/none.stl", "parts", "a\0.stl", "http://a/b.stl",
    ):  # fmt: skip
        assert urdf.mesh_file(arm, name) is None, name


def test_an_arm_without_visuals_is_drawn_from_joint_to_joint() -> None:
    robot = robots.load("", urdf=str(BENT))
    drawn = parts(robot, (), FINE)
    assert {part.joint for part in drawn} == {0, 1, 2, 3}
    ends = {0: [0, 0, 0.3], 1: [0.05, 0, 0.1], 2: [0, 0.03, 0.35], 3: [0, 0, 0.3]}
    for joint, end in ends.items():
        vertices = np.vstack([part.vertices for part in drawn if part.joint == joint])
        assert np.linalg.norm(vertices - np.array(end), axis=1).min() < 0.04


def test_uploads_are_kept_by_their_contents(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    path = uploaded_urdfs.keep("../../my arm<b>.urdf", TEXT.encode())
    assert path.read_text() == TEXT
    assert path.is_relative_to(tmp_path / "vsmrc-lab" / "urdf")
    assert path.name == "my_arm_b.urdf"
    assert uploaded_urdfs.keep("../../my arm<b>.urdf", TEXT.encode()) == path
    assert uploaded_urdfs.keep("my arm<b>.urdf", TEXT.replace("3.0", "3.1").encode()).parent != path.parent
    with pytest.raises(ScenarioError, match="has a DOCTYPE"):
        uploaded_urdfs.keep("evil.xml", b"<!DOCTYPE a><robot/>")
    files = sorted(tmp_path.rglob("*.*"))
    assert len([file for file in files if file.is_file()]) == 2


def test_only_a_continuous_joint_has_no_range(tmp_path: Path) -> None:
    """A continuous joint has the limits of one turn for the model, but may turn on."""
    (urdf := tmp_path / "arm.urdf").write_text(TEXT)
    middle, half = robots.load("", urdf=str(urdf)).ranges
    assert np.isinf(half).tolist() == [True, False, False]
    np.testing.assert_allclose(half[1], 1.8)
    np.testing.assert_allclose(middle[:2], 0.0)


def test_another_tool_frame_of_the_same_joints_keeps_their_rotors_and_posture() -> None:
    for name, frame in (("ur5", "wrist_3_link"), ("xarm7", "link7")):
        own, other = robots.load(name), robots.load(name, tool_frame=frame)
        np.testing.assert_array_equal(other.model.armature, own.model.armature)
        np.testing.assert_array_equal(other.posture, own.posture)
        assert (other.rotor_source, other.supplemental) == (own.rotor_source, own.supplemental)
    fewer = robots.load("panda", tool_frame="panda_link6")
    np.testing.assert_array_equal(fewer.model.armature, robots.load("panda").model.armature[:6])


def test_renamed_joints_keep_apart_and_an_endless_one_without_limits_has_no_effort_limit(tmp_path: Path) -> None:
    body = """<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>"""
    links = "".join(f'<link name="{name}">{body}</link>' for name in ("base", "arm", "fore", "tip"))
    turns = "".join(
        f'<joint name="{name}" type="continuous"><parent link="{a}"/><child link="{b}"/>'
        f'<origin xyz="0.3 0 0"/><axis xyz="{axis}"/></joint>'
        for name, a, b, axis in (
            ("arm", "base", "arm", "0 1 0"), ("arm_joint", "arm", "fore", "0 1 0"), ("wrist", "fore", "tip", "0 1 0"),
        )
    )  # fmt: skip
    file = tmp_path / "named.urdf"
    file.write_text(f'<robot name="named">{links}{turns}</robot>')
    root = urdf.read(file)
    names = [joint.get("name") for joint in root.findall("joint")]
    assert names == ["arm_joint_joint", "arm_joint", "wrist"]
    robot = robots.load("ur5", urdf=file)
    assert list(robot.model.names)[1:] == names
    assert (np.array(robot.model.upperEffortLimit) >= 1e6).all()
