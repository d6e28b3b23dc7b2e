"""Session pool: the sessions, their processes, and the queue of those that wait for a place; no page and no socket
here."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Callable, Coroutine, Iterator

import structlog

from app.access.session_messages import Answers, Asks, Begin
from app.gateway.known_sessions import KnownSessions
from app.gateway.session import Process, Session
from app.gateway.session_store import MOST_STORED, SessionStore
from app.gateway.visitors import NOBODY, Viewer, Visitor, VisitorLimits, visitor_limit
from app.gateway.worker import WorkerError

log = structlog.get_logger()

SILENT = 15.0  # s: a waiting session that nobody has asked for in that time gets no place
FORGOTTEN = 120.0  # s: it leaves the queue if nobody asks for it in that time; a locked phone asks for nothing
UNSEEN = 60.0  # s: a process that nobody ever looked at is closed
HURRIED = 120.0  # s: while others wait, a session that nobody looks at loses its place after so long
CRASHES, WITHIN = 3, 60.0  # after that many crashes of its process within that many s a session is given up
SPARE_AFTER = 2.0  # s from the start of a process to that of the spare: a page that is being loaded comes first
UNKEPT = f"this session is not kept on disk: {MOST_STORED} others are, and none of them may go for it"


class Excess(Exception):
    """Refusal of what is more than a visitor may have: one sentence."""


class SessionPool:
    """Session pool: sessions and their processes, at most `capacity` of them at once; all in one event loop.

    scenario: TOML of a new session.
    launch: makes a process with this scenario ready.
    idle: idle timeout, s after which a session that nobody looks at is closed, its scenario kept, None for never.
    store: where sessions are kept beyond the life of the pool, None for nowhere.
    spare: have a process ready in advance.
    classes: whether lessons may ask a class.
    limits: limits of one visitor.
    of_one_address: sessions that one address may run, see `visitor_limit`.
    """

    def __init__(
        self,
        scenario: str,
        launch: Callable[[str], Coroutine[None, None, Process]],
        capacity: int,
        idle: float | None,
        *,
        store: SessionStore | None = None,
        spare: bool = True,
        limits: VisitorLimits | None = None,
        of_one_address: int | None = None,
        classes: bool = False,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._scenario, self._launch, self.capacity, self._idle = scenario, launch, capacity, idle
        self._wants_spare, self._clock = spare, clock
        self.classes = classes
        self.limits, self._visitor_limit = limits or VisitorLimits(), visitor_limit(capacity, of_one_address)
        self._queue: list[Session] = []
        self._spare: asyncio.Task[Process] | None = None
        self._doing: set[asyncio.Task[object]] = set()
        self._closed = False
        self.crashes = 0
        self._started = clock() - SPARE_AFTER
        self._known = KnownSessions(store, self._do, clock())

    @property
    def taken(self) -> int:
        """Number of sessions that run, or are about to begin or end."""
        return sum(session.life is not None for session in self._known)

    @property
    def sessions(self) -> list[Session]:
        """All known sessions."""
        return list(self._known)

    def crowded(self, session: Session, viewer: Viewer) -> str:
        """Reason why this page cannot be opened as well; "" where it can."""
        limits, everywhere = self.limits, self._known
        limit = limits.steering if viewer.kind == "steer" else limits.watching
        refusal = limit.refusal(viewer.visitor, session.visitors(viewer.kind))
        if not refusal and viewer.kind == "watch":
            watching = [visitor for each in everywhere for visitor in each.visitors("watch")]
            refusal = limits.all_watching.refusal(viewer.visitor, watching)
        every = [visitor for each in everywhere for visitor in each.visitors("steer", "watch")]
        return refusal or limits.pages.refusal(viewer.visitor, every)

    def named(self, name: str) -> Session | None:
        return self._known.named(name)

    def watched(self, name: str) -> Session | None:
        return self._known.watched(name)

    def new(self, owner: Visitor = NOBODY) -> Session:
        """New resting session with the usual scenario."""
        return self._entered(Session(self._scenario, owner=owner))

    def copy(self, original: Session, owner: Visitor) -> Session:
        """New resting session with the scenario of this one. Raises Excess."""
        now, every = self._clock(), self._known
        copies = [s for s in every if s.original and (s.phase in _ASKING or now - s.seen < FORGOTTEN)]
        of_it = [copy.owner for copy in copies if copy.original == original.folder]
        refusal = self.limits.link_copies.refusal(owner, of_it)
        if refusal := refusal or self.limits.copies.refusal(owner, [copy.owner for copy in copies]):
            raise Excess(refusal)
        return self._entered(Session(original.scenario, owner=owner, original=original.folder))

    def _entered(self, session: Session) -> Session:
        session.seen = now = self._clock()
        self._known.make_room(session, kept=False, waiting=self._queue, now=now)
        return self._known.add(session)

    def everyone(self) -> Session:
        """The session of a pool that has one for all visitors: it keeps its earlier links and has the usual
        scenario."""
        session = next(iter(self._known), None) or self.new()
        session.scenario, session.offers = self._scenario, True
        return session

    def refusal(self, session: Session) -> str:
        """Reason why this session can neither run nor wait, or goes on waiting although there is room; "" where it
        may run."""
        if session.phase == "resting" and self.taken >= self.capacity:
            return self.limits.waiting.refusal(session.owner, [waiting.owner for waiting in self._queue])
        if session.phase in ("resting", "waiting") and self.taken < self.capacity:
            return self._visitor_limit.refusal(session.owner, self._holders)
        return ""

    @property
    def _holders(self) -> list[Visitor]:
        """Owners of the sessions that have a place."""
        return [session.owner for session in self._known if session.life is not None]

    def want(self, session: Session) -> None:
        """Request a session, for a visitor: run it, or keep its place in the queue, unless that place is due to
        others."""
        session.requested = session.seen = self._clock()
        waiting = [each.owner for each in self._queue]
        if session.phase == "resting" and not self.limits.waiting.refusal(session.owner, waiting):
            session.phase = "waiting"
            self._queue.append(session)
            self._advance()

    async def soon(self, session: Session, patience: float) -> bool:
        """Whether the session runs, or will within `patience` s: with a spare process it does."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(patience):
                await session.runs.wait()
        return session.phase == "running"

    def queue_position(self, session: Session) -> int:
        """Place in the queue, from 1; 0 for a session that does not wait."""
        return self._queue.index(session) + 1 if session in self._queue else 0

    def again(self, session: Session) -> None:
        """Begin a failed session anew: with its own scenario where that is not the reason, else with the usual one."""
        if session.phase == "failed":
            session.phase, session.notice = "resting", ""
            if session.crash_times or session.retried:
                session.scenario, session.offers = self._scenario, session.kept
            session.retried = not session.crash_times
            session.crash_times.clear()
            self.want(session)

    async def renew(self, session: Session) -> None:
        """Renew the links: the old ones lead nowhere, and the pages that they have opened are closed.

        Raises OSError where the new links cannot be kept on disk. Then the links stay as they were, because the old
        ones would open the session again after the next start.
        """
        await asyncio.shield(self._do(self._renewed(session)))  # as a whole, also where the caller stops waiting

    async def _renewed(self, session: Session) -> None:
        if await self._known.renew(session):
            taken_back, session.taken_back = session.taken_back, asyncio.Event()
            taken_back.set()
            log.info("new links", session=session.log_name, pages=len(session.pages))

    @contextlib.contextmanager
    def viewing(self, session: Session, viewer: Viewer) -> Iterator[None]:
        """Context of an open page; from the first page on, the session is kept on disk."""
        session.pages.append(viewer)
        if not session.opened:
            session.opened = session.looked_at = True
            self._do(self._keep(session))
        try:
            yield
        finally:
            session.pages.remove(viewer)
            session.seen = self._clock()

    def tick(self) -> None:
        """Update the pool, to be called each second: close unseen sessions, advance the queue, launch a spare
        process."""
        for session in self._known:
            if session.phase == "running" and not session.pages and self._unseen(session) and session.process:
                log.info("session closed", session=session.log_name, reason="nobody looks at it")
                session.closing = True
                session.phase, session.notice = "resting", ""  # a crash is no news any more
                session.process, process = None, session.process
                self._do(process.end())
        self._advance()
        if self._spare is not None and self._spare.done() and not _of_use(self._spare):
            self._spare = None
        wanted = self._wants_spare and not self._closed and self._spare is None and self.taken < self.capacity
        if wanted and self._clock() - self._started >= SPARE_AFTER:
            self._started = self._clock()  # a launch that fails is not tried again at once either
            self._spare = asyncio.create_task(self._launch(self._scenario))

    async def close(self) -> None:
        """End every process, and start no other one; returns when they have ended."""
        self._closed = True
        lives = [session.life for session in self._known if session.life is not None]
        if self._spare is not None:
            lives.append(asyncio.create_task(_end(self._spare)))
        for session in self._known:
            session.closing = True
            if session.process is not None:
                self._do(session.process.end())
            elif session.life is not None:
                session.life.cancel()
        await asyncio.gather(*lives, *self._doing, return_exceptions=True)

    def _unseen(self, session: Session) -> bool:
        if self._idle is None:
            return False
        least = self._idle if session.opened else min(UNSEEN, self._idle)
        if self._queue and self.taken >= self.capacity:  # some wait for their visitor's own share only
            least = min(least, HURRIED)
        return self._clock() - session.seen > least

    def _do(self, what: Coroutine[None, None, object]) -> asyncio.Task[object]:
        """Start a background task; only the end of the pool waits for it."""
        task = asyncio.create_task(what)
        self._doing.add(task)
        task.add_done_callback(self._doing.discard)
        return task

    def _advance(self) -> None:
        now, waiting = self._clock(), list[Session]()
        for session in self._queue:
            if now - session.requested > FORGOTTEN:
                session.phase = "resting"
            elif self._may_begin(session, now):
                session.phase, session.closing, session.opened = "starting", False, False
                session.life = asyncio.create_task(self._live(session))
            else:
                waiting.append(session)
        self._queue = waiting

    def _may_begin(self, session: Session, now: float) -> bool:
        # a session that is being closed may begin again once it is closed
        asks = session.life is None and now - session.requested <= SILENT
        free = not self._closed and self.taken < self.capacity
        return asks and free and not self._visitor_limit.refusal(session.owner, self._holders)

    async def _live(self, session: Session) -> None:
        """Life of a session, from its place in the pool to its end, over as many processes as it takes."""
        try:
            while not session.closing:
                session.phase = "starting"
                process = await self._process(session)
                session.process, session.phase, session.seen = process, "running", self._clock()
                session.retried = False
                session.runs.set()
                log.info("session opened", session=session.log_name, sessions=self.taken)
                async for changed in process.changes():
                    if isinstance(changed, Asks):
                        if session.hands_over_soon and session.classroom.given:  # a new question would delete them
                            process.answer(Answers(session.classroom.number, session.classroom.given))
                        session.classroom.ask(changed.question)
                        if session.classroom.given:
                            process.answer(Answers(session.classroom.number, session.classroom.given))
                        continue
                    session.scenario, session.offers, session.pinned = changed.scenario, False, changed.pinned
                    if changed.pinned and not session.kept:
                        self._do(self._keep(session))
                session.runs.clear()
                how = await process.end()
                session.process = None
                if not session.closing:
                    self._fallen(session, how)
        except WorkerError as error:
            session.phase, session.notice = "failed", str(error)
            log.warning("session given up", session=session.log_name, reason=str(error))
        except Exception as error:  # a fault of this program ends the session, and is reported
            session.phase, session.notice = "failed", f"the server could not look after it ({type(error).__name__})"
            log.error("fault", stage="a session", session=session.log_name, exc_info=error)
            if session.process is not None:
                self._do(session.process.end())
                session.process = None
        finally:
            session.life = None
            session.runs.clear()
            if session.phase in ("starting", "running"):
                session.phase = "resting"

    def _fallen(self, session: Session, how: str) -> None:
        now = self._clock()
        session.crash_times = [fall for fall in session.crash_times if now - fall < WITHIN] + [now]
        session.crashes += 1
        self.crashes += 1
        log.warning("session crashed", session=session.log_name, how=how)
        if len(session.crash_times) >= CRASHES:
            raise WorkerError(f"its process has ended unexpectedly {CRASHES} times within a minute ({how})")
        session.notice = f"its process ended unexpectedly ({how}); another one has begun its last scenario anew"

    async def _process(self, session: Session) -> Process:
        """The spare process, or a new one; it has begun the session's scenario."""
        scenario, kept = session.scenario, await self._known.folder(session) if session.kept else None
        spare, self._spare = self._spare, None
        process = None
        if spare is not None:
            with contextlib.suppress(WorkerError):
                process = await spare
        if process is None or not process.alive:
            process = await self._launch(scenario)
            changed = None
        else:
            changed = None if scenario == self._scenario else scenario
        process.begin(Begin(changed, kept, session.owner.marks, self.classes, session.classroom.number))
        self._started = self._clock()
        return process

    async def _keep(self, session: Session) -> None:
        """Let the process of a session that somebody looks at keep it in a folder from now on, if there is room."""
        if not self._known.on_disk or session.kept or (process := session.process) is None:
            return
        if not self._known.make_room(session, kept=True, waiting=self._queue, now=self._clock()):
            process.remark(UNKEPT)
            return
        session.kept = True
        kept = await self._known.folder(session)
        if kept is not None and session.process is process:  # another process has begun with the folder
            process.keep(kept)


_ASKING = ("waiting", "starting", "running")


def _of_use(launch: asyncio.Task[Process]) -> bool:
    """Whether this launch, which is done, has led to a process that is alive."""
    return not launch.cancelled() and launch.exception() is None and launch.result().alive


async def _end(launch: asyncio.Task[Process]) -> None:
    launch.cancel()
    with contextlib.suppress(asyncio.CancelledError, WorkerError):
        await (await launch).end()
