"""The gateway's end of a session's process, `app.workers.session`."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import socket
import subprocess
from collections.abc import AsyncIterator, Awaitable, Callable

import structlog

from app.access.session_messages import (
    LONGEST,
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
    from_session,
    line,
)
from app.gateway.server_settings import PageStyle
from app.process import launcher
from app.process.launcher import ChildProcess
from app.process.redaction import new_secret

log = structlog.get_logger()

PATIENCE = 1.0  # s that a process has to end by itself
STARTING = 120.0  # s until the first sign of life of a process, whose imports take long on a busy machine
SILENCE = 10.0  # s without a sign of life, after which a process counts as hanging


class WorkerError(RuntimeError):
    """A process that could not be started: one sentence."""


Start = Callable[[int], Awaitable[ChildProcess]]


async def started(file: int) -> ChildProcess:
    """New process of a session, which inherits this file. Raises OSError."""
    return launcher.start("app.workers.session", str(file), niceness=0, stdin=subprocess.DEVNULL, pass_fds=(file,))


class Worker:
    """Worker: the process of a session, or a spare one. It is killed when it gives no sign of life for `silence` s.
    port, key: of its dashboard, which answers only requests with this key.
    report_fields: see `app.access.rate_limits.harmless`.
    late: see `Alive`."""

    def __init__(
        self,
        process: ChildProcess,
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
        key: str,
        silence: float,
    ) -> None:
        self._process, self._reader, self._writer = process, reader, writer
        self.key = key
        self.port = 0
        self.report_fields: frozenset[str] = frozenset()
        self.late: float | None = None
        self._failure = ""
        self._silence, self._allowed = silence, STARTING
        self._listens = False

    @classmethod
    async def prepared(
        cls, scenario: str, style: PageStyle, *, shared: bool = False, silence: float = SILENCE, start: Start = started
    ) -> Worker:
        """Process with its dashboard set up and this scenario (TOML) compiled. Raises WorkerError.
        shared: see `Prepare`. start: makes the process."""
        try:
            ours, theirs = socket.socketpair()
        except OSError as error:
            raise WorkerError(f"the session's process cannot be reached: {error.strerror}") from error
        with theirs:
            try:
                process = await start(theirs.fileno())
            except BaseException as error:
                ours.close()
                if isinstance(error, OSError):
                    raise WorkerError(f"the session's process cannot be started: {error.strerror}") from error
                raise
        reader, writer = await asyncio.open_connection(sock=ours, limit=LONGEST)
        worker = cls(process, reader, writer, new_secret(), silence)
        try:
            worker._send(Prepare(scenario, style.theme, style.fps, worker.key, shared))
            await worker._ready()
        except BaseException:
            await worker.end()
            raise
        return worker

    @property
    def process_id(self) -> int:
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether the process has not ended."""
        return self._process.poll() is None

    def begin(self, begin: Begin) -> None:
        """Let the spare become a session. Where the process has just ended, this shows in the end of `changes`."""
        self._send(begin)

    def keep(self, kept: KeptFolder) -> None:
        """Let the process keep the session in a folder from now on; it has begun without one."""
        self._send(Keep(kept))

    def remark(self, sentence: str) -> None:
        """Let the process show a sentence on the page."""
        self._send(Remark(sentence))

    def answer(self, answers: Answers) -> None:
        """Hand the answers of a class to the process."""
        self._send(answers)

    async def changes(self) -> AsyncIterator[Changed | Asks]:
        """Changes of the scenario that runs, and questions to the class, until the process ends or is killed because it
        hangs."""
        async for message in self._messages():
            if isinstance(message, Changed | Asks):
                yield message

    async def end(self) -> str:
        """End the process, if it has not ended; returns in a few words how it ended."""
        self._writer.close()
        if not self._listens:
            self._process.kill()  # it still imports, and would notice only afterwards
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(PATIENCE):
                while self.alive:  # no thread waits for the process: the end would have to wait for that thread in turn
                    await asyncio.sleep(0.02)
        if self.alive:
            log.warning("session killed", killed=self.process_id, reason="it did not end by itself")
            self._process.kill()
        while (status := self._process.poll()) is None:
            await asyncio.sleep(0.02)
        if self._failure:
            return self._failure
        return f"ended by {signal.Signals(-status).name}" if status < 0 else f"exit status {status}"

    async def _ready(self) -> None:
        async for message in self._messages():
            if isinstance(message, Ready):
                self.port, self.report_fields, self._listens = message.port, message.report_fields, True
                return
        raise WorkerError(f"the session's process could not begin: {await self.end()}")

    async def _messages(self) -> AsyncIterator[FromSession]:
        with contextlib.suppress(ConnectionError, asyncio.IncompleteReadError):
            # the last line of a killed process may be cut off
            while (text := await self._line()).endswith(b"\n"):
                message = from_session.decode(text)
                self._allowed = self._silence
                if isinstance(message, Failed):
                    self._failure = message.reason
                elif isinstance(message, Alive):
                    self.late = message.late
                yield message

    async def _line(self) -> bytes:
        """Next line from the process; b"" where it says nothing for too long, and then it is killed."""
        for _ in range(2):  # a gateway that was itself suspended finds in the second half the lines sent meanwhile
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(0.5 * self._allowed):
                    return await self._reader.readline()
        self._failure = f"it gave no sign of life for {self._allowed:g} s"
        log.warning("session killed", killed=self.process_id, reason=self._failure)
        self._process.kill()
        return b""

    def _send(self, message: ToSession) -> None:
        self._writer.write(line(message))
