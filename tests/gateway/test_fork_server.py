"""Sessions of a shared server are forked from a process that has loaded the program."""

import asyncio
import errno
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from app.process.fork_server import ForkedProcess, ForkServer
from app.workers.fork_server import PREVIEW, SESSION, answered_by_its_number
from drivers.visitors import Server, gone, serving, visiting
from drivers.waiting import until
from tests.gateway.test_gateway import arrive


def name(process: int) -> str:
    return Path(f"/proc/{process}/comm").read_text().strip()


def fork_server(server: Server) -> int:
    """The process that forks sessions: sessions have its command line, and names of their own as soon as they begin."""

    def forks(child: int) -> bool:
        with suppress(OSError):  # it has ended
            command = Path(f"/proc/{child}/cmdline").read_bytes()
            return b"app.workers.fork_server" in command and name(child) != SESSION
        return False

    def alone() -> int | None:
        found = [child for child in server.children() if forks(child)]
        return found[0] if len(found) == 1 else None

    return until(alone)


def sessions(server: Server) -> list[int]:
    """Processes of sessions, the oldest first."""
    return [child for child in server.children() if name(child) == SESSION]


@pytest.mark.slow
def test_sessions_outlive_the_process_that_they_were_forked_from_and_another_one_takes_its_place() -> None:
    with serving("--shared", "--max-sessions", "2", lines=2) as server:
        first = arrive(server.port)
        first.loaded()
        with visiting(first.url) as page:
            page.wait(lambda: page.t > 0.0)
            forks = fork_server(server)
            assert len(list(Path(f"/proc/{forks}/task").iterdir())) == 1  # a fork would lose any other thread
            until(lambda: len(sessions(server)) == 2, "no spare")
            spare = sessions(server)[1]
            os.kill(forks, signal.SIGKILL)
            os.kill(spare, signal.SIGKILL)
            for killed in (forks, spare):  # on a busy machine a signal takes its time
                assert gone(killed)
            began = page.t
            page.wait(lambda: page.t > began + 0.3)
            second = arrive(server.port)
            second.loaded()
            with visiting(second.url) as other:
                other.wait(lambda: other.t > 0.0)
            assert fork_server(server) != forks
            assert first.about()["crashes"] == second.about()["crashes"] == 0
            theirs = [Path(f"/proc/{session}/task/{session}/children").read_text() for session in sessions(server)]
            assert [[name(int(child)) for child in children.split()] for children in theirs] == [[PREVIEW], [PREVIEW]]


STAND_IN = """
import os, socket, sys
control = socket.socket(fileno=int(sys.argv[1]))
control.recv(100)
for answer in (str(os.getpid()), "-11"):
    socket.recv_fds(control, 100, 1)
    control.send(answer.encode())
for _ in range(2):
    socket.recv_fds(control, 100, 1)
control.send(b"1")  # too late
"""


def test_failed_fork_is_reported_and_late_answers_are_discarded(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def start(_: str, file: str, *, niceness: int, **options: Any) -> subprocess.Popen[bytes]:
        assert niceness == 0  # a session and its loop come first
        return subprocess.Popen[bytes]([sys.executable, "-c", STAND_IN, file], **options)

    monkeypatch.setattr("app.process.launcher.start", start)
    forks = ForkServer("")

    async def asked() -> None:
        first = await forks.start(0)
        with pytest.raises(OSError, match="Resource temporarily unavailable"):
            await forks.start(0)
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(forks.start(0), 0.01)
        assert (await forks.start(0)).pid not in (1, first.pid)

    try:
        asyncio.run(asked())
    finally:
        forks.close()


def test_an_error_of_the_fork_server_is_its_answer() -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours, theirs:
        with answered_by_its_number(theirs):
            raise OSError(errno.EAGAIN, "no more processes")
        assert int(ours.recv(100)) == -errno.EAGAIN


@pytest.fixture
def sleeper() -> Iterator[ForkedProcess]:
    child = subprocess.Popen(["sleep", "1000"])  # forked by somebody else, which makes no difference to the system
    yield ForkedProcess(child.pid)
    child.returncode = 0  # it has been waited for


def test_a_forked_process_has_the_methods_of_others(sleeper: ForkedProcess) -> None:
    assert sleeper.poll() is None
    began = time.monotonic()
    with pytest.raises(subprocess.TimeoutExpired):
        sleeper.wait(0.05)
    assert time.monotonic() - began >= 0.05
    sleeper.terminate()
    assert sleeper.wait() == -signal.SIGTERM
    sleeper.kill()  # nobody else
    assert sleeper.poll() == sleeper.wait(1.0) == -signal.SIGTERM
