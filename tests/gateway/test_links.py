"""Links to one session: what they open, and that they can be taken back."""

from __future__ import annotations

import asyncio
from contextlib import closing
from pathlib import Path
from typing import NamedTuple
from urllib.parse import parse_qs, urlsplit

import aiohttp
import pytest
from aiohttp import WSMsgType

from app.access.admission import Names, Tokens
from app.gateway.session_store import SessionStore
from drivers.town import HELLO, Town, town
from drivers.visitors import PATIENCE
from tests.hostile.test_hostile_visitors import at, in_a_loop

PUBLIC = Names(public=("https://lab.example.org",))
FAR = at("203.0.113.7")


class Links(NamedTuple):
    """As the Share button shows them, from the server's own address."""

    steer: str
    watch: str


async def links(lab: Town, path: str, **headers: str) -> Links:
    shown = (await lab.about(path, **headers))["links"]
    return Links(*(shown[kind].removeprefix("../..") for kind in ("steer", "watch")))


def bare(link: str) -> str:
    return urlsplit(link).path


def cookies(answer: aiohttp.ClientResponse) -> str:
    """As the browser that got this answer sends them back to the same path."""
    return "; ".join(f"{name}={morsel.value}" for name, morsel in answer.cookies.items())


async def come_in(lab: Town, link: str) -> str:
    """The cookies of a browser that has opened this link; the address is clean then."""
    answer = await lab.ask(link, **FAR)
    assert (answer.status, answer.headers["Location"]) == (303, "./")
    return cookies(answer)


@in_a_loop
async def test_a_link_to_steer_opens_its_session_and_nothing_else() -> None:
    tokens = Tokens()
    async with town(names=PUBLIC, tokens=tokens) as lab:
        own = {"Cookie": f"vsmrc-token-{lab.port}={tokens.steer}"}
        one, other = await lab.arrive(**own), await lab.arrive(**own)
        link = await links(lab, one, **own)
        assert tokens.steer not in link.steer + link.watch
        shown = await lab.ask(link.steer, **FAR)
        guest = {"Cookie": await come_in(lab, link.steer), **FAR}
        assert tokens.steer not in guest["Cookie"]
        # the session's token goes below its own path only: the browser's default, wherever a proxy has put that
        assert shown.cookies[f"vsmrc-steer-{lab.port}"]["path"] == ""
        assert shown.cookies[f"vsmrc-steer-{lab.port}"]["httponly"]

        page = await lab.looked_at(one, **guest)
        assert (await lab.ask(one, **guest)).status == 200
        assert (await lab.ask(f"{one}again", "POST", **guest)).status == 204
        assert (await lab.ask("/assets/overlay.js", **guest)).status == 200
        assert (await lab.ask(bare(link.watch), **guest)).status == 200
        assert await links(lab, one, **guest) == link  # it may pass on what it has
        assert not page.closed

        token = parse_qs(urlsplit(link.steer).query)["token"][0]
        for path, method in (("/", "GET"), (other, "GET"), (f"{other}about", "GET"), (f"{other}again", "POST"),
                             ("/metrics", "GET"), (f"{one}renew", "POST")):  # fmt: skip
            assert (await lab.ask(path, method, **guest)).status == 403, path
        for path in ("/", other, f"{bare(link.watch)}", "/s/guessed/", "/metrics"):
            assert (await lab.ask(f"{path}?token={token}", **FAR)).status == 403, path
        refused = await lab.client.get(lab.url(other), headers={"Cookie": guest["Cookie"], "Upgrade": "websocket"})
        assert refused.status == 403


@in_a_loop
async def test_revoked_links_open_nothing_and_close_their_pages() -> None:
    tokens = Tokens()
    async with town(names=PUBLIC, tokens=tokens) as lab, asyncio.timeout(PATIENCE):
        came = f"vsmrc-token-{lab.port}={tokens.steer}"
        front = await lab.ask("/", Cookie=came)
        path, own = "/" + front.headers["Location"], {"Cookie": f"{came}; {cookies(front)}"}
        other = await lab.looked_at(await lab.arrive(Cookie=came), Cookie=came)
        old = await links(lab, path, **own)
        guest = {"Cookie": await come_in(lab, old.steer), **FAR}
        student = {"Cookie": await come_in(lab, old.watch), **FAR}
        pages = [
            await lab.looked_at(path, **own),
            await lab.looked_at(path, **guest),
            await lab.looked_at(bare(old.watch), **student),
        ]

        led = await lab.ask(f"{path}renew", "POST", **own)
        new = led.headers["Location"].removeprefix("../..")
        for page in pages:
            end = await page.receive()
            assert (end.type, end.extra) == (WSMsgType.CLOSE, "this link was taken back; ask for a new one")
        for link, visitor in ((old.steer, guest), (old.watch, student), (old.steer, own), (old.watch, own)):
            for address in (bare(link), f"{bare(link)}about"):
                answer = await lab.ask(address, **visitor)
                assert answer.status == 404, address
                assert "it was taken back: ask for a new one" in await answer.text()
        afresh = await lab.ask(old.steer, **FAR)  # nor is its token worth anything to another browser
        assert (afresh.status, len(afresh.cookies)) == (403, 0)
        assert "or it was taken back" in await afresh.text()

        back = {"Cookie": f"{came}; {cookies(led)}"}
        assert (await lab.ask("/", **back)).headers["Location"] == new[1:]  # who has pressed comes back to it
        assert len(lab.actors) == 2  # the run goes on
        fresh = await links(lab, new, **back)
        assert not {*map(bare, old)} & {*map(bare, fresh)}
        assert (await lab.ask(new, **guest)).status == 403  # also where the new name is seen, on a projector
        for link in fresh:
            assert await lab.looked_at(bare(link), Cookie=await come_in(lab, link), **FAR)
        await other.send_bytes(HELLO)
        assert not other.closed


def relaying() -> int:
    """Number of tasks that relay pages, three for each."""
    names = [getattr(task.get_coro(), "__qualname__", "") for task in asyncio.all_tasks()]
    return sum(names.count(name) for name in ("_pass_on", "_pass_back", "Event.wait"))


@in_a_loop
async def test_pages_that_are_gone_leave_no_task_behind() -> None:
    async with town() as lab, asyncio.timeout(PATIENCE):
        path = await lab.arrive()
        stays, closed, aborted = [await lab.looked_at(path) for _ in range(3)]
        (session,) = lab.pool.sessions
        assert relaying() == 9
        await closed.close()
        connection = aborted._response.connection
        assert connection is not None
        assert connection.transport is not None
        connection.transport.abort()
        while len(session.pages) > 1:
            await asyncio.sleep(0.01)
        assert relaying() == 3
        await stays.close()


@in_a_loop
async def test_without_a_token_only_the_owner_takes_links_back() -> None:
    async with town() as lab:
        front = await lab.ask("/")
        path = "/" + front.headers["Location"]
        assert not (await lab.about(path))["renew"]
        assert (await lab.ask(f"{path}renew", "POST")).status == 403
        assert (
            await lab.ask(f"{path}renew", "POST", Cookie=cookies(front), Origin="http://evil.example")
        ).status == 403
        assert (await lab.about(path, Cookie=cookies(front)))["renew"]
        assert (await lab.ask(f"{path}renew", "POST", Cookie=cookies(front))).status == 303
        assert (await lab.ask(path)).status == 404


def test_links_taken_back_stay_so_after_a_restart_or_are_not_taken_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:

    @in_a_loop
    async def before() -> None:
        async with town(state=tmp_path) as lab:
            # a proxy asks for the token, say: the session is nobody's, as the one for all
            session = lab.pool.everyone()
            first = Links(f"/s/{session.name}/", f"/watch/{session.watch}/")
            await lab.looked_at(first.steer)
            while lab.actors[0].kept is None:
                await asyncio.sleep(0.01)
            with monkeypatch.context() as broken:
                broken.setattr(SessionStore, "enter", full)
                refused = await lab.ask(f"{first.steer}renew", "POST")
            assert (refused.status, await links(lab, first.steer)) == (503, first)
            assert "New ones cannot be kept on disk: No space left on device." in await refused.text()

            asked = [lab.ask(f"{first.steer}renew", "POST") for _ in range(3)]  # an impatient one
            statuses = sorted(answer.status for answer in await asyncio.gather(*asked))
            assert statuses[0] == 303
            session.pinned = 1  # and what is noted of it later on has the new links
            await lab.pool._known.folder(session)
            known.append((first, Links(f"/s/{session.name}/", f"/watch/{session.watch}/")))

    @in_a_loop
    async def after() -> None:
        async with town(state=tmp_path) as lab:
            ((first, last),) = known
            assert [(await lab.ask(link)).status for link in first] == [404, 404]
            assert [(await lab.ask(link)).status for link in last] == [200, 200]

    known = list[tuple[Links, Links]]()
    before()
    with closing(SessionStore(tmp_path)) as store:
        assert len(store.known()) == 1
    after()


def full(*_: object) -> None:
    raise OSError(28, "No space left on device")
