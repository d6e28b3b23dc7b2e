"""Computation beside the loop: its rows, its end, its place among those of others, and what is taken away of it."""

from __future__ import annotations

import io
import signal
import subprocess
import sys
import threading
import zipfile
from pathlib import Path
from types import SimpleNamespace

import msgspec
import pytest

from app.cli.commands import execute
from app.export.export_jobs import ExportError, ExportJobs, MadeJob
from app.process import slots
from app.scenario.data import edited, shipped
from app.scenario.errors import ScenarioError
from app.session.commands import Perform
from app.session.headless_run import simulate
from app.session.runner import Runner as Loop
from app.sweep import background
from app.sweep.axes import axis_of
from app.sweep.background import Background, BackgroundSweep
from app.sweep.background_jobs import Allowance, BackgroundJobs, allowance_of
from app.sweep.folder import packed, zipped
from app.sweep.plan import Sweep, SweepPlan
from app.sweep.run_metrics import SweepRunner
from app.sweep.run_store import table_of
from drivers.waiting import until
from tests.support.disks import largest_file
from tests.sweep.test_running import timeless

SHORT = edited(shipped()["planar3r-hybrid"], "simulation.duration", 0.2)
SWEEP = Sweep(SHORT, (axis_of("contact.K_e=1e3:1e4:3:log"),), draw=2, engine="pinocchio")

pytestmark = pytest.mark.slow  # processes of their own


def test_rows_of_the_background_are_those_of_a_run_and_of_the_loop_to_the_last_bit() -> None:
    sweep = BackgroundSweep(SWEEP, 1)
    until(lambda: not sweep.going, lambda: sweep.problem)
    assert sweep.complete
    alone, found = SweepRunner(SWEEP), {row["row"]: timeless(row) for row in sweep.rows}
    assert found == {number: timeless(alone.metrics(number)) for number in range(6)}

    asked = SweepPlan(SWEEP)
    loop = Loop(shipped()["planar2r-semicircle"])  # it has another scenario before
    loop.start()
    try:
        loop.post(Perform(asked.scenario(asked.row(3)), (), SHORT.simulation.duration))
        until(lambda: loop.snapshot.phase == "paused" and loop.snapshot.t > 0.1)
        ours = loop.snapshot.recording
    finally:
        loop.close()
    theirs, _ = simulate(asked.scenario(asked.row(3)))
    for name, values in theirs.recording.signals(("q", "s", "F", "tau_applied")).items():
        assert (ours.signals((name,))[name] == values).all(), name


@pytest.mark.parametrize("ended", ["killed", "cancelled"])
def test_a_session_that_is_killed_or_cancels_takes_its_computation_with_it(ended: str) -> None:
    long = msgspec.structs.replace(SWEEP, scenario=edited(SHORT, "simulation.duration", 1e4))
    text = msgspec.json.encode(msgspec.to_builtins(long))
    code = (
        "import sys, time, msgspec\n"
        "from app.sweep import background\n"
        "from app.sweep.background import BackgroundSweep\n"
        "from app.sweep.plan import Sweep\n"
        "background.LINGER = 1e4\n"  # it is ended, and not waited for
        f"sweep = BackgroundSweep(msgspec.convert(msgspec.json.decode({text!r}), Sweep), 1)\n"
        "sys.stdin.readline()\n"
        "sweep.cancel()\n"
        "time.sleep(1000)\n"
    )
    command = [sys.executable, "-c", code]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as session:

        def all_of() -> list[int]:
            found, new = [session.pid], [session.pid]
            while new:
                new = [child for pid in new for child in _children(pid)]
                found += new
            return found

        processes = until(lambda: found if any(map(_computes, found := all_of())) else None)
        assert session.stdin is not None
        assert session.stderr is not None
        if ended == "cancelled":
            session.stdin.write("\n")
            session.stdin.flush()
            until(lambda: not any(_alive(pid) for pid in processes[1:]), lambda: processes)
            assert _alive(session.pid)
        session.send_signal(signal.SIGKILL)
        told = session.stderr.read()
    until(lambda: not any(_alive(pid) for pid in processes), lambda: processes)
    assert told == ""  # also by Python's own processes


def _computes(pid: int) -> bool:
    """Whether a process is one of a pool."""
    try:
        return b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return False


def _children(pid: int) -> list[int]:
    try:
        return [int(c) for task in Path(f"/proc/{pid}/task").iterdir() for c in (task / "children").read_text().split()]
    except OSError:
        return []


def _alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_a_shared_machine_has_one_question_of_each_session_and_so_many_of_all() -> None:
    ours, theirs = BackgroundJobs(Allowance(1, at_once=1, runs=6)), BackgroundJobs(Allowance(1, at_once=1, runs=6))
    with pytest.raises(ScenarioError, match="7 runs; allowed: at most 6, since this server is shared"):
        ours.begin(lambda _: pytest.fail("begun"), 7)
    held, release = threading.Event(), threading.Event()

    def hold() -> None:
        with slots.held(1, lambda: None):
            held.set()
            release.wait()

    holder = threading.Thread(target=hold)
    holder.start()
    held.wait()
    first = ours.begin(lambda a: BackgroundSweep(SWEEP, a.workers, a.at_once), 6)
    until(lambda: first.waiting)
    with pytest.raises(ScenarioError, match="map: one is going on; allowed: after its end"):
        ours.begin(lambda a: Background(SWEEP, a.workers, a.at_once), 6)
    second = theirs.begin(lambda a: BackgroundSweep(SWEEP, a.workers, a.at_once), 6)
    until(lambda: second.waiting)
    theirs.close()
    until(lambda: not second.going)
    assert not second.rows
    assert not second.waiting
    release.set()
    holder.join()
    until(lambda: first.complete, lambda: first.problem)
    assert len(first.rows) == 6
    assert "since this server is shared" in str(allowance_of(shared=True))
    assert "shared" not in str(allowance_of(shared=False))


def test_a_map_that_is_taken_away_is_the_folder_of_a_sweep(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [SweepRunner(SWEEP).metrics(number) for number in (4, 1)]
    with zipfile.ZipFile(io.BytesIO(zipped(SWEEP, rows))) as file:
        file.extractall(tmp_path)
    (folder,) = tmp_path.iterdir()
    _, columns = table_of(folder)
    assert columns["row"].tolist() == [1, 4]
    assert execute(["sweep", str(folder / "sweep.toml"), "--out", str(folder), "--workers", "1"]) == 0
    assert "2 of 6 runs are there already" in capsys.readouterr().out
    assert execute(["run", "--from", str(folder), "--row", "4", "--out", str(tmp_path / "row")]) == 0
    metrics = msgspec.json.decode((tmp_path / "row" / "metrics.json").read_bytes())
    assert metrics["force_error_tail"] == rows[0]["force_error"]
    assert execute(["sweep", "plot", str(folder), "--of", "force_error"]) == 0


def test_a_name_leads_nowhere_out_of_the_file() -> None:
    with zipfile.ZipFile(io.BytesIO(packed("../../evil-sweep", lambda folder: (folder / "a").touch()))) as file:
        assert file.namelist() == ["evil-sweep/a"]


@pytest.mark.parametrize("most", [100, 600])
def test_a_disk_that_is_full_while_a_sweep_is_packed_is_said_and_nothing_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, most: int
) -> None:
    """A file may not grow beyond so many bytes, in the process that packs: its first one, or a later one."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    rows = [SweepRunner(SWEEP).metrics(number) for number in (1, 4)]
    job, jobs = MadeJob(zipped, (SWEEP, rows)), ExportJobs()
    with largest_file(most), pytest.raises(ExportError, match="File too large"):
        jobs.made(job, lambda _: None)
    assert zipfile.is_zipfile(io.BytesIO(jobs.made(job, lambda _: None)))
    assert list(tmp_path.iterdir()) == []


def test_a_process_that_falls_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    ends_at_once = SimpleNamespace(start=lambda *_, **__: subprocess.Popen(["false"]))
    monkeypatch.setattr(background, "launcher", ends_at_once)
    sweep = BackgroundSweep(SWEEP, 1)
    until(lambda: not sweep.going)
    assert sweep.problem == "the map could not be computed: its process has ended"


def test_a_process_that_cannot_go_on_says_why() -> None:
    sweep = BackgroundSweep(SWEEP, 0)  # no pool has so few workers
    until(lambda: not sweep.going)
    assert sweep.problem.startswith("the map could not be computed: internal error: ")
    assert "\n" not in sweep.problem
    assert not sweep.complete
