"""Fork server: starts processes by forking one that has loaded the program, which takes milliseconds; what was loaded
is in memory once for all of them. The forked end is `app.workers.fork_server`. Linux only."""

from __future__ import annotations

import asyncio
import contextlib
import ctypes
import errno
import os
import select
import signal
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

from app.process import launcher

_PR_SET_CHILD_SUBREAPER = 36
LOADED_WITHIN = 120.0  # s for the first answer, which comes after the imports: they take long on a busy machine
PATIENCE = 20.0  # s for another answer


class ForkedProcess:
    """A child of this process that has been forked, with the methods of `subprocess.Popen`."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self._status: int | None = None

    def poll(self) -> int | None:
        """Exit status, negative for the number of a signal; None while the process runs."""
        if self._status is None:
            ended, status = os.waitpid(self.pid, os.WNOHANG)
            if ended:
                self._status = os.waitstatus_to_exitcode(status)
        return self._status

    def wait(self, timeout: float | None = None) -> int:
        """Exit status, once the process has ended. Raises TimeoutExpired after `timeout` s."""
        if (status := self.poll()) is not None:  # what has been waited for cannot be opened
            return status
        end = os.pidfd_open(self.pid)
        try:
            select.select([end], [], [], timeout)
        finally:
            os.close(end)
        if (status := self.poll()) is None:
            raise subprocess.TimeoutExpired(str(self.pid), timeout or 0.0)
        return status

    def terminate(self) -> None:
        self._send(signal.SIGTERM)

    def kill(self) -> None:
        self._send(signal.SIGKILL)

    def _send(self, number: int) -> None:
        if self.poll() is None:  # until then nobody else can have its number
            os.kill(self.pid, number)


class ForkServer:
    """Fork server for sessions; the processes have the kernels of this scenario (TOML) loaded. The server is started by
    the first `start`, and again where it has ended."""

    def __init__(self, scenario: str) -> None:
        self._scenario = scenario
        self._asking = asyncio.Lock()
        self._control: socket.socket | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._loaded = False  # whether it has answered
        self._orphans = set[int]()  # adopted beside the sessions' processes, and not waited for yet

    async def start(self, file: int) -> ForkedProcess:
        """Start a session's process, which inherits this file. Raises OSError."""
        async with self._asking:
            self._orphans = {orphan for orphan in self._orphans if not _has_ended(orphan)}
            if self._control is not None:
                with contextlib.suppress(ConnectionError):
                    return await self._forked(self._control, file)
            self._control = self._begun()
            return await self._forked(self._control, file)

    async def _forked(self, control: socket.socket, file: int) -> ForkedProcess:
        """Process that the fork server makes; where it does not answer, or nobody waits any more, it is ended. Raises
        OSError."""
        try:
            with _adopting_orphans(self._orphans):
                async with asyncio.timeout(PATIENCE if self._loaded else LOADED_WITHIN):
                    socket.send_fds(control, [b"session"], [file])
                    answer = await asyncio.get_running_loop().sock_recv(control, 100)
            if not answer:
                raise ConnectionResetError("the fork server has ended")
        except BaseException as error:  # an answer that comes later would be taken for that to the next question
            self.close()
            if isinstance(error, TimeoutError):
                raise OSError(errno.ETIMEDOUT, os.strerror(errno.ETIMEDOUT)) from error
            raise
        self._loaded = True
        if (number := int(answer)) < 0:
            raise OSError(-number, os.strerror(-number))
        return ForkedProcess(number)

    def _begun(self) -> socket.socket:
        self.close()
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)  # messages arrive one by one
        with theirs:
            file = theirs.fileno()
            self._process = launcher.start(
                "app.workers.fork_server", str(file), niceness=0, stdin=subprocess.DEVNULL, pass_fds=(file,)
            )
        ours.send(self._scenario.encode())
        ours.setblocking(False)
        return ours

    def close(self) -> None:
        """End the fork server; the processes that it has made go on."""
        if self._control is not None:
            self._control.close()
            self._control, self._loaded = None, False
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None


@contextlib.contextmanager
def _adopting_orphans(others: set[int]) -> Iterator[None]:
    """Context in which orphans among the descendants of this process become its children: the fork server's child ends
    at once, so that its own child, the session's process, does not depend on the fork server's life.

    others: gets the children of a session's process that is killed meanwhile, for whom nobody else would wait. They are
    older than the context; other new children may have been started by this process."""
    prctl = ctypes.CDLL(None).prctl
    began, before = time.clock_gettime(time.CLOCK_BOOTTIME), _children()
    prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    try:
        yield
    finally:
        prctl(_PR_SET_CHILD_SUBREAPER, 0, 0, 0, 0)
        others |= {child for child in _children() - before if _started(child) < began}


def _children() -> set[int]:
    """Numbers of this process's children, also of those that have ended and are not waited for; of none where the
    system does not tell."""
    found = set[int]()
    for thread in Path("/proc/self/task").iterdir():
        with contextlib.suppress(OSError):  # the thread has ended
            found.update(map(int, (thread / "children").read_text().split()))
    return found


def _started(process: int) -> float:
    """Latest instant (s since the system's start) at which a process may have started; inf where it is gone."""
    try:
        stat = Path(f"/proc/{process}/stat").read_text()
    except OSError:
        return float("inf")
    ticks = int(stat.rpartition(")")[2].split()[19])  # behind the name, which may have blanks
    return (ticks + 1) / os.sysconf("SC_CLK_TCK")


def _has_ended(child: int) -> bool:
    """Whether a child has ended; it is waited for then."""
    try:
        return os.waitpid(child, os.WNOHANG)[0] == child
    except ChildProcessError:  # somebody has waited for it
        return True
