"""What the tests of faults share: a loop that runs, and a page without a browser."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import msgspec
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from app.scenario.data import load
from app.scenario.schema import Scenario
from app.session.commands import Load, Play, Reset
from app.session.runner import Runner
from app.session.snapshot import Snapshot
from drivers.viser_protocol import CAMERA, PROTOCOL
from drivers.waiting import PATIENCE, until


@contextmanager
def running() -> Iterator[Runner]:
    """A loop that runs in its thread."""
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
            open_timeout=PATIENCE,
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


def boom(*_: object) -> None:
    raise KeyError("boom")


def warp(*_: object) -> None:
    raise ValueError("warp")
