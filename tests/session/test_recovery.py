"""The session on disk: whole whatever happens, offered to the next server, and of no harm when it is broken."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest

from app.scenario.data import edited, load
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.session.autosave import Autosave, StateFolder, default_folder
from app.session.changes import with_robot
from app.session.commands import Edit, Pause, Pin, Seek, ToEnd, Unpin
from app.session.runner import Runner
from app.session.timeline import Pinned, Timeline
from app.simulation.closed_loop import ClosedLoop
from app.storage.session_index import OFFER, SESSION, StateError
from drivers.waiting import until
from tests.support.disks import largest_file

pytestmark = pytest.mark.slow  # processes of its own

SCENARIO = load("planar2r-semicircle")


@pytest.fixture(scope="module")
def pinned() -> tuple[Pinned, ...]:
    line = Timeline(ClosedLoop.from_scenario(SCENARIO, 10_000))
    for _ in range(3):
        for _ in range(100):
            line.step()
        line.pin()
    return line.pinned


def changed(number: float = 0.02) -> Scenario:
    return edited(SCENARIO, "controller.layer", number)


def left(folder: Path) -> set[str]:
    return {file.name for file in folder.iterdir()} - {"lock"}


def test_what_was_saved_is_offered_to_the_next_server_bit_for_bit(tmp_path: Path, pinned: tuple[Pinned, ...]) -> None:
    first = StateFolder(tmp_path / "deep" / "state")
    assert first.offer() is None
    first.save(changed(), pinned[:2])
    first.save(changed(0.03), pinned[1:])
    written = left(first.path)
    pinned = (*pinned[:-1], replace(pinned[-1], name="stiff"))
    first.save(changed(0.03), pinned[1:])
    assert left(first.path) == written  # a name is no reason to write a run anew
    first.close()
    assert len(left(first.path)) == 3  # the index and a file for each pinned run, not for the one that was let go
    assert all(file.stat().st_mode & 0o077 == 0 for file in first.path.iterdir())

    second = StateFolder(first.path)
    offer = second.offer()
    assert offer is not None
    assert offer.scenario == changed(0.03)
    runs, problem = second.read_offer(offer)
    assert (problem, [run.number for run in runs]) == ("", [2, 3])
    assert [run.title for run in runs] == ["run 2", "stiff"]
    for run, known in zip(runs, pinned[1:], strict=True):
        np.testing.assert_array_equal(run.recording.rows(), known.recording.rows())
        assert (run.scenario, run.t, run.system.layout.n) == (known.scenario, known.t, 2)
    files = left(second.path)
    second.save(offer.scenario, runs)  # which writes no run anew
    second.close()
    assert left(second.path) == files - {OFFER} | {SESSION}


def test_an_offer_stays_until_the_loop_goes_on_with_it(tmp_path: Path, pinned: tuple[Pinned, ...]) -> None:
    """A change may be saved after the offer was read and before the loop has it; a server killed then loses nothing."""
    folder = StateFolder(tmp_path)
    folder.save(changed(0.03), pinned[1:])
    folder.close()
    folder = StateFolder(tmp_path)
    offer = folder.offer()
    assert offer is not None
    runs, _ = folder.read_offer(offer)
    files = left(folder.path)
    folder.save(changed(0.02), ())
    assert folder.offer() == offer
    assert left(folder.path) == files | {SESSION}
    folder.save(changed(0.02), runs)
    assert folder.offer() is None
    assert left(folder.path) == files - {OFFER} | {SESSION}  # no run was written again
    folder.close()


def test_an_offer_stays_until_it_is_answered(tmp_path: Path, pinned: tuple[Pinned, ...]) -> None:
    for answer in (None, StateFolder.refuse_offer):
        folder = StateFolder(tmp_path)
        if answer is None:
            folder.save(changed(), pinned[:1])
            folder.close()
            folder = StateFolder(tmp_path)
            assert folder.continues
            folder.close()  # a server that did nothing
            folder = StateFolder(tmp_path)
            assert not folder.continues  # what it has is of the server before that
        offer = folder.offer()
        assert offer is not None
        assert (offer.scenario, len(offer.runs)) == (changed(), 1)
        if answer is not None:
            answer(folder)
        folder.close()
    assert left(tmp_path) == set()


def test_a_folder_has_one_server_at_a_time(tmp_path: Path) -> None:
    first = StateFolder(tmp_path)
    with pytest.raises(StateError, match="another server uses it; allowed: a folder of its own"):
        StateFolder(tmp_path)
    first.save(changed(), ())
    first.close()
    StateFolder(tmp_path).close()
    (tmp_path / "file").touch()
    with pytest.raises(StateError, match="cannot be written: "):
        StateFolder(tmp_path / "file")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "no session of this program"),
        (b"\x00\xff" * 500, "no session of this program"),
        (b"[" * 100_000, "no session of this program"),
        (b'{"colour": "red"}', "no session of this program"),
        (b'{"format": "vsmrc-lab session", "version": 2, "anything": {}}', "written by a newer version"),
        (b'{"format": "vsmrc-lab session", "version": 1, "saved": "today"}', "no session of this program"),
        (
            b'{"format": "vsmrc-lab session", "version": 1, "saved": 1, "scenario": "mode = 3", "pinned": []}',
            "mode",
        ),
        (b" " * 5_000_000, "more than 4 MB"),
    ],
)
def test_a_file_that_is_no_session_is_set_aside_in_a_sentence(tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / SESSION).write_bytes(content)
    folder = StateFolder(tmp_path)
    assert folder.offer() is None
    assert message in folder.problem
    assert "\n" not in folder.problem
    assert (tmp_path / f"set-aside-{SESSION}").read_bytes() == content
    folder.save(changed(), ())
    folder.close()
    StateFolder(tmp_path).close()


@pytest.mark.parametrize("damage", ["newer", "cut off before its runs", "too large"])
def test_the_runs_of_an_index_that_is_set_aside_are_kept_with_it(
    tmp_path: Path, pinned: tuple[Pinned, ...], damage: str
) -> None:
    folder = StateFolder(tmp_path)
    folder.save(changed(), pinned[:2])
    folder.close()
    runs = left(tmp_path) - {SESSION}
    index = (tmp_path / SESSION).read_bytes()
    (tmp_path / SESSION).write_bytes(
        {
            "newer": index.replace(b'"version": 1', b'"version": 2'),
            "cut off before its runs": index[:60],
            "too large": index + b" " * 4_000_000,
        }[damage]
    )
    for _ in range(2):  # by the server that sets it aside, and by the next one, whose own run goes
        folder = StateFolder(tmp_path)
        os.utime(tmp_path / f"set-aside-{SESSION}", (time.time() - 1.0,) * 2)  # its time is that of its last write
        for run in runs:
            os.utime(tmp_path / run, (time.time() - 2.0,) * 2)
        folder.save(changed(), pinned[2:])
        folder.save(changed(0.03), ())
        assert left(tmp_path) - {OFFER} == runs | {SESSION, f"set-aside-{SESSION}"}
        (tmp_path / OFFER).unlink(missing_ok=True)
        folder.close()
    (tmp_path / f"set-aside-{SESSION}").unlink()
    folder = StateFolder(tmp_path)
    folder.refuse_offer()
    folder.close()
    assert left(tmp_path) == set()


def test_runs_that_cannot_be_read_are_said_and_the_rest_is_continued(
    tmp_path: Path, pinned: tuple[Pinned, ...]
) -> None:
    folder = StateFolder(tmp_path)
    folder.save(changed(), pinned)
    folder.close()
    index = json.loads((tmp_path / SESSION).read_text())
    content = bytearray((tmp_path / index["pinned"][0]["file"]).read_bytes())
    content[len(content) // 2 :] = b"\0" * 9
    (tmp_path / index["pinned"][0]["file"]).write_bytes(content)
    index["pinned"][1]["file"] = "../../etc/passwd"
    (tmp_path / SESSION).write_text(json.dumps(index))
    folder = StateFolder(tmp_path)
    offer = folder.offer()
    assert offer is not None
    runs, problem = folder.read_offer(offer)
    assert [run.number for run in runs] == [3]
    assert "run 1 cannot be shown again" in problem
    assert "run 2 cannot be shown again: '../../etc/passwd' is no name of a run's file" in problem
    folder.save(changed(0.03), runs)
    folder.close()
    assert (tmp_path / f"set-aside-{index['pinned'][0]['file']}").read_bytes() == content


def test_what_cannot_be_continued_now_is_kept_for_later(tmp_path: Path, pinned: tuple[Pinned, ...]) -> None:
    arm = tmp_path / "arm.urdf"
    arm.write_bytes((Path(__file__).parents[1] / "support" / "robots" / "bent3r.urdf").read_bytes())
    own = with_robot(load("ur5-motion"), {"urdf": str(arm)})
    folder = StateFolder(tmp_path / "state")
    folder.save(own, pinned[:1])
    folder.close()
    content = arm.read_bytes()
    arm.unlink()
    folder = StateFolder(tmp_path / "state")
    offer = folder.offer()
    assert offer is not None
    with pytest.raises(ScenarioError, match="cannot read"):
        folder.read_offer(offer)
    folder.save(changed(), ())  # the session that runs instead has changed
    arm.write_bytes(content)
    runs, problem = folder.read_offer(offer)
    assert ([run.number for run in runs], problem) == ([1], "")
    folder.close()


def test_changes_are_saved_as_they_come_and_at_the_end(tmp_path: Path) -> None:
    runner = Runner(SCENARIO)
    runner.start()
    message: list[str] = []
    autosave = Autosave(StateFolder(tmp_path), lambda: runner.snapshot, message.append)
    until(lambda: runner.snapshot.t > 1.0)
    assert left(tmp_path) == set()  # nothing has been changed
    runner.post(Edit("controller.layer", 0.02))
    until(lambda: left(tmp_path) == {SESSION})
    runner.post(Edit("controller.layer", 0.03))
    with largest_file(100_000):
        runner.post(Pin())
        until(lambda: message)
    assert message == [f"the session cannot be saved in {tmp_path}: File too large; the run goes on"]
    assert left(tmp_path) == {SESSION}
    assert "0.03" in (tmp_path / SESSION).read_text()  # what fits is saved
    runner.post(Unpin(1))
    runner.post(Seek(0.0))  # what is looked at is not the session
    until(lambda: runner.snapshot.looking_back and runner.snapshot.scenario == SCENARIO)
    assert runner.snapshot.latest.scenario == changed(0.03)
    runner.post(ToEnd())
    runner.post(Edit("controller.layer", 0.04))
    until(lambda: not runner.snapshot.pinned and runner.snapshot.scenario == changed(0.04))
    runner.close()
    autosave.close()
    folder = StateFolder(tmp_path)
    offer = folder.offer()
    assert offer is not None
    assert (offer.scenario, offer.runs) == (changed(0.04), ())
    folder.close()


def test_the_session_that_is_saved_is_not_what_is_looked_at(tmp_path: Path) -> None:
    runner = Runner(SCENARIO)
    runner.start()
    autosave = Autosave(StateFolder(tmp_path), lambda: runner.snapshot, print)
    until(lambda: runner.snapshot.t > 0.1)
    runner.post(Edit("controller.layer", 0.02))
    until(lambda: left(tmp_path) == {SESSION})
    runner.post(Seek(0.0))
    until(lambda: runner.snapshot.looking_back and runner.snapshot.scenario == SCENARIO)
    runner.close()
    autosave.close()
    folder = StateFolder(tmp_path)
    offer = folder.offer()
    folder.close()
    assert offer is not None
    assert offer.scenario == changed(0.02)


def test_what_could_not_be_saved_is_saved_at_the_end_when_there_is_room_again(tmp_path: Path) -> None:
    runner, message = Runner(SCENARIO), list[str]()
    runner.start()
    autosave = Autosave(StateFolder(tmp_path), lambda: runner.snapshot, message.append)
    runner.post(Pause())
    until(lambda: runner.snapshot.phase == "paused")  # a loop that is too slow would write to the log, a file here, too
    with largest_file(100):
        runner.post(Edit("controller.layer", 0.02))
        until(lambda: message)
    runner.close()
    autosave.close()
    folder = StateFolder(tmp_path)
    offer = folder.offer()
    assert offer is not None
    assert offer.scenario == changed(0.02)
    folder.close()


def test_what_cannot_be_saved_is_said_again_after_a_while(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Who opens the session later has not seen the first sentence."""
    runner, messages, tries = Runner(SCENARIO), list[str](), list[Scenario]()
    runner.start()
    folder = StateFolder(tmp_path)

    def full(scenario: Scenario, _: tuple[Pinned, ...]) -> NoReturn:
        tries.append(scenario)
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    autosave = Autosave(folder, lambda: runner.snapshot, messages.append)
    with monkeypatch.context() as patched:
        patched.setattr(folder, "save", full)
        for number, layer in enumerate((0.02, 0.03), start=1):
            runner.post(Edit("controller.layer", layer))
            until(lambda number=number: len(tries) == number)
        until(lambda: messages)
        patched.setattr("app.session.autosave.REMINDER", 0.0)
        runner.post(Edit("controller.layer", 0.04))
        until(lambda: len(messages) == 2)
    assert messages == 2 * [f"the session cannot be saved in {tmp_path}: No space left on device; the run goes on"]
    runner.close()
    autosave.close()


KILLED = """
import os, random, signal, sys, time
from pathlib import Path
from typing import NoReturn
from app.simulation.closed_loop import ClosedLoop
from app.storage.recording_files import read_npz
from app.session.autosave import StateFolder
from app.scenario.data import edited, load
from app.session.timeline import Timeline

scenario = load("planar2r-semicircle")
line = Timeline(ClosedLoop.from_scenario(scenario, 10_000))
for _ in range(100):
    line.step()
def scenarios():
    k = 0
    while True:
        k += 1
        yield edited(scenario, "controller.layer", 0.01 + 1e-5 * k)
random.seed(6)
offered = 0
for kill in range(18):
    saved, saves = os.pipe()
    child = os.fork()
    if child == 0:
        folder = StateFolder(Path(sys.argv[1]))
        for changed in scenarios():
            if line.pinned:
                line.unpin(line.pinned[-1].number)
            line.pin()
            folder.save(changed, line.pinned)
            os.write(saves, b".")
    os.close(saves)
    began = time.perf_counter()
    for _ in range(random.randint(0 if kill else 1, 3)):
        assert os.read(saved, 1)
        began, took = time.perf_counter(), time.perf_counter() - began
    time.sleep(random.uniform(0.0, took))  # in the next save, however fast the machine
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    os.close(saved)
    folder = StateFolder(Path(sys.argv[1]))
    assert folder.problem == "", folder.problem
    offer = folder.offer()
    if offer is not None:
        offered += 1
        assert len(offer.runs) >= 1
        for run in offer.runs:
            assert len(read_npz(Path(sys.argv[1]) / run.file)[1]) == 100
        known = {run.file for run in offer.runs} | {"offer.json", "lock"}
        assert {file.name for file in Path(sys.argv[1]).iterdir()} == known
    folder.close()
print(offered)
"""


def test_a_process_that_is_killed_at_any_instant_leaves_no_broken_file(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", KILLED, str(tmp_path)], capture_output=True, text=True, timeout=900, check=False
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) == 18  # something was saved before the first kill


def test_the_default_folder_is_the_users(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", "/somewhere")
    assert default_folder() == Path("/somewhere/vsmrc-lab")
