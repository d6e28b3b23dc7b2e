"""The `vsmrc` command: files, exit statuses, and one sentence for every wrong input."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from app.analysis.metrics import FIGURES, METRICS
from app.cli import commands
from app.cli.run import run
from app.scenario.data import edited, from_toml, load, to_toml
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.scenario.units import CARTESIAN, JOINT

pytestmark = pytest.mark.slow  # processes of its own


def vsmrc(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "app", *arguments], capture_output=True, text=True, timeout=600)


class Done(NamedTuple):
    returncode: int
    stdout: str
    stderr: str


@pytest.fixture
def here(capfd: pytest.CaptureFixture[str]) -> Callable[..., Done]:
    """`vsmrc` within this process, which is spared two seconds of imports; what `main` adds has tests of its own."""

    def execute(*arguments: str) -> Done:
        try:
            status = commands.execute([*arguments])
        except SystemExit as ended:
            status = int(ended.code or 0)
        return Done(status, *capfd.readouterr())

    return execute


def test_run_writes_recording_and_metrics(tmp_path: Path) -> None:
    done = vsmrc(
        "run", "ur5-hybrid", "--set", "force.value=15", "truth.link_scaling=1.1", "--set", "controller.layer=0.02",
        "--duration", "0.5", "--out", str(tmp_path),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert {
        "motion_error_tail", "force_error_tail", "constraint_violation", "reaching_time", "reaching_time_bound",
        "envelope_violation", "gain_condition_margin", "target_model_residual_tail", "torque_total_variation",
        "realtime_factor", "stopped",
    } <= metrics.keys()  # fmt: skip
    assert metrics["stopped"] is None
    with np.load(tmp_path / "recording.npz") as recording:
        assert len(recording["t"]) == 500
        assert np.all(recording["F_cd"][:, 0] == 15.0)
    scenario = from_toml((tmp_path / "scenario.toml").read_text())
    assert scenario.controller.layer == 0.02


def test_compiled_run_says_so_and_repeats_to_the_last_bit(tmp_path: Path, here: Callable[..., Done]) -> None:
    tables = []
    for folder in (tmp_path / "first", tmp_path / "second"):
        done = here(
            "run", "ur5-hybrid", "--set", "sensor.noise=0.5", "--duration", "0.5", "--engine", "compiled",
            "--out", str(folder),
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert json.loads((folder / "metrics.json").read_text())["engine"] == "compiled"
        with np.load(folder / "recording.npz") as recording:
            tables.append({name: recording[name] for name in recording})
    assert len(tables[0]["t"]) == 500
    np.testing.assert_equal(tables[0], tables[1])


def test_compiled_run_refuses_a_law_of_your_own(tmp_path: Path) -> None:
    done = vsmrc(
        "run", "ur5-hybrid", "--use", "docs/examples/pid_gravity.py", "--set", "controller.law=pid-gravity",
        "--engine", "compiled", "--out", str(tmp_path),
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr == (
        "vsmrc: --engine compiled: controller.law: 'pid-gravity' is a law of your own; allowed: --engine pinocchio\n"
    )


def test_stopped_run_keeps_its_files_and_says_why(tmp_path: Path) -> None:
    done = vsmrc("run", "ur5-constrained", "--set", "force.value=-5", "--duration", "1", "--out", str(tmp_path))
    assert done.returncode == 3
    assert "contact lost" in json.loads((tmp_path / "metrics.json").read_text())["stopped"]
    assert (tmp_path / "recording.npz").exists()


@pytest.mark.parametrize(("space", "length", "force"), [("joint", "mrad", "N·m"), ("cartesian", "mm", "N")])
def test_run_says_in_which_units_its_figures_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], space: str, length: str, force: str
) -> None:
    assert run("ur5-motion", out=tmp_path, duration=0.05, settings=((f"task_space.kind={space}",),)) == 0
    told = capsys.readouterr().out
    assert not re.search(r"[a-z]_[a-z]", told.replace(str(tmp_path), "")), "words, as on the page"
    units = {line[:40].strip(): line.split()[-1] for line in told.splitlines()}
    assert units["path error at the end, largest"] == length
    excess = next(figure for figure in METRICS if figure.field == "envelope_violation")
    assert excess.unit(JOINT if space == "joint" else CARTESIAN) == f"{length}/s"
    assert units["least margin of (17)"] == units["residual of (8) at the end, RMS"] == force
    assert units["s = 0 by (18) within"] == units["simulated time"] == "s"
    assert units["variation of the torques, per joint"] == "N·m/s"
    assert units["force error at the end, largest"] == "—"


def test_figures_that_a_law_has_not_are_not_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    own = ("controller.law=computed-torque",)
    assert run("planar2r-semicircle", out=tmp_path, duration=0.05, settings=(own,)) == 0
    told = {line[:40].strip(): line[40:].strip() for line in capsys.readouterr().out.splitlines()}
    for figure in ("least margin of (17)", "s = 0 by (18) within", "‖s‖ beyond (20) and the band, largest"):
        assert told[figure] == "—"
    assert told["path error at the end, largest"] != "—"


def test_runs_are_compared_side_by_side(here: Callable[..., Done]) -> None:
    done = here("compare", "planar3r-hybrid", "planar2r-semicircle", "--duration", "0.3", "--last", "0.1")
    assert done.returncode == 0, done.stderr
    figures = {line.split("│")[1].strip(): line.split("│")[2:4] for line in done.stdout.splitlines() if "│" in line}
    assert len(figures) == len(FIGURES)
    assert all(float(value) >= 0.0 for value in figures["‖s‖, largest [mm/s]"])


def test_a_frame_rate_that_makes_no_sense_is_refused(here: Callable[..., Done]) -> None:
    done = here("serve", "--port", "0", "--fps", "0")
    assert done.returncode == 2
    assert "--fps: 0; allowed: 1 to 60" in done.stderr


def test_a_misspelt_choice_of_a_flag_is_refused_with_what_was_meant(here: Callable[..., Done]) -> None:
    for arguments, said in (
        (("serve", "--theme", "drak"), "--theme 'drak'; allowed: dark, light; did you mean dark?"),
        (
            ("serve", "--log-level", "inf"),
            "--log-level 'inf'; allowed: debug, info, warning, error; did you mean info?",
        ),
        (("serve", "--token", "allways"), "did you mean always?"),
        (("compare", "ur5-hybrid", "--engine", "compild"), "allowed: pinocchio, compiled; did you mean compiled?"),
        (("figures", "--out", "x", "--only", "theorm"), "did you mean theorem?"),
    ):
        done = here(*arguments)
        assert done.returncode == 2
        assert said in done.stderr
        assert done.stderr.count("\n") == 1


def test_a_port_that_is_none_is_refused(here: Callable[..., Done]) -> None:
    for port, command in (("70000", vsmrc), ("-1", here)):
        done = command("serve", "--port", port)
        assert (done.returncode, done.stderr) == (2, f"vsmrc: --port {port}; allowed: 0 to 65535\n")


def test_what_is_said_when_nobody_reads_any_more_stops_nothing() -> None:
    ours, theirs = os.pipe()
    os.close(ours)
    code = "from app.process.terminal_text import say; say('one'); say('two')"
    done = subprocess.run([sys.executable, "-c", code], stdout=theirs, stderr=subprocess.PIPE, text=True, check=False)
    os.close(theirs)
    assert (done.returncode, done.stderr) == (0, "")


def test_nothing_to_compare_is_said(here: Callable[..., Done]) -> None:
    for arguments, said in (((), "compare: no scenario"), (("ur5-hybrid", "--last", "-1"), "allowed: more than 0 s")):
        done = here("compare", *arguments)
        assert done.returncode == 2
        assert said in done.stderr


def test_a_part_of_the_run_without_figures_is_refused_and_the_least_one_has_them(here: Callable[..., Done]) -> None:
    for arguments, said in (
        (("--last", "0.0005"), "--last 0.0005: fewer than two control periods of planar3r-hybrid; allowed: 0.002 s or"),
        (("--last", "0.0019"), "--last 0.0019: fewer than two control periods of planar3r-hybrid; allowed: 0.002 s or"),
        (("--duration", "0.001"), "simulation.duration: 0.001: fewer than two control periods of planar3r-hybrid"),
        (("--last", "0.002", "--set", "controller.period=0.002"), "allowed: 0.004 s or more"),
    ):
        done = here("compare", "planar3r-hybrid", *arguments)
        assert done.returncode == 2
        assert said in done.stderr
        assert done.stderr.count("\n") == 1
    for duration in ("0.002", "0.013", "0.3"):  # whatever the instants of the rows are rounded to
        done = here("compare", "planar3r-hybrid", "--duration", duration, "--last", "0.002")
        assert done.returncode == 0, done.stderr
        figures = {
            line.split("│")[1].strip(): line.split("│")[2].strip() for line in done.stdout.splitlines() if "│" in line
        }
        assert float(figures["path error, RMS [mm]"]) >= 0.0, duration


def test_one_entry_of_a_list_is_set(tmp_path: Path, here: Callable[..., Done]) -> None:
    before = load("ur5-impedance")
    done = here(
        "run", "ur5-impedance", "--duration", "0.01", "--out", str(tmp_path),
        "--set", "target_model.K_m.2=1200", "truth.push.3=7",
        "--set", "robot.posture=[0.1,-1.2,1.8,-2.0,-1.5,0.0]", "robot.posture.2=-1.25",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    after = load(str(tmp_path / "scenario.toml"))
    K_m, kept = after.target_model.K_m, before.target_model.K_m
    assert K_m is not None
    assert kept is not None
    assert K_m == (kept[0], 1200.0, *kept[2:])
    assert after.truth.push == (*before.truth.push[:2], 7.0)
    assert after.robot.posture == (0.1, -1.25, 1.8, -2.0, -1.5, 0.0)


@pytest.mark.parametrize(
    "arguments",
    [
        ("run", "FILE.toml", "--out", "OUT"),
        ("run", "ur5-hybrid", "--blend-to", "FILE.toml", "--out", "OUT"),
        ("run", "ur5-hybrid", "--use", "FILE.py", "--out", "OUT"),
        ("run", "ur5-hybrid", "--set", "robot.urdf=FILE.urdf", "--out", "OUT"),
        ("run", "--from", "FOLDER", "--row", "0", "--out", "OUT"),
        ("compare", "FILE.toml"),
        ("export", "FILE.toml", "--out", "OUT"),
        ("response", "FILE.toml", "--out", "OUT"),
        ("serve", "FILE.toml", "--port", "0"),
        ("sweep", "FILE.toml", "--dry-run"),
        ("sweep", "FOLDER/sweep.toml", "--out", "OUT"),
        ("sweep", "plot", "FOLDER"),
        ("tune", "FILE.toml", "--dry-run"),
        ("lesson", "check", "FOLDER"),
        ("lesson", "run", "FOLDER/lesson.md"),
    ],
)
def test_a_text_that_is_not_in_utf_8_is_refused_with_the_files_name(
    arguments: tuple[str, ...], tmp_path: Path, here: Callable[..., Done]
) -> None:
    for name in ("file.toml", "file.py", "file.urdf", "sweep.toml", "lesson.md"):
        (tmp_path / name).write_bytes("name = 'f\xfcnf'\n".encode("latin-1"))
    places = {"FILE": str(tmp_path / "file"), "FOLDER": str(tmp_path), "OUT": str(tmp_path / "out")}
    typed = [re.sub("FILE|FOLDER|OUT", lambda found: places[found[0]], each) for each in arguments]
    done = here(*typed)
    assert done.returncode == 2
    assert re.search(r"\bfile\.|sweep\.toml|lesson\.md", done.stderr)
    assert ("utf-8" if "FILE.py" in arguments else "UTF-8") in done.stderr  # Python's own sentence
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_list_shows_robots_and_scenarios() -> None:
    done = vsmrc("list")
    assert done.returncode == 0
    assert "panda" in done.stdout
    assert "planar2r-semicircle" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("run", "nothing"), "allowed: a .toml file or"),
        (("run", "ur5-hybird"), "; did you mean ur5-hybrid?"),
        (("run", "UR5-Motion"), "; did you mean ur5-motion?"),
        (
            ("run", "ur5-hybrid", "--set", "force.vale=3"),
            "force.vale: no such field; allowed: kind, value; did you mean v",
        ),
        (("run", "ur5-hybrid", "--set", "robot.nmae=ur3"), "; did you mean name?"),
        (("run", "ur5-hybrid", "--set", "robot.name=pandas"), "; did you mean panda?"),
        (("run", "ur5-hybrid", "--set", "mode=hybrd"), "; did you mean hybrid?"),
        (("run", "ur5-hybrid", "--set", "contact.kind=elastc"), "; did you mean elastic?"),
        (("run", "ur5-hybrid", "--set", "controller.law=vsmcr"), "; did you mean vsmrc?"),
        (
            ("exprt", "ur5-hybrid"),
            "no such command; allowed: serve, run, compare, export, response, sweep, tune, figures, lesson, list; did",
        ),
        (("run", "ur5-hybrid", "--set", "force.value"), "allowed: KEY=VALUE"),
        (("run", "ur5-hybrid", "--set", "force.value=nan"), "force.value: nan; allowed: a finite number"),
        (("run", "ur5-hybrid", "--set", "controller.layer=-1"), "controller.layer: -1; allowed: a number > 0"),
        (("run", "ur5-hybrid", "--set", "mode=constrained"), "contact.kind: 'elastic' in constrained mode"),
        (("run", "ur5-hybrid", "--set", "target_model.M_m=[1,2]"), "target_model.M_m: 2 entries; allowed: 6"),
        (("run", "ur5-hybrid", "--set", "robot.urdf=/none.urdf"), "robot.urdf: cannot read /none.urdf"),
        (("run", "ur5-hybrid", "--set", "robot.tool_frame=hand"), "robot.tool_frame: no frame 'hand'"),
        (("sweep", "ur5-hybrid", "--vary", "contact.K_e=1e4:1e5:3", "--draw", "-1"), "--draw -1; allowed: 0 or more"),
        (("tune", "ur5-hybrid", "--seed", "5000000000"), "--seed 5000000000; allowed: at most 4294967295"),
        (("run", "ur5-hybrid", "--blend-at", "3"), "--blend-at or --blend-over without --blend-to; allowed: with"),
        (("sweep", "ur5-hybrid", "--vary", "contact.K_e=1e4:1e5:3", "--as", "map"), "allowed: for `vsmrc sweep plot"),
        (("run", "ur5-hybrid", "--set", "contact.K_e=0"), "contact.K_e: 0 N/m, which takes no force in hybrid mode"),
        (
            ("run", "ur5-motion", "--set", "truth.push=[0,5,0]", "truth.push_frequency=500"),
            "truth.push_frequency: 500 Hz, at least half the control rate, so that the loop sees a slower one",
        ),
        (
            (
                *("run", "ur5-motion", "--set", "truth.push=[0,5,0]"),
                *("truth.push_duration=2", "truth.push_every=1", "truth.push_frequency=2"),
            ),
            "truth.push_every: 1 s, which cuts a sine of 2 s short; allowed: 0 for once, or at least",
        ),
        # also where the value is the one that the option has without
        (("run", "ur5-hybrid", "--blend-at", "0"), "--blend-at or --blend-over without --blend-to; allowed: with"),
        (("export", "ur5-hybrid", "--to", "csv", "--type-size", "7"), "--type-size: with --to csv; allowed: with --to"),
        (
            ("export", "ur5-hybrid", "--to", "csv", "--no-letters"),
            "--no-letters: with --to csv; allowed: with --to svg",
        ),
        (("export", "ur5-hybrid", "--to", "csv", "--caption"), "--caption: with --to csv; allowed: with --to svg, pdf"),
        (("export", "ur5-hybrid", "--to", "toml", "--start", "0"), "--start: with --to toml; allowed: with --to svg"),
        (
            ("export", "a.npz", "--engine", "pinocchio"),
            "--engine pinocchio: a recording is not computed again; allowed",
        ),
        (("run", "ur5-impedance", "--set", "target_model.K_m.9=1"), "target_model.K_m.9: no such entry; allowed: an"),
        (("run", "ur5-impedance", "--set", f"target_model.K_m.{'9' * 5000}=1"), "no such entry; allowed: an entry"),
        (("run", "ur5-hybrid", "--set", "contact.K_e.1=1"), "contact.K_e.1: no such entry; allowed: an entry, from 1"),
        (("run", "ur5-hybrid", "--set", "5=1"), "5: no such field; allowed: name, title, mode, robot"),
        (("run", "ur5-hybrid", "--set", "title=\udcff"), "title: '\\udcff'; allowed: a text in UTF-8"),
        (("sweep", "ur5-hybrid", "--vary", "robot.urdf=\udcff"), "robot.urdf: '\\udcff'; allowed: a text in UTF-8"),
        (("response", "ur5-hybrid", "--at", "1e9"), "--at 1e+09: allowed: 0 to 10 s, the duration of the run"),
        (("run", "ur5-hybrid", "--row", "3"), "--row 3 without --from; allowed: --from FOLDER --row N"),
        (("sweep", "any/sweep.toml", "--seed", "7"), "is the whole question; allowed: without --vary, --draw, --seed"),
        (
            ("response", "ur5-impedance", "--at", "0.5", "--set", "truth.push=[0,5000,0]", "truth.push_start=0.0"),
            "--at 0.5: the run stops before, ",
        ),
    ],
)
def test_wrong_input_is_refused_in_one_sentence(
    arguments: tuple[str, ...], said: str, tmp_path: Path, here: Callable[..., Done]
) -> None:
    done = here(*arguments, "--out", str(tmp_path / "out"))
    assert done.returncode == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("mode", "levitation"), "mode: 'levitation'; allowed: constrained, hybrid"),
        (("motion", "spiral"), "motion"),
        (("controller.gain", 3), "controller.gain"),
        (("sensor.bias", [1.0, 2.0]), "sensor.bias"),
        (("contact.K_e", "stiff"), "contact.K_e: 'stiff'; allowed: a number"),
        (("target_model.K_m", 5), "target_model.K_m: 5; allowed: a list of numbers, or of rows where it is a matrix"),
        (("robot.urdf", 5), "robot.urdf: 5; allowed: text"),
        (("simulation.substeps", 2.5), "simulation.substeps: 2.5; allowed: a whole number"),
        (("robot", 5), "robot"),
        (("surface.colour", "red"), "surface.colour: no such field; allowed: kind, origin"),
    ],
)
def test_wrong_field_is_named(change: tuple[str, object], said: str) -> None:
    with pytest.raises(ScenarioError, match=said.replace("(", r"\(")):
        edited(Scenario(), *change)


def test_scenario_files_that_are_none(tmp_path: Path) -> None:
    for text, said in (("mode = ", "not a TOML file"), ("colour = 'red'", "colour"), ("[robot]\nlegs = 2", "legs")):
        path = tmp_path / "scenario.toml"
        path.write_text(text)
        with pytest.raises(ScenarioError, match=said):
            load(str(path))
    with pytest.raises(ScenarioError, match="cannot be read"):
        load(str(tmp_path / "missing.toml"))


def test_toml_keeps_every_field() -> None:
    scenario = edited(Scenario(), "target_model.K_m", [[1.0, 0.5], [0.5, 2.0]])
    assert from_toml(to_toml(scenario)) == scenario


def test_serve_says_its_address_and_a_busy_port_and_ends_on_ctrl_c() -> None:
    command = [sys.executable, "-m", "app", "serve", "planar2r-semicircle", "--port", "8137", "--stateless"]
    command += ["--token", "never"]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert server.stdout is not None
        said = next(line for line in server.stdout if line.startswith("VSMRC Lab"))
        assert "http://127.0.0.1:8137" in said
        second = vsmrc("serve", "--port", "8137")
        assert second.returncode == 2
        assert "8137" in second.stderr
        time.sleep(1.0)
        for _ in range(2):  # an impatient one
            os.kill(server.pid, signal.SIGINT)
            time.sleep(0.1)
        _, complaints = server.communicate(timeout=120)
        assert server.returncode == 0
        assert "Traceback" not in complaints
    finally:
        server.kill()
        server.wait()


def test_ctrl_c_ends_a_server_that_a_script_has_begun_in_the_background() -> None:
    """A shell without job control hands SIGINT on ignored."""
    command = [sys.executable, "-m", "app", "serve", "planar2r-semicircle", "--port", "0", "--stateless"]
    ignoring = (
        "import os, signal, sys; signal.signal(signal.SIGINT, signal.SIG_IGN); os.execv(sys.argv[1], sys.argv[1:])"
    )
    server = subprocess.Popen(
        [sys.executable, "-c", ignoring, *command], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        assert server.stdout is not None
        assert next(line for line in server.stdout if line.startswith("VSMRC Lab"))
        server.send_signal(signal.SIGINT)
        server.communicate(timeout=60)
        assert server.returncode == 0
    finally:
        server.kill()
        server.wait()


@pytest.mark.parametrize("shared", [(), ("--shared",)])
def test_the_end_does_not_wait_for_the_interpreter_to_be_taken_down(shared: tuple[str, ...]) -> None:
    """Nor does it come from the deadline, which a busy machine may need: both are taken away here."""
    program = """
import atexit, sys, threading
import app.process.deadline
app.process.deadline.end_within = lambda: None
threading.Thread(target=threading.Event().wait).start()  # an interpreter waits for it for ever
atexit.register(lambda: print("what was registered"))
from app.__main__ import main
main()
"""
    arguments = ["serve", "planar2r-semicircle", "--port", "0", "--stateless", "--token", "never", *shared]
    server = subprocess.Popen([sys.executable, "-c", program, *arguments], stdout=subprocess.PIPE, text=True)
    try:
        assert server.stdout is not None
        assert next(line for line in server.stdout if line.startswith("VSMRC Lab"))
        server.send_signal(signal.SIGINT)
        said, _ = server.communicate(timeout=60)
        assert server.returncode == 0
        assert "ended" in said
        assert said.splitlines()[-1] == "what was registered"
    finally:
        server.kill()
        server.wait()


def test_ctrl_c_is_not_lost_where_python_swallows_what_it_raises() -> None:
    program = """
import signal
import app.process.precompile
from app.__main__ import main

class Finalized:
    def __del__(self):
        signal.raise_signal(signal.SIGINT)

def start():
    Finalized()

app.process.precompile.start = start
main()
"""
    arguments = ["serve", "planar2r-semicircle", "--port", "0", "--stateless", "--token", "never"]
    ended = subprocess.run(
        [sys.executable, "-c", program, *arguments], capture_output=True, text=True, check=False, timeout=120
    )
    assert "Exception ignored in" in ended.stderr
    assert ended.returncode == 0
    assert "ended" in ended.stdout.splitlines()


def test_what_cannot_be_printed_is_no_success() -> None:
    with open("/dev/full", "w") as full:
        listed = [sys.executable, "-m", "app", "list"]
        done = subprocess.run(listed, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode != 0
    assert "No space left on device" in done.stderr


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_reader_that_has_read_enough_is_no_fault(unbuffered: str) -> None:
    listed = [sys.executable, "-m", "app", "list"]
    with subprocess.Popen(
        listed, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=os.environ | {"PYTHONUNBUFFERED": unbuffered}
    ) as listing:
        assert listing.stdout is not None
        assert listing.stderr is not None
        listing.stdout.close()
        assert listing.stderr.read() == b""
    assert listing.returncode == 0


def test_any_urdf_runs_and_a_truth_outside_its_declaration_is_said(tmp_path: Path, here: Callable[..., Done]) -> None:
    done = here(
        "run", "ur5-hybrid", "--duration", "0.1", "--out", str(tmp_path),
        "--set", "truth.payload_mass=2", "robot.tool_frame=flange", "robot.urdf=tests/support/robots/bent3r.urdf",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "outside what was declared: payload 2 kg > declared 0 kg" in done.stdout
    assert load(str(tmp_path / "scenario.toml")).robot.tool_frame == "flange"


def test_ctrl_c_before_the_command_is_loaded_is_no_traceback() -> None:
    interrupted = """
import sys

class Finder:
    def find_spec(self, name, *_):
        if name == "msgspec":
            raise KeyboardInterrupt

sys.meta_path.insert(0, Finder())
from app.__main__ import main
main()
"""
    done = subprocess.run([sys.executable, "-c", interrupted], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")
