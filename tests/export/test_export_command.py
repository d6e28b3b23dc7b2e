"""`vsmrc export`: every kind of file, also of a recording, and the names of the files."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from app.cli import commands
from app.export.export_jobs import file_name
from app.scenario.data import from_file, load, to_toml
from app.scenario.errors import ScenarioError

pytestmark = pytest.mark.slow  # processes of its own


def test_file_names_are_tame() -> None:
    assert file_name("ur5-hybrid", 12.3456, "svg") == "vsmrc-ur5-hybrid-12.35s.svg"
    assert file_name("ur5-hybrid", 0.2, "csv", start=0.101) == "vsmrc-ur5-hybrid-0.101-0.20s.csv"
    assert file_name("ur5-hybrid", 2.0, "svg", "normal force tau_1") == "vsmrc-ur5-hybrid-normal-force-tau_1-2.00s.svg"
    assert file_name("../../etc/<pass wd>\n", 0.0, "csv") == "vsmrc-etc-pass-wd-0.00s.csv"
    assert file_name("ur5-hybrid", 2.0, "svg", start=0.5) == "vsmrc-ur5-hybrid-0.50-2.00s.svg"
    assert file_name("Ä", 0.0, "csv") == "vsmrc-A-0.00s.csv"
    assert len({file_name(name, 0.0, "csv") for name in ("Käse", "Köse", "日本", "中国", "ø", "")}) == 6
    assert len(file_name("x" * 500, 1.0, "npz")) < 80
    lines = ("α", "β", "ψ₁", "ψ₂", "τ₁", "ℓ·α", "‖residual‖", "residual", "x" * 200, "x" * 199 + "y")
    names = [file_name("ur5-hybrid", 2.0, "svg", line) for line in lines]
    assert len({name.casefold() for name in names}) == len(lines)
    assert names[2] == file_name("ur5-hybrid", 2.0, "svg", "psi_1") == "vsmrc-ur5-hybrid-psi_1-2.00s.svg"
    assert file_name("ur5-hybrid", 2.0, "svg", "||s||") == "vsmrc-ur5-hybrid-norm-s-2.00s.svg"


def test_uploads_that_are_no_scenario_are_refused() -> None:
    assert from_file(to_toml(load("ur5-motion")).encode()) == load("ur5-motion")
    for content, message in (
        (b"\xff\xfe", "UTF-8"),
        (b"mode = ", "not a TOML file"),
        (b"a = 1\n", "a"),
        (b"#" * 2_000_000, "2 MB"),
    ):
        with pytest.raises(ScenarioError, match=message):
            from_file(content)


def vsmrc(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "app", *arguments], capture_output=True, text=True, timeout=900)


def test_export_command_writes_every_kind_and_goes_on_from_a_recording(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    first, again, plots = tmp_path / "first", tmp_path / "again", ("--plots", "Overview", "Sliding")
    done = vsmrc(
        "export", "ur5-hybrid", "--set", "simulation.duration=0.5", "--out", str(first),
        "--to", "svg", "pdf", "png", "csv", "npz", "html", "toml", *plots,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert sorted(p.name for p in first.iterdir()) == sorted(
        [f"vsmrc-ur5-hybrid-Overview-Sliding-0.50s.{kind}" for kind in ("svg", "pdf", "png", "html")]
        + [f"vsmrc-ur5-hybrid-0.50s.{kind}" for kind in ("csv", "npz", "toml")]
    )
    saved = str(first / "vsmrc-ur5-hybrid-0.50s.npz")
    assert vsmrc("export", saved, "--out", str(again), "--to", "svg", "csv", *plots).returncode == 0
    for name in ("vsmrc-ur5-hybrid-Overview-Sliding-0.50s.svg", "vsmrc-ur5-hybrid-0.50s.csv"):
        assert (again / name).read_bytes() == (first / name).read_bytes()
    assert commands.execute(["export", saved, "--start", "0.1", "--to", "csv", "npz", "toml", "--out", str(again)]) == 0
    parts = {"vsmrc-ur5-hybrid-0.10-0.50s.csv", "vsmrc-ur5-hybrid-0.10-0.50s.npz", "vsmrc-ur5-hybrid-0.50s.toml"}
    assert parts < {path.name for path in again.iterdir()}  # the whole run's files are still there
    for arguments, message in (
        (
            (saved, "--start", "3", "--out", str(again)),
            "nothing recorded from 3 s to the end; allowed: within 0 to 0.499 s",
        ),
        ((saved, "--plots", "Overveiw", "--out", str(again)), "did you mean Overview?"),
        ((saved, "--to", "sgv", "--out", str(again)), "--to 'sgv'; allowed: svg, pdf, png, csv, npz, html, toml; did"),
        ((saved, "--width", "wide", "--out", str(again)), "--width 'wide'; allowed: a length such as 85mm"),
        ((saved, "--type-size", "50", "--out", str(again)), "type size: 50 pt; allowed: 4 to 24 pt"),
        ((saved, "--height", "30mm", "--out", str(again)), "height: 30 mm; allowed: at least"),
        ((saved, "--to", "svg", "--series", "tau_9", "--out", str(again)), "series: 'tau_9'; allowed: φ, ψ₁"),
        (
            (saved, "--to", "svg", "--plots", "moment by axes", "--out", str(again)),
            "--plots 'moment by axes': no line to draw in this run; allowed: tracking error, force, bound of s, gain, ",
        ),
        (
            (saved, "--to", "html", "--plots", "moment by axes", "--out", str(again)),
            "--plots 'moment by axes': no line to draw in this run; allowed: tracking error, force, bound of s, gain, ",
        ),
        ((saved, "--engine", "compiled", "--out", str(again)), "--engine compiled: a recording is not computed again"),
        ((saved, "--to", "csv", "--letters", "--out", str(again)), "--letters: with --to csv; allowed: with --to svg,"),
        ((saved, "--to", "toml", "--end", "0.1", "--out", str(again)), "--end: with --to toml; allowed: with --to svg"),
        ((saved, "--to", "html", "--width", "single", "--out", str(again)), "--width: with --to html; allowed: with"),
        ((saved, "--to", "npz", "csv", "--series", "d", "--out", str(again)), "--series: with --to npz csv; allowed"),
        ((saved, "--out", "/dev/null/x"), "--out /dev/null/x: /dev/null is a file; allowed: a folder"),
    ):
        assert commands.execute(["export", *arguments]) == 2
        refusal = capfd.readouterr().err
        assert refusal.count("\n") == 1
        assert message in refusal
