"""The `vsmrc` command: files, exit statuses, and what it prints."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

from app.analysis.metrics import ACCOUNT_METRICS, RUN_METRICS
from app.cli.commands import COMMANDS, SUBCOMMANDS, execute
from app.cli.list import SECTIONS
from app.cli.run import run
from app.scenario.data import edited, from_toml, load, to_toml
from app.scenario.field_info import field_info, types_of
from app.scenario.schema import Scenario
from app.scenario.units import CARTESIAN, JOINT
from app.simulation.closed_loop import ClosedLoop
from app.simulation.compiled_run import CompiledRun
from app.simulation.signals import SIGNALS
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


def test_compiled_run_refuses_a_law_in_plain_numpy(tmp_path: Path) -> None:
    done = vsmrc(
        "run", "ur5-hybrid", "--use", "docs/examples/pid_gravity.py", "--set", "controller.law=pid-gravity",
        "--engine", "compiled", "--out", str(tmp_path),
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr == (
        "vsmrc: --engine compiled: controller.law: 'pid-gravity' is in plain numpy; allowed: --engine pinocchio\n"
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
    assert units["s = 0 by (18), promised or not"] == units["simulated time"] == "s"
    assert units["torque variation, per joint"] == "N·m/s"
    assert units["force error at the end, largest"] == "—"


@pytest.mark.parametrize("section", SECTIONS)
def test_the_fields_of_each_section_are_listed(section: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["list", "--fields", section]) == 0
    lines: dict[str, list[str]] = {}
    for line in capsys.readouterr().out.splitlines():
        lines.setdefault(line.split()[0], []).append(line)
    stated = getattr(load("ur5-corner"), section)
    names = [name for name in stated.__struct_fields__ if not types_of(type(stated), name)]
    assert {f"{section}.{name}" for name in names} <= lines.keys()
    for path in (path for path in lines if not path.endswith(".kind:")):
        info = field_info(path)
        assert info.doc in lines[path][0]
        assert info.largest is None or f"{info.largest:g}" in lines[path][0]
    if section == "surface":
        assert lines["surface.tilt.axis"][0].endswith("axis (plane)")
        assert lines["surface.tilt.amplitude"][0].split()[1:3] == ["rad", "0.0"]
        assert lines["surface.motion.amplitude"][0].split()[1:3] == ["m", "0.0"]
        assert lines["surface.motion.amplitude"][0].endswith("<= 1              amplitude")
    if section in ("target_model", "blend"):
        place, default = ("target_model", "the mode's") if section == "target_model" else ("blend.to", "target_model's")
        assert re.search(rf"{default} +n numbers, or n rows  .*docs/target-model.md$", lines[f"{place}.K_m"][0])
    if section == "rotation":
        assert lines["rotation.radius"][0].split()[1:3] == ["rad", "0.05"]
    if section == "motion":
        assert lines["motion.ramp"][0].endswith(
            "1.0               >= 0, <= 3600           time to full speed (circle, line)"
        )
        assert [line.rpartition("  ")[2] for line in lines["motion.period"]] == [
            "time of one turn (circle)",
            "time there and back (line)",
        ]
    if section == "second":
        assert lines["second.surface.kind:"] == ["second.surface.kind: plane, cylinder, sphere, formula, own"]
        assert lines["second.surface.radius"][0].endswith("radius (cylinder, sphere)")
        assert lines["second.force.rise"][0].endswith("how long it takes (step)")
        assert "  true              true, false  " in lines["second.contact.unilateral"][0]
    assert execute(["list", "--fields", "surfaces"]) == 2
    assert capsys.readouterr().err.endswith("simulation; did you mean surface?\n")


def test_the_signals_of_a_recording_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["list", "--signals"]) == 0
    listed = [line.split(maxsplit=3) for line in capsys.readouterr().out.splitlines()[1:]]
    assert listed == [[each.name, str(each.width or "n"), each.unit, each.doc] for each in SIGNALS]
    assert execute(["list", "--laws"]) == 0
    assert "PD + gravity. Its torque depends on Ĝ, the velocities; not on M̂ and Ĉ," in capsys.readouterr().out
    assert execute(["list", "--signals", "--fields", "robot"]) == 2
    assert capsys.readouterr().err == "vsmrc: --signals with --fields; allowed: one of them\n"


def test_figures_that_a_law_has_not_are_not_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    own = ("controller.law=computed-torque",)
    assert run("planar2r-semicircle", out=tmp_path, duration=0.05, settings=(own,)) == 0
    figures = {line[:40].strip(): line[40:].strip() for line in capsys.readouterr().out.splitlines()}
    for figure in ("least margin of (17)", "s = 0 by (18), promised or not", "‖s‖ beyond (20) and the band, largest"):
        assert figures[figure] == "—"
    assert figures["path error at the end, largest"] != "—"


def test_runs_are_compared_side_by_side(here: Callable[..., Done]) -> None:
    done = here("compare", "planar3r-hybrid", "planar2r-semicircle", "--duration", "0.3", "--last", "0.1")
    assert done.returncode == 0, done.stderr
    figures = {line.split("│")[1].strip(): line.split("│")[2:4] for line in done.stdout.splitlines() if "│" in line}
    assert len(figures) == len(ACCOUNT_METRICS)
    for name, shown in zip(("planar3r-hybrid", "planar2r-semicircle"), figures["‖s‖, largest [mm/s]"], strict=True):
        loop = ClosedLoop.from_scenario(load(name))
        CompiledRun(loop).advance(300)
        largest = 1e3 * float(loop.recording.stretch()["s_norm"][-100:].max())
        assert float(shown) == pytest.approx(largest, rel=1e-2)


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


def test_the_version_is_said_at_once() -> None:
    done = vsmrc("--version")
    assert (done.returncode, done.stdout, done.stderr) == (0, f"vsmrc-lab {version('vsmrc-lab')}\n", "")
    code = "import sys; sys.argv[1:] = ['--version']; from app.__main__ import main; import app.__main__ as program; "
    code += "program.end = lambda status: None; main(); assert not {'tyro', 'numpy'} & sys.modules.keys()"
    subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.DEVNULL)  # what makes others slow


def test_the_help_has_every_command_and_says_what_runs_without_one(here: Callable[..., Done]) -> None:
    done = here("--help")
    assert done.returncode == 0
    words = " ".join(done.stdout.split())
    assert "usage: vsmrc [COMMAND] [OPTIONS]" in words
    assert "Without a command, vsmrc does what `vsmrc serve` does, and takes its options" in words
    assert "required" not in words
    listed = re.findall(r"^  (\S+) +[A-Z]", done.stdout, re.MULTILINE)
    assert listed == list(COMMANDS)


def test_each_help_says_what_is_typed(here: Callable[..., Done]) -> None:
    helps = {
        name: " ".join(re.sub("[│╭╮╰╯─]", " ", here(*name.split(), "--help").stdout).split())
        for name in (*COMMANDS, *(f"{name} {action}" for name in SUBCOMMANDS for action in SUBCOMMANDS[name]))
    }
    assert len(set(helps.values())) == len(helps)
    for name, shown in helps.items():
        assert f"usage: vsmrc {name} [-h]" in shown
        assert "(default: )" not in shown
    assert (helps["sweep"].count("(repeatable)"), helps["tune"].count("(repeatable)")) == (2, 3)
    assert "{svg,pdf,png,csv,npz,html,toml} [...]" in helps["export"]
    points = helps["sweep"].rpartition(" --points ")[2].partition(" --draw ")[0]
    assert "required with --design latin or sobol" in points
    assert "default" not in points
    assert "--set, --duration and --use apply to every scenario" in helps["compare"]


def test_list_shows_robots_and_scenarios() -> None:
    done = vsmrc("list")
    assert done.returncode == 0
    assert "panda" in done.stdout
    assert "planar2r-semicircle" in done.stdout


def test_toml_keeps_every_field() -> None:
    scenario = edited(Scenario(), "target_model.K_m", [[1.0, 0.5], [0.5, 2.0]])
    assert from_toml(to_toml(scenario)) == scenario


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
    assert "outside the declared set: payload 2 kg > declared 0 kg" in done.stdout
    assert load(str(tmp_path / "scenario.toml")).robot.tool_frame == "flange"


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
        assert "2 of 2 runs were refused, 1 of them for: simulation.duration: 10⁻⁹ s; allowed: at" in done.stdout
