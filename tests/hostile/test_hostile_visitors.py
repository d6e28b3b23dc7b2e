"""What a red team tried on a shared server, each attack as a test: docs/security.md names them."""

from __future__ import annotations

import asyncio
import resource
import socket
import subprocess
import sys
from collections.abc import Awaitable, Callable
from functools import wraps
from pathlib import Path

import pytest

import drivers.town
from app.access.admission import Names, Tokens
from app.session.autosave import StateFolder
from drivers.town import HELLO, Town, town
from drivers.visitors import PATIENCE

pytestmark = pytest.mark.slow  # servers

PUBLIC = Names(public=("https://lab.example.org",))


def in_a_loop(test: Callable[..., Awaitable[None]]) -> Callable[..., None]:
    @wraps(test)
    def run(**fixtures: object) -> None:
        async def within() -> None:
            await test(**fixtures)

        asyncio.run(within())

    return run


def at(address: str) -> dict[str, str]:
    """Headers of who comes from there, through the proxy."""
    return {"X_Forwarded_For": address}


async def watch_link(town: Town, path: str) -> str:
    links = (await town.about(path))["links"]
    return links["watch"].removeprefix("../..").partition("?")[0]


# a watcher locks the presenter out


@in_a_loop
async def test_pages_that_watch_leave_room_for_those_that_steer() -> None:
    async with town() as lab:
        link = await lab.arrive()
        watch = await watch_link(lab, link)
        cookies = [f"vsmrc-visitor-{lab.port}={number:022d}" for number in range(80)]  # each another browser, it says
        watching = [await lab.let_in(watch, Cookie=cookie) for cookie in cookies]
        assert sum(page is not None for page in watching) == 48
        assert await lab.let_in(link) is not None


@in_a_loop
async def test_one_browser_and_one_address_have_their_share_of_the_pages_that_watch() -> None:
    async with town(names=PUBLIC) as lab:
        link = await lab.arrive()
        watch = await watch_link(lab, link)
        cookie = f"vsmrc-visitor-{lab.port}={7:022d}"
        own = [await lab.let_in(watch, Cookie=cookie) for _ in range(10)]
        assert sum(page is not None for page in own) == 6
        near = [await lab.let_in(watch, **at("203.0.113.7")) for _ in range(48)]
        assert sum(page is not None for page in near) == 32
        assert await lab.let_in(watch, **at("203.0.113.8")) is not None


# the token to watch opens a link to steer


@in_a_loop
async def test_the_token_to_watch_opens_no_link_to_steer_but_that_of_ones_own_copy() -> None:
    tokens = Tokens()
    async with town(names=PUBLIC, tokens=tokens) as lab:
        steers, watches = (f"vsmrc-token-{lab.port}={token}" for token in (tokens.steer, tokens.watch))
        path = "/" + (await lab.ask("/", Cookie=steers)).headers["Location"]
        links = (await lab.about(path, Cookie=steers))["links"]
        await lab.looked_at(path, Cookie=steers)
        for what in ("", "about"):
            assert (await lab.ask(path + what, Cookie=watches)).status == 403
        assert (await lab.ask(f"{path}again", "POST", Cookie=watches)).status == 403
        refused = await lab.client.get(lab.url(path), headers={"Cookie": watches, "Upgrade": "websocket"})
        assert refused.status == 403

        watch = links["watch"].removeprefix("../..").partition("?")[0]
        shown = await lab.ask(watch, Cookie=watches)
        visitor = f"vsmrc-visitor-{lab.port}={shown.cookies[f'vsmrc-visitor-{lab.port}'].value}"
        moved = await lab.ask(f"{watch}copy", "POST", Cookie=f"{watches}; {visitor}")
        copy = moved.headers["Location"].removeprefix("../..")
        assert (await lab.ask(copy, Cookie=f"{watches}; {visitor}")).status == 200
        await lab.looked_at(copy, Cookie=f"{watches}; {visitor}")
        assert (await lab.ask(copy, Cookie=watches)).status == 403
        shared = (await lab.about(copy, Cookie=f"{watches}; {visitor}"))["links"][
            "steer"
        ]  # of this copy: test_links.py
        assert tokens.steer not in shared


# a link to watch deletes everybody's kept sessions


@in_a_loop
async def test_copies_that_nobody_looks_at_take_no_folder_and_no_kept_session_away(tmp_path: Path) -> None:
    async with town(capacity=400, state=tmp_path) as lab:
        link = await lab.arrive()
        watch = await watch_link(lab, link)
        page = await lab.let_in(link)
        assert page is not None
        while lab.actors[0].kept is None:  # its folder is written, and it keeps itself there
            await asyncio.sleep(0.01)
        folder = Path(lab.actors[0].kept.folder)
        assert StateFolder(folder).offer() is None
        await page.close()
        for number in range(150):
            answer = await lab.ask(f"{watch}copy", "POST", Cookie=f"vsmrc-visitor-{lab.port}={number:022d}")
            if answer.status == 303:
                await lab.about(answer.headers["Location"].removeprefix("../.."))
        assert [path.name for path in tmp_path.iterdir() if path.is_dir()] == [folder.name]
        assert lab.pool.watched(folder.name) is not None


# one visitor takes all that is shared


@in_a_loop
async def test_one_visitor_does_not_take_the_queue_and_a_link_not_all_copies() -> None:
    async with town(capacity=1, names=PUBLIC) as lab:
        link = await lab.arrive(**at("203.0.113.1"))
        watch = await watch_link(lab, link)

        async def copies(count: int, **headers: str) -> int:
            answers = [await lab.ask(f"{watch}copy", "POST", **headers) for _ in range(count)]
            taken = [answer for answer in answers if answer.status == 303]
            for answer in taken:
                await lab.about(answer.headers["Location"].removeprefix("../.."), **headers)
            return len(taken)

        assert await copies(40, **at("203.0.113.66")) == 32
        browser = {"Cookie": f"vsmrc-visitor-{lab.port}={1:022d}"}
        assert await copies(10, **at("203.0.113.67"), **browser) == 4
        refused = await lab.ask(f"{watch}copy", "POST", **at("203.0.113.66"))
        assert refused.status == 429
        assert "32 private copies of one address; allowed: no more" in await refused.text()
        assert await copies(60, **at("203.0.113.68")) == 64 - 36  # of this link, from wherever
        arrived = [await lab.arrive(**at("203.0.113.66")) for _ in range(70)]
        waiting = [await lab.about(path) for path in arrived]
        assert sum(about["place"] > 0 for about in waiting) == 64 - 32  # its copies wait, too
        assert waiting[-1]["full"]
        assert "64 sessions that wait for a place of one address" in waiting[-1]["why"]
        late = await lab.about(await lab.arrive(**at("203.0.113.99")))
        assert late["place"] > 0


@in_a_loop
async def test_one_address_leaves_a_place_to_others() -> None:
    async with town(capacity=4, names=PUBLIC) as lab:
        for _ in range(6):
            await lab.arrive(**at("203.0.113.66"))
        assert lab.pool.taken == 3
        other = await lab.arrive(**at("203.0.113.99"))
        assert (await lab.about(other))["phase"] == "running"


@in_a_loop
async def test_copies_can_be_forbidden() -> None:
    async with town(copies=False) as lab:
        watch = await watch_link(lab, await lab.arrive())
        assert not (await lab.about(watch))["copy"]
        assert (await lab.ask(f"{watch}copy", "POST")).status == 403


# slow and silent connections


async def silent(town: Town, content: bytes = b"") -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    reader, writer = await asyncio.open_connection("127.0.0.1", town.port)
    writer.write(content)
    return reader, writer


@in_a_loop
async def test_a_request_that_does_not_come_is_not_waited_for() -> None:
    async with town(serves={"deadline": 0.3}) as lab, asyncio.timeout(PATIENCE):
        page = await lab.looked_at(await lab.arrive())
        for content in (b"", b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n", b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nA: "):
            reader, _ = await silent(lab, content)
            assert await reader.read() == b""  # closed
        await page.ping()
        assert not page.closed  # who is in, may be silent


@in_a_loop
async def test_silent_connections_keep_nobody_out_and_push_nobody_out() -> None:
    async with town(serves={"connections": 12}) as lab, asyncio.timeout(PATIENCE):
        link = await lab.arrive()
        inside = [await lab.looked_at(link) for _ in range(4)]
        hanging = [await silent(lab) for _ in range(60)]
        for _, (reader, _) in zip(range(48), hanging, strict=False):
            assert await reader.read() == b""
        inside.append(await lab.looked_at(link))
        for page in inside:
            await page.send_bytes(HELLO)
            assert not page.closed


@in_a_loop
async def test_visitors_who_do_not_read_their_answers_keep_nobody_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drivers.town, "PAGE", f"<html><head></head><body>{500_000 * ' '}</body></html>")
    async with town(serves={"connections": 12, "deadline": 0.3}) as lab, asyncio.timeout(PATIENCE):
        link = await lab.arrive()
        page = await lab.looked_at(link)
        asked = f"GET {link} HTTP/1.1\r\nHost: 127.0.0.1:{lab.port}\r\n\r\n".encode()
        deaf = []
        for _ in range(12):
            with socket.socket() as own:
                own.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
                own.connect(("127.0.0.1", lab.port))
                own.setblocking(False)
                deaf.append(own.dup())
            deaf[-1].send(20 * asked)  # more than the buffers of the system hold
        now = asyncio.get_running_loop().time
        while len(lab.gateway.read) < 11 or now() - max(lab.gateway.read.values()) < 0.4:  # with the page, all of them
            await asyncio.sleep(0.01)
        assert await lab.let_in(link) is not None
        await page.send_bytes(HELLO)
        assert not page.closed
        for own in deaf:
            own.close()


@pytest.mark.parametrize(
    ("arguments", "needed"),
    [
        (("--shared", "--max-sessions", "2"), "716 or more, for 2 sessions and their pages"),
        ((), "192 or more, for the session and its pages"),
    ],
)
def test_a_server_that_may_open_too_few_files_says_how_many_it_needs(arguments: tuple[str, ...], needed: str) -> None:
    def few() -> None:
        resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64))

    command = [sys.executable, "-m", "app", "serve", "--port", "0", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, preexec_fn=few, check=False)
    assert done.returncode == 2
    assert f"open files: 64 (ulimit -n); allowed: {needed}" in done.stderr
    assert "Traceback" not in done.stderr


# what whoever runs it sees, and nobody else


@in_a_loop
async def test_health_and_metrics_are_for_whoever_runs_the_server() -> None:
    tokens = Tokens()
    async with town(names=PUBLIC, tokens=tokens) as lab:
        steers, watches = (f"vsmrc-token-{lab.port}={token}" for token in (tokens.steer, tokens.watch))
        link = await lab.arrive(Cookie=steers)
        page = await lab.looked_at(link, Cookie=steers)
        for path in ("/healthz", "/metrics"):
            assert (await lab.ask(path)).status == 200  # by a program of this machine
            assert (await lab.ask(path, **at("203.0.113.7"))).status == 403
            assert (await lab.ask(path, Host="lab.example.org")).status == 403
            assert (await lab.ask(path, Cookie=watches, **at("203.0.113.7"))).status == 403
            assert (await lab.ask(path, Authorization=f"Bearer {tokens.steer}", **at("203.0.113.7"))).status == 200
        assert (await lab.ask("/", Authorization=f"Bearer {tokens.steer}")).status == 403  # it opens nothing else
        answer = await lab.ask("/metrics")
        assert answer.headers["Content-Type"] == "text/plain; version=0.0.4"
        text = await answer.text()
        assert text.splitlines()[:2] == ["# HELP vsmrc_sessions Sessions by phase.", "# TYPE vsmrc_sessions gauge"]
        values = dict(line.rsplit(" ", 1) for line in text.splitlines() if not line.startswith("#"))
        assert values['vsmrc_sessions{phase="running"}'] == "1"
        assert values['vsmrc_pages{kind="steer"}'] == "1"
        assert values["vsmrc_places"] == "2"
        assert values['vsmrc_refusals_total{reason="no token"}'] == "5"
        assert link.split("/")[-2] not in text
        await page.close()
    async with town() as lab:
        assert (await lab.ask("/metrics")).status == 200
        assert (await lab.ask("/metrics", **at("203.0.113.7"))).status == 403
