"""Recordings as files: they hold what was recorded, bit for bit, with its units, scenario and changes."""

from __future__ import annotations

import io
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

from app.analysis.metrics import metrics_of
from app.dashboard.export import ExportedStretch, FigureChoice, _figure, write
from app.dashboard.plots.charts import Setup
from app.dashboard.plots.paper_figures import figure_of, plots_of
from app.export.export_jobs import DataJob, ExportError, ExportJobs
from app.export.formats import Kind
from app.scenario.data import edited, from_toml, load
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.scenario.units import Units
from app.session import headless_run
from app.session.changes import blending_to
from app.session.snapshot import snapshot_of, with_conditions_at
from app.simulation.builders.controller_builder import target_model
from app.simulation.closed_loop import ClosedLoop
from app.simulation.recording import BLOCK, Recording
from app.storage.constants_store import kept_memory
from app.storage.recording_files import RecordingTable, TooLarge, read_npz, table, write_csv, write_npz
from tests.support.svg import letters_of

pytestmark = pytest.mark.slow  # processes of its own

made = ExportJobs().made
CONDITIONED = ("bound of s", "gain", "Sliding", "Guarantee", "Residual")  # plots of what epochs say


def noise(rows: int, n: int = 2) -> Recording:
    """A recording of numbers with all their digits, some of which are no numbers."""
    recording, random = Recording(n, history=10 * BLOCK), np.random.default_rng(3)
    for k in range(rows):
        row = recording.new_row().view(float)
        row[:] = random.standard_normal(recording.width) * 10.0 ** random.integers(-300, 300, recording.width)
        row[0] = 1e-3 * k
        row[3] = (np.nan, np.inf, -np.inf, -0.0)[k % 4]
        recording.commit()
    return recording


def bits(rows: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(rows).view(np.uint64)


def test_csv_reads_back_to_the_same_bits_and_carries_the_scenario() -> None:
    recording, scenario, file = noise(BLOCK + 700), load("ur5-hybrid"), io.BytesIO()
    write_csv(table(scenario, recording), file)
    lines = file.getvalue().decode().splitlines()
    commented = [line for line in lines if line.startswith("# ")]
    assert from_toml("\n".join(line[2:] for line in commented)) == scenario
    header = lines[len(commented)].split(",")
    assert header[:4] == ["t [s]", "q[0] [rad]", "q[1] [rad]", "q_dot[0] [rad/s]"]
    assert "tau[1] [N·m]" in header
    rows = np.loadtxt(lines[len(commented) + 1 :], delimiter=",")
    assert np.array_equal(bits(rows)[~np.isnan(rows)], bits(recording.rows())[~np.isnan(rows)])
    assert np.array_equal(np.isnan(rows), np.isnan(recording.rows()))


def test_npz_reads_back_to_the_same_bits_and_names_every_unit(tmp_path: Path) -> None:
    recording, scenario = noise(BLOCK + 700), load("ur5-hybrid")
    with (tmp_path / "run.npz").open("wb") as file:
        write_npz(table(scenario, recording, 0.5, 4.5), file)
    with np.load(tmp_path / "run.npz") as saved:
        assert "tau: N·m" in saved["units"]
        assert saved["t"].shape == (4001,)
    read_scenario, read, _ = read_npz(tmp_path / "run.npz")
    assert read_scenario == scenario
    assert np.array_equal(bits(read.rows()), bits(recording.rows(0.5, 4.5)))


def test_files_that_are_no_recording_are_named(tmp_path: Path) -> None:
    (tmp_path / "text.npz").write_text("text")
    np.savez(tmp_path / "other.npz", t=np.zeros(3))
    for name, message in (
        ("text.npz", "not a recording"),
        ("other.npz", "not a recording"),
        ("none.npz", "No such file"),
    ):
        with pytest.raises(ScenarioError, match=message):
            read_npz(tmp_path / name)


@pytest.mark.parametrize("write", [write_csv, write_npz])
def test_data_over_their_limit_are_refused_with_what_fits(write) -> None:
    data = table(load("ur5-hybrid"), noise(4000))
    whole = io.BytesIO()
    write(data, whole)
    with pytest.raises(TooLarge, match=r"allowed: \d+ MB, which is about") as refusal:
        write(data, io.BytesIO(), limit=0.5 * len(whole.getvalue()))
    fits = re.search(r"about ([\d.]+) s of this run", str(refusal.value))
    assert fits is not None
    assert float(fits[1]) == pytest.approx(0.5 * data.seconds, rel=0.15)


def test_data_come_from_the_other_process_as_from_this_one() -> None:
    data, progress = table(load("ur5-hybrid"), noise(2 * BLOCK + 5)), []
    here = io.BytesIO()
    write_csv(data, here)
    assert made(DataJob(data, "csv", np.inf), progress.append) == here.getvalue()
    assert progress == sorted(progress)
    assert progress[-1] == 1.0
    for form in ("csv", "npz"):
        with pytest.raises(ExportError, match="allowed: 1 MB"):
            made(DataJob(data, form, 1e6), lambda _: None)


def test_one_instant_is_written_where_no_figure_is_drawn_of_it(tmp_path: Path) -> None:
    stretch = ExportedStretch(load("planar3r-hybrid"), noise(5, n=3), 0.002, 0.0025)
    paths = list(write(stretch, ["csv", "npz", "toml"], FigureChoice(), tmp_path))
    assert [path.suffix for path in paths] == [".csv", ".npz", ".toml"]
    assert np.array_equal(bits(read_npz(paths[1])[1].rows()), bits(stretch.recording.rows(0.002, 0.0025)))
    where = r"one instant recorded from 0\.002 s to 0\.0025 s, t = 0\.002 s; allowed: two or more, or --to csv, npz, t"
    refused: tuple[tuple[Kind, ...], ...] = (("csv", "svg"), ("html",))
    for kinds in refused:
        with pytest.raises(ScenarioError, match=f"^--to {kinds[-1]}: {where}"):
            list(write(stretch, kinds, FigureChoice(), tmp_path / "none"))
    assert not (tmp_path / "none").exists()


def test_a_stretch_without_a_row_is_refused_with_those_that_have_one(tmp_path: Path) -> None:
    scenario = load("planar3r-hybrid")
    (saved,) = write(ExportedStretch(scenario, noise(5, n=3), 0.002, 0.003), ["npz"], FigureChoice(), tmp_path)
    later = ExportedStretch(*read_npz(saved)[:2], 0.0, 0.001)
    with pytest.raises(ScenarioError, match=r"nothing recorded from 0 s to 0\.001 s; allowed: within 0\.002 to 0\.003"):
        list(write(later, ["csv"], FigureChoice(), tmp_path))


def changes_in_csv(recording: Recording, scenario: Scenario, since: float = 0.0) -> tuple[Scenario, list[str]]:
    """Scenario in the comment lines of a CSV, and what they tell of its changes."""
    file = io.BytesIO()
    write_csv(table(scenario, recording, since), file)
    comments = [line[2:] for line in file.getvalue().decode().splitlines() if line.startswith("# ")]
    changes = [line.removeprefix("# ") for line in comments if line.startswith("# from")]
    return from_toml("\n".join(comments)), changes


def test_a_scenario_that_held_for_no_row_is_not_that_of_a_file() -> None:
    """An edit of a paused run; and of a run in which nothing was changed the file is the same as before there was a
    list of changes."""
    loop = ClosedLoop.from_scenario(load("ur5-hybrid"), 100, memory=kept_memory())
    run_to(loop, 0.02)
    whole, held = io.BytesIO(), loop.system.scenario
    write_csv(RecordingTable(held, 6, 20, 0.02, Units(), 6 * (False,), loop.recording.pieces()), whole)
    loop.edit(edited(held, "contact.K_e", 2e4))
    again = io.BytesIO()
    write_csv(table(loop.system.scenario, loop.recording), again)
    assert again.getvalue() == whole.getvalue()


def test_the_end_of_a_planned_blend_is_told() -> None:
    planned = blending_to(
        load("ur5-hybrid"), edited(load("ur5-hybrid"), "target_model.K_m", [0.0, *[900.0] * 5]), 0.02, 0.02
    )
    loop = ClosedLoop.from_scenario(planned, 100, memory=kept_memory())
    run_to(loop, 0.06)
    first, changes = changes_in_csv(loop.recording, loop.system.scenario)
    assert first == planned
    assert changes == ["from t = 0.04 s: the planned blend has ended, its model is the target model from here on"]


def test_a_figure_has_the_conditions_of_its_last_row() -> None:
    """Not those of edits that came later, and within a blend the model to which it had led."""
    loop = ClosedLoop.from_scenario(load("planar3r-hybrid"), 1000, memory=kept_memory())
    run_to(loop, 0.1)
    loop.edit(edited(loop.system.scenario, "contact.K_e", 3210.0))
    paused = with_conditions_at(snapshot_of(loop), float(loop.recording.signals(("t",))["t"][-1]))
    assert paused.scenario == load("planar3r-hybrid")  # no row had the other stiffness
    loop.edit(edited(loop.system.scenario, "controller.law", "computed-torque"))
    run_to(loop, 0.2)
    before, after = (with_conditions_at(snapshot_of(loop), t) for t in (0.05, 0.15))
    assert before.scenario == load("planar3r-hybrid")
    assert after is not before
    assert after.scenario.contact.K_e == 3210.0
    for seen, robust in ((before, True), (after, False)):
        assert Setup.of(seen, 0, 0).robust == robust
        text = figure_of(plots_of(["force"]), seen, Setup.of(seen, 0, 0), 0.0, 0.05 if robust else 0.15).caption
        assert ("3210" in text) == (not robust)
        assert ("Changed at t = 0.1 s" in text) == (not robust)


def test_a_file_says_why_the_run_stopped_unless_it_ends_before(tmp_path: Path) -> None:
    loop = ClosedLoop.from_scenario(load("planar3r-hybrid"), 1000, memory=kept_memory())
    run_to(loop, 0.05)
    loop.fail("the control law", ValueError("no\nsolution"))
    assert loop.stopped is not None
    reason, scenario = "Stopped at t = 0.050 s: the control law failed (no solution)", load("planar3r-hybrid")
    headless_run.write(loop, metrics_of(loop, 1.0, "pinocchio"), tmp_path)
    saved = read_npz(tmp_path / "recording.npz")
    assert saved.stopped == loop.stopped
    for end, stops in ((math.inf, True), (0.03, False)):
        stretch = ExportedStretch(saved.scenario, saved.recording, 0.0, end, saved.stopped)
        csv, npz = write(stretch, ["csv", "npz"], FigureChoice(), tmp_path)
        lines = csv.read_text().splitlines()
        assert (lines[0] == f"# # {reason}") == stops
        assert from_toml("\n".join(line[2:] for line in lines if line.startswith("# "))) == scenario
        assert read_npz(npz).stopped == (loop.stopped if stops else "")
        shown = snapshot_of(loop)
        of_page = figure_of(plots_of(["force"]), shown, Setup.of(shown, 0, 0), 0.0, end)
        for figure in (of_page, _figure(stretch, FigureChoice(["force"]))):
            assert (f" {reason}. " in figure.caption) == stops


def test_the_scenario_of_a_run_with_a_blend_plays_it_again(tmp_path: Path) -> None:
    to = edited(load("planar3r-hybrid"), "target_model.K_m", [0.0, 900.0, 900.0])
    planned = blending_to(load("planar3r-hybrid"), to, 0.02, 0.1)
    loop = ClosedLoop.from_scenario(planned, 1000, memory=kept_memory())
    run_to(loop, 0.2)
    stretch = ExportedStretch(loop.system.scenario, loop.recording, 0.0, 0.07)
    (path,) = write(
        ExportedStretch(loop.system.scenario, loop.recording, 0.0, math.inf), ["toml"], FigureChoice(), tmp_path
    )
    assert from_toml(path.read_text(encoding="utf-8")) == planned
    half = with_conditions_at(snapshot_of(loop), 0.07)
    K_m = half.matrices["K_m"][1, 1]
    begin, end = (np.diag(target_model(each, 3).K_m)[1] for each in (load("planar3r-hybrid"), to))
    assert K_m == pytest.approx(0.5 * (begin + end), rel=0.01)
    assert f"{K_m:.4g}" in _figure(stretch, FigureChoice(("force",))).caption


@pytest.mark.parametrize("instant", [0.007, 0.009, 0.014])
def test_an_instant_is_that_of_its_row_although_its_decimals_are_not(instant: float, tmp_path: Path) -> None:
    recording = noise(20, n=3)
    (path,) = write(
        ExportedStretch(load("planar3r-hybrid"), recording, instant, instant), ["csv"], FigureChoice(), tmp_path
    )
    assert path.read_text(encoding="utf-8").splitlines()[-1].startswith(repr(round(instant * 1e3) * 1e-3))


def run_to(loop: ClosedLoop, t: float) -> None:
    while loop.t < t - 0.5 * loop.period:
        loop.advance()


def test_units_of_files_are_those_of_the_task_space() -> None:
    loop = ClosedLoop.from_scenario(edited(load("ur5-motion"), "task_space.kind", "joint"), 10)
    loop.step()
    text, archive = io.BytesIO(), io.BytesIO()
    write_csv(table(loop.system.scenario, loop.recording), text)
    write_npz(table(loop.system.scenario, loop.recording), archive)
    assert b"e_r[0] [rad],e_r[1] [rad]" in text.getvalue()
    archive.seek(0)
    units = dict(line.split(": ") for line in np.load(archive)["units"].tolist())
    assert (units["s"], units["d"], units["q"], units["tool"], units["F"]) == ("rad/s", "N·m", "rad", "m", "N")


def test_a_recording_with_an_edit_on_its_way_is_drawn_as_the_run_itself(tmp_path: Path) -> None:
    """Bounds, V, perturbation and marks are those of each stretch's own conditions."""
    begun = edited(load("ur5-hybrid"), "truth.payload_mass", 1.0)
    loop = ClosedLoop.from_scenario(begun, 3000, memory=kept_memory())
    for instant, path, value in (
        (0.1, "truth.payload_mass", 3.0),
        (0.2, "contact.K_e", 3e4),
        (0.2, "contact.K_e", 2e4),
        (0.3, "controller.law", "computed-torque"),
    ):
        run_to(loop, instant)
        loop.edit(edited(loop.system.scenario, path, value))
    run_to(loop, 0.4)
    scenario = loop.system.scenario
    with (tmp_path / "run.npz").open("wb") as file:
        write_npz(table(scenario, loop.recording), file)
    swapped = loop.recording.epochs[-1].t  # told to the last bit, as the rows have it
    changes = [
        "from t = 0.1 s: truth.payload_mass = 3.0",
        "from t = 0.2 s: contact.K_e = 20000.0",  # 30000 was in force for no row
        f'from t = {swapped!r} s: controller.law = "computed-torque"',
    ]
    with np.load(tmp_path / "run.npz") as saved:
        assert saved["epochs"] == pytest.approx([0.0, 0.1, 0.2, 0.2, 0.3])
        assert from_toml(str(saved["first_scenario"])) == begun
        assert saved["changes"].tolist() == changes
    assert changes_in_csv(loop.recording, scenario) == (begun, changes)
    assert changes_in_csv(loop.recording, scenario, 0.25) == (loop.recording.epochs[3].scenario, changes[2:])
    np.testing.assert_array_equal(played_again(begun, changes, 0.4).recording.rows(), loop.recording.rows())
    assert read_npz(tmp_path / "run.npz")[0] == scenario
    files = {}
    for name, recording in (("run", loop.recording), ("file", read_npz(tmp_path / "run.npz")[1])):
        stretch = ExportedStretch(scenario, recording, 0.0, 1.0)
        (path,) = write(stretch, ["svg"], FigureChoice(CONDITIONED), tmp_path / name)
        files[name] = path.read_bytes()
    assert files["file"] == files["run"]
    assert "Changed at t = 0.1, 0.2, 0.3 s" in letters_of(files["file"])


def played_again(begun: Scenario, changes: list[str], until: float) -> ClosedLoop:
    """A run with the changes that a file tells."""
    loop = ClosedLoop.from_scenario(begun, 3000, memory=kept_memory())
    for line in changes:
        t, path, value = re.fullmatch(r"from t = (\S+) s: (\S+) = (.*)", line).groups()  # pyright: ignore[reportOptionalMemberAccess]
        run_to(loop, float(t))
        loop.edit(edited(loop.system.scenario, path, json.loads(value)))
    run_to(loop, until)
    return loop
