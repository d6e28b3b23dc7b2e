"""Gateway sessions for tests: fake workers instead of processes, and a clock that the test sets."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from functools import wraps

from app.access.session_messages import Begin, Changed, KeptFolder
from app.gateway.session import Session
from app.gateway.session_pool import SessionPool
from app.gateway.session_store import SessionStore
from app.gateway.visitors import NOBODY, Viewer, VisitorLimits
from app.gateway.worker import WorkerError

USUAL = "usual"
PAGE = Viewer(NOBODY, "steer")


class Fake:
    """A process: what it was told, and a handle to make it speak or fall."""

    port, key, report_fields, late = 0, "", frozenset[str](), None

    def __init__(self, prepared: str) -> None:
        self.prepared, self.begun, self.alive = prepared, "", True
        self.kept: KeptFolder | None = None
        self.remarks = list[str]()
        self._outbox: asyncio.Queue[Changed | None] = asyncio.Queue()

    def begin(self, begin: Begin) -> None:
        self.begun, self.kept = begin.scenario or self.prepared, begin.kept

    def keep(self, kept: KeptFolder) -> None:
        self.kept = kept

    def remark(self, sentence: str) -> None:
        self.remarks.append(sentence)

    async def changes(self) -> AsyncIterator[Changed]:
        while (message := await self._outbox.get()) is not None:
            yield message

    async def end(self) -> str:
        self.fall()
        return "ended by SIGKILL"

    def emit(self, scenario: str, pinned: int = 0) -> None:
        self._outbox.put_nowait(Changed(scenario, pinned))

    def fall(self) -> None:
        self.alive = False
        self._outbox.put_nowait(None)


class Town:
    """A pool, its processes in the order of their making, and the time."""

    def __init__(
        self,
        capacity: int,
        idle: float | None = 600.0,
        *,
        store: SessionStore | None = None,
        spare: bool = False,
        limits: VisitorLimits | None = None,
    ) -> None:
        self.now, self.made, self.broken = 1000.0, list[Fake](), False
        self._stored = store is not None
        self.pool = SessionPool(
            USUAL, self._launch, capacity, idle, store=store, spare=spare, limits=limits, clock=lambda: self.now
        )

    async def _launch(self, scenario: str) -> Fake:
        if self.broken:
            raise WorkerError("the session's process could not begin: exit status 1")
        self.made.append(Fake(scenario))
        return self.made[-1]

    async def pass_time(self, seconds: float = 0.0) -> None:
        """What is to happen within, happens."""
        self.now += seconds
        self.pool.tick()
        for _ in range(20):
            await asyncio.sleep(0.0)
            while self._stored and self._on_its_way:
                await asyncio.sleep(1e-3)

    @property
    def _on_its_way(self) -> bool:
        """Whether something waits for the disk."""
        return bool(self.pool._doing) or any(session.phase == "starting" for session in self.pool.sessions)

    async def wanted(self, session: Session) -> str:
        self.pool.want(session)
        await self.pass_time()
        return session.phase

    async def looked_at(self, session: Session, seconds: float = 0.0) -> None:
        """A page of it is open meanwhile."""
        self.pool.want(session)
        await self.pass_time()
        with self.pool.viewing(session, PAGE):
            await self.pass_time(seconds)


def in_a_loop(test: Callable[..., Awaitable[None]]) -> Callable[..., None]:
    @wraps(test)
    def run(*fixtures: object) -> None:
        async def within() -> None:
            await test(*fixtures)

        asyncio.run(within())

    return run
