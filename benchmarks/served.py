"""Dashboard in a fresh process, as `vsmrc serve` makes it, which answers questions on its state."""

from __future__ import annotations

import contextlib
import io
import multiprocessing
import os
import threading
import time
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from typing import NamedTuple
from unittest import mock

import numpy as np

from app.dashboard.page import Dashboard
from app.process import log
from app.process.priority import RealTimePriority
from app.scenario.data import load
from app.session import runner as runner_module
from app.session.commands import SetSpeed
from app.session.runner import Runner
from app.simulation.closed_loop import ClosedLoop


class State(NamedTuple):
    """State of the dashboard.
    t: simulated time, s.
    reason: for which the loop stopped, "" where it runs.
    resident: memory, bytes.
    processor: processor time, s.
    rows: number of recorded rows that are still kept."""

    t: float
    reason: str
    resident: int
    processor: float
    rows: int


class Use(NamedTuple):
    """Use of a new desired force. value: N. computed: wall time, s of `time.perf_counter`, at which the first step with
    this force ended."""

    value: float
    computed: float


class Served:
    """Served dashboard: the parent's end of the connection. Times are those of `time.perf_counter`, which is one clock
    for all processes of a Linux machine."""

    def __init__(self, connection: Connection, pid: int) -> None:
        self._connection = connection
        self.pid = pid
        self.url: str = self._received()

    def state(self) -> State:
        return State(*self._asked("state"))

    def lateness(self, since: float) -> np.ndarray:
        """Lateness of every control step since a wall time, both s."""
        return self._asked("lateness", since)

    def uses(self) -> list[Use]:
        """Uses of new desired forces so far."""
        return [Use(*use) for use in self._asked("uses")]

    def _asked(self, *question: object):
        self._connection.send(question)
        return self._received()

    def _received(self):
        if not self._connection.poll(120.0):
            raise TimeoutError("the served dashboard does not answer")
        return self._connection.recv()


@contextlib.contextmanager
def served(
    scenario: str, speed: float = 1.0, log_file: Path | None = None, priority: RealTimePriority | None = None
) -> Iterator[Served]:
    """Context in which the dashboard runs. speed: of the loop, times real time. log_file: to which it logs as well.
    priority: of the loop's thread, None for the usual one."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(theirs, scenario, speed, log_file, priority), daemon=True)
    process.start()
    theirs.close()  # else the end of the process would not end the connection
    try:
        yield Served(ours, process.pid or 0)
    finally:
        process.terminate()
        process.join()


def _noting(uses: list[tuple[float, float]]) -> type[ClosedLoop]:
    """Class of a loop that notes in `uses` when the first step with another desired force has been computed."""

    class Noting(ClosedLoop):
        seen = np.nan

        def step(self) -> None:
            super().step()
            value = self.system.scenario.force.value
            if value != self.seen:
                self.seen = value
                uses.append((value, time.perf_counter()))

    return Noting


def _serve(
    connection: Connection, scenario: str, speed: float, log_file: Path | None, priority: RealTimePriority | None
) -> None:
    log.configure(file=log_file)
    uses: list[tuple[float, float]] = []
    with contextlib.redirect_stdout(io.StringIO()), mock.patch.object(runner_module, "ClosedLoop", _noting(uses)):
        dashboard = Dashboard(port=0)
        runner = Runner(load(scenario))
        runner.post(SetSpeed(speed))
        runner.start(priority)
        dashboard.attach(runner)
        threading.Thread(target=_answer, args=(connection, runner, uses, dashboard.close), daemon=True).start()
        connection.send(dashboard.url)
        dashboard.run_forever()


def _answer(connection: Connection, runner: Runner, uses: list[tuple[float, float]], close: Callable[[], None]) -> None:
    """Answer the parent's questions until its end."""
    with contextlib.suppress(EOFError):
        while True:
            match connection.recv():
                case ("state",):
                    now = runner.snapshot
                    connection.send((now.t, now.reason, _resident(), time.process_time(), len(now.recording)))
                case ("lateness", since):
                    connection.send(runner.meter.lateness(since))
                case ("uses",):
                    connection.send(list(uses))
    close()


def _resident() -> int:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")
