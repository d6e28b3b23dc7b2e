"""Places, queue, spare, crashes and rest, with processes that are none and a clock that is turned by hand."""

from __future__ import annotations

import pytest

from app.gateway import known_sessions, session_pool
from app.gateway.session import STALE
from app.gateway.visitors import VisitorLimit, VisitorLimits
from tests.support.sessions import PAGE, USUAL, Town, in_a_loop


@in_a_loop
async def test_visitors_beyond_capacity_queue_and_expire() -> None:
    town = Town(capacity=2)
    a, b, c, d = (town.pool.new() for _ in range(4))
    assert [await town.wanted(s) for s in (a, b, c, d)] == ["running", "running", "waiting", "waiting"]
    assert [town.pool.queue_position(s) for s in (a, c, d)] == [0, 1, 2]
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
    town = Town(capacity=1, limits=VisitorLimits(waiting=VisitorLimit("sessions that wait", 2, 2, 2)))
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
    assert town.pool.queue_position(b) == 1
    assert await town.wanted(d) == "waiting"
    await town.pass_time(session_pool.FORGOTTEN + 1)
    assert b.phase == "resting"
    await town.pool.close()
    assert await town.wanted(b) == "waiting"  # nothing begins any more
    assert len(town.made) == 2


@in_a_loop
async def test_a_session_that_nobody_looks_at_rests_with_its_scenario_and_comes_back_with_it() -> None:
    town = Town(capacity=1, idle=600.0)
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
    town = Town(capacity=2)
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
    town = Town(capacity=1)
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
    town = Town(capacity=1)
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
    town = Town(capacity=1)
    session = town.pool.new()
    await town.wanted(session)
    town.made[0].fall()
    await town.pass_time()
    assert "SIGKILL" in session.notice
    await town.pass_time(session_pool.UNSEEN + 1)
    assert (session.phase, session.notice) == ("resting", "")


@in_a_loop
async def test_a_spare_is_ready_beforehand_and_takes_no_place() -> None:
    town = Town(capacity=2, spare=True)
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
    town = Town(capacity=1)
    town.broken = True
    session = town.pool.new()
    assert await town.wanted(session) == "failed"
    assert "could not begin" in session.notice
    assert town.pool.taken == 0


@in_a_loop
async def test_links_are_told_apart_and_only_resting_sessions_are_forgotten() -> None:
    town = Town(capacity=1)
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
        town = Town(capacity=1)
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
