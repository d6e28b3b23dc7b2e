"""Scenarios, formulas, numbers and recordings that are made to do harm: each is refused in one sentence, in bounded
time and memory."""

from __future__ import annotations

import io
import os
import struct
import zipfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.cli.options import setting
from app.dashboard.widgets.fields.matrix_text import read_matrix
from app.process.terminal_text import printable
from app.scenario.data import LARGEST, edited, from_file, from_toml, load, shipped, to_toml
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.simulation.closed_loop import ClosedLoop
from app.simulation.recording import Recording
from app.simulation.signals import SIGNALS
from app.storage import recording_files
from app.storage.epoch_bytes import to_bytes
from app.storage.recording_files import read_npz, table, write_npz
from environments.bytecode import bytecode_of
from environments.formula import FormulaError, parse
from fuzzing.matrix import read_typed
from tests.support.sentences import one_sentence

pytestmark = pytest.mark.slow  # processes of its own

# scenarios


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a=" + "[" * 5000, "nested without end; allowed: at most 16 deep"),
        ("y." * 20_000 + "b = 1", "line 1 has 20000 dots; allowed: at most 300"),
        ("x." * 100 + "b = 1", "tables or lists within each other; allowed: at most 16"),
        ("[simulation]\nseed = " + "9" * 5000, "thousands of digits; allowed"),
        ("[simulation]\nseed = " + "9" * 300, "simulation.seed: a whole number of 997 bits; allowed"),
        ("[contact]\nK_e = 1e999", "contact.K_e: inf; allowed: a finite number"),
        ("[controller]\nlayer = nan", "controller.layer: nan; allowed: a finite number"),
        ("[truth]\npayload_mass = 1979-05-27", "truth.payload_mass: 1979-05-27, a date or a time; allowed: a number"),
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
def test_scenarios_that_are_refused(text: str, message: str) -> None:
    with pytest.raises(ScenarioError, match=message) as caught:
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
        with pytest.raises(
            ScenarioError, match=r"scenario .*(cannot be read|is a folder|is a pipe or a device)"
        ) as caught:
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
        try:
            scenario = from_file(text)
        except ScenarioError:
            continue
        assert from_toml(to_toml(scenario)) == scenario


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
        bytecode_of(parse(text))
    one_sentence(caught.value)


@given(st.one_of(st.text(max_size=80), st.text("0123456789.,;[]() \n-+eEnaif_", max_size=60)), st.integers(1, 6))
@settings(max_examples=200, deadline=None)
def test_whatever_is_pasted_is_finite_numbers_or_is_refused(text: str, n: int) -> None:
    read_typed(text, n)
    with suppress(ValueError):
        assert read_matrix(text, n).shape == (n, n)


def test_settings_of_the_command_line_never_end_in_a_traceback() -> None:
    assert setting("a=" + "[" * 5000)[1] == "[" * 5000
    assert setting("a=" + "9" * 5000)[1] == "9" * 5000
    assert printable("a\x1b[2J\n\u202eb\udcff") == "a\\x1b[2J\\n\\u202eb\\udcff"


# recordings


def npz(**changed: np.ndarray | None) -> bytes:
    recording = Recording(2, history=8)
    for k in range(3):
        recording.new_row().view(float)[:] = float(k)
        recording.commit()
    file = io.BytesIO()
    write_npz(table(load("planar2r-semicircle"), recording), file)
    with np.load(io.BytesIO(file.getvalue())) as saved:
        arrays = {**saved} | changed
    plain = io.BytesIO()
    np.savez(plain, allow_pickle=True, **{name: array for name, array in arrays.items() if array is not None})
    return plain.getvalue()


def conditions() -> np.ndarray:
    """Those of a run of another arm."""
    return np.frombuffer(to_bytes(ClosedLoop.from_scenario(load("ur5-impedance"), 1).recording.epochs), np.uint8)


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
    ("made", "message"),
    [
        (lambda: npz(t=np.array([{}, {}, {}], dtype=object)), "t claims object .*; allowed: numbers or text"),
        (lambda: npz(t=None), "t is missing"),
        (lambda: npz(q=np.zeros((3, 9))), "q of shape .*; allowed: 1 to 8 joints"),
        (lambda: npz(q=np.zeros(3)), "q of shape"),
        (lambda: npz(F=np.zeros((3, 2))), r"F holds float64 of shape \(3, 2\); allowed: float64 of \(3, 3\)"),
        (lambda: npz(s=np.zeros((4, 2))), "s holds float64 of shape"),
        (lambda: npz(d=np.zeros(3, dtype=complex)), "d holds complex128"),
        (lambda: npz(t=np.array([0.0, np.nan, 1.0])), "t does not grow; allowed: finite times"),
        (lambda: npz(t=np.zeros(3)), "t does not grow"),
        (lambda: npz(scenario=np.array("mode = 1")), "mode: 1; allowed: text"),
        (lambda: npz(conditions=np.frombuffer(b"\xc1" * 9, np.uint8)), "conditions are not those of a run"),
        (lambda: npz(conditions=conditions()), "conditions of 6 coordinates; allowed: 2"),
        (lambda: claiming("(10**12,)"), "not a recording"),
        (lambda: claiming("(1000000000000,)"), "t claims float64 of shape"),
        (lambda: claiming("(-3,)"), "t claims float64 of shape"),
        (lambda: claiming("(True,)"), "not a recording"),
        (lambda: claiming("("), "not a recording"),
        (lambda: claiming("(99999999999999999999999, 0)"), "not a recording"),
        (lambda: npz()[:-40], "not a recording"),
        (lambda: b"", "not a recording"),
    ],
)  # fmt: skip
def test_recordings_that_are_refused(tmp_path: Path, made: Callable[[], bytes], message: str) -> None:
    (tmp_path / "run.npz").write_bytes(made())
    with pytest.raises(ScenarioError, match=message) as caught:
        read_npz(tmp_path / "run.npz")
    one_sentence(caught.value)


def test_a_recording_from_before_there_were_several_surfaces_is_read(tmp_path: Path) -> None:
    names = ("multiplier_2", "phi_2", "multiplier_3", "phi_3")
    (tmp_path / "run.npz").write_bytes(npz(**dict.fromkeys(names)))
    _, recording, _ = read_npz(tmp_path / "run.npz")
    assert all((recording.signals((name,))[name] == 0.0).all() for name in names)
    assert recording.signals(("phi",))["phi"].tolist() == [0.0, 1.0, 2.0]


def test_a_recording_that_becomes_too_large_is_not_unpacked(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "run.npz", "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        with zipfile.ZipFile(io.BytesIO(npz())) as old:
            archive.writestr("scenario.npy", old.read("scenario.npy"))
        with archive.open("t.npy", "w", force_zip64=True) as entry:
            for _ in range(3):
                entry.write(bytes(50_000_000))
    with pytest.raises(ScenarioError, match=r"t has 150 MB; allowed: 19\.0476 MB"):
        read_npz(tmp_path / "run.npz")


def test_all_signals_together_have_one_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each alone is small."""
    monkeypatch.setattr(recording_files, "LARGEST_RECORDING", 1_000_000)
    rows = 1900
    long = npz(t=np.arange(rows, dtype=float), q=np.zeros((rows, 2)))
    (tmp_path / "run.npz").write_bytes(long)
    with pytest.raises(ScenarioError, match="1900 rows of 2 joints; allowed: 1 MB"):
        read_npz(tmp_path / "run.npz")
    (tmp_path / "run.npz").write_bytes(npz(more=np.zeros(130_000)))
    with pytest.raises(ScenarioError, match=r"1.0\d MB when unpacked; allowed: 1 MB"):
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
