"""The process of one session: `python -m app.session_worker FD`, started by `app.gateway`.

It serves a dashboard at a loopback port, to its gateway only, and tells it of every change of the scenario. It ends
when the other end of the connection does, whatever became of the gateway.
"""

from __future__ import annotations

import contextlib
import io
import os
import socket
import sys
import threading
from io import BufferedReader
from pathlib import Path
from typing import cast

import structlog

from app import log
from app.commands import Continue
from app.dashboard import Dashboard
from app.dashboard.last_session import left_by, remark
from app.dashboard.theme import Theme
from app.recovery import Keeper, StateError, StateFolder
from app.runner import Runner
from app.scenario import Scenario, ScenarioError
from app.scenario_data import from_toml, to_toml
from app.session_messages import Begin, Changed, Failed, FromSession, Kept, Prepare, Ready, ToSession, line, to_session
from app.timeline import Pinned
from app.uploads import Reach

events = structlog.get_logger()

LOOK = 0.05  # s between two looks whether the scenario has changed: a copy may be so much older


class Gateway:
    """The connection's end in this process."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self._lines: BufferedReader = connection.makefile("rb")

    def next(self) -> ToSession:
        """Raises EOFError when the gateway has gone."""
        if not (text := self._lines.readline()):
            raise EOFError
        return to_session.decode(text)

    def tell(self, message: FromSession) -> None:
        """Raises ConnectionError when the gateway has gone."""
        self._connection.sendall(line(message))


def serve(gateway: Gateway) -> None:
    """From the preparation to the end of the connection. Raises EOFError or ConnectionError then."""
    prepare = gateway.next()
    assert isinstance(prepare, Prepare)
    scenario = from_toml(prepare.scenario)
    with contextlib.redirect_stdout(io.StringIO()):  # viser would print an address where nobody is answered
        dashboard = Dashboard(port=0, theme=cast(Theme, prepare.theme), fps=prepare.fps, key=prepare.key)
    given = scenario.robot.urdf
    runner = Runner(scenario, Reach((given,) if given else ()))
    dashboard.attach(runner)
    gateway.tell(Ready(dashboard.port, dashboard.looking_fields))
    begin = gateway.next()
    assert isinstance(begin, Begin)
    begun = from_toml(begin.scenario) if begin.scenario else scenario
    keeper, runs = (None, ()) if begin.kept is None else _keeper(begin.kept, begun, runner, dashboard)
    if begin.scenario or runs:
        runner.post(Continue(begun, runs))
    runner.start()
    threading.Thread(target=_report, args=(gateway, runner, scenario), name="reports", daemon=True).start()
    threading.Thread(target=dashboard.run_forever, name="drawing", daemon=True).start()
    try:
        gateway.next()  # nothing is asked of a running session: this returns when the other end has gone
    finally:
        if keeper is not None:
            keeper.close()


def _keeper(
    kept: Kept, scenario: Scenario, runner: Runner, dashboard: Dashboard
) -> tuple[Keeper | None, tuple[Pinned, ...]]:
    """Keeps the session from now on, in its folder, unless that cannot be used; and the pinned runs that are taken up
    from there. What cannot be taken up is shown or offered."""
    try:
        folder = StateFolder(Path(kept.folder))
    except StateError as error:
        dashboard.offer(remark(f"this session is not kept: {error}"))
        return None, ()
    keeper = Keeper(folder, lambda: runner.snapshot, dashboard.fail)
    left = left_by(folder, keeper, scenario)
    if left is None:
        return keeper, ()
    if left.offer is None or kept.earlier == "offered":
        dashboard.offer(left)
        return keeper, ()
    try:
        runs, problem = keeper.take_up(left.offer)
    except ScenarioError:  # it is older than the one that runs, and cannot run now
        dashboard.offer(left)
        return keeper, ()
    if problem:
        dashboard.offer(remark(problem))
    return keeper, runs


def _report(gateway: Gateway, runner: Runner, told: Scenario) -> None:
    pause = threading.Event()
    with contextlib.suppress(OSError):
        while not pause.wait(LOOK):
            scenario = runner.snapshot.scenario
            if scenario is not told and scenario != told:
                told = scenario
                gateway.tell(Changed(to_toml(scenario)))


def main() -> None:
    log.configure_as_parent()
    with socket.socket(fileno=int(sys.argv[1])) as connection:
        gateway = Gateway(connection)
        try:
            serve(gateway)
        except (EOFError, ConnectionError):
            # at once: the gateway knows the scenario, processes of ours end with us, and nothing else is to be kept
            os._exit(0)
        except Exception as error:  # the process's last resort: let the gateway say it
            events.exception("fault", stage="a session")
            with contextlib.suppress(OSError):
                gateway.tell(Failed(f"{error}"))
            os._exit(1)


if __name__ == "__main__":
    main()
