"""The `vsmrc` command: files, exit statuses, and how a server begins and ends."""

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

import numpy as np
import pytest

from app.analysis.metrics import ACCOUNT_METRICS, RUN_METRICS
from app.cli.run import run
from app.scenario.data import edited, from_toml, load, to_toml
from app.scenario.schema import Scenario
from app.scenario.units import CARTESIAN, JOINT
from drivers.waiting import until
from tests.support.commands import Done, vsmrc

pytestmark = pytest.mark.slow  # processes of its own


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
    output = capsys.readouterr().out
    assert not re.search(r"[a-z]_[a-z]", output.replace(str(tmp_path), "")), "words, as on the page"
    units = {line[:40].strip(): line.split()[-1] for line in output.splitlines()}
    assert units["path error at the end, largest"] == length
    excess = next(figure for figure in RUN_METRICS if figure.field == "envelope_violation")
    assert excess.unit(JOINT if space == "joint" else CARTESIAN) == f"{length}/s"
    assert units["least margin of (17)"] == units["residual of (8) at the end, RMS"] == force
    assert units["s = 0 by (18), if promised"] == units["simulated time"] == "s"
    assert units["variation of the torques, per joint"] == "N·m/s"
    assert units["force error at the end, largest"] == "—"


def test_figures_that_a_law_has_not_are_not_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    own = ("controller.law=computed-torque",)
    assert run("planar2r-semicircle", out=tmp_path, duration=0.05, settings=(own,)) == 0
    figures = {line[:40].strip(): line[40:].strip() for line in capsys.readouterr().out.splitlines()}
    for figure in ("least margin of (17)", "s = 0 by (18), if promised", "‖s‖ beyond (20) and the band, largest"):
        assert figures[figure] == "—"
    assert figures["path error at the end, largest"] != "—"


def test_runs_are_compared_side_by_side(here: Callable[..., Done]) -> None:
    done = here("compare", "planar3r-hybrid", "planar2r-semicircle", "--duration", "0.3", "--last", "0.1")
    assert done.returncode == 0, done.stderr
    figures = {line.split("│")[1].strip(): line.split("│")[2:4] for line in done.stdout.splitlines() if "│" in line}
    assert len(figures) == len(ACCOUNT_METRICS)
    assert all(float(value) >= 0.0 for value in figures["‖s‖, largest [mm/s]"])


def test_what_is_said_when_nobody_reads_any_more_stops_nothing() -> None:
    ours, theirs = os.pipe()
    os.close(ours)
    code = "from app.process.terminal_text import print_line; print_line('one'); print_line('two')"
    done = subprocess.run([sys.executable, "-c", code], stdout=theirs, stderr=subprocess.PIPE, text=True, check=False)
    os.close(theirs)
    assert (done.returncode, done.stderr) == (0, "")


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


def test_list_shows_robots_and_scenarios() -> None:
    done = vsmrc("list")
    assert done.returncode == 0
    assert "panda" in done.stdout
    assert "planar2r-semicircle" in done.stdout


def test_toml_keeps_every_field() -> None:
    scenario = edited(Scenario(), "target_model.K_m", [[1.0, 0.5], [0.5, 2.0]])
    assert from_toml(to_toml(scenario)) == scenario


def interrupted(pid: int) -> bool:
    """Whether a process has not received the last SIGINT yet; another one would be lost."""
    pending = re.search(r"^ShdPnd:\s*(\w+)", Path(f"/proc/{pid}/status").read_text(), re.MULTILINE)
    return pending is not None and bool(int(pending[1], 16) >> (signal.SIGINT - 1) & 1)


def test_serve_says_its_address_and_a_busy_port_and_ends_on_ctrl_c() -> None:
    command = [sys.executable, "-m", "app", "serve", "planar2r-semicircle", "--port", "0", "--stateless"]
    command += ["--token", "never"]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert server.stdout is not None
        line = next(line for line in server.stdout if line.startswith("VSMRC Lab"))
        port = re.search(r"http://127\.0\.0\.1:(\d+)", line)
        assert port is not None
        second = vsmrc("serve", "--port", port[1])
        assert second.returncode == 2
        assert port[1] in second.stderr
        for _ in range(2):  # an impatient one
            server.send_signal(signal.SIGINT)
            until(lambda: server.poll() is not None or not interrupted(server.pid))
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
        output, _ = server.communicate(timeout=60)
        assert server.returncode == 0
        assert "ended" in output
        assert output.splitlines()[-1] == "what was registered"
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


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_what_cannot_be_printed_is_no_success(unbuffered: str) -> None:
    with open("/dev/full", "w") as full:
        listed = [sys.executable, "-m", "app", "list"]
        done = subprocess.run(
            listed,
            stdout=full,
            stderr=subprocess.PIPE,
            env=os.environ | {"PYTHONUNBUFFERED": unbuffered},
            text=True,
            check=False,
        )
    assert done.returncode == 1
    assert re.fullmatch("vsmrc: standard output .*cannot be written: No space left on device\n", done.stderr)


@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&- >&- 2>&-"])
def test_closed_outputs_are_no_fault(closed: str, tmp_path: Path) -> None:
    command = f"{sys.executable} -m app run planar2r-semicircle --duration 0.01 --out {tmp_path} {closed}"
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert "Traceback" not in done.stdout + done.stderr
    assert load(str(tmp_path / "scenario.toml")).name == "planar2r-semicircle"


def test_no_number_of_a_comparison_is_cut(here: Callable[..., Done], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    names = ("planar3r-hybrid", "planar2r-semicircle", "planar2r-semicircle-discontinuous")
    for forced in ({}, {"FORCE_COLOR": "1"}):  # a pipe, and a narrow terminal
        for name, value in forced.items():
            monkeypatch.setenv(name, value)
        done = here("compare", *names, "--duration", "0.01")
        assert done.returncode == 0
        assert "…" not in done.stdout
        assert all(name in done.stdout for name in names)


def test_another_arm_keeps_the_scenarios_name(tmp_path: Path, here: Callable[..., Done]) -> None:
    done = here(
        "run", "planar3r-hybrid", "--set", "robot.name=planar2r", "--duration", "0.01", "--out", str(tmp_path)
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert load(str(tmp_path / "scenario.toml")).name == "planar3r-hybrid-edited"


@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize("command", ["list", "--help"])
def test_a_reader_that_has_read_enough_is_no_fault(command: str, unbuffered: str) -> None:
    listed = [sys.executable, "-m", "app", command]
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


@pytest.mark.parametrize("encoding", ["utf-8", "ascii"])
def test_a_run_whose_output_nobody_reads_leaves_its_files_and_status(encoding: str, tmp_path: Path) -> None:
    ours, theirs = os.pipe()
    os.close(ours)
    run = ["run", "planar2r-semicircle", "--duration", "0.01", "--strict", "--set", "controller.law=pd-gravity"]
    done = subprocess.run(
        [sys.executable, "-m", "app", *run, "--out", str(tmp_path)],
        stdout=theirs,
        stderr=theirs,  # the bar's
        env=os.environ | {"PYTHONUNBUFFERED": "1", "PYTHONIOENCODING": encoding},
        check=False,
    )
    os.close(theirs)
    assert {path.name for path in tmp_path.iterdir()} == {"metrics.json", "recording.npz", "scenario.toml"}
    assert done.returncode == 5  # nothing is promised for this law


def test_a_full_disk_behind_standard_output_is_no_reason_to_stop(tmp_path: Path) -> None:
    arguments = ["export", "planar2r-semicircle", "--set", "simulation.duration=0.01", "--to", "toml", "csv"]
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "app", *arguments, "--out", str(tmp_path)],
            stdout=full,
            stderr=subprocess.PIPE,
            env=os.environ | {"PYTHONUNBUFFERED": "1"},
            text=True,
            check=False,
        )
    assert done.returncode == 1
    assert "vsmrc: standard output cannot be written: No space left on device\n" in done.stderr
    assert len(list(tmp_path.iterdir())) == 2


def test_a_section_of_another_kind_and_another_arm_are_set_by_their_names(
    tmp_path: Path, here: Callable[..., Done]
) -> None:
    done = here(
        "run", "planar3r-hybrid", "--duration", "0.01", "--out", str(tmp_path),
        "--set", "robot=planar2r", "motion.kind=hold",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    written = load(str(tmp_path / "scenario.toml"))
    assert (written.robot.name, type(written.motion)) == ("planar2r", type(edited(written, "motion", "hold").motion))


def test_a_sweep_of_refused_runs_says_why_and_is_no_success(tmp_path: Path, here: Callable[..., Done]) -> None:
    arguments = ("planar2r-semicircle", "--vary", "simulation.duration=1e-9,2e-9", "--workers", "1")
    for _ in range(2):  # also where all of them are there already
        done = here("sweep", *arguments, "--out", str(tmp_path / "sweep"))
        assert done.returncode == 2
        assert "2 of 2 runs were refused, 1 of them for: simulation.duration: 1e-09 s; allowed: at" in done.stdout


def test_two_interruptions_end_a_pool_whose_processes_go_on(tmp_path: Path) -> None:
    program = """
import signal, time
from app.process import worker_pool

def computing():
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # as a kernel that is under way, which sees no signal
    return time.sleep

def execute(_):
    for _ in worker_pool.results(computing, (), [0, 600], 1):
        print("begun", flush=True)
    return 0

if __name__ == "__main__":
    import app.cli.commands
    from app.__main__ import main
    app.cli.commands.execute = execute
    main()
"""
    file = tmp_path / "pool.py"  # which its processes import, too
    file.write_text(program)
    with subprocess.Popen([sys.executable, file], stdout=subprocess.PIPE, text=True) as pool:
        assert pool.stdout is not None
        assert pool.stdout.readline() == "begun\n"
        time.sleep(1.0)
        pool.send_signal(signal.SIGINT)
        time.sleep(0.5)
        pool.send_signal(signal.SIGINT)
        try:
            assert pool.wait(timeout=60) == 130
        finally:
            pool.kill()
