"""Client of `app.workers.preview`: starts the process, sends the newest request, keeps the newest answer."""

from __future__ import annotations

import contextlib
import subprocess
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from multiprocessing import Pipe
from multiprocessing.connection import Connection

import structlog

from app.process import launcher
from app.process.launcher import ChildProcess
from app.scenario.schema import Scenario
from app.session.preview_messages import Hurry, Preview, PreviewDone, PreviewRefusal, PreviewRequest
from app.simulation.state import State

log = structlog.get_logger()

NICENESS = 10  # of the process
PATIENCE = 2.0  # s that the process has to end by itself


@dataclass
class _Worker:
    """Worker: the preview process and the connection to it.
    busy: whether it has a request that it has not answered yet.
    hurried: whether it knows that nobody waits for that answer."""

    process: ChildProcess
    connection: Connection
    busy: bool = False
    hurried: bool = False


class Previewer:
    """Client for previews that never waits. A request that a newer one overtakes is dropped, not queued. May be used
    from any thread.

    newest: the latest answer to the requests since `drop`, None before.
    failure: sentence why the process could not be started or has ended, None while there is no such reason; the next
    request starts another process.
    answered: called in another thread when an answer has come, or the process is lost.
    first: the process to begin with, and the connection to it; None to start one with the first request.
    """

    def __init__(self, first: tuple[ChildProcess, Connection] | None = None) -> None:
        self._lock = threading.Lock()
        self._worker = None if first is None else self._with_listener(_Worker(*first))
        self._waiting: PreviewRequest | None = None
        self._number = self._dropped = 0
        self._closed = False
        self._starter = ThreadPoolExecutor(1, "starter")  # the process ends with this thread
        self.newest: Preview | PreviewRefusal | None = None
        self.failure: str | None = None
        self.answered: Callable[[], None] = lambda: None

    @property
    def idle(self) -> bool:
        """Whether no request is open."""
        with self._lock:
            return self._waiting is None and (self._worker is None or not self._worker.busy)

    @property
    def process_id(self) -> int | None:
        """Number of the process that answers, None while there is none."""
        worker = self._worker
        return None if worker is None else worker.process.pid

    def warm_up(self, state: State) -> None:
        """Start the process, and have it load what a preview from this state needs; nobody waits for the answer."""
        with self._lock:
            self._put(PreviewRequest(0, state, state.scenario, state.scenario.controller.period, partial=False))

    def ask(
        self,
        state: State,
        scenario: Scenario,
        horizon: float,
        *,
        partial: bool = True,
        push: float = 0.0,
        compared: bool = False,
        arms: int = 0,
    ) -> None:
        """Ask for a preview, see `PreviewRequest`."""
        with self._lock:
            self._number += 1
            request = PreviewRequest(
                number=self._number,
                state=state,
                scenario=scenario,
                horizon=horizon,
                partial=partial,
                push=push,
                compared=compared,
                arms=arms,
            )
            self._put(request)

    def drop(self) -> None:
        """Forget the answer; the requests asked so far do not count any more."""
        with self._lock:
            self._dropped, self.newest, self._waiting = self._number, None, None
            if self._worker is not None:
                self._hurry(self._worker)

    def close(self) -> None:
        """End the process, and start no other one; returns when it has ended."""
        with self._lock:
            self._closed = True
            worker, self._worker, self._waiting = self._worker, None, None
        if worker is not None:
            _end(worker)
        self._starter.shutdown()

    def _put(self, request: PreviewRequest) -> None:
        if self._closed:
            return
        self._waiting = request
        try:
            self._worker = self._worker or self._started()
            self._pass_on(self._worker)
        except OSError as error:
            self.failure = f"the preview's process cannot be started or reached: {error}"

    def _started(self) -> _Worker:
        ours, theirs = Pipe()
        with theirs:
            file = theirs.fileno()
            process = self._starter.submit(
                launcher.start,
                "app.workers.preview",
                str(file),
                niceness=NICENESS,
                stdin=subprocess.DEVNULL,
                pass_fds=(file,),
            ).result()
        return self._with_listener(_Worker(process, ours))

    def _with_listener(self, worker: _Worker) -> _Worker:
        threading.Thread(target=self._listen, args=(worker,), name="previews", daemon=True).start()
        return worker

    def _pass_on(self, worker: _Worker) -> None:
        if self._waiting is None:
            return
        if not worker.busy:
            request, self._waiting = self._waiting, None
            worker.busy, worker.hurried = True, False
            worker.connection.send(request)
        else:
            self._hurry(worker)

    def _hurry(self, worker: _Worker) -> None:
        """Say that nobody waits: for the answer, or for the rest of the band behind the last one."""
        if not worker.hurried:
            worker.hurried = True
            with contextlib.suppress(ConnectionError):  # `_listen` will notice, and say so
                worker.connection.send(Hurry())

    def _listen(self, worker: _Worker) -> None:
        with worker.connection as connection:
            try:
                while True:
                    self._take(connection.recv(), worker)
            except (EOFError, OSError):
                self._lost(worker)

    def _take(self, message: Preview | PreviewRefusal | PreviewDone, worker: _Worker) -> None:
        with self._lock:
            if isinstance(message, PreviewDone):
                worker.busy = False
                self._pass_on(worker)
            elif message.number > self._dropped:
                self.failure, self.newest = None, message
                self.answered()

    def _lost(self, worker: _Worker) -> None:
        with self._lock:
            if self._worker is not worker:
                return  # the worker was closed
            self._worker, self._waiting, self.newest = None, None, None
            status = _end(worker)
            self.failure = f"the preview's process has ended (exit status {status}); the next movement starts another"
        self.answered()
        log.warning("preview lost", reason=self.failure)


def _end(worker: _Worker) -> int:
    """End the process; returns its exit status."""
    worker.process.terminate()
    try:
        return worker.process.wait(PATIENCE)
    except subprocess.TimeoutExpired:
        worker.process.kill()
        return worker.process.wait()
