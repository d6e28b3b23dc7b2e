"""docs/extending.md: each of its sentences, done with something small, which then runs and is on the page."""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest

from app.dashboard.panels.robot import RobotPanel
from app.dashboard.plots import plot_table
from app.dashboard.plots.charts import ChartLine, Drawing, Plot, Setup
from app.dashboard.plots.dock import Plots
from app.dashboard.plots.line_values import column
from app.dashboard.plots.paper_figures import figure_of, plots_of
from app.dashboard.plots.plot_table import Tab
from app.dashboard.transport.visible_parts import VisibleParts
from app.dashboard.view_options import Viewing
from app.dashboard.widgets.fields.controls import Desk
from app.scenario.data import edited, load
from app.session.changes import on_robot, on_surface
from app.session.snapshot import snapshot_of
from app.simulation.closed_loop import ClosedLoop
from environments.catalogue import CATALOGUE
from tests.support.added_members import (
    ASKED,
    CLIP,
    CLIPPED,
    DAMPING,
    FADE,
    NOD,
    PUSHED,
    SLOPE,
    SLOPED,
    SOFT,
    STEEP,
    STEEP_ROW,
)
from tests.support.commands import Done
from tests.support.pages import Page

pytestmark = pytest.mark.slow  # a process that compiles

ROOT = Path(__file__).parents[2]


def insert(file: Path, before: str, text: str) -> None:
    source = file.read_text(encoding="utf-8")
    assert source.count(before) == 1
    file.write_text(source.replace(before, text), encoding="utf-8")


@pytest.fixture(scope="module")
def extended(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> dict[str, Any]:
    """What a copy of the program says that has got a law, a mode and a scenario, each as its sentence says; made once
    for all workers of a test run, since its kernels take minutes."""
    own = tmp_path_factory.getbasetemp()
    shared = own if worker_id == "master" else own.parent
    answers = shared / "extended.json"
    with (shared / "extended.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not answers.exists():
            answers.write_text(said_by_the_extended(tmp_path_factory.mktemp("extended")), encoding="utf-8")
    return json.loads(answers.read_text(encoding="utf-8"))


def said_by_the_extended(tree: Path) -> str:
    """JSON that a copy of the program in the folder `tree`, with all that is added to it, says."""
    for folder in ("app", "controllers", "environments", "kernels", "parameters", "static"):
        shutil.copytree(ROOT / folder, tree / folder, ignore=shutil.ignore_patterns("__pycache__"))
    (tree / "controllers" / "laws" / "damping.py").write_text(DAMPING, encoding="utf-8")
    insert(tree / "controllers" / "laws" / "__init__.py", '"pd-gravity")', '"pd-gravity", "damping")')
    insert(tree / "controllers" / "modes.py", "    )\n}\n", SOFT)
    insert(tree / "controllers" / "switching.py", "SWITCHING: dict", STEEP)
    insert(tree / "controllers" / "switching.py", '\n        SwitchingFunction("tanh",', STEEP_ROW)
    for kind, file, text, table, before in (
        ("Slope", "surfaces/slope.py", SLOPE, "SURFACES", "Sphere, FormulaSurface, OwnForm)"),
        ("Nod", "trajectories/nod.py", NOD, "TRAJECTORIES", "Circle, Line, OwnPath)"),
        ("Growing", "force_profiles/growing.py", FADE, "FORCE_PROFILES", "ForceStep, ForceSinusoid)"),
    ):
        folder, module = file.removesuffix(".py").split("/")
        (tree / "environments" / file).write_text(text, encoding="utf-8")
        insert(tree / "environments" / folder / "table.py", before, f"{before.removesuffix(')')}, {kind})")
        insert(
            tree / "environments" / folder / "table.py",
            f"\n{table}: ",
            f"\nfrom environments.{folder}.{module} import {kind}\n\n{table}: ",
        )
    insert(tree / "environments" / "force_profiles" / "force_profile.py", "    omega: float\n", SLOPED)
    insert(tree / "environments" / "sensors.py", "STAGES: tuple[type[Stage], ...] = (", CLIP)
    insert(tree / "environments" / "sensors.py", "    noise: ", CLIPPED)
    insert(tree / "environments" / "sensors.py", "decades, field\n", "decades, field, slider\n")
    insert(tree / "environments" / "contact_kinds.py", '\n    "rigid":', PUSHED)
    (tree / "static" / "scenarios" / "mine.toml").write_text('title = "Mine"\nrobot.name = "planar2r"\n')
    quickly = {"NUMBA_CACHE_DIR": str(tree / "cache"), "NUMBA_OPT": "0"}  # compiled soon rather than well
    environment = os.environ | quickly | {"PYTHONPATH": str(tree)}
    command = [sys.executable, "-c", ASKED]
    done = subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()[-1]


def test_a_law_is_a_file_and_its_name(extended: dict[str, Any]) -> None:
    assert extended["number"] == 3
    assert extended["stopped"] is None
    assert extended["tau"] == pytest.approx(extended["gravity"])  # at rest a brake has nothing else to do
    assert np.abs(extended["gravity"]).min() > 1.0
    assert "damping" in extended["menus"]


def test_a_mode_is_a_row_and_its_name(extended: dict[str, Any]) -> None:
    assert extended["stiffness"] == 50.0
    assert "Soft" in extended["menus"]


def test_a_switching_function_is_two_kernels_and_a_row(extended: dict[str, Any]) -> None:
    assert "arc tangent" in extended["menus"]
    s, layer, d = np.array(extended["s"]), 0.02, 50.0
    eta = 2.0 / np.pi * np.arctan(0.5 * np.pi * np.linalg.norm(s) / layer)
    assert extended["switched"] == pytest.approx(-d * eta * s / np.linalg.norm(s), rel=1e-9)
    kept = 1.0 - 0.5 * 2.0 / d  # epsilon is 2 N
    assert extended["width"] == pytest.approx(2.0 / np.pi * layer * np.tan(0.5 * np.pi * kept))


def test_a_scenario_is_a_file(extended: dict[str, Any]) -> None:
    assert "mine" in extended["scenarios"]
    assert "Mine" in extended["menus"]


def test_a_surface_is_a_file_and_its_class(extended: dict[str, Any]) -> None:
    assert "slope at 45°" in extended["menus"]
    assert "drawn over [m]" in extended["fields"]
    assert extended["normal"] == pytest.approx([0.5**0.5, 0.0, -(0.5**0.5)])
    assert extended["other"] is None


def test_a_trajectory_is_a_file_and_its_class(extended: dict[str, Any]) -> None:
    assert extended["menus"].count("nod") == 2  # of the positions, and of the angles
    assert "nods at [Hz]" in extended["fields"]
    moved = extended["wanted"][1] - extended["start"][1]
    assert moved == pytest.approx(0.002)  # half a period of 0.2 s after one and a half


def test_a_force_profile_is_a_file_and_its_class(extended: dict[str, Any]) -> None:
    assert "growing" in extended["menus"]
    assert "grows by [N/s]" in extended["fields"]
    assert extended["force"] == pytest.approx(26.0)


def test_a_stage_of_the_sensor_is_a_class_a_field_and_a_row(extended: dict[str, Any]) -> None:
    assert "clips at [N]" in extended["fields"]
    assert extended["measured"] <= 0.5 < extended["touched"]


def test_a_kind_of_contact_is_a_row(extended: dict[str, Any]) -> None:
    assert "pushed" in extended["menus"]
    away, within = extended["pushed"]  # of the surface, on either side of it
    assert away == 0.0
    assert within > 1.0


def test_an_arm_is_a_row(monkeypatch: pytest.MonkeyPatch) -> None:
    entry = replace(CATALOGUE["planar3r"], title="Mine", tool_offset=(0.05, 0.0, 0.0))
    monkeypatch.setitem(CATALOGUE, "mine", entry)
    loop = ClosedLoop.from_scenario(on_robot(load("planar3r-hybrid"), "mine"))
    for _ in range(20):
        loop.step()
    assert loop.stopped is None
    gui = MagicMock()
    RobotPanel(MagicMock(spec=Desk, gui=gui))
    assert any("Mine" in call.args[1] for call in gui.add_dropdown.call_args_list)


def test_a_plot_is_a_row(monkeypatch: pytest.MonkeyPatch) -> None:
    def heights(_: Setup) -> Drawing:
        return Drawing("height of the tool  [m]", [ChartLine("z", (66, 135, 245), column("tool", 2))])

    monkeypatch.setitem(plot_table.TABS, "Mine", Tab((Plot("height", heights),)))
    loop = ClosedLoop.from_scenario(load("planar3r-hybrid"))
    for _ in range(20):
        loop.step()
    snapshot = snapshot_of(loop)
    figure = figure_of(plots_of(["Mine", "height"]), snapshot, Setup.of(snapshot, 0, 0), 0.0, 1.0)
    np.testing.assert_array_equal(figure.charts[0].curves[0].y, loop.recording.signals(("tool",))["tool"][:, 2])
    gui = MagicMock()
    Plots(gui, VisibleParts(), Viewing(), nullcontext())
    assert "Mine" in str(gui.mock_calls)


def test_the_command_with_a_surface_of_ones_own_presses_on_it_and_keeps_the_promise(
    tmp_path: Path, here: Callable[..., Done]
) -> None:
    page = Page(ROOT / "docs" / "extending.md")
    (words,) = [each.words for each in page.commands if "surface=own:cone" in each.words]
    asked = [str(tmp_path) if word.startswith("build/") else word for word in words[1:]]
    done = here(*asked, "--duration", "1")
    assert done.returncode == 0, done.stderr
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert metrics["promise"]["verdict"] == "holds"
    assert metrics["force_error_tail"] < 0.1
    with np.load(tmp_path / "recording.npz") as recording:
        assert recording["multiplier"][-1] == pytest.approx(20.0, abs=0.1)
    assert "not touched" not in done.stdout


def test_a_surface_is_a_formula() -> None:
    loop = ClosedLoop.from_scenario(
        edited(on_surface(load("ur5-hybrid"), "formula"), "surface.text", "z - 0.01*cos(5*x)")
    )
    for _ in range(20):
        loop.step()
    assert loop.stopped is None
    p, surface = loop.view().tool, loop.system.surface
    x, _, z = p - surface.origin
    along = np.linspace(x - 0.1, x + 0.1, 200_001)
    distance = np.hypot(along - x, 0.01 * np.cos(5 * along) - z).min()
    assert surface.chart(p, loop.t).g[0] == pytest.approx(-distance, abs=1e-9)  # phi < 0 outside of the solid
