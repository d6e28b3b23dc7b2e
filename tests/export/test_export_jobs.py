"""Files to take away: they hold what was recorded, bit for bit, and say of what; the same again makes the same file."""

from __future__ import annotations

import base64
import io
import json
import re
import struct
import subprocess
import sys
from dataclasses import replace
from html import unescape
from pathlib import Path

import msgspec
import numpy as np
import pytest
import zstandard

from app.cli import commands
from app.dashboard.export import ExportedStretch, FigureChoice, write
from app.dashboard.plots.charts import Setup
from app.dashboard.plots.paper_figures import figure_of, plots_of, title_and_unit
from app.dashboard.plots.plot_table import TABS
from app.dashboard.scene.standalone import snapshots, standalone_html
from app.dashboard.theme.colors import SERIES
from app.export.export_jobs import DataJob, ExportError, ExportJobs, FigureJob, PlaybackJob, file_name
from app.export.figures import Curve, Figure, FigureChart
from app.export.formats import ALL_PLOTS
from app.export.inks import CONTRAST, printed
from app.export.playback_frames import FRAMES_PER_SECOND, PlaybackFrames, playback_frames
from app.export.printing import render
from app.export.sheet import BINS, thinned
from app.scenario.caption import caption
from app.scenario.data import edited, from_file, from_toml, load, to_toml
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.scenario.units import CARTESIAN, JOINT, Units
from app.session import headless_run
from app.session.changes import blending_to
from app.session.snapshot import Snapshot, snapshot_of
from app.simulation.assembly import assemble
from app.simulation.closed_loop import ClosedLoop
from app.simulation.recording import BLOCK, Recording
from app.storage.constants_store import kept_memory
from app.storage.recording_files import RecordingTable, TooLarge, read_npz, table, write_csv, write_npz
from tests.support.svg import letters_of

pytestmark = pytest.mark.slow  # processes of its own

made = ExportJobs().made
CONDITIONED = ("bound of s", "gain", "Sliding", "Guarantee", "Residual")  # plots of what epochs say


@pytest.fixture(scope="module")
def loop() -> ClosedLoop:
    return headless_run.simulate(edited(load("ur5-hybrid-moving"), "simulation.duration", 1.0))[0]


@pytest.fixture(scope="module")
def snapshot(loop: ClosedLoop) -> Snapshot:
    return snapshot_of(loop)


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
    read_scenario, read = read_npz(tmp_path / "run.npz")
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


def test_svg_is_the_same_again_and_its_words_are_text(snapshot: Snapshot) -> None:
    setup = Setup.of(snapshot, 0, 0)
    figure = figure_of(plots_of([ALL_PLOTS]), snapshot, setup, 0.2, 0.9)
    words = letters_of(render(figure, "svg"))
    for drawing in (plot.draw(setup) for tab in TABS.values() for plot in tab.plots):
        title, unit = title_and_unit(drawing.title if drawing else "")
        assert unit in words
        for word in re.findall(r"[a-z]{3,}", title):
            assert word in words
    assert "frequency [Hz]" in words
    assert "moving surface (ur5-hybrid-moving, edited): hybrid mode" in words
    few = figure_of(plots_of(["Overview"]), snapshot, setup, 0.2, 0.9)
    svg = render(few, "svg")
    assert made(FigureJob(few, "svg"), lambda _: None) == svg
    assert "dc:date" not in svg.decode()


def test_pdf_and_png_are_what_they_say(snapshot: Snapshot) -> None:
    figure = figure_of(plots_of(["Overview"]), snapshot, Setup.of(snapshot, 0, 0), 0.0, 1.0)
    pdf = render(figure, "pdf")
    assert pdf.startswith(b"%PDF-")
    assert b"CreationDate" not in pdf
    width, height = struct.unpack(">II", render(figure, "png")[16:24])
    assert width == int(300 * 85 / 25.4)
    assert height > width


def test_figure_draws_what_was_recorded(snapshot: Snapshot) -> None:
    setup = Setup.of(snapshot, 0, 0)
    figure = figure_of(plots_of(["Overview"]), snapshot, setup, 0.25, 0.75)
    rows = snapshot.recording.signals(("t", "e_r"), 0.25, 0.75)
    for i, curve in enumerate(figure.charts[0].curves):
        np.testing.assert_array_equal(curve.x, rows["t"])
        np.testing.assert_allclose(curve.y, 1e3 * rows["e_r"][:, i])
    with pytest.raises(ValueError, match="nothing recorded there"):
        figure_of(plots_of(["Overview"]), snapshot, setup, 5.0, 6.0)


def test_a_figure_stacks_terms_over_one_another(snapshot: Snapshot) -> None:
    setup = Setup.of(snapshot, 0, 2)
    chart = figure_of(plots_of(["Torque"]), snapshot, setup, 0.2, 0.9).charts[1]
    assert len(chart.areas) == 12
    top, bottom, total = chart.curves[6].y, chart.curves[12].y, chart.curves[-1].y
    np.testing.assert_allclose(top + bottom, total, atol=1e-9)
    listed = [curve.name for curve in chart.curves if curve.listed]
    assert listed == ["inertia", "Coriolis", "gravity", "Jᵀ F", "K_s s", "switching", "τ"]


def test_a_hostile_name_stays_text() -> None:
    curve = Curve("<b>&$x_1^", SERIES[0], np.arange(3.0), np.ones(3))
    svg = render(Figure((FigureChart("<script>", "mm", (curve,)),), "caption <script> $\\frac{"), "svg").decode()
    assert "<script>" not in svg
    assert "caption <script> $\\frac{" in letters_of(svg.encode())
    assert "<b>&$x_1^" in letters_of(svg.encode()).replace(" ", "")


def test_thinning_keeps_a_spike_and_the_ends() -> None:
    x = np.arange(100_000.0)
    y = np.sin(x / 5000.0)
    y[54_321] = 7.0
    few_x, few_y = thinned(x, y, BINS)
    assert len(few_x) <= 2 * BINS + 2
    assert few_y.max() == 7.0
    assert (few_x[0], few_x[-1]) == (0.0, 99_999.0)
    assert np.all(np.diff(few_x) > 0)
    np.testing.assert_array_equal(y[few_x.astype(int)], few_y)


def test_printed_colours_can_be_seen_on_white_and_told_apart() -> None:
    colors = [np.array(printed(color)) for color in SERIES]
    for color in colors:
        linear = np.where(color <= 0.04045, color / 12.92, ((color + 0.055) / 1.055) ** 2.4)
        assert 1.05 / (linear @ (0.2126, 0.7152, 0.0722) + 0.05) >= CONTRAST
    # Machado, Oliveira and Fernandes (2009): what a person without the middle cones sees
    deuteranopia = np.array([[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]])
    seen = [deuteranopia @ color for color in colors]
    assert min(np.linalg.norm(a - b) for i, a in enumerate(seen) for b in seen[:i]) > 0.07


def test_caption_says_the_scenario_in_numbers() -> None:
    scenario = edited(edited(load("ur5-hybrid"), "truth.payload_mass", 1.5), "declared.payload_mass", 2.0)
    model = {"M_m": 10 * np.eye(2), "B_m": np.diag([632.5, 4]), "K_m": np.array([[2, 1], [1, 2.0]]), "K_f": np.eye(2)}
    text = caption(scenario, assemble(scenario).controller, model, CARTESIAN, 1.0, 9.0)
    for words in (
        "ur5-hybrid", "hybrid mode", "t = 1 to 9 s", "M_m = 10 I kg", "diag(632.5, 4) N·s/m", "[2 1; 1 2] N/m",
        "True arm: link scaling 1.15, payload mass 1.5 kg", "Declared: link scaling 0.15, payload mass 2 kg",
        "T = 1 ms", "K_e = 10000 N/m", "Force: constant, value 20 N", "F_1 = 10",
    ):  # fmt: skip
        assert words in text
    assert text.startswith("UR5 presses with 20 N, draws a circle (ur5-hybrid, edited): ")
    plain = caption(load("ur5-hybrid"), assemble(scenario).controller, model, CARTESIAN, 1.0, 9.0)
    assert plain.startswith("UR5 presses with 20 N, draws a circle (ur5-hybrid): ")
    moving = edited(scenario, "mode", "motion")
    assert caption(moving, assemble(scenario).controller, model, CARTESIAN, 1.0, 9.0).startswith(
        "Universal Robots UR5: motion, plane (ur5-hybrid, edited): "
    )
    joint = edited(moving, "task_space.kind", "joint")
    six = {name: 4.0 * np.eye(6) for name in model}
    assert "B_m = 4 I N·m·s/rad, K_m = 4 I N·m/rad, K_f" in caption(
        joint, assemble(scenario).controller, six, JOINT, 0.0, 1.0
    )
    turning = caption(moving, assemble(scenario).controller, six, CARTESIAN, 0.0, 1.0)
    assert "K_m = 4 I N/m, K_f = 4 I, angles in r times ℓ = 0.15 m." in turning
    twisted = caption(moving, assemble(scenario).controller, six, CARTESIAN, 0.0, 1.0, angles=[3, 4, 5])
    assert "angles in r times ℓ = 0.15 m (their K_m ℓ² = 0.09 I N·m/rad)." in twisted
    assert "True arm: as believed" in caption(Scenario(), assemble(Scenario()).controller, model, CARTESIAN, 0.0, 1.0)


def test_film_has_a_row_for_each_thirtieth_of_a_second(loop: ClosedLoop) -> None:
    shot = playback_frames(loop.system.scenario, loop.recording, 0.1, 0.9)
    assert len(shot) == round(0.8 * FRAMES_PER_SECOND) + 1
    np.testing.assert_allclose(np.diff(shot.signals["t"]), 1 / FRAMES_PER_SECOND, atol=1.01e-3)
    last = loop.recording.at(float(shot.signals["t"][-1]))
    np.testing.assert_array_equal(shot.signals["q"][-1], last["q"])


def test_film_shows_what_the_page_showed() -> None:
    loop = ClosedLoop.from_scenario(load("ur5-hybrid-moving"))
    for _ in range(700):
        loop.step()
    seen = snapshot_of(loop)
    loop.step()
    (frame,) = snapshots(playback_frames(loop.system.scenario, loop.recording, seen.t, seen.t))
    assert frame.t == seen.t
    assert np.linalg.norm(seen.force) > 1.0
    for name in ("q", "tool", "tool_desired", "force", "force_desired"):
        np.testing.assert_allclose(getattr(frame, name), getattr(seen, name), rtol=1e-9, atol=1e-12, err_msg=name)
    assert [each.form for each in frame.surfaces] == [each.form for each in seen.surfaces]


def messages_in(html: str) -> dict:
    """What viser's player reads from the page."""
    embedded = re.search(r'window.__VISER_EMBED_DATA__="([^"]*)"', html)
    assert embedded is not None
    packed = base64.b64decode(embedded[1])
    plain = zstandard.ZstdDecompressor().decompress(packed[8:], max_output_size=int.from_bytes(packed[:8], "little"))
    size = int.from_bytes(plain[:8], "little")
    return msgspec.msgpack.decode(plain[8 : 8 + size])


def test_playback_moves_arm_surface_and_force(loop: ClosedLoop) -> None:
    shot = playback_frames(loop.system.scenario, loop.recording)
    played = messages_in(made(PlaybackJob(shot, 25e6), lambda _: None).decode())
    assert played["durationSeconds"] == pytest.approx(shot.signals["t"][-1] + 1 / FRAMES_PER_SECOND)
    moved = {(m["name"], m["type"]) for t, m in played["messages"] if t > 0 and "name" in m}
    assert ("/surface", "SetPositionMessage") in moved
    assert any(name.startswith("/robot_1/") and kind == "SetOrientationMessage" for name, kind in moved)
    assert any(name == "/force/true" for name, _ in moved)
    heights = [(t, m["position"][2]) for t, m in played["messages"] if m.get("name") == "/surface" and "position" in m]
    surface = loop.system.surface.motion
    for t, height in heights[1:]:
        assert height == pytest.approx(surface.offset(t + shot.signals["t"][0])[2], abs=1e-3)


def test_playback_has_its_plots_beside_it(loop: ClosedLoop, snapshot: Snapshot) -> None:
    shot = playback_frames(loop.system.scenario, loop.recording, 0.2, 0.8)
    figure = figure_of(plots_of(["Overview", "Chattering"]), snapshot, Setup.of(snapshot, 0, 0), 0.2, 0.8)
    page = made(PlaybackJob(shot, 25e6, figure), lambda _: None).decode()
    aside = re.search(
        r'<aside id="vs-plots" data-begin="([\d.]+)" data-panels="([^"]*)">.*?(<svg.*?</svg>)', page, re.DOTALL
    )
    assert aside is not None
    assert float(aside[1]) == shot.signals["t"][0]
    panels = msgspec.json.decode(unescape(aside[2]))
    assert len(panels) == 5, "those over time: a spectrum has no instant"
    for panel in panels:
        assert 0.2 <= panel["first"] < 0.31, "a variation needs 0.1 s before its first value"
        assert panel["last"] == pytest.approx(0.8, abs=2e-3)
        assert 0 < panel["left"] < panel["right"] < 1
        assert 0 < panel["top"] < panel["bottom"] < 1
    assert "tracking error" in letters_of(aside[3].encode())
    assert page.count("</body>") == 1


def test_playback_over_its_limit_is_refused_with_what_fits(loop: ClosedLoop) -> None:
    shot = playback_frames(loop.system.scenario, loop.recording)
    many = {name: np.concatenate([values] * 12) for name, values in shot.signals.items()}
    many["t"] = np.arange(len(many["t"])) / FRAMES_PER_SECOND
    long = PlaybackFrames(shot.scenario, many)
    least = len(
        standalone_html(playback_frames(loop.system.scenario, loop.recording, 0.0, 0.0), np.inf, lambda _: None)
    )
    whole = len(standalone_html(long, np.inf, lambda _: None))
    with pytest.raises(TooLarge, match=r"which is about ([45678][.\d]*) s"):
        standalone_html(long, (least + whole) / 2, lambda _: None)
    with pytest.raises(TooLarge, match="the scene alone takes"):
        standalone_html(long, 1e5, lambda _: None)
    with pytest.raises(ValueError, match="nothing recorded"):
        standalone_html(replace(long, signals={k: v[:0] for k, v in many.items()}), 1e6, lambda _: None)


def test_file_names_are_tame() -> None:
    assert file_name("ur5-hybrid", 12.3456, "svg") == "vsmrc-ur5-hybrid-12.35s.svg"
    assert file_name("ur5-hybrid", 2.0, "svg", "normal force tau_1") == "vsmrc-ur5-hybrid-normal-force-tau_1-2.00s.svg"
    assert file_name("../../etc/<pass wd>\n", 0.0, "csv") == "vsmrc-etc-pass-wd-0.00s.csv"
    assert file_name("Ä", 0.0, "csv") == "vsmrc-run-0.00s.csv"
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
    return subprocess.run([sys.executable, "-m", "app", *arguments], capture_output=True, text=True, timeout=300)


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
