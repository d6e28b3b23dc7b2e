"""Faults, one at a time: the reason is said, what is recorded stays, Reset works, nothing is left behind."""

from __future__ import annotations

import contextlib
import itertools
import os
import resource
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from app.closed_loop import ClosedLoop
from app.dashboard import Dashboard, playback
from app.dashboard.laggards import Laggards
from app.data_files import table
from app.recording import Recording
from app.runner import Blend, Edit, Load, Play, Reset, Runner, Seek, Snapshot
from app.scenario import Scenario, edited, load
from app.takeaway import DataJob, Maker, TakeAwayError
from tests.drawn import drawn
from tests.viser_protocol import CAMERA, PROTOCOL

PATIENCE = 60.0  # s, for a machine that has other things to do


def until(condition: Callable[[], Any], what: object = "") -> Any:
    """What the condition gives, as soon as that is something."""
    deadline = time.monotonic() + PATIENCE
    while not (met := condition()):
        assert time.monotonic() < deadline, what() if callable(what) else what
        time.sleep(0.01)
    return met


@pytest.fixture(scope="module")
def runner() -> Iterator[Runner]:
    runner = Runner(load("ur5-hybrid"))
    runner.start()
    yield runner
    runner.close()


def begun(runner: Runner, scenario: Scenario) -> Snapshot:
    """A run of this scenario from its start, which has come to 0.1 s."""
    before = runner.snapshot.run
    for command in (Load(scenario), Reset(), Play()):
        runner.post(command)
    until(lambda: runner.snapshot.run > before and runner.snapshot.scenario == scenario)
    return until(lambda: runner.snapshot.t > 0.1 and runner.snapshot, lambda: runner.snapshot.reason)


def ended(runner: Runner) -> Snapshot:
    return until(lambda: runner.snapshot.phase == "stopped" and runner.snapshot, "it has not stopped")


def assert_kept_and_reset_works(runner: Runner, stopped: Snapshot) -> None:
    rows = stopped.recording.rows()
    assert len(rows) > 100
    assert rows[-1, 0] == pytest.approx(stopped.end, abs=2e-3)
    assert np.isfinite(stopped.q).all()  # the page has a picture to show
    assert np.isfinite(stopped.tool).all()
    runner.post(Seek(0.05))
    until(lambda: runner.snapshot.looking_back)
    for command in (Reset(), Play()):
        runner.post(command)
    until(lambda: runner.snapshot.phase == "running" and runner.snapshot.t < stopped.t)
    until(lambda: runner.snapshot.t > 0.05)


def boom(*_: object) -> None:
    raise KeyError("boom")


def warp(*_: object) -> None:
    raise ValueError("warp")


@pytest.mark.parametrize(
    ("part", "stage"),
    [
        ("_push_tool", "the measurement"),
        ("_control_period", "the control law"),
        ("_complete_row", "the record"),
        ("view", "the view of the loop"),
    ],
)
def test_an_exception_in_any_stage_ends_the_run_and_not_its_thread(runner: Runner, part: str, stage: str) -> None:
    begun(runner, load("ur5-hybrid"))
    loop = runner._line.loop
    setattr(loop, part, boom)
    stopped = ended(runner)
    assert stopped.reason == f"t = {stopped.end:.3f} s: {stage} failed (KeyError: 'boom')"
    if part in vars(loop):
        delattr(loop, part)
    assert_kept_and_reset_works(runner, stopped)


def test_a_plant_that_fails_ends_the_run(runner: Runner, monkeypatch: pytest.MonkeyPatch) -> None:
    begun(runner, load("ur5-hybrid"))
    with monkeypatch.context() as patched:
        patched.setattr(type(runner._line.loop.system.plant), "advance", boom)
        stopped = ended(runner)
    assert "the plant failed (KeyError: 'boom')" in stopped.reason
    assert_kept_and_reset_works(runner, stopped)


def test_the_loop_itself_failing_ends_the_run_and_not_its_thread(
    runner: Runner, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun(runner, load("ur5-hybrid"))
    with monkeypatch.context() as patched:
        patched.setattr(runner, "_advance", boom)
        stopped = ended(runner)
    assert "the loop failed (KeyError: 'boom')" in stopped.reason
    assert_kept_and_reset_works(runner, stopped)


def test_a_law_that_gives_no_number_ends_the_run(runner: Runner) -> None:
    begun(runner, load("ur5-hybrid"))
    loop = runner._line.loop
    law = loop._control_period

    def failing(*arguments: object) -> None:
        law(*arguments)
        loop._period.views.output.tau[:] = loop._period.views.applied[:] = np.nan

    loop._control_period = failing
    stopped = ended(runner)
    assert "the control law asks for a torque that is no finite number: [nan, nan" in stopped.reason
    assert_kept_and_reset_works(runner, stopped)


BILATERAL = edited(load("ur5-constrained"), "contact.unilateral", False)
YIELDING = edited(edited(load("ur5-impedance"), "target_model.K_m", [1.0] * 6), "simulation.leaving_domain", "stop")


@pytest.mark.parametrize(
    ("base", "path", "value", "said"),
    [
        (BILATERAL, "target_model.M_m", [1.0] + [12.0] * 5, "the arm diverges"),
        (load("ur5-constrained"), "force.value", -5.0, "contact lost, the surface would have to pull"),
        (edited(YIELDING, "truth.push_duration", 60.0), "truth.push", [0.0, 0.0, 100.0], "J_q is nearly singular"),
    ],
)
def test_what_nature_ends_ends_in_a_sentence(
    runner: Runner, base: Scenario, path: str, value: object, said: str
) -> None:
    begun(runner, base)
    runner.post(Edit(path, value))
    stopped = ended(runner)
    assert said in stopped.reason
    assert len(stopped.recording) > 100
    runner.post(Load(base))
    until(lambda: runner.snapshot.scenario == base and runner.snapshot.phase == "running")


def test_a_command_that_fails_unexpectedly_is_refused_and_the_run_goes_on(runner: Runner) -> None:
    before = begun(runner, load("ur5-hybrid"))
    runner.post(Blend(5, 1.0))  # pyright: ignore[reportArgumentType]
    refused = until(lambda: runner.snapshot.refusal_number > before.refusal_number and runner.snapshot)
    assert refused.refusal == "Blend failed (TypeError: 'int' object is not iterable)"
    until(lambda: runner.snapshot.t > refused.t + 0.1)


def test_an_edit_that_fails_half_way_leaves_the_loop_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    loop, twin = ClosedLoop(load("ur5-hybrid"), 1000), ClosedLoop(load("ur5-hybrid"), 1000)
    for _ in range(5):
        loop.step()
        twin.step()
    with monkeypatch.context() as patched:
        patched.setattr(loop, "_contact_loop_warning", boom)
        with pytest.raises(KeyError):
            loop.edit(edited(load("ur5-hybrid"), "force.value", 30.0))
    vars(loop).pop("_contact_loop_warning", None)
    for _ in range(50):
        loop.step()
        twin.step()
    assert np.array_equal(loop.recording.rows(), twin.recording.rows())
    assert len(loop.recording.epochs) == len(twin.recording.epochs)


# --- the page -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Server:
    dashboard: Dashboard
    runner: Runner

    def open(self, *, reads: bool = True) -> Client:
        return Client(self.dashboard.port, lambda: set(self.dashboard.clients), reads=reads)

    def said(self) -> str:
        """What the status line shows."""
        return self.dashboard._view._status.content if self.dashboard._view is not None else ""


@pytest.fixture(scope="module")
def server(runner: Runner) -> Iterator[Server]:
    with drawn(Dashboard(runner, port=0, fps=10.0)) as dashboard:
        yield Server(dashboard, runner)


class Client:
    """A page without a browser: it says what it is told to, and reads or does not."""

    def __init__(self, port: int, numbers: Callable[[], set[int]], *, reads: bool = True) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port))
        if not reads:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        known = numbers()
        self._connection: ClientConnection = connect(
            f"ws://127.0.0.1:{port}",
            sock=self._socket,
            subprotocols=[PROTOCOL],
            max_queue=1,
            max_size=None,
            ping_interval=None,
        )
        self.send(CAMERA)
        (self.number,) = until(lambda: numbers() - known)
        if reads:
            threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        with contextlib.suppress(ConnectionClosed):
            for _ in self._connection:
                pass

    def send(self, message: dict[str, Any]) -> None:
        self._connection.send(msgspec.msgpack.encode(message))

    def vanish(self) -> None:
        """Without a farewell."""
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
        self._socket.shutdown(socket.SHUT_RDWR)


def drag(phase: str, to: np.ndarray, modifier: str | None = None) -> dict[str, Any]:
    point = [float(x) for x in to]
    return {
        "type": "SceneNodeDragMessage", "phase": phase, "name": "/hand/handle", "instance_index": None,
        "start_position": point, "start_screen_pos": [0.5, 0.5], "end_position": point, "end_screen_pos": [0.5, 0.5],
        "button": "left", "modifier": modifier, "owner": "",
    }  # fmt: skip


def test_a_page_that_vanishes_lets_go_of_the_tool_and_leaves_the_target(server: Server) -> None:
    before = begun(server.runner, load("ur5-impedance"))
    page = server.open()
    page.send(drag("start", before.tool))
    page.send(drag("update", before.tool + np.array([0.0, 0.05, 0.0])))
    until(lambda: server.runner.snapshot.state.grip is not None)
    page.vanish()
    until(lambda: server.runner.snapshot.state.grip is None)
    page = server.open()
    hand = server.dashboard._view._hand  # pyright: ignore[reportOptionalMemberAccess]
    page.send(drag("start", before.tool, "shift"))
    page.send(drag("update", before.tool + np.array([0.0, 0.05, 0.0]), "shift"))
    until(lambda: hand._held is not None and hand._held.moved.any())
    page.vanish()
    until(lambda: hand._held is None and not server.dashboard.clients)
    server.runner.post(Edit("force.value", 21.0))  # whatever the page posted comes before it
    until(lambda: server.runner.snapshot.scenario.force.value == 21.0)  # pyright: ignore[reportAttributeAccessIssue]
    assert server.runner.snapshot.scenario.shift == before.scenario.shift


def test_a_page_that_vanishes_with_a_slider_held_ends_the_preview(server: Server) -> None:
    before = begun(server.runner, load("ur5-hybrid"))
    view = server.dashboard._view
    assert view is not None
    handles = view._server.gui._gui_input_handle_from_uuid
    label = next(h for h in handles.values() if getattr(h, "label", "") == "F_d [N]")
    slider = list(handles.values())[list(handles.values()).index(label) + 1]
    page, other = server.open(), server.open()
    positions = itertools.cycle((0.7, 0.6))

    def held() -> bool:  # a page that is not drawn yet knows of no run, and holds nothing
        if view._whatif.held is None:
            page.send({"type": "GuiUpdateMessage", "uuid": slider._impl.uuid, "updates": {"value": next(positions)}})
        return view._whatif.held is not None and view._whatif.outlook is not None

    until(held, lambda: (view._whatif.held, view._whatif.refusal))
    page.vanish()
    until(lambda: view._whatif.held is None and view._whatif.outlook is None)
    until(lambda: view._previewer.idle)
    assert server.runner.snapshot.scenario == before.scenario
    other.vanish()


def test_a_client_that_does_not_read_is_dropped_and_bounded_meanwhile(server: Server) -> None:
    begun(server.runner, load("ur5-hybrid"))
    reading, stuck = server.open(), server.open(reads=False)
    websock = server.dashboard._server._websock_server
    laggards = Laggards(server.dashboard._server, patience=2.0)
    # something big enough to fill every buffer on the way
    server.dashboard.clients[stuck.number].send_file_download("file", bytes(20_000_000))
    until(lambda: laggards._sizes().get(stuck.number, 0) > 20_000)
    kept = len(websock._broadcast_buffer.message_from_id)
    counter = websock._broadcast_buffer.message_counter
    until(lambda: websock._broadcast_buffer.message_counter > counter + 200)
    assert len(websock._broadcast_buffer.message_from_id) < kept + 50  # of each kind the newest
    until(lambda: laggards.drop() or stuck.number not in server.dashboard.clients)
    assert reading.number in server.dashboard.clients
    reading.vanish()


def test_a_page_that_cannot_be_drawn_says_so_and_the_run_goes_on(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = begun(server.runner, load("ur5-hybrid"))
    view, client = server.dashboard._view, server.open()
    assert view is not None
    with monkeypatch.context() as patched:
        patched.setattr(view._plots, "show", boom)
        until(lambda: "the page could not be drawn (KeyError: &#x27;boom&#x27;); the run goes on" in server.said())
    until(lambda: view._drawn is not None and view._drawn.t > before.t + 1.0)
    client.vanish()


def test_drawing_that_hangs_for_seconds_costs_the_run_nothing(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    before = begun(server.runner, load("ur5-hybrid"))
    view, client = server.dashboard._view, server.open()
    assert view is not None
    hangs, goes_on = threading.Event(), threading.Event()

    def hanging(*_: object) -> None:
        hangs.set()
        goes_on.wait()

    with monkeypatch.context() as patched:
        patched.setattr(view._playback, "show", hanging)
        assert hangs.wait(PATIENCE)
        now = until(lambda: server.runner.snapshot.t > before.t + 3.0 and server.runner.snapshot)
        t = now.recording.signals(("t",))["t"]
        assert np.allclose(np.diff(t), now.scenario.controller.period)  # no control step is missing
        goes_on.set()
    until(lambda: view._drawn is not None and view._drawn.t > now.t)
    client.vanish()


def test_a_callback_that_fails_is_said_on_the_page(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    before = begun(server.runner, load("ur5-hybrid"))
    view, client = server.dashboard._view, server.open()
    assert view is not None
    with monkeypatch.context() as patched:
        patched.setattr(view._hand, "_drag", boom)  # which viser calls one after the other
        client.send(drag("start", before.tool))
        until(lambda: "could not carry that out (KeyError: &#x27;boom&#x27;)" in server.said(), server.said)
    handles = view._server.gui._gui_input_handle_from_uuid
    speed = next(h for h in handles.values() if getattr(h, "label", "") == "Speed")
    choice = {"type": "GuiUpdateMessage", "uuid": speed._impl.uuid, "updates": {"value": "2×"}}
    with monkeypatch.context() as patched:
        patched.setattr(playback, "SetSpeed", warp)
        client.send(choice)  # as a task
        until(lambda: "could not carry that out (ValueError: warp)" in server.said(), server.said)
    client._connection.send(b"\x93garbage")
    client.send(choice)
    until(lambda: server.runner.snapshot.speed == 2.0)
    until(lambda: server.runner.snapshot.t > before.t + 0.1)


# --- the disk, and processes ---------------------------------------------------------------------------------------


@contextmanager
def largest_file(size: int) -> Iterator[None]:
    """A disk on which no file gets larger than this (bytes), for the processes begun meanwhile as well."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def noise(rows: int) -> Recording:
    recording, random = Recording(6, history=rows), np.random.default_rng(1)
    for k in range(rows):
        row = recording.new_row()
        row[:] = random.standard_normal(recording.width)
        row[0] = 1e-3 * k
        recording.commit()
    return recording


@pytest.mark.parametrize("form", ["csv", "npz"])
def test_a_disk_that_is_full_while_exporting_is_said(form: str) -> None:
    job = DataJob(table(load("ur5-hybrid"), noise(6000)), form, np.inf)  # pyright: ignore[reportArgumentType]
    with largest_file(2_000_000), pytest.raises(TakeAwayError, match="the file cannot be written: File too large"):
        Maker().made(job, lambda _: None)


def vsmrc(*arguments: str, preexec: Callable[[], None] | None = None) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "app", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, preexec_fn=preexec, check=False)


def test_a_disk_that_is_full_leaves_no_half_file(tmp_path: Path) -> None:
    def small() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000))

    done = vsmrc("run", "planar2r-semicircle", "--duration", "2", "--out", str(tmp_path), preexec=small)
    assert (done.returncode, done.stdout) == (2, "")
    assert f"--out {tmp_path}: cannot be written: File too large" in done.stderr
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_process_that_makes_a_file_and_is_killed_is_said_and_leaves_nothing() -> None:
    maker, killed = Maker(), []

    def kill(_: float) -> None:
        if not killed:
            (process,) = maker._working
            os.kill(process.pid, signal.SIGKILL)
            killed.append(process)

    with pytest.raises(TakeAwayError, match=r"the process that makes it has ended \(exit status -9\)"):
        maker.made(DataJob(table(load("ur5-hybrid"), noise(6000)), "csv", np.inf), kill)
    assert killed[0].returncode == -signal.SIGKILL
    assert not maker._working
    with pytest.raises(TakeAwayError, match="has ended"):  # and so at the end of the program
        maker.made(DataJob(table(load("ur5-hybrid"), noise(6000)), "csv", np.inf), lambda _: maker.close())
    with pytest.raises(TakeAwayError, match="the program is ending"):
        maker.made(DataJob(table(load("ur5-hybrid"), noise(10)), "csv", np.inf), lambda _: None)


def children(process: int) -> list[int]:
    """Of this process, by number."""
    found = subprocess.run(["ps", "-o", "pid=", "--ppid", str(process)], capture_output=True, text=True, check=False)
    return [int(line) for line in found.stdout.split()]


def test_a_server_ended_in_the_middle_of_everything_leaves_nothing_behind(tmp_path: Path) -> None:
    """By SIGTERM; see `test_command` for Ctrl-C. A page that reads, one that does not, the process that previews."""
    log = tmp_path / "log"
    places = ("--port", "0", "--state-dir", str(tmp_path / "state"), "--log-file", str(log))
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
