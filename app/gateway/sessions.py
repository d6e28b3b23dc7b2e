"""Who has a session, which of them run, who waits for a place: no page and no socket here."""

from __future__ import annotations

import asyncio
import contextlib
import secrets
import time
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from dataclasses import dataclass, field
from typing import Literal, Protocol

import structlog

from app.gateway.register import MOST, Known, Register
from app.gateway.worker import WorkerError
from app.session_messages import Begin, Kept

log = structlog.get_logger()

Phase = Literal["resting", "waiting", "starting", "running", "failed"]

SILENT = 15.0  # s: who waits for a place and has not asked for so long is passed over
FORGOTTEN = 120.0  # s: and has gone after so long; a locked phone asks for nothing
MOST_WAITING = 500
UNSEEN = 60.0  # s: a process that nobody ever looked at is closed
HURRIED = 120.0  # s: while others wait, a place that nobody looks at is free so soon
CRASHES, WITHIN = 3, 60.0  # so many ends of a process within so many s, and it is not begun again
SPARE_AFTER = 2.0  # s after a start, for the page that is just being loaded has the processor first
MOST_KEPT = 2000  # sessions that rest; of more, the one not seen for longest is forgotten, see `_forget`


class Process(Protocol):
    """What a session needs of `Worker`."""

    port: int
    key: str
    looking: frozenset[str]

    @property
    def alive(self) -> bool: ...
    def begin(self, begin: Begin) -> None: ...
    def changes(self) -> AsyncIterator[str]: ...
    async def end(self) -> str: ...


@dataclass(eq=False)
class Session:
    """A run that has a link, whether or not a process runs it now.

    name, watch: parts of the links to steer and to watch, neither to be guessed, nor one from the other. scenario:
    TOML, as it was last. offers: what is kept of it on disk is something else, to be offered. viewers: open pages.
    told: what happened to its process last, "" while nothing did; crashes counts that. ran: it had a place once.
    """

    scenario: str
    name: str = field(default_factory=lambda: secrets.token_urlsafe(16))
    watch: str = field(default_factory=lambda: secrets.token_urlsafe(16))
    offers: bool = False
    phase: Phase = "resting"
    process: Process | None = None
    viewers: int = 0
    told: str = ""
    crashes: int = 0
    ran: bool = False
    asked: float = 0.0
    seen: float = 0.0
    _falls: list[float] = field(default_factory=list)
    _ever_seen: bool = False
    _runs: asyncio.Event = field(default_factory=asyncio.Event)
    _life: asyncio.Task[None] | None = None
    _closing: bool = False

    @property
    def called(self) -> str:
        """What the log calls it: neither of its links can be made of that."""
        return self.watch[:6]


class House:
    """Sessions and their processes, at most `places` of them at once; all in one event loop.

    scenario: TOML of a new session; launch: makes a process with this scenario ready; idle: s after which a session
    that nobody looks at is closed, its scenario kept, None for never; register: where sessions are kept beyond the
    life of the house, None for nowhere; spare: have a process ready in advance.
    """

    def __init__(
        self,
        scenario: str,
        launch: Callable[[str], Coroutine[None, None, Process]],
        places: int,
        idle: float | None,
        *,
        register: Register | None = None,
        spare: bool = True,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._scenario, self._launch, self.places, self._idle = scenario, launch, places, idle
        self._register, self._wants_spare, self._clock = register, spare, clock
        self._by_name: dict[str, Session] = {}
        self._by_watch: dict[str, Session] = {}
        self._queue: list[Session] = []
        self._spare: asyncio.Task[Process] | None = None
        self._doing: set[asyncio.Task[object]] = set()
        self._closed = False
        self._started = clock() - SPARE_AFTER
        for name, watch, last in register.known() if register is not None else ():
            self._add(Session(last, name, watch, ran=True, seen=clock()))

    @property
    def taken(self) -> int:
        """How many places are."""
        return sum(session._life is not None for session in self._by_name.values())

    @property
    def viewers(self) -> int:
        """Open pages of all sessions."""
        return sum(session.viewers for session in self._by_name.values())

    def named(self, name: str) -> Session | None:
        return self._by_name.get(name)

    def watched(self, name: str) -> Session | None:
        return self._by_watch.get(name)

    def new(self, scenario: str | None = None) -> Session:
        """A session that rests; scenario: TOML, None for the usual one."""
        self._forget(MOST_KEPT, ran=False)
        return self._add(Session(scenario or self._scenario, seen=self._clock()))

    def everyone(self) -> Session:
        """The session of a house that has one for all: its links are the old ones, its scenario is the usual one."""
        session = next(iter(self._by_name.values()), None) or self.new()
        session.scenario, session.offers = self._scenario, True
        return session

    @property
    def full(self) -> bool:
        """Whether nobody else can come or wait."""
        return self.taken >= self.places and len(self._queue) >= MOST_WAITING

    def want(self, session: Session) -> None:
        """Somebody looks for this session: run it, or keep its place in the queue, unless that is full."""
        session.asked = session.seen = self._clock()
        if session.phase == "resting" and not self.full:
            session.phase = "waiting"
            self._queue.append(session)
            self._advance()

    async def soon(self, session: Session, patience: float) -> bool:
        """Whether it runs, or will within so many s: with a spare it does."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(patience):
                await session._runs.wait()
        return session.phase == "running"

    def place(self, session: Session) -> int:
        """In the queue, from 1; 0 for a session that does not wait."""
        return self._queue.index(session) + 1 if session in self._queue else 0

    def again(self, session: Session) -> None:
        """Begin a failed session anew, with the usual scenario."""
        if session.phase == "failed":
            session.scenario, session.phase, session.told = self._scenario, "resting", ""
            session._falls.clear()
            self.want(session)

    @contextlib.contextmanager
    def viewing(self, session: Session) -> Iterator[None]:
        """While a page is open."""
        session.viewers += 1
        session._ever_seen = True
        try:
            yield
        finally:
            session.viewers -= 1
            session.seen = self._clock()

    def tick(self) -> None:
        """What time brings: places fall free, who waits moves on, a spare is ordered. To be called each second."""
        for session in self._by_name.values():
            if session.phase == "running" and not session.viewers and self._unseen(session) and session.process:
                log.info("session closed", session=session.called, reason="nobody looks at it")
                session._closing = True
                session.phase = "resting"
                session.process, process = None, session.process
                self._do(process.end())
        self._advance()
        if self._spare is not None and self._spare.done() and not _of_use(self._spare):
            self._spare = None
        wanted = self._wants_spare and not self._closed and self._spare is None and self.taken < self.places
        if wanted and self._clock() - self._started >= SPARE_AFTER:
            self._started = self._clock()  # a launch that fails is not tried again at once either
            self._spare = asyncio.create_task(self._launch(self._scenario))

    async def close(self) -> None:
        """End every process, and begin no other one; returns when they have ended."""
        self._closed = True
        lives = [session._life for session in self._by_name.values() if session._life is not None]
        if self._spare is not None:
            lives.append(asyncio.create_task(_end(self._spare)))
        for session in self._by_name.values():
            session._closing = True
            if session.process is not None:
                self._do(session.process.end())
            elif session._life is not None:
                session._life.cancel()
        await asyncio.gather(*lives, *self._doing, return_exceptions=True)

    def _unseen(self, session: Session) -> bool:
        if self._idle is None:
            return False
        least = self._idle if session._ever_seen else min(UNSEEN, self._idle)
        if self._queue:
            least = min(least, HURRIED)
        return self._clock() - session.seen > least

    def _do(self, what: Coroutine[None, None, object]) -> None:
        """Meanwhile; nobody waits for it but the end."""
        task = asyncio.create_task(what)
        self._doing.add(task)
        task.add_done_callback(self._doing.discard)

    def _advance(self) -> None:
        now, free = self._clock(), 0 if self._closed else self.places - self.taken
        waiting = list[Session]()
        for session in self._queue:
            if now - session.asked > FORGOTTEN:
                session.phase = "resting"
            # one that is just being closed comes back when it has been
            elif free > 0 and session._life is None and now - session.asked <= SILENT:
                free -= 1
                session.phase, session._closing, session._ever_seen = "starting", False, False
                session._life = asyncio.create_task(self._live(session))
            else:
                waiting.append(session)
        self._queue = waiting

    async def _live(self, session: Session) -> None:
        """From its place in the house to its end, over as many processes as it takes."""
        try:
            while not session._closing:
                session.phase = "starting"
                process = await self._process(session)
                session.process, session.phase, session.seen = process, "running", self._clock()
                session._runs.set()
                log.info("session opened", session=session.called, sessions=self.taken)
                async for scenario in process.changes():
                    session.scenario, session.offers = scenario, False
                session._runs.clear()
                how = await process.end()
                session.process = None
                if not session._closing:
                    self._fallen(session, how)
        except WorkerError as error:
            session.phase, session.told = "failed", str(error)
            log.warning("session given up", session=session.called, reason=str(error))
        except Exception as error:  # a fault of ours ends this session, and is told
            session.phase, session.told = "failed", f"the server could not look after it ({type(error).__name__})"
            log.error("fault", stage="a session", session=session.called, exc_info=error)
            if session.process is not None:
                self._do(session.process.end())
                session.process = None
        finally:
            session._life = None
            session._runs.clear()
            if session.phase in ("starting", "running"):
                session.phase = "resting"

    def _fallen(self, session: Session, how: str) -> None:
        now = self._clock()
        session._falls = [fall for fall in session._falls if now - fall < WITHIN] + [now]
        session.crashes += 1
        log.warning("session crashed", session=session.called, how=how)
        if len(session._falls) >= CRASHES:
            raise WorkerError(f"its process has ended unexpectedly {CRASHES} times within a minute ({how})")
        session.told = f"its process ended unexpectedly ({how}); another one has begun its last scenario anew"

    async def _process(self, session: Session) -> Process:
        """The spare, or a new one; it has begun the session's scenario."""
        scenario, kept = session.scenario, None
        if not session.ran:
            self._forget(MOST_KEPT if self._register is None else MOST, ran=True)
            session.ran = True
        if self._register is not None:
            known = Known(session.name, session.watch, scenario)
            folder = await asyncio.to_thread(self._register.entered, known)
            kept = Kept(str(folder), "offered" if session.offers else "shown")
        spare, self._spare = self._spare, None
        process = None
        if spare is not None:
            with contextlib.suppress(WorkerError):
                process = await spare
        if process is None or not process.alive:
            process = await self._launch(scenario)
            process.begin(Begin(None, kept))
        else:
            process.begin(Begin(None if scenario == self._scenario else scenario, kept))
        self._started = self._clock()
        return process

    def _add(self, session: Session) -> Session:
        self._by_name[session.name] = self._by_watch[session.watch] = session
        return session

    def _forget(self, most: int, *, ran: bool) -> None:
        """Make room for one more beside `most` that rest: those that ran make room for one that runs only, so that
        calling again and again at the door costs nobody a session."""
        waiting = set(self._queue)
        every = self._by_name.values()
        resting = [s for s in every if s.ran == ran and s._life is None and s not in waiting]
        if len(resting) >= most:
            oldest = min(resting, key=lambda session: session.seen)
            del self._by_name[oldest.name], self._by_watch[oldest.watch]
            if self._register is not None and ran:
                self._do(asyncio.to_thread(self._register.forget, oldest.watch))


def _of_use(launch: asyncio.Task[Process]) -> bool:
    """Whether this launch, which is done, has led to a process that is there."""
    return not launch.cancelled() and launch.exception() is None and launch.result().alive


async def _end(launch: asyncio.Task[Process]) -> None:
    launch.cancel()
    with contextlib.suppress(asyncio.CancelledError, WorkerError):
        await (await launch).end()
