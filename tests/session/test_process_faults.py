"""A full disk, and processes that end before their time: it is said, and nothing is left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from app.export.export_jobs import DataJob, ExportError, ExportJobs
from app.scenario.data import load
from app.simulation.recording import Recording
from app.storage.recording_files import table
from drivers.waiting import PATIENCE, until
from tests.support.commands import vsmrc
from tests.support.disks import largest_file
from tests.support.faults import Client

pytestmark = pytest.mark.slow  # processes of its own


def noise(rows: int) -> Recording:
    recording, random = Recording(6, history=rows), np.random.default_rng(1)
    for k in range(rows):
        row = recording.new_row().view(float)
        row[:] = random.standard_normal(recording.width)
        row[0] = 1e-3 * k
        recording.commit()
    return recording


@pytest.mark.parametrize("form", ["csv", "npz"])
def test_a_disk_that_is_full_while_exporting_is_said(form: str) -> None:
    job = DataJob(table(load("ur5-hybrid"), noise(6000)), form, np.inf)  # pyright: ignore[reportArgumentType]
    with largest_file(2_000_000), pytest.raises(ExportError, match="the file cannot be written: File too large"):
        ExportJobs().made(job, lambda _: None)


def test_a_disk_that_is_full_is_said_and_leaves_what_has_room_and_no_half_file(tmp_path: Path) -> None:
    with largest_file(300_000):
        done = vsmrc("run", "planar2r-semicircle", "--duration", "2", "--out", str(tmp_path))
    assert done.returncode == 1
    assert "boundary layer reached after" in done.stdout  # what was computed is not lost
    assert f"--out {tmp_path}: cannot be written: File too large" in done.stderr
    assert "Traceback" not in done.stderr
    assert sorted(each.name for each in tmp_path.iterdir()) == ["metrics.json", "scenario.toml"]


def test_a_process_that_makes_a_file_and_is_killed_is_said_and_leaves_nothing() -> None:
    export_jobs, killed = ExportJobs(), []

    def kill(_: float) -> None:
        if not killed:
            (process,) = export_jobs._working
            os.kill(process.pid, signal.SIGKILL)
            killed.append(process)

    with pytest.raises(ExportError, match=r"the process that makes it has ended \(exit status -9\)"):
        export_jobs.made(DataJob(table(load("ur5-hybrid"), noise(6000)), "csv", np.inf), kill)
    assert killed[0].returncode == -signal.SIGKILL
    assert not export_jobs._working
    with pytest.raises(ExportError, match="has ended"):  # and so at the end of the program
        export_jobs.made(DataJob(table(load("ur5-hybrid"), noise(6000)), "csv", np.inf), lambda _: export_jobs.close())
    with pytest.raises(ExportError, match="the program is ending"):
        export_jobs.made(DataJob(table(load("ur5-hybrid"), noise(10)), "csv", np.inf), lambda _: None)


@pytest.mark.parametrize("ending", ["os._exit(0)", "os.kill(os.getpid(), signal.SIGKILL)"])
def test_a_process_that_ends_while_a_file_is_made_leaves_nothing_on_the_disk(ending: str, tmp_path: Path) -> None:
    """As a session's process ends at once when its gateway has gone."""
    program = (
        "import os, signal, threading, time\n"
        "from app.export.export_jobs import ExportJobs, MadeJob\n"
        "jobs = ExportJobs()\n"
        "job = MadeJob(time.sleep, (1000.0,))\n"
        "threading.Thread(target=jobs.made, args=(job, print), daemon=True).start()\n"
        "while not jobs._working: time.sleep(0.01)\n"
        "(process,) = jobs._working\n"
        "print(process.pid, flush=True)\n"
        f"{ending}\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], env=os.environ | {"TMPDIR": str(tmp_path)}, capture_output=True, text=True,
        timeout=PATIENCE, check=False,
    )  # fmt: skip
    until(lambda: not Path(f"/proc/{int(done.stdout)}").exists(), done.stderr)
    assert list(tmp_path.iterdir()) == []


def children(process: int) -> list[int]:
    """Of this process, by number."""
    found = subprocess.run(["ps", "-o", "pid=", "--ppid", str(process)], capture_output=True, text=True, check=False)
    return [int(line) for line in found.stdout.split()]


def test_a_server_ended_in_the_middle_of_everything_leaves_nothing_behind(tmp_path: Path) -> None:
    """By SIGTERM; see `test_command` for Ctrl-C. A page that reads, one that does not, the process that previews."""
    log = tmp_path / "log"
    places = ("--port", "0", "--token", "never", "--state-dir", str(tmp_path / "state"), "--log-file", str(log))
    command = [sys.executable, "-m", "app", "serve", "ur5-hybrid", *places]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        until(lambda: log.exists() and "session opened" in log.read_text(), "no session")
        port = int(log.read_text().partition("url=http://127.0.0.1:")[2].split()[0])
        for reads in (True, False):
            Client(port, lambda: set(range(log.read_text().count("client connected"))), reads=reads)
        others = until(lambda: children(server.pid))  # the preview's begins as soon as somebody looks
        began = time.monotonic()
        server.send_signal(signal.SIGTERM)
        _, complaints = server.communicate(timeout=PATIENCE)
        print(f"ended within {time.monotonic() - began:.2f} s")
        assert (server.returncode, complaints) == (0, "")
        assert "session closed" in log.read_text()
        until(lambda: not any(Path(f"/proc/{process}").exists() for process in others))
    finally:
        server.kill()
        server.wait()
