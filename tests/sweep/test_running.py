"""Runs of a sweep: the same metrics in whatever order, process and company they are computed."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import get_args

import msgspec
import numpy as np
import pytest

from app.cli.commands import execute
from app.process import worker_pool
from app.scenario.data import edited, shipped
from app.scenario.errors import ScenarioError
from app.session.headless_run import play, simulate
from app.simulation.promise.verdict import Outcome
from app.sweep import run_metrics, running
from app.sweep.axes import axis_of
from app.sweep.fingerprint import fingerprint
from app.sweep.plan import Sweep, SweepPlan
from app.sweep.run_metrics import COLUMNS, ENDED, METRIC_COLUMNS, RunMetrics, SweepRunner
from app.sweep.run_store import JOURNAL, RunStore, table_of
from app.sweep.running import SweepEstimate
from tests.support.pages import ROOT
from tests.tune.test_running import in_this_process

SHORT = edited(shipped()["planar3r-hybrid"], "simulation.duration", 0.3)
SWEEP = Sweep(
    SHORT,
    (axis_of("contact.K_e=1e3:1e4:2:log"), axis_of("controller.law=vsmrc,computed-torque")),
    draw=2,
    program=fingerprint(),
)

# 12 runs of 0.3 s
ASKED = ("sweep", "planar3r-hybrid", "--vary", "contact.K_e=1e3:1e5:3:log", "--vary", "controller.K_s=20:80:2",
         "--duration", "0.3", "--draw", "2", "--workers", "1")  # fmt: skip


def timeless(metrics: RunMetrics) -> RunMetrics:
    return {name: value for name, value in metrics.items() if name != "wall_time"}


def test_a_row_is_the_same_alone_and_after_any_others() -> None:
    forwards, backwards = SweepRunner(SWEEP), SweepRunner(SWEEP)
    first = [timeless(forwards.metrics(number)) for number in range(8)]
    assert [timeless(backwards.metrics(number)) for number in reversed(range(8))] == first[::-1]
    assert timeless(SweepRunner(SWEEP).metrics(5)) == first[5]
    asked = SweepPlan(SWEEP)
    _, metrics = simulate(asked.scenario(asked.row(5)), engine="compiled")
    for name, value in {
        "motion_error": metrics.motion_error_tail, "angle_error": metrics.angle_error_tail,
        "force_error": metrics.force_error_tail,
        "reaching_time_bound": metrics.reaching_time_bound, "band_time_bound": metrics.band_time_bound,
        "gain_margin": metrics.gain_condition_margin, "verdict": metrics.promise.verdict, "declared": 1.0,
        "torque_variation": sum(metrics.torque_total_variation), "simulated_time": pytest.approx(0.3),
    }.items():  # fmt: skip
        assert first[5][name] == value, name
    assert first[0]["motion_error"] != first[1]["motion_error"]  # another arm
    assert set(COLUMNS) <= {*first[0], "wall_time"}


def test_moments_of_a_flat_tool_have_a_column() -> None:
    short = edited(shipped()["panda-align"], "simulation.duration", 0.1)
    runner = SweepRunner(Sweep(short, (axis_of("controller.K_s=40:60:2"),), program=fingerprint()))
    _, metrics = simulate(edited(short, "controller.K_s", 40.0), engine="compiled")
    assert metrics.moment_error_tail
    assert runner.metrics(0)["moment_error"] == metrics.moment_error_tail


def test_the_columns_in_the_docs_are_those_of_the_table() -> None:
    table = "\n".join(
        f"| `{name}` | {column.unit or '—'} | {column.whole_meaning} |" for name, column in COLUMNS.items()
    )
    page = (ROOT / "docs" / "sweeps.md").read_text(encoding="utf-8")
    assert table in page
    renamed = {name: column.metric for name, column in COLUMNS.items() if column.metric not in ("", name)}
    assert all(f"\n| `{name}` | `{metric}`" in page for name, metric in renamed.items())
    assert all(outcome in COLUMNS["verdict"].meaning for outcome in get_args(Outcome))


def test_an_earlier_end_changes_nothing_before_it_and_goes_on_within_omega() -> None:
    short = msgspec.structs.replace(SWEEP, until=0.1)
    asked, row = SweepPlan(short), SweepRunner(short).metrics(5)
    assert asked.seconds_of(np.arange(asked.count)) == pytest.approx(0.1 * asked.count)
    loop, _ = simulate(asked.scenario(asked.row(5)), until=0.1, engine="compiled")
    assert row["simulated_time"] == pytest.approx(loop.t) == pytest.approx(0.1)
    full, _ = simulate(asked.scenario(asked.row(5)), engine="compiled")
    for name, values in loop.recording.signals(("q", "d", "tau")).items():
        np.testing.assert_array_equal(values, full.recording.signals((name,))[name][: len(values)])
    play(loop, round(0.15 / loop.system.scenario.controller.period))
    assert loop.t > 0.2
    assert loop.warning is None  # with a duration of 0.1 s the arm would have left Omega


def test_an_estimate_is_of_the_durations_that_are_varied(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = msgspec.structs.replace(SWEEP, vary=(axis_of("simulation.duration=0.1,0.2,0.9"),))

    def as_long_as_simulated(_: SweepRunner, number: int) -> RunMetrics:
        plan = SweepPlan(asked)
        return {"wall_time": plan.scenario(plan.row(number)).simulation.duration}

    monkeypatch.setattr(SweepRunner, "metrics", as_long_as_simulated)
    monkeypatch.setattr(worker_pool, "results", in_this_process)
    for left, length in ((range(6), 2.4), ((0, 1, 2), 0.4), ((3, 4, 5), 2.0), ((), 0.0)):  # also after an interruption
        estimate = running.estimated(asked, np.array(left, dtype=int), 1)
        assert estimate.simulated == pytest.approx(length)
        assert estimate.seconds == pytest.approx(running.BEGIN + length if left else 0.0)
        assert estimate.size == (running.FILES + len(left) * running.BYTES if left else 0.0)


def test_an_estimate_has_numbers_that_are_read_at_a_glance() -> None:
    words = "simulated time in all: about"
    assert str(SweepEstimate(1, 3.0, 2.0, 90.0)) == f"1 run of 3 s {words} 2 s, 0.09 kB"
    assert str(SweepEstimate(2_000_000, 6e6, 104.2, 1.8e8)) == f"2000000 runs of 69.4 days {words} 104 s, 180 MB"
    assert str(SweepEstimate(40_000, 2e9, 7e8, 3.6e6)) == f"40000 runs of 23,100 days {words} 8,100 days, 3.6 MB"


def ending(_: Sweep) -> Callable[[tuple[int, ...]], list[RunMetrics]]:
    return lambda _: os._exit(7)


UNKNOWN = "12 runs of 3.6 s simulated time in all, 17 kB; their computing time is not known, since a run"


@pytest.mark.slow
def test_a_run_that_ends_its_process_does_not_end_the_command_that_estimates(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(SweepRunner, "computing", staticmethod(ending))
    assert execute([*ASKED, "--dry-run"]) == 0
    assert UNKNOWN in capsys.readouterr().out


def test_a_sweep_whose_time_is_not_known_is_computed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fallen(_: object, __: object, tasks: Iterable[object], ___: int) -> Iterator[tuple[object, worker_pool.Fallen]]:
        return ((task, worker_pool.FALLEN) for task in tasks)

    monkeypatch.setattr(worker_pool, "results", fallen)
    assert execute([*ASKED, "--out", str(tmp_path / "out")]) == 1
    said = capsys.readouterr().out
    assert UNKNOWN in said
    assert "12 of 12 runs were ended by a fault (column stopped); the same command tries them again" in said
    assert set(table_of(tmp_path / "out")[1]["stopped"]) == {f"{ENDED}: the process that computed it has ended"}
    assert execute([*ASKED, "--out", str(tmp_path / "out"), "--dry-run"]) == 0
    assert "0 of 12 runs are there already" in capsys.readouterr().out


@pytest.mark.slow
def test_the_command_ends_runs_earlier_than_their_duration(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked = ["sweep", "planar3r-hybrid", "--vary", "controller.K_s=20:80:2", "--duration", "0.3", "--workers", "1"]
    out = tmp_path / "out"
    assert execute([*asked, "--until", "0.1", "--out", str(out)]) == 0
    assert "2 runs of 0.2 s simulated time" in capsys.readouterr().out
    sweep, columns = table_of(out)
    assert (sweep.until, sweep.scenario.simulation.duration) == (0.1, 0.3)
    assert columns["simulated_time"].tolist() == pytest.approx([0.1, 0.1])


def test_a_fault_of_the_program_in_one_run_is_a_row_and_one_of_the_machine_ends_the_sweep(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def failing(error: Exception) -> Callable[..., object]:
        def simulate(*_: object, **__: object) -> object:
            raise error

        return simulate

    monkeypatch.setattr(run_metrics, "simulate", failing(KeyError("d")))
    assert SweepRunner(SWEEP).metrics(3)["stopped"] == f"{ENDED}: internal error: KeyError: 'd'"
    monkeypatch.setattr(run_metrics, "simulate", failing(OSError(errno.ENOSPC, "No space left on device")))
    with pytest.raises(ScenarioError, match=r"run 3 cannot be computed here: .*No space left on device; others"):
        SweepRunner(SWEEP).metrics(3)


def test_what_is_refused_or_stops_is_a_row() -> None:
    refused, going = (
        SweepRunner(msgspec.structs.replace(SWEEP, vary=(axis_of("controller.layer=-1,0.01"),), draw=0)).metrics(k)
        for k in (0, 1)
    )
    assert refused["stopped"].startswith("refused: controller.layer: -1")
    assert "motion_error" not in refused
    assert going["stopped"] is None
    missing = msgspec.structs.replace(SWEEP, vary=(axis_of("robot.urdf=/nonsense.urdf"),), draw=1)
    assert "nonsense" in SweepRunner(missing).metrics(0)["stopped"]
    pressing = edited(shipped()["ur5-constrained"], "target_model.K_f", [1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    lost, kept = (SweepRunner(Sweep(pressing, (axis_of("target_model.K_f.1=0.2,1"),))).metrics(k) for k in (0, 1))
    assert "contact lost" in lost["stopped"]
    assert lost["simulated_time"] < kept["simulated_time"]
    assert kept["stopped"] is None


@pytest.mark.slow
def test_a_sweep_on_two_processes_that_is_stopped_and_goes_on_has_every_row_once(tmp_path: Path) -> None:
    whole, interrupted = tmp_path / "whole", tmp_path / "interrupted"
    with RunStore(whole, SWEEP) as store:
        assert running.run(store, SWEEP, 2) == 0
    size = sum(path.stat().st_size for path in whole.rglob("*") if path.is_file())
    assert SweepEstimate.of(8, 2.4, 1.0, 2).size == pytest.approx(size, rel=0.2)  # most of it is not of the runs
    text = [f"--vary={axis}" for axis in ("contact.K_e=1e3:1e4:2:log", "controller.law=vsmrc,computed-torque")]
    command = [sys.executable, "-m", "app", "sweep", "planar3r-hybrid", *text, "--draw", "2", "--duration", "0.3",
               "--workers", "1", "--out", str(interrupted)]  # fmt: skip
    with subprocess.Popen(command, start_new_session=True) as process:
        while not (interrupted / JOURNAL).exists() or not (interrupted / JOURNAL).read_bytes():
            if process.poll() is not None:  # it was over between two looks
                assert process.returncode == 0
                break
            time.sleep(0.001)
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    assert execute(command[3:]) == 0
    (_, one), (_, other) = table_of(whole), table_of(interrupted)
    assert one["row"].tolist() == other["row"].tolist() == list(range(8))
    for name in set(METRIC_COLUMNS) - {"wall_time"}:
        assert np.array_equal(np.array(one[name], dtype=float), np.array(other[name], dtype=float), equal_nan=True), (
            name
        )


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the 12 runs of `ASKED`."""
    folder = tmp_path_factory.mktemp("swept") / "sweep"
    assert execute([*ASKED, "--out", str(folder)]) == 0
    return folder


@pytest.mark.slow
def test_the_command_runs_draws_and_repeats_a_row(
    swept: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = str(swept)
    assert execute([*ASKED, "--dry-run"]) == 0
    assert "12 runs of 3.6 s simulated time" in capsys.readouterr().out
    assert execute([*ASKED, "--out", folder]) == 0
    output = capsys.readouterr().out
    assert "12 of 12 runs are there already" in output
    assert "0 runs" not in output
    png = tmp_path / "of.png"
    assert execute(["sweep", "plot", folder, "--out", str(png)]) == 0  # the name says which form
    assert png.read_bytes().startswith(b"\x89PNG")
    assert execute(["sweep", f"{folder}/sweep.toml", "--out", str(tmp_path / "again"), "--workers", "1"]) == 0
    _, columns = table_of(swept)
    _, again = table_of(tmp_path / "again")
    assert columns["residual"].tolist() == again["residual"].tolist()
    for kind, over in (("map", ()), ("slices", ("controller.K_s",)), ("parallel", ())):
        out = tmp_path / f"{kind}.svg"
        chosen = ["--over", *over] if over else []
        assert execute(["sweep", "plot", folder, "--of", "force_error", "--as", kind, *chosen, "--out", str(out)]) == 0
        assert out.read_bytes().startswith(b"<?xml")
    assert execute(["run", "--from", folder, "--row", "7", "--out", str(tmp_path / "row")]) == 0
    metrics = msgspec.json.decode((tmp_path / "row" / "metrics.json").read_bytes())
    assert metrics["target_model_residual_tail"] == columns["residual"][7]
    assert metrics["engine"] == "compiled"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (ASKED, "no folder for the runs"),
        ((*ASKED, "--out", "."), "--out: no folder of its own"),
        ((*ASKED, "--out", "FOLDER", "--seed", "3"), "holds another sweep (seed 0 there, 3 here)"),
        (("sweep", "plot", "FOLDER", "--to", "png", "--out", "FOLDER.svg"), "allowed: a name that ends in .png"),
        (("sweep", "plot", "FOLDER", "--of", "beauty"), "--of 'beauty'"),
        (("sweep", "plot", "FOLDER", "--show", "share"), "allowed: share with --within"),
        (("sweep", "plot", "FOLDER", "--over", "controller.layer"), "--over 'controller.layer'"),
        (("run", "--from", "FOLDER", "--out", "FOLDER"), "--from FOLDER --row N"),
        (("run", "--from", "FOLDER", "--row", "12", "--out", "FOLDER"), "row 12; allowed: 0 to 11"),
        (("run", "--out", "FOLDER"), "no scenario"),
        # also options that are typed with the value that they have without
        (
            ("run", "--from", "FOLDER", "--row", "7", "--engine", "pinocchio", "--out", "FOLDER"),
            "the same run again, as it",
        ),
        (("sweep", "FOLDER/sweep.toml", "--draw", "0", "--dry-run"), "is the whole question"),
        (("sweep", "FOLDER/sweep.toml", "--no-corners", "--dry-run"), "is the whole question"),
        (
            ("sweep", "planar3r-hybrid", "--vary", "contact.K_e=1e3:2e3:2", "--no-corners", "--dry-run"),
            "--no-corners: no arm is drawn; allowed: with --draw",
        ),
        (("sweep", "FOLDER/sweep.toml", "--engine", "compiled", "--dry-run"), "is the whole question"),
        (("sweep", "FOLDER/sweep.toml", "--until", "0.1", "--dry-run"), "is the whole question"),
        # and those that would have no effect
        ((*ASKED, "--set", "truth.payload_mass=1", "--dry-run"), "--set truth.payload_mass: it is drawn for each true"),
        (
            (*ASKED, "--set", "contact.K_e=1e4", "--dry-run"),
            "--set contact.K_e: it is varied, too; allowed: one of both",
        ),
        (
            (*ASKED, "--vary", "simulation.duration=1,2", "--dry-run"),
            "--duration 0.3: simulation.duration is varied, too",
        ),
        ((*ASKED, "--until", "0", "--dry-run"), "--until 0; allowed: more than 0 s, at most the duration of the runs"),
        ((*ASKED, "--until", "1", "--dry-run"), "until: 1 s; allowed: at most 0.3 s"),
        (("sweep", "ur5-hybrid", "--vary", "contact.K_e=1:nan:3", "--dry-run"), "allowed: finite numbers"),
        (("sweep", "ur5-hybrid", "--vary", "contact.K_e=1:2:1000000000", "--dry-run"), "allowed: 2 to 100000"),
        (("sweep", "ur5-hybrid", "--vary", "contact.K=1:2:3", "--dry-run"), "contact.K: no such field"),
        (
            ("tune", "planar3r-hybrid", "--move", "controller.K_s=5:90", "--for", "residual", "--out", "FOLDER"),
            "holds runs of something else (no tune.toml)",
        ),
    ],
)
def test_options_that_make_no_sense_are_refused_in_one_sentence(
    swept: Path, arguments: tuple[str, ...], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """FOLDER is that of a sweep which has run."""
    assert execute([argument.replace("FOLDER", str(swept)) for argument in arguments]) == 2
    output = capsys.readouterr().err
    assert sentence in output
    assert output.count("\n") == 1


def test_a_full_disk_is_one_sentence_and_what_is_there_stays(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def none_left(*_: object) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    folder = tmp_path / "sweep"
    with RunStore(folder, SWEEP) as store:
        store.add(SweepRunner(SWEEP).metrics(0))
    monkeypatch.setattr(RunStore, "add", none_left)
    monkeypatch.setattr(worker_pool, "results", in_this_process)
    assert execute(["sweep", str(folder / "sweep.toml"), "--out", str(folder), "--workers", "1"]) == 1
    assert capsys.readouterr().err.endswith("cannot be written: No space left on device; what is there stays\n")
    with RunStore(folder, SWEEP) as store:
        assert np.flatnonzero(store.done).tolist() == [0]
