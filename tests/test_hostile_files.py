"""Files and texts that are made to do harm: each is refused in one sentence, in bounded time and memory."""

from __future__ import annotations

import io
import os
import struct
import subprocess
import sys
import zipfile
from contextlib import suppress
from pathlib import Path
from unittest.mock import MagicMock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app import uploads, visuals
from app.commands import _setting
from app.dashboard.robot_view import RobotView
from app.data_files import SIGNALS, read_npz, table, write_npz
from app.printable import printable
from app.recording import Recording
from app.scenario import LARGEST, Scenario, ScenarioError, edited, from_file, from_toml, load, shipped, to_toml
from environments import robots, urdf
from environments.formula import FormulaError, parse
from environments.tape import tape_of
from environments.urdf import RobotError
from fuzzing.matrix import read_typed
from tests.visitors import gone

BENT = (Path(__file__).parent / "robots" / "bent3r.urdf").read_text(encoding="utf-8")
UPPER = '<link name="upper">'


def one_sentence(error: BaseException) -> str:
    said = str(error)
    assert "\n" not in said
    assert "Traceback" not in said
    assert len(said) < 1200
    return said


# URDFs


def entities(levels: int) -> str:
    grown = "".join(f'<!ENTITY e{i + 1} "{f"&e{i};" * 10}">' for i in range(levels))
    return f'<?xml version="1.0"?><!DOCTYPE r [<!ENTITY e0 "lol">{grown}]><robot name="&e{levels};"/>'


@pytest.mark.parametrize(
    ("content", "said"),
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
        (BENT.replace('<mass value="', f'<mass value="{"1 " * 100_000}" x="', 1), "allowed: 1 finite number"),
        (BENT.replace('<mass value="', '<mass value="1_0" x="', 1), "value = '1_0'; allowed"),
        (BENT.replace("</joint>", '<mimic joint="turn" multiplier="nan"/></joint>', 1), "multiplier = 'nan'; allowed"),
        (BENT.replace("</joint>", '<dynamics damping="inf"/></joint>', 1), "damping = 'inf'; allowed"),
        (BENT.replace(UPPER, UPPER + '<visual><geometry><sphere radius="nan"/></geometry></visual>'), "radius = 'nan'"),
        (BENT.replace(UPPER, UPPER + '<visual><geometry><box size="1 0 1"/></geometry></visual>'), "size = 0; allowed"),
    ],
)  # fmt: skip
def test_urdfs_that_are_refused(content: str, said: str) -> None:
    with pytest.raises(RobotError, match=said) as caught:
        urdf.parse(content.encode("utf-8"), "evil.urdf")
    assert one_sentence(caught.value).startswith("robot.urdf: evil.urdf: ")


def test_paths_that_are_no_urdf_are_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.urdf")
    closed = tmp_path / "closed"
    closed.mkdir()
    closed.chmod(0)
    for path in ("/dev/zero", str(tmp_path), str(tmp_path / "pipe.urdf"), "a" * 5000, "a\0b", f"{closed}/a.urdf"):
        with pytest.raises(RobotError, match=r"robot.urdf: cannot read .*: ") as caught:
            robots.load("", urdf=path)
        one_sentence(caught.value)
    closed.chmod(0o700)


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
        f'ixx="{number("0.1")}" iyy="0.1" izz="{number("0.1")}" ixy="{number("0")}"/></inertial></link>'
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


@given(arms())
@settings(max_examples=120, deadline=None)
def test_whatever_is_nearly_an_arm_is_one_or_is_refused(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    path = tmp_path_factory.getbasetemp() / "generated.urdf"
    path.write_text(text)
    try:
        robot = robots.load("", urdf=str(path))
    except RobotError as error:
        one_sentence(error)
    else:
        assert np.isfinite(robot.posture).all()


@given(st.one_of(st.binary(max_size=200), st.text(max_size=200).map(str.encode)))
@settings(max_examples=150, deadline=None)
def test_whatever_is_uploaded_is_a_urdf_or_is_refused(content: bytes) -> None:
    for whole in (content, BENT.encode().replace(b"<axis", content)):
        with suppress(RobotError):
            urdf.parse(whole, "arm.urdf")


def test_uploads_do_not_fill_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    kept = uploads.keep("one.urdf", BENT.encode())
    monkeypatch.setattr(uploads, "MOST_KEPT", len(BENT) + 10)
    assert uploads.keep("one.urdf", BENT.encode()) == kept
    with pytest.raises(
        ScenarioError, match=r"two.urdf has .* MB, and .* MB of uploads are kept .*; allowed: "
    ) as caught:
        uploads.keep("two.urdf", BENT.replace("3.0", "3.1").encode())
    one_sentence(caught.value)
    assert [file for file in tmp_path.rglob("*") if file.is_file()] == [kept]


# meshes


def _bomb(path: Path) -> None:
    packed = zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1)
    with packed as archive, archive.open("a.dae", "w", force_zip64=True) as entry:
        for _ in range(16):
            entry.write(bytes(100_000_000))


def _pipe(path: Path) -> None:
    os.mkfifo(path.with_name("pipe.png"))
    path.with_name("a.mtl").write_text("newmtl m\nmap_Kd pipe.png\n")
    path.write_text("mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n")


def _lie(path: Path) -> None:
    path.write_bytes(bytes(80) + struct.pack("<I", 4_000_000_000) + bytes(500))


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("bomb.dae", _bomb),  # an archive that becomes 1.6 GB
        ("pipe.obj", _pipe),  # a picture that never comes
        ("lie.stl", _lie),  # a header that claims 4e9 triangles
        ("laughs.dae", lambda path: path.write_text(entities(9).replace("robot", "COLLADA"))),
    ],
)
def test_meshes_that_would_take_the_machine_are_not_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, make
) -> None:
    monkeypatch.setattr(visuals, "PATIENCE", 3.0 if name == "pipe.obj" else 60.0)
    make(tmp_path / name)
    arm = tmp_path / "arm.urdf"
    mesh = f'<visual><geometry><mesh filename="{name}"/></geometry></visual>'
    arm.write_text(BENT.replace(UPPER, UPPER + mesh))
    assert visuals.link_meshes(robots.load("", urdf=str(arm))).result(90.0) == ()


def test_the_process_that_reads_meshes_ends_with_the_one_that_began_it(tmp_path: Path) -> None:
    _pipe(tmp_path / "pipe.obj")
    arm = tmp_path / "arm.urdf"
    arm.write_text(BENT.replace(UPPER, UPPER + '<visual><geometry><mesh filename="pipe.obj"/></geometry></visual>'))
    code = f"""
import os, pathlib, time
from app import visuals
from environments import robots
visuals.link_meshes(robots.load("", urdf={str(arm)!r}))
children = pathlib.Path(f"/proc/{{os.getpid()}}/task")
while not (found := "".join(path.read_text() for path in children.glob("*/children")).split()):
    time.sleep(0.05)
print(*found, flush=True)
time.sleep(1.0)
os._exit(0)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=90, check=True)
    (reader,) = map(int, done.stdout.split())
    assert gone(reader, 10.0)


def test_a_mesh_of_ones_own_is_shown(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    arm = tmp_path / "arm.urdf"
    visual = '<visual><origin xyz="0 0 2"/><geometry><mesh filename="a.obj"/></geometry></visual>'
    arm.write_text(BENT.replace(UPPER, UPPER + visual))
    robot, scene = robots.load("", urdf=str(arm)), MagicMock()
    scene.add_mesh_simple.side_effect = lambda name, *_, **__: MagicMock(path=name)
    view = RobotView(scene, robot, "/arm")
    bones = list(view._shapes)
    assert {Path(bone.path).name[:5] for bone in bones} == {"bone_"}  # nobody waits for the process that reads
    (mesh,) = visuals.link_meshes(robot).result(90.0)
    assert mesh.link == "upper"
    np.testing.assert_allclose(mesh.vertices.max(axis=0), [1, 1, 2])
    for _ in range(2):
        view.show(np.zeros(robot.n))
        assert all(bone.remove.call_count == 1 for bone in bones)
        assert {Path(shape.path).name[:5] for shape in view._shapes} == {"mesh_"}


# scenarios


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a=" + "[" * 5000, "nested without end; allowed: at most 16 deep"),
        ("y." * 20_000 + "b = 1", "line 1 has 20000 dots; allowed: at most 300"),
        ("x." * 100 + "b = 1", "tables or lists within each other; allowed: at most 16"),
        ("[simulation]\nseed = " + "9" * 5000, "thousands of digits; allowed"),
        ("[simulation]\nseed = " + "9" * 300, "simulation.seed: a whole number of 997 bits; allowed"),
        ("[contact]\nK_e = 1e999", "contact.K_e: inf; allowed: a finite number"),
        ("[controller]\nlayer = nan", "controller.layer: nan; allowed: a finite number"),
        ("[truth]\npayload_mass = 1979-05-27", "truth.payload_mass: datetime.*; allowed: a number"),
        ("[target_model]\nM_m = [" + "1," * 1000 + "]", "target_model.M_m: .*allowed: .*length <= 32"),
        ("[target_model]\nM_m = [['a']]", r"target_model.M_m\[0\]\[0\]: 'a'; allowed: a number"),
        (f"title = '{'x' * 300}'", "title: 'xxx.*; allowed: text of length <= 200"),
        ('title = "a\\u001b[2J"', "title: 'a.x1b.2J'; allowed: text in one line, without control characters"),
        ("colour = 1", "colour: no such field; allowed: name, title, mode"),
        ("[surface]\nkind = 'plane'\nradius = 1", "surface.radius: no such field; allowed: kind, origin"),
        ("[motion]\nkind = 'spiral'", "motion.kind: 'spiral'; allowed: hold, point-to-point"),
        ("robot = 1", "robot: 1; allowed: a table"),
        ("#" * (LARGEST + 1), "allowed: at most"),
    ],
)  # fmt: skip
def test_scenarios_that_are_refused(text: str, said: str) -> None:
    with pytest.raises(ScenarioError, match=said) as caught:
        from_file(text.encode())
    one_sentence(caught.value)


def test_encodings_of_scenarios() -> None:
    assert from_file(b"\xef\xbb\xbfname = 'a'\r\ntitle = 'b'\r\n") == Scenario(name="a", title="b")
    for content in ("name = 'a'".encode("utf-16"), b"name = '\xe9'"):
        with pytest.raises(ScenarioError, match="not a TOML file"):
            from_file(content)


def test_files_that_are_no_scenario_are_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.toml")
    (tmp_path / "folder.toml").mkdir()
    (tmp_path / "zero.toml").symlink_to("/dev/zero")
    for path in (
        tmp_path / "pipe.toml",
        tmp_path / "folder.toml",
        tmp_path / "zero.toml",
        "a" * 5000 + ".toml",
        "\0.toml",
    ):
        with pytest.raises(ScenarioError, match=r"scenario .*cannot be read") as caught:
            load(str(path))
        one_sentence(caught.value)


PLAIN = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=8), st.dates()),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=6), inner, max_size=4),
    max_leaves=12,
)
PATHS = [f"{section}.{name}" for section in Scenario.__struct_fields__ for name in ("kind", "K_e", "M_m", "by", "x")]
PATHS += [
    "robot.posture",
    "surface.text",
    "simulation.seed",
    "controller.F_1",
    "truth.link_scaling",
    "blend.to.K_m",
    "",
]


@given(st.sampled_from(PATHS), PLAIN)
@settings(max_examples=200, deadline=None)
def test_whatever_a_field_is_set_to_is_a_scenario_or_is_refused(path: str, value: object) -> None:
    try:
        scenario = edited(load("ur5-hybrid"), path, value)
    except ScenarioError as error:
        one_sentence(error)
    else:
        assert from_toml(to_toml(scenario)) == scenario


@given(st.one_of(st.binary(max_size=120), st.text(max_size=120).map(str.encode)), st.integers(0, 400))
@settings(max_examples=150, deadline=None)
def test_whatever_is_loaded_is_a_scenario_or_is_refused(content: bytes, at: int) -> None:
    whole = to_toml(shipped()["ur5-hybrid"]).encode()
    for text in (content, whole[:at] + content + whole[at:]):
        with suppress(ScenarioError):
            from_file(text)


# formulas (more in test_formula.py), numbers, matrices, settings


@pytest.mark.parametrize(
    "text",
    [
        "9**9**9**9", "().__class__", "z.__init__", "exec('1')", "lambda: 1", "z if 1 else 0", "[z]", "x@y", "z;z",
        "𝗓 - 1", "z − 1", "z\0", "sin" * 100, "1/0", "z - 1/(1 - 1)", "1e308*1e308*z", "x" * 600, "z" + "^1.5" * 45,
        "exp(exp(9))*z",
        *(f"{'sin(' * 39}x*y*z*t{')' * 39}", "*".join(["sin(x*y*z*t)"] * 38), f"{'hypot(' * 30}x{',y*z*t)' * 30}"),
    ],
)  # fmt: skip
def test_formulas_that_are_refused(text: str) -> None:
    with pytest.raises(FormulaError) as caught:
        tape_of(parse(text))
    one_sentence(caught.value)


@given(st.one_of(st.text(max_size=80), st.text("0123456789.,;[]() \n-+eEnaif_", max_size=60)), st.integers(1, 6))
@settings(max_examples=200, deadline=None)
def test_whatever_is_pasted_is_finite_numbers_or_is_refused(text: str, n: int) -> None:
    read_typed(text, n)


def test_settings_of_the_command_line_never_end_in_a_traceback() -> None:
    assert _setting("a=" + "[" * 5000)[1] == "[" * 5000
    assert _setting("a=" + "9" * 5000)[1] == "9" * 5000
    assert printable("a\x1b[2J\n\u202eb\udcff") == "a\\x1b[2J\\n\\u202eb\\udcff"


# recordings


def npz(**changed: np.ndarray | None) -> bytes:
    recording = Recording(2, history=8)
    for k in range(3):
        recording.new_row()[:] = float(k)
        recording.commit()
    file = io.BytesIO()
    write_npz(table(load("planar2r-semicircle"), recording), file)
    with np.load(io.BytesIO(file.getvalue())) as saved:
        arrays = {**saved} | changed
    plain = io.BytesIO()
    np.savez(plain, allow_pickle=True, **{name: array for name, array in arrays.items() if array is not None})
    return plain.getvalue()


def claiming(shape: str) -> bytes:
    """An array t whose header says so."""
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".encode().ljust(117) + b"\n"
    entry = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + bytes(24)
    file = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(npz())) as old, zipfile.ZipFile(file, "w") as new:
        for name in old.namelist():
            new.writestr(name, entry if name == "t.npy" else old.read(name))
    return file.getvalue()


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (npz(t=np.array([{}, {}, {}], dtype=object)), "t claims object .*; allowed: numbers or text"),
        (npz(t=None), "t is missing"),
        (npz(q=np.zeros((3, 9))), "q of shape .*; allowed: 1 to 8 joints"),
        (npz(q=np.zeros(3)), "q of shape"),
        (npz(F=np.zeros((3, 2))), r"F holds float64 of shape \(3, 2\); allowed: float64 of \(3, 3\)"),
        (npz(s=np.zeros((4, 2))), "s holds float64 of shape"),
        (npz(d=np.zeros(3, dtype=complex)), "d holds complex128"),
        (npz(t=np.array([0.0, np.nan, 1.0])), "t does not grow; allowed: finite times"),
        (npz(t=np.zeros(3)), "t does not grow"),
        (npz(scenario=np.array("mode = 1")), "mode: 1; allowed: text"),
        (claiming("(10**12,)"), "not a recording"),
        (claiming("(1000000000000,)"), "t claims float64 of shape"),
        (claiming("(-3,)"), "t claims float64 of shape"),
        (npz()[:-40], "not a recording"),
        (b"", "not a recording"),
    ],
)  # fmt: skip
def test_recordings_that_are_refused(tmp_path: Path, content: bytes, said: str) -> None:
    (tmp_path / "run.npz").write_bytes(content)
    with pytest.raises(ScenarioError, match=said) as caught:
        read_npz(tmp_path / "run.npz")
    one_sentence(caught.value)


def test_a_recording_that_becomes_too_large_is_not_unpacked(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "run.npz", "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        with zipfile.ZipFile(io.BytesIO(npz())) as old:
            archive.writestr("scenario.npy", old.read("scenario.npy"))
        with archive.open("t.npy", "w", force_zip64=True) as entry:
            for _ in range(3):
                entry.write(bytes(50_000_000))
    with pytest.raises(ScenarioError, match="t has 150 MB; allowed: 100 MB"):
        read_npz(tmp_path / "run.npz")


@given(st.data())
@settings(max_examples=100, deadline=None)
def test_a_recording_with_a_few_wrong_bytes_is_one_or_is_refused(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    content = bytearray(RECORDED)
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path_factory.getbasetemp() / "flipped.npz"
    path.write_bytes(content)
    try:
        read_npz(path)
    except ScenarioError as error:
        one_sentence(error)


RECORDED = npz()
assert {signal.name for signal in SIGNALS} <= set(np.load(io.BytesIO(RECORDED)).files)
