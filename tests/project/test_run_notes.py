"""What `vsmrc run` says beside its numbers: settings without effect, surfaces that were not touched, and premises."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.support.commands import Done

pytestmark = pytest.mark.slow  # simulations

Here = Callable[..., Done]
UNUSED = (
    "vsmrc: note: controller.d is not used while controller.gain is theorem; --set controller.gain=constant chooses it"
    "\n"
)


def test_a_constant_gain_without_effect_is_said_by_each_command(tmp_path: Path, here: Here) -> None:
    setting, out = ("--set", "controller.d=5"), ("--out", str(tmp_path))
    for command in (
        ("run", "planar3r-hybrid", "--duration", "0.01", *out),
        ("compare", "planar3r-hybrid", "--duration", "0.01"),
        ("sweep", "planar3r-hybrid", "--vary", "controller.K_s=50:60:2", "--duration", "0.01", "--dry-run"),
    ):
        assert UNUSED in here(*command, *setting).stderr, command
        assert "not used" not in here(*command, *setting, "controller.gain=constant").stderr, command
        assert "not used" not in here(*command).stderr, command
    rigid = here("run", "ur5-constrained", "--duration", "0.01", *out, "--set", "contact.K_e=5e3", "contact.B_e=1")
    for name in ("K_e", "B_e"):
        note = f"contact.{name} is not used while contact.kind is rigid; --set contact.kind=elastic chooses it\n"
        assert f"vsmrc: note: {note}" in rigid.stderr
    kinds = ("sweep", "ur5-constrained", "--vary", "contact.kind=elastic,rigid", "--duration", "0.01", "--dry-run")
    assert "not used" not in here(*kinds, "--set", "contact.K_e=5e3").stderr


def test_a_surface_that_was_not_touched_is_said_with_the_tools_position(tmp_path: Path, here: Here) -> None:
    run = ("run", "ur5-hybrid", "--duration", "0.1", "--out", str(tmp_path))
    done = here(*run, "--set", "surface=plane")
    assert "note: the tool has not touched the surface; it began 0.18 m away, at [0.57" in done.stdout
    with np.load(tmp_path / "recording.npz") as recording:
        place = ", ".join(f"{x:.4g}" for x in recording["tool"][0])
    assert f"at [{place}] in the world\n" in done.stdout
    moved = here(*run, "--set", "surface=plane", f"surface.origin=[{place}]")
    assert "not touched" not in moved.stdout
    assert "not touched" not in here(*run, "--set", "surface=plane", "force.value=0").stdout  # as it was asked


@pytest.mark.parametrize("law", ["pd-gravity", "computed-torque"])
def test_premises_about_the_terms_of_25_are_not_told_of_another_law(law: str, tmp_path: Path, here: Here) -> None:
    run = ("run", "planar2r-semicircle", "--duration", "0.1", "--out", str(tmp_path), "--set", f"controller.law={law}")
    failed = [line for line in here(*run).stdout.splitlines() if line.startswith("premise failed")]
    assert failed == ["premise failed at 0 s: robust law (25)"]
    premises = json.loads((tmp_path / "metrics.json").read_text())["premises"]
    assert [each["premise"] for each in premises if each["failed"] is not None] == ["law"]
    assert {"gain", "held", "layer"}.isdisjoint(each["premise"] for each in premises)


def test_settling_w_and_the_band_are_printed(tmp_path: Path, here: Here) -> None:
    run = ("planar3r-hybrid", "--duration", "1")
    done = here("run", *run, "--out", str(tmp_path))
    printed = {line[:40].strip(): line[40:].strip() for line in done.stdout.splitlines()}
    settled = json.loads((tmp_path / "metrics.json").read_text())["settling_time"]
    assert printed["settled after"] == f"{settled:.4g} s"
    with np.load(tmp_path / "recording.npz") as recording:
        w, band = recording["held_error"].max(), recording["s_band"].max()
    assert printed["w while the torque is held, largest"] == f"{w:.4g} N"
    assert printed["band of ‖s‖, largest where promised"] == f"{1e3 * band:.4g} mm/s"
    (row,) = [line.split("│") for line in here("compare", *run).stdout.splitlines() if "settled after [s]" in line]
    assert row[2].strip() == f"{settled:.4g}"
    assert "settled" not in here("compare", *run, "--last", "0.1").stdout


NO_NUMBER = """
from controllers.control_law import ControlLaw

def torque(given, out, x, x_dot):
    x_dot[:] = 1.0
    out.terms.gravity[:] = given.feedforward.G_hat if x[0] < 0.03 else float("nan")

LAW = ControlLaw(
    kind="ends", title="Ends", about="Ends.", torque=torque, told=("gravity",), terms={"gravity": "gravity"},
    states=lambda n: 1,
)
"""


def test_a_run_that_stopped_on_no_number_has_dashes_and_figures(tmp_path: Path, here: Here) -> None:
    (law := tmp_path / "ends.py").write_text(NO_NUMBER)
    chosen = ("planar3r-hybrid", "--use", str(law), "--set", "controller.law=ends", "--out", str(out := tmp_path / "o"))
    done = here("run", *chosen)
    assert done.returncode == 3
    shown = {line[:40].strip(): line[40:].strip() for line in done.stdout.splitlines()}
    assert "no finite number" in shown["stopped"]
    for metric in ("residual of (8) at the end, RMS", "torque variation, per joint"):
        assert shown[metric] == "—"
    assert shown["time with a drive at its limit"] == "0 %"
    metrics = json.loads((out / "metrics.json").read_text())
    assert (metrics["saturated_share"], metrics["target_model_residual_tail"]) == (0.0, None)
    done = here("export", *chosen, "--to", "csv", "svg")
    assert (done.returncode, done.stderr.count("vsmrc:")) == (3, 0)
    assert {path.suffix for path in out.iterdir()} >= {".csv", ".svg"}
