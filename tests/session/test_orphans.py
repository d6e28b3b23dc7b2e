"""Orphans that the fork server's asker adopts while a session's process is being started: none is left as a zombie."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from app.process.fork_server import ForkServer
from drivers.waiting import until

# a session's process with a child of its own
SESSION = """
import subprocess, time
print(subprocess.Popen(["sleep", "1000"]).pid, flush=True)
time.sleep(1000)
"""
# a fork server, during whose first answer that session's process is killed
STAND_IN = """
import os, signal, socket, sys, time
control = socket.socket(fileno=int(sys.argv[1]))
control.recv(100)
for killed in (int(sys.argv[2]), 0):
    socket.recv_fds(control, 100, 1)
    if killed:
        os.kill(killed, signal.SIGKILL)
        while open(f"/proc/{killed}/stat").read().split()[2] != "Z":
            time.sleep(0.001)
    control.send(str(os.getpid()).encode())
"""


def parent(process: int) -> int:
    return int(Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[1])


@pytest.mark.skipif(sys.platform != "linux", reason="of Linux only")
def test_the_children_of_a_session_that_is_killed_meanwhile_are_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    session = subprocess.Popen([sys.executable, "-c", SESSION], stdout=subprocess.PIPE, text=True)
    assert session.stdout is not None
    orphan = int(session.stdout.readline())
    time.sleep(0.05)  # the system tells to a hundredth of a second when a process began
    own: list[subprocess.Popen[bytes]] = []

    def start(_: str, file: str, *, niceness: int, **options: Any) -> subprocess.Popen[bytes]:
        assert niceness == 0  # a session and its loop come first
        return subprocess.Popen[bytes]([sys.executable, "-c", STAND_IN, file, str(session.pid)], **options)

    async def another_child() -> None:
        own.append(subprocess.Popen([sys.executable, "-c", ""]))  # of this process itself

    async def asked() -> None:
        await asyncio.gather(forks.start(0), another_child())
        assert parent(orphan) == os.getpid()
        await forks.start(0)
        assert parent(orphan) == os.getpid()  # it lives
        os.kill(orphan, 9)
        until(lambda: Path(f"/proc/{orphan}/stat").read_text().rpartition(")")[2].split()[0] == "Z")
        until(lambda: Path(f"/proc/{own[0].pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z")
        monkeypatch.setattr(forks, "_control", None)  # the stand-in has ended
        await forks.start(0)

    monkeypatch.setattr("app.process.launcher.start", start)
    forks = ForkServer("")
    try:
        asyncio.run(asked())
        assert not Path(f"/proc/{orphan}").exists()
        assert own[0].wait() == 0  # its status is left for the one who started it
    finally:
        forks.close()
        session.kill()
        session.wait()
        session.stdout.close()
