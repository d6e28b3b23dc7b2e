"""Sessions on the disk: those of a server that has ended, and which go when there is no room."""

from __future__ import annotations

import os
from contextlib import closing
from pathlib import Path

import pytest

from app.gateway.session import Session
from app.gateway.session_store import LINK, MOST_STORED, SessionStore, StoredSession
from app.gateway.visitors import Visitor
from app.scenario.data import from_toml, load, to_toml
from app.session.autosave import StateFolder
from app.storage.session_index import StateError
from tests.support.sessions import USUAL, Town, in_a_loop


def test_reopened_session_store_restores_sessions_and_links(tmp_path: Path) -> None:
    changed = to_toml(load("planar2r-semicircle"))
    links = list[tuple[str, str]]()

    @in_a_loop
    async def before() -> None:
        with closing(SessionStore(tmp_path)) as store:
            with pytest.raises(StateError, match="another server uses it"):
                SessionStore(tmp_path)
            town = Town(capacity=3, store=store)
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
            pool = Town(capacity=3, store=store).pool
            known = [pool.named(name) for name, _ in links]
            assert [session and session.scenario for session in known] == [changed, "a copy", None]
            assert [pool.watched(watch) for _, watch in links] == known
            assert pool.watched("broken2") is None

            # where there is one for all, it begins as asked, and what was is offered until it has changed
            town = Town(capacity=1, store=store)
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

            for _ in range(MOST_STORED):
                pool.new()
            assert [pool.named(name) for name, _ in links] == known  # nobody loses anything by calls at the door
            crowded = Town(capacity=MOST_STORED, store=store)
            ran = [s for name, _ in links if (s := crowded.pool.named(name))]
            for _ in range(MOST_STORED - len(ran)):
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


def test_a_session_that_was_being_removed_is_removed_at_the_next_start(tmp_path: Path) -> None:
    with closing(SessionStore(tmp_path)) as store:
        folder = store.entered(StoredSession("a" * 22, "b" * 22, "", 0, "", "b" * 22))
        (folder / "run-1.npz").touch()
        os.replace(folder, tmp_path / f".gone-{folder.name}")  # a server that was killed in the middle
        assert store.known() == []
        assert not any(tmp_path.glob(".gone-*"))
        again = store.entered(StoredSession("a" * 22, "b" * 22, "", 0, "", "b" * 22))
        store.forget(again.name)
        assert not any(path.is_dir() for path in tmp_path.iterdir())


def test_sessions_with_pinned_runs_stay_for_those_without(tmp_path: Path) -> None:
    @in_a_loop
    async def check(store: SessionStore) -> None:
        town = Town(capacity=4, store=store)
        pool, mine, theirs = town.pool, Visitor("b" * 22, "203.0.113.1"), Visitor("c" * 22, "203.0.113.2")
        for owner in (mine, *(theirs,) * (MOST_STORED - 1)):
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
        assert len([session for session in pool._known if session.kept]) == MOST_STORED
        await pool.close()

    with closing(SessionStore(tmp_path)) as store:
        check(store)
