"""URDFs and meshes that are made to do harm: each is refused in one sentence, in bounded time and memory."""

from __future__ import annotations

import fcntl
import os
import time
from itertools import count
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from app.scenario.data import edited, load
from app.scenario.errors import ScenarioError
from app.session import commanded_run
from app.session.commands import Command, Edit, Load
from app.session.runner import Runner
from app.simulation.builders.environment_builder import robot_of
from app.storage import uploaded_urdfs
from drivers.waiting import until
from environments import robots, urdf
from environments.robots import Robot
from environments.urdf import RobotError
from tests.support.sentences import one_sentence
from tests.support.urdf_texts import BENT, UPPER, entities

pytestmark = pytest.mark.slow  # processes of its own


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (entities(9), "has a DOCTYPE"),
        ('<!DOCTYPE r SYSTEM "file:///etc/passwd"><robot name="r"/>', "has a DOCTYPE"),
        ('<!doctype r [<!ENTITY % x SYSTEM "http://127.0.0.1/"> %x;]><robot/>', "has a DOCTYPE"),
        (entities(3).encode("utf-16").decode("latin-1"), "not XML in UTF-8|not XML"),
        ("<robot>" + "<a>" * 100_000, "nested at most 32 deep"),
        ("<robot>" + "<a/>" * 60_000, "at most 50000 XML elements"),
        ("<robot>" + " " * 6_000_000, "larger than 5 MB"),
        ("<robot>" + '<link name="a"/>' * 2000 + "</robot>", "2000 links; allowed: 1 to 300"),
        (BENT.replace("upper", "u" * 500), "500 characters; allowed: at most 200"),
        (BENT.replace('<mass value="', '<mass value="nan" x="', 1), "value = 'nan'; allowed: 1 finite number"),
        (BENT.replace('<mass value="', '<mass value="1e99" x="', 1), "value = '1e99'; allowed"),
        (BENT.replace('<mass value="', f'<mass value="{"1 " * 100_000}" x="', 1), "has 200000 characters; allowed"),
        (BENT.replace('<mass value="', f'<mass value="0.{"0" * 197}1e300" x="', 1), "value has 204 characters"),
        (BENT.replace('<mass value="', '<mass value="x 1 " x="', 1), "value = 'x 1 '; allowed"),
        (BENT.replace('<mass value="', '<mass value="1_0" x="', 1), "value = '1_0'; allowed"),
        (BENT.replace("</joint>", '<mimic joint="turn" multiplier="nan"/></joint>', 1), "multiplier = 'nan'; allowed"),
        (BENT.replace("</joint>", '<dynamics damping="inf"/></joint>', 1), "damping = 'inf'; allowed"),
        (BENT.replace(UPPER, UPPER + '<visual><geometry><sphere radius="nan"/></geometry></visual>'), "radius = 'nan'"),
        (BENT.replace(UPPER, UPPER + '<visual><geometry><box size="1 0 1"/></geometry></visual>'), "size = 0; allowed"),
    ],
)  # fmt: skip
def test_urdfs_that_are_refused(content: str, message: str) -> None:
    with pytest.raises(RobotError, match=message) as caught:
        urdf.parse(content.encode("utf-8"), "evil.urdf")
    assert one_sentence(caught.value).startswith("robot.urdf: evil.urdf: ")


def test_what_is_called_like_the_world_is_not_taken_for_it(tmp_path: Path) -> None:
    (path := tmp_path / "arm.urdf").write_text(BENT.replace('"shoulder"', '"universe"'))
    assert robots.load("", urdf=str(path)).n == 3
    with pytest.raises(RobotError, match="a link is called 'universe', as the world is; allowed: another name"):
        urdf.parse(BENT.replace('"flange"', '"universe"').encode(), "arm.urdf")


def test_paths_that_are_no_urdf_are_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.urdf")
    closed = tmp_path / "closed"
    closed.mkdir()
    closed.chmod(0)
    for path in (
        "/dev/zero",
        str(tmp_path),
        str(tmp_path / "pipe.urdf"),
        "a" * 5000,
        "a\0b",
        f"{closed}/a.urdf",
    ):
        with pytest.raises(RobotError, match=r"robot.urdf: cannot read .*: ") as caught:
            robots.load("", urdf=path)
        one_sentence(caught.value)
    closed.chmod(0o700)
    with pytest.raises(RobotError):  # which is called a regular file, and says something when the system does
        robots.load("", urdf="/proc/kmsg")


def test_no_picture_and_no_mesh_elsewhere_is_left_to_be_read(tmp_path: Path) -> None:
    picture = '<material name="m"><texture filename="/dev/zero"/></material>'
    root = urdf.parse(BENT.replace(UPPER, f"{picture}{UPPER}").encode(), "arm.urdf")
    assert not list(root.iter("texture"))
    (tmp_path / "home" / "up").mkdir(parents=True)
    (tmp_path / "home" / "secret.stl").write_text("solid")
    arm = tmp_path / "home" / "up" / "arm.urdf"
    (tmp_path / "home" / "up" / "loop").symlink_to("loop")
    for name in ("package://home/secret.stl", "loop/a.stl", "x" * 5000 + ".stl", "file:///etc/passwd", "a\0.stl"):
        assert urdf.mesh_file(arm, name) is None, name


NUMBER = st.sampled_from(["0", "1", "-1", "0.3", "1e6", "1e-320", "nan", "inf", "1e999", "", "1 2", "x", "0x1"])


KIND = st.sampled_from(["revolute", "revolute", "continuous", "prismatic", "fixed"])


@st.composite
def arms(draw: st.DrawFn) -> str:
    """Nearly an arm: a tree most of the time, with a few odd numbers."""

    def number(usual: str) -> str:
        return draw(NUMBER) if draw(st.integers(0, 60)) == 0 else usual

    n = draw(st.integers(1, 6))
    links = "".join(
        f'<link name="l{i}"><inertial><origin xyz="0 0 {number("0.1")}"/><mass value="{number("1")}"/><inertia '
        f'ixx="{number("0.1")}" iyy="0.1" izz="{number("0.1")}" ixy="{number("0")}" '
        f'ixz="0" iyz="0"/></inertial></link>'
        for i in range(n + 1)
    )
    joints = "".join(
        f'<joint name="j{i}" type="{draw(KIND)}">'
        f'<parent link="l{draw(st.sampled_from([i] * 20 + [0, n]))}"/><child link="l{i + 1}"/>'
        f'<origin xyz="0 {number("0.1")} 0.3" rpy="{number("0")} 0 0"/>'
        f'<axis xyz="{number("0")} {i % 2} {(i + 1) % 2}"/>'
        f'<limit lower="{number("-2")}" upper="{number("2")}" effort="{number("9")}" velocity="9"/></joint>'
        for i in range(n)
    )
    return f'<robot name="r">{links}{joints}</robot>'


def test_whatever_is_nearly_an_arm_is_one_or_is_refused(tmp_path: Path) -> None:
    path, loaded = tmp_path / "generated.urdf", list[Robot]()

    @given(arms())
    @example(BENT)  # how many of those that are drawn can be loaded is chance
    @example('<robot name="r"/>')
    @settings(max_examples=120, deadline=None)
    def check(text: str) -> None:
        path.write_text(text)
        try:
            loaded.append(robots.load("", urdf=str(path)))
        except RobotError as error:
            one_sentence(error)

    check()
    assert loaded
    assert all(np.isfinite(robot.posture).all() for robot in loaded)


@given(st.one_of(st.binary(max_size=200), st.text(max_size=200).map(str.encode)))
@example("<À".encode())  # a tag that is not in ASCII
@settings(max_examples=150, deadline=None)
def test_whatever_is_uploaded_is_a_urdf_or_is_refused(content: bytes) -> None:
    for whole in (content, BENT.encode().replace(b"<axis", content)):
        try:
            text = ElementTree.tostring(urdf.parse(whole, "arm.urdf"), encoding="utf-8")
        except RobotError as error:
            one_sentence(error)
        else:
            assert ElementTree.tostring(urdf.parse(text, "arm.urdf"), encoding="utf-8") == text


def in_use(path: Path) -> Robot:
    """The arm of an uploaded file, held as a run holds its own."""
    robot = robot_of(edited(load("ur5-motion"), "robot", {"urdf": str(path)}))
    uploaded_urdfs.lock_while_used(robot, str(path))
    return robot


def test_a_run_holds_the_file_of_its_arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    one, two = (edited(load("ur5-motion"), "robot", {"urdf": str(tmp_path / name)}) for name in ("1.urdf", "2.urdf"))
    for scenario in (one, two):
        Path(scenario.robot.urdf or "").write_text(BENT)
    held: list[tuple[Robot, str | None]] = []
    monkeypatch.setattr(commanded_run, "lock_while_used", lambda robot, path: held.append((robot, path)))
    running = Runner(one)
    running.post(Load(two))
    assert running._obey(running._queued())
    assert [path for _, path in held] == [one.robot.urdf, two.robot.urdf]
    assert held[-1][0] is running._loop.system.robot


def test_a_file_that_a_run_uses_stays_locked_when_it_is_uploaded_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    path = uploaded_urdfs.keep("arm.urdf", BENT.encode())
    arm = in_use(path)
    assert uploaded_urdfs.keep("arm.urdf", BENT.encode()) == path
    with path.open("rb") as file, pytest.raises(BlockingIOError):
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    assert arm.n


def test_uploads_do_not_fill_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))

    def left() -> set[Path]:
        return {file for file in tmp_path.rglob("*") if file.is_file()}

    def another(number: int) -> Path:
        return uploaded_urdfs.keep(f"arm{number}.urdf", BENT.replace("3.0", f"3.{number}").encode())

    one, two = another(1), another(2)
    monkeypatch.setattr(uploaded_urdfs, "MOST_BYTES", int(2.5 * len(BENT)))
    with pytest.raises(ScenarioError, match=r"arm3.urdf has .* MB, and 2 uploads of .* are kept in .*; allowed: ") as e:
        another(3)
    one_sentence(e.value)
    assert another(2) == two  # what is kept already is no more
    assert left() == {one, two}
    foreign = tmp_path / "foreign.urdf"
    foreign.write_text(BENT)
    for file in (one, two, foreign):
        os.utime(file, (0, 0))  # long ago
    for file in (two, foreign):
        in_use(file)
    assert foreign.stat().st_mtime == 0
    three = another(3)
    assert left() == {two, three, foreign}  # the one that nobody has used has gone
    running = in_use(two)
    os.utime(two, (0, 0))  # the clock was put right, or the run goes on for months
    monkeypatch.setattr(uploaded_urdfs, "MOST_BYTES", int(3.5 * len(BENT)))
    four = another(4)
    assert left() == {two, three, four, foreign}
    del running
    os.utime(two, (0, 0))
    five = another(5)
    assert left() == {three, four, five, foreign}
    assert all(file.stat().st_mode & 0o777 == 0o600 for file in (three, four, five))
    assert all(at.stat().st_mode & 0o777 == 0o700 for at in (three.parent, uploaded_urdfs.folder()))
    monkeypatch.setattr(uploaded_urdfs, "MOST_KEPT", 3)
    with pytest.raises(ScenarioError, match="3 uploads"):
        another(6)


def test_who_comes_over_the_network_learns_of_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    (given := tmp_path / "given.urdf").write_text(BENT)
    (other := tmp_path / "other.urdf").write_text(BENT)
    uploaded = uploaded_urdfs.keep("arm.urdf", BENT.encode())
    runner = Runner(edited(load("ur5-motion"), "motion", {"kind": "hold"}), uploaded_urdfs.FileAccess((str(given),)))
    runner.start()

    def answer(command: Command) -> str | None:
        before = runner.snapshot.revision, runner.snapshot.refusal_number
        runner.post(command)
        until(lambda: (runner.snapshot.revision, runner.snapshot.refusal_number) != before)
        return runner.snapshot.refusal

    try:
        for there in (str(given), str(uploaded)):
            assert answer(Edit("robot.urdf", there)) is None
        for elsewhere in (
            str(other),
            str(tmp_path / "none"),
            f"{uploaded_urdfs.folder()}/../../other.urdf",
            "/dev/tty",
            "~",
        ):
            for command in (Edit("robot.urdf", elsewhere), Load(edited(load("ur5-motion"), "robot.urdf", elsewhere))):
                message = answer(command)
                assert message is not None
                assert message.endswith(": not on this server; allowed: a URDF that was uploaded"), message
    finally:
        runner.close()


def test_one_visitor_does_not_take_all_uploads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    monkeypatch.setattr(uploaded_urdfs, "MOST_OF_ONE", 4)
    monkeypatch.setattr(uploaded_urdfs, "MOST_KEPT", 7)
    numbers = count()

    def another(*marks: str) -> Path:
        number = next(numbers)
        return uploaded_urdfs.keep(f"arm{number}.urdf", BENT.replace("3.0", f"3.{number}").encode(), marks)

    oldest = another()
    greedy = [another(f"browser{number}", "address") for number in range(4)]
    with pytest.raises(ScenarioError, match=r"and 4 uploads .*; allowed: 4 of 100 MB of one visitor") as e:
        another("browser9", "address")
    one_sentence(e.value)
    others = [another("other"), another("other")]
    with pytest.raises(ScenarioError, match=r"and 7 uploads .* in all"):
        another("other")  # all of them are in use
    for number, path in enumerate([oldest, *others, *greedy]):
        os.utime(path, (time.time() - 2 * uploaded_urdfs.IDLE + number,) * 2)
    new = another("other")
    assert [path.exists() for path in (oldest, *others, *greedy, new)] == [True] * 3 + [False] + [True] * 4
    another("browser9", "address")  # makes room of its own first
    assert [path.exists() for path in greedy] == [False, False, True, True]


def test_an_upload_that_nobody_used_for_long_stays_while_there_is_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A saved scenario may name it."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    monkeypatch.setattr(uploaded_urdfs, "MOST_KEPT", 3)
    kept = [uploaded_urdfs.keep("arm1.urdf", BENT.encode(), ("browser",))]
    for number in (1, 2, 3):
        os.utime(kept[0], (time.time() - 2 * uploaded_urdfs.UNUSED,) * 2)
        kept.append(uploaded_urdfs.keep(f"arm{number}.urdf", BENT.replace("3.0", f"3.{number}").encode(), ("other",)))
        assert kept[0].exists() == (number < 3)
    assert all(path.exists() for path in kept[1:])


def test_an_upload_in_use_stays_also_where_its_visitor_has_too_many(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    monkeypatch.setattr(uploaded_urdfs, "MOST_OF_ONE", 2)
    monkeypatch.setattr(uploaded_urdfs, "UNUSED", 2 * uploaded_urdfs.IDLE)

    def another(number: int) -> Path:
        return uploaded_urdfs.keep(f"arm{number}.urdf", BENT.replace("3.0", f"3.{number}").encode(), ("browser",))

    one, two = another(1), another(2)
    running = in_use(one)
    for path in (one, two):
        os.utime(path, (0, 0))  # the clock was put right
    three = another(3)
    assert [path.exists() for path in (one, two, three)] == [True, False, True]
    assert {file.stat().st_mode & 0o777 for file in tmp_path.glob("vsmrc-lab/urdf/*/*")} == {0o600}  # marks, too
    assert {file.stat().st_mode & 0o777 for file in tmp_path.glob("vsmrc-lab/urdf/*")} == {0o700}
    with pytest.raises(ScenarioError, match="allowed: 2 of 100 MB of one visitor"):
        another(4)
    del running
    os.utime(one, (0, 0))
    four = another(4)
    assert [path.exists() for path in (one, three, four)] == [False, True, True]


# meshes
