"""Process of one session: `python -m app.workers.session FD`, started by `app.gateway`.

It serves a dashboard at a loopback port, to its gateway only, and tells the gateway of every change of the scenario. It
ends when the gateway's end of the connection closes, for whatever reason.
"""

from __future__ import annotations

import contextlib
import io
import os
import resource
import socket
import sys
import threading
import time
from collections.abc import Callable
from io import BufferedReader
from pathlib import Path
from typing import cast

import structlog

from app.access.session_messages import (
    Alive,
    Answers,
    Asks,
    Begin,
    Changed,
    Failed,
    FromSession,
    Keep,
    KeptFolder,
    Prepare,
    Ready,
    Remark,
    ToSession,
    line,
    to_session,
)
from app.dashboard.page import Dashboard
from app.dashboard.theme.colors import Theme
from app.dashboard.widgets.page.last_session import left_by, remark
from app.process import log
from app.scenario.data import OPENING, from_toml, load, to_toml
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.session.autosave import Autosave, StateFolder
from app.session.commands import Continue
from app.session.preview_client import Previewer
from app.session.runner import Runner
from app.session.timeline import Pinned
from app.storage import uploaded_urdfs
from app.storage.session_index import StateError
from app.storage.uploaded_urdfs import FileAccess
from app.sweep.background_jobs import allowance_of

events = structlog.get_logger()

MEMORY, FILES = 4_000_000_000, 512  # bytes of data, open files: a fresh session has 0.3 GB, its 64 pages one file each
BEAT = 1.0  # s between two signs of life
IN_USE = 600.0  # s between two notes that an upload is in use
LOOK = 0.05  # s between two looks whether the scenario has changed; a visitor's copy may be older by that much


class GatewayConnection:
    """This process's end of the connection to the gateway."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self._lines: BufferedReader = connection.makefile("rb")
        self._sending = threading.Lock()

    def next(self) -> ToSession:
        """Next message from the gateway. Raises EOFError when the gateway has gone."""
        if not (text := self._lines.readline()):
            raise EOFError
        return to_session.decode(text)

    def send(self, message: FromSession) -> None:
        """Send a message, from any thread. Raises ConnectionError when the gateway has gone."""
        with self._sending:
            self._connection.sendall(line(message))


class Pulse:
    """Heartbeat: tells the gateway that this process lives and its pages are answered, until `stop`."""

    def __init__(self, gateway: GatewayConnection, dashboard: Dashboard, late: Callable[[], float | None]) -> None:
        self._gateway, self._dashboard, self._late = gateway, dashboard, late
        self._stopped = threading.Event()
        threading.Thread(target=self._run, name="pulse", daemon=True).start()

    def stop(self) -> None:
        self._stopped.set()

    def _run(self) -> None:
        with contextlib.suppress(OSError):
            while not self._stopped.is_set():
                self._dashboard.come_round()
                self._gateway.send(Alive(self._late()))
                self._stopped.wait(BEAT)


def serve(gateway: GatewayConnection, previewer: Previewer) -> None:
    """Serve one session, from the preparation to the end of the connection. Raises EOFError or ConnectionError then."""
    prepare = gateway.next()
    assert isinstance(prepare, Prepare)
    scenario, unfit = _runnable(prepare.scenario, load(OPENING))
    with contextlib.redirect_stdout(io.StringIO()):  # viser would print an address that answers nobody but the gateway
        dashboard = Dashboard(
            port=0,
            theme=cast(Theme, prepare.theme),
            fps=prepare.fps,
            key=prepare.key,
            previewer=previewer,
            allowance=allowance_of(shared=prepare.shared),
        )
    given = scenario.robot.urdf
    preparing = Pulse(gateway, dashboard, lambda: None)  # the very first arm of its kind takes half a minute
    runner = Runner(scenario, FileAccess((given,) if given else ()))
    dashboard.attach(runner)
    preparing.stop()  # nobody listens to a spare process
    gateway.send(Ready(dashboard.port, dashboard.report_fields))
    begin = gateway.next()
    assert isinstance(begin, Begin)
    Pulse(gateway, dashboard, lambda: None if (pace := runner.unrefreshed.pace) is None else pace.late_median)
    dashboard.uploads.marks = begin.marks
    begun, also_unfit = _runnable(begin.scenario, scenario) if begin.scenario else (scenario, "")
    if problem := unfit or also_unfit:
        dashboard.offer(remark(f"the session's scenario cannot be read, {begun.name} runs in its place: {problem}"))
    autosave, runs = (None, ()) if begin.kept is None else _autosave(begin.kept, begun, runner, dashboard)
    if begin.classes:
        dashboard.classroom.open(lambda question: gateway.send(Asks(question)), begin.asked)
    if begin.scenario or runs:
        runner.post(Continue(begun, runs))
    runner.start()
    threading.Thread(target=_report, args=(gateway, runner, scenario), name="reports", daemon=True).start()
    threading.Thread(target=dashboard.run_forever, name="drawing", daemon=True).start()
    try:
        while True:  # until the other end has gone
            match gateway.next():
                case Keep(kept) if autosave is None:
                    autosave = _kept_from_now(kept, runner, dashboard)
                case Remark(sentence):
                    dashboard.offer(remark(sentence))
                case Answers(number, given):
                    dashboard.classroom.take(number, given)
    finally:
        if autosave is not None:
            autosave.close()


def _runnable(text: str, usual: Scenario) -> tuple[Scenario, str]:
    """Scenario of this text (TOML), or the usual one and the reason why: the text may be that of another version's
    session."""
    try:
        return from_toml(text), ""
    except ScenarioError as error:
        return usual, str(error)


def _folder(kept: KeptFolder, dashboard: Dashboard) -> StateFolder | None:
    """Folder of the session, None where it cannot be used; the page shows the reason then."""
    try:
        folder = StateFolder(Path(kept.folder))
        problems = (
            dashboard.notebook.keep_in(folder.path),
            dashboard.classroom.keep_in(folder.path, dashboard.fail),
        )
    except StateError as error:
        dashboard.offer(remark(f"this session is not kept: {error}"))
        return None
    for problem in filter(None, problems):
        dashboard.offer(remark(problem))
    return folder


def _kept_from_now(kept: KeptFolder, runner: Runner, dashboard: Dashboard) -> Autosave | None:
    """Autosave of a session that has begun without a folder."""
    folder = _folder(kept, dashboard)
    return None if folder is None else Autosave(folder, lambda: runner.unrefreshed, dashboard.fail, begun=True)


def _autosave(
    kept: KeptFolder, scenario: Scenario, runner: Runner, dashboard: Dashboard
) -> tuple[Autosave | None, tuple[Pinned, ...]]:
    """Autosave of the session from its beginning, None where its folder cannot be used; and the pinned runs that are
    restored from the folder. Runs that cannot be restored are shown or offered."""
    if (folder := _folder(kept, dashboard)) is None:
        return None, ()
    autosave = Autosave(folder, lambda: runner.unrefreshed, dashboard.fail)
    left = left_by(folder, autosave, scenario)
    if left is None:
        return autosave, ()
    if left.offer is None or kept.earlier == "offered" or not folder.continues:  # or it is of a session before this one
        dashboard.offer(left)
        return autosave, ()
    try:
        runs, problem = autosave.take_up(left.offer)
    except ScenarioError:  # it is older than the one that runs, and cannot run now
        dashboard.offer(left)
        return autosave, ()
    if problem:
        dashboard.offer(remark(problem))
    return autosave, runs


def _report(gateway: GatewayConnection, runner: Runner, reported: Scenario) -> None:
    pause, pinned, due = threading.Event(), 0, time.monotonic() + IN_USE
    with contextlib.suppress(OSError):
        while not pause.wait(LOOK):
            now = runner.unrefreshed
            scenario = now.own_push.restored_in(now.latest.scenario)  # also while somebody looks back
            if time.monotonic() > due:
                uploaded_urdfs.note_use(scenario.robot.urdf)
                due = time.monotonic() + IN_USE
            if (scenario is not reported and scenario != reported) or len(now.pinned) != pinned:
                reported, pinned = scenario, len(now.pinned)
                gateway.send(Changed(to_toml(reported), pinned))


def limit_resources() -> None:
    """Limit memory and open files of this process and of those that it starts; lower limits stay."""
    for what, most in ((resource.RLIMIT_DATA, MEMORY), (resource.RLIMIT_NOFILE, FILES)):
        hard = resource.getrlimit(what)[1]
        least = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(what, (least, least))


def run(file: int, previewer: Previewer) -> None:
    """Serve one session over this connection to the gateway, and end this process."""
    with socket.socket(fileno=file) as connection:
        gateway = GatewayConnection(connection)
        try:
            serve(gateway, previewer)
        except (EOFError, ConnectionError):
            # at once: the gateway knows the scenario, child processes end with this one, and nothing else is to be kept
            os._exit(0)
        except Exception as error:  # the process's last resort: let the gateway say it
            events.exception("fault", stage="a session")
            with contextlib.suppress(OSError):
                gateway.send(Failed(f"{type(error).__name__}: {error}"))
            os._exit(1)


if __name__ == "__main__":
    log.configure_as_parent()
    limit_resources()
    run(int(sys.argv[1]), Previewer())
