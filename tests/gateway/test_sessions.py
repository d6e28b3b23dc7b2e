"""Places, queue, spare, crashes and rest, with processes that are none and a clock that is turned by hand."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import closing
from functools import wraps
from pathlib import Path

import pytest

from app.access.session_messages import Begin, Changed, KeptFolder
from app.gateway import known_sessions, session_pool
from app.gateway.session import STALE, Session
from app.gateway.session_pool import SessionPool
from app.gateway.session_store import LINK, MOST, SessionStore
from app.gateway.visitors import NOBODY, Viewer, Visitor, VisitorLimit, VisitorLimits
from app.gateway.worker import WorkerError
from app.scenario.data import from_toml, load, to_toml
from app.session.autosave import StateFolder
from app.storage.session_index import StateError

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
        places: int,
        idle: float | None = 600.0,
        *,
        store: SessionStore | None = None,
        spare: bool = False,
        limits: VisitorLimits | None = None,
    ) -> None:
        self.now, self.made, self.broken = 1000.0, list[Fake](), False
        self._stored = store is not None
        self.pool = SessionPool(
            USUAL, self._launch, places, idle, store=store, spare=spare, limits=limits, clock=lambda: self.now
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


@in_a_loop
async def test_visitors_beyond_capacity_queue_and_expire() -> None:
    town = Town(places=2)
    a, b, c, d = (town.pool.new() for _ in range(4))
    assert [await town.wanted(s) for s in (a, b, c, d)] == ["running", "running", "waiting", "waiting"]
    assert [town.pool.place(s) for s in (a, c, d)] == [0, 1, 2]
    with town.pool.viewing(a, PAGE):
        for _ in range(30):  # c goes away, d keeps asking; b is looked at by nobody
            await town.pass_time(5.0)
            town.pool.want(d)
            town.pool.want(a)
        assert (c.phase, d.phase, b.phase, a.phase) == ("resting", "running", "resting", "running")
    assert len(town.made) == 3
    await town.pool.close()
    assert not any(process.alive for process in town.made)


@in_a_loop
async def test_a_page_that_sleeps_keeps_its_number_and_is_passed_over() -> None:
    town = Town(places=1, limits=VisitorLimits(waiting=VisitorLimit("sessions that wait", 2, 2, 2)))
    a, b, c, d = (town.pool.new() for _ in range(4))
    assert [await town.wanted(s) for s in (a, b, c, d)] == ["running", "waiting", "waiting", "resting"]
    assert town.pool.refusal(d) == "2 sessions that wait; allowed: no more"
    await town.pass_time(session_pool.SILENT + 1)
    town.pool.want(c)
    town.made[0].fall()
    a.closing = True
    await town.pass_time()
    await town.pass_time()
    assert (b.phase, c.phase) == ("waiting", "running")
    assert town.pool.place(b) == 1
    assert await town.wanted(d) == "waiting"
    await town.pass_time(session_pool.FORGOTTEN + 1)
    assert b.phase == "resting"
    await town.pool.close()
    assert await town.wanted(b) == "waiting"  # nothing begins any more
    assert len(town.made) == 2


@in_a_loop
async def test_a_session_that_nobody_looks_at_rests_with_its_scenario_and_comes_back_with_it() -> None:
    town = Town(places=1, idle=600.0)
    session = town.pool.new()
    await town.wanted(session)
    with town.pool.viewing(session, PAGE):
        town.made[0].emit("changed")
        await town.pass_time(10_000.0)
        assert session.phase == "running"
    await town.pass_time(599.0)
    assert session.phase == "running"
    await town.pass_time(2.0)
    assert (session.phase, town.made[0].alive, town.pool.taken) == ("resting", False, 0)
    assert await town.wanted(session) == "running"
    assert town.made[1].begun == "changed"
    assert session.crashes == 0


@in_a_loop
async def test_a_fall_is_told_and_mended_without_touching_the_others() -> None:
    town = Town(places=2)
    a, b = town.pool.new(), town.pool.new()
    await town.wanted(a), await town.wanted(b)
    first, other = town.made
    first.emit("as it was last")
    await town.pass_time()
    first.fall()
    await town.pass_time()
    assert (a.phase, a.crashes) == ("running", 1)
    assert "SIGKILL" in a.notice
    assert town.made[2].begun == "as it was last"
    assert (b.process, other.alive, b.crashes, b.notice) == (other, True, 0, "")


@in_a_loop
async def test_session_that_crashes_three_times_fails_until_restarted() -> None:
    town = Town(places=1)
    session, waiting = town.pool.new(), town.pool.new()
    session.scenario = "falls"
    await town.wanted(session)
    for _ in range(session_pool.CRASHES):
        town.made[-1].fall()
        await town.pass_time(1.0)
    assert session.phase == "failed"
    assert "3 times within a minute" in session.notice
    assert await town.wanted(session) == "failed"  # and a page that asks again does not begin it
    assert await town.wanted(waiting) == "running"  # its place is free
    town.pool.again(session)
    assert (session.phase, session.scenario) == ("waiting", USUAL)
    await town.pass_time(session_pool.UNSEEN + 1)  # nobody has ever looked at the other one
    town.pool.want(session)
    await town.pass_time()
    assert (session.phase, town.made[-1].begun) == ("running", USUAL)


@in_a_loop
async def test_a_session_whose_process_could_not_start_keeps_its_scenario_until_that_fails_too() -> None:
    town = Town(places=1)
    session = town.pool.new()
    await town.wanted(session)
    town.made[-1].emit("the visitor's own")
    await town.pass_time(session_pool.UNSEEN + 1)
    town.broken = True
    assert await town.wanted(session) == "failed"
    town.pool.again(session)
    await town.pass_time()
    assert (session.phase, session.scenario) == ("failed", "the visitor's own")
    town.broken = False
    town.pool.again(session)  # the scenario may be the reason: this time the usual one
    await town.pass_time()
    assert (session.phase, town.made[-1].begun) == ("running", USUAL)


@in_a_loop
async def test_a_crash_is_no_news_after_the_session_was_left_alone() -> None:
    town = Town(places=1)
    session = town.pool.new()
    await town.wanted(session)
    town.made[0].fall()
    await town.pass_time()
    assert "SIGKILL" in session.notice
    await town.pass_time(session_pool.UNSEEN + 1)
    assert (session.phase, session.notice) == ("resting", "")


@in_a_loop
async def test_a_spare_is_ready_beforehand_and_takes_no_place() -> None:
    town = Town(places=2, spare=True)
    await town.pass_time()
    assert [process.begun for process in town.made] == [""]
    a = town.pool.new()
    a.scenario = "another"
    assert await town.wanted(a) == "running"
    assert town.made[0].begun == "another"
    await town.pass_time(session_pool.SPARE_AFTER)
    assert len(town.made) == 2
    town.made[1].fall()  # a spare that has died is replaced, and never given away
    await town.pass_time(session_pool.SPARE_AFTER)
    assert await town.wanted(town.pool.new()) == "running"
    assert [process.begun for process in town.made] == ["another", "", USUAL]
    await town.pass_time(session_pool.SPARE_AFTER)
    assert len(town.made) == 3  # all places are taken: none is needed
    await town.pool.close()
    assert not any(process.alive for process in town.made)


@in_a_loop
async def test_a_process_that_cannot_begin_is_told() -> None:
    town = Town(places=1)
    town.broken = True
    session = town.pool.new()
    assert await town.wanted(session) == "failed"
    assert "could not begin" in session.notice
    assert town.pool.taken == 0


@in_a_loop
async def test_links_are_told_apart_and_only_resting_sessions_are_forgotten() -> None:
    town = Town(places=1)
    kept = town.pool.new()
    await town.wanted(kept)
    await town.looked_at(kept)
    town.made[0].fall()
    kept.closing = True
    await town.pass_time()
    assert kept.phase == "resting"
    await town.wanted(town.pool.new())
    asked = town.pool.new()
    assert await town.wanted(asked) == "waiting"
    await town.pass_time(session_pool.FORGOTTEN + 1)
    assert asked.phase == "resting"
    others = [town.pool.new() for _ in range(known_sessions.MOST_UNKEPT + 5)]
    assert town.pool.named(kept.name) is kept is town.pool.watched(kept.watch)  # somebody looked at it
    assert town.pool.named(asked.name) is None
    assert town.pool.named(others[0].name) is None
    assert town.pool.named(others[-1].name) is others[-1]
    assert town.pool.named(kept.watch) is None is town.pool.watched(kept.name)


def test_newcomers_displace_sessions_without_a_visitor_for_a_day_and_not_each_other(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(known_sessions, "MOST_UNKEPT", 3)

    @in_a_loop
    async def displace() -> None:
        town = Town(places=1)
        left = [town.pool.new() for _ in range(3)]
        for session in left:
            session.looked_at = True
        await town.pass_time(STALE)
        assert town.pool.named(town.pool.new().name) is not None
        assert all(town.pool.named(session.name) is session for session in left)  # not yet for so long
        await town.pass_time(1.0)
        newcomers = [town.pool.new() for _ in range(3)]
        assert [town.pool.named(session.name) for session in newcomers] == [*newcomers]
        assert not any(town.pool.named(session.name) for session in left)
        assert len(town.pool.sessions) <= 4

    displace()


def test_reopened_session_store_restores_sessions_and_links(tmp_path: Path) -> None:
    changed = to_toml(load("planar2r-semicircle"))
    links = list[tuple[str, str]]()

    @in_a_loop
    async def before() -> None:
        with closing(SessionStore(tmp_path)) as store:
            with pytest.raises(StateError, match="another server uses it"):
                SessionStore(tmp_path)
            town = Town(places=3, store=store)
            left = [town.pool.new() for _ in range(3)]
            left[1].scenario = "a copy"
            links.extend((session.name, session.watch) for session in left)
            for session in left[:2]:
                assert await town.wanted(session) == "running"
                assert not (tmp_path / session.watch).exists()
                await town.looked_at(session)
            for process, session in zip(town.made, left, strict=False):
                assert process.kept is not None
                assert process.kept.earlier == "shown"
                assert session.name not in process.kept.folder  # pages may show it, also to those who only watch
            with closing(StateFolder(tmp_path / left[0].watch)) as folder:
                folder.save(from_toml(changed), ())
            await town.pool.close()

    @in_a_loop
    async def after() -> None:
        deep = b'{"name": "a", "scenario": "", "more": ' + b"[" * 100_000
        for number, content in enumerate((b"", b"{}", b'{"name": "../..", "scenario": ""}', deep)):
            (tmp_path / f"broken{number}").mkdir()
            (tmp_path / f"broken{number}" / LINK).write_bytes(content)
        (tmp_path / "pipe").mkdir()
        os.mkfifo(tmp_path / "pipe" / LINK)
        with closing(SessionStore(tmp_path)) as store:
            pool = Town(places=3, store=store).pool
            known = [pool.named(name) for name, _ in links]
            assert [session and session.scenario for session in known] == [changed, "a copy", None]
            assert [pool.watched(watch) for _, watch in links] == known
            assert pool.watched("broken2") is None

            # where there is one for all, it begins as asked, and what was is offered until it has changed
            town = Town(places=1, store=store)
            everyone = town.pool.everyone()
            assert everyone.watch in dict(links).values()
            await town.looked_at(everyone)
            town.made[0].fall()
            await town.pass_time()
            town.made[1].emit("another")
            await town.pass_time()
            town.made[1].fall()
            await town.pass_time()
            assert [process.kept and process.kept.earlier for process in town.made] == ["offered", "offered", "shown"]
            assert [process.begun for process in town.made] == [USUAL, USUAL, "another"]
            await town.pool.close()

            for _ in range(MOST):
                pool.new()
            assert [pool.named(name) for name, _ in links] == known  # nobody loses anything by calls at the door
            crowded = Town(places=MOST, store=store)
            ran = [s for name, _ in links if (s := crowded.pool.named(name))]
            for _ in range(MOST - len(ran)):
                crowded.pool._known.add(Session(USUAL, kept=True, looked_at=True, seen=2000.0))
            new = crowded.pool.new()
            await crowded.wanted(new)
            assert [crowded.pool.named(s.name) for s in ran] == ran  # nor by a session that nobody looks at
            await crowded.looked_at(new)
            assert [crowded.pool.named(s.name) for s in ran] != ran  # but one that is looked at takes the oldest's room
            assert sum((tmp_path / watch).exists() for _, watch in links) == len(ran) - 1
            await crowded.pool.close()

    before()
    after()


def test_sessions_with_pinned_runs_stay_for_those_without(tmp_path: Path) -> None:
    @in_a_loop
    async def check(store: SessionStore) -> None:
        town = Town(places=4, store=store)
        pool, mine, theirs = town.pool, Visitor("b" * 22, "203.0.113.1"), Visitor("c" * 22, "203.0.113.2")
        for owner in (mine, *(theirs,) * (MOST - 1)):
            pool._known.add(Session(USUAL, owner=owner, pinned=1, kept=True, looked_at=True, seen=pool._clock()))
            town.now += 1.0
        oldest = next(iter(pool._known))
        new = pool.new(theirs)
        await town.looked_at(new)
        assert "none of them may go for it" in town.made[0].remarks[0]
        assert (new.kept, town.made[0].kept) == (False, None)
        town.made[0].emit(USUAL, pinned=1)
        await town.pass_time()
        assert new.kept  # with pinned runs of its own it takes the room of one of who has most, not of the oldest
        assert town.made[0].kept is not None
        assert pool.named(oldest.name) is oldest
        assert len([session for session in pool._known if session.kept]) == MOST
        await pool.close()

    with closing(SessionStore(tmp_path)) as store:
        check(store)
