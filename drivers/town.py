"""Gateway for tests whose sessions are no processes: each records its messages, and answers pages by a web socket."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, closing, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import aiohttp
from aiohttp import WSMsgType, web

from app.access.admission import Names, Tokens
from app.access.session_messages import Answers, Begin, KeptFolder
from app.gateway.access_control import AccessSettings
from app.gateway.server import Gateway, serving
from app.gateway.session_pool import SessionPool
from app.gateway.session_store import SessionStore

PAGE = "<html><head></head><body></body></html>"
HELLO = b"hello"


class Actor:
    """Actor: the stand-in for the process of a session."""

    key, report_fields, late = "key", frozenset[str](), None

    def __init__(self, port: int) -> None:
        self.port, self.alive = port, True
        self.begun: Begin | None = None
        self.kept: KeptFolder | None = None
        self.answers: list[Answers] = []
        self._outbox: asyncio.Queue[Any] = asyncio.Queue()

    def begin(self, begin: Begin) -> None:
        self.begun, self.kept = begin, begin.kept

    def keep(self, kept: KeptFolder) -> None:
        self.kept = kept

    def remark(self, sentence: str) -> None:
        del sentence

    def answer(self, answers: Answers) -> None:
        self.answers.append(answers)

    async def changes(self) -> AsyncIterator[Any]:
        while (message := await self._outbox.get()) is not None:
            yield message

    def emit(self, message: object) -> None:
        self._outbox.put_nowait(message)

    async def end(self) -> str:
        self.alive = False
        self._outbox.put_nowait(None)
        return "ended by SIGKILL"


@dataclass
class Town:
    """Town: a gateway that answers at `port`, with its pool. actors: of its sessions, in the order of their start."""

    pool: SessionPool
    gateway: Gateway
    client: aiohttp.ClientSession
    port: int = 0
    actors: list[Actor] = field(default_factory=list)

    def url(self, path: str) -> str:
        return f"http://127.0.0.1:{self.port}{path}"

    async def ask(self, path: str, method: str = "GET", **headers: str) -> aiohttp.ClientResponse:
        named = {name.replace("_", "-"): value for name, value in headers.items()}
        answer = await self.client.request(method, self.url(path), headers=named, allow_redirects=False)
        await answer.read()
        return answer

    async def about(self, path: str, **headers: str) -> dict[str, Any]:
        return await (await self.ask(f"{path}about?wait", **headers)).json()

    async def looked_at(self, path: str, **headers: str) -> aiohttp.ClientWebSocketResponse:
        """Web socket of the page at this path, once its session runs."""
        while (await self.about(path, **headers))["phase"] != "running":
            await asyncio.sleep(0.01)
        page = await self.let_in(path, **headers)
        assert page is not None
        return page

    async def arrive(self, **headers: str) -> str:
        """Link of a visitor's own session, once it runs or waits."""
        path = "/" + (await self.ask("/", **headers)).headers["Location"]
        while (await self.about(path, **headers))["phase"] == "starting":
            await asyncio.sleep(0.01)
        return path

    async def open(self, path: str, **headers: str) -> aiohttp.ClientWebSocketResponse:
        named = {name.replace("_", "-"): value for name, value in headers.items()}
        return await self.client.ws_connect(self.url(path), headers=named)

    async def let_in(self, path: str, **headers: str) -> aiohttp.ClientWebSocketResponse | None:
        """Web socket of the page at this path, None where it is refused."""
        page = await self.open(path, **headers)
        return page if (await page.receive()).type is WSMsgType.BINARY else None


async def _session(request: web.Request) -> web.StreamResponse:
    if request.headers.get("Upgrade", "").lower() != "websocket":
        return web.Response(text=PAGE, content_type="text/html")
    page = web.WebSocketResponse()
    await page.prepare(request)
    await page.send_bytes(HELLO)
    async for _ in page:
        pass
    return page


@asynccontextmanager
async def town(
    capacity: int = 2,
    *,
    names: Names | None = None,
    tokens: Tokens | None = None,
    state: Path | None = None,
    copies: bool = True,
    serves: dict[str, Any] | None = None,
    **more: Any,
) -> AsyncIterator[Town]:
    """Context in which the gateway answers.
    state: folder that keeps sessions.
    serves: options of `app.gateway.server.serving`.
    more: options of `SessionPool`."""
    inner = web.Application()
    inner.router.add_get("/", _session)
    runner = web.AppRunner(inner, access_log=None, shutdown_timeout=0.1)
    await runner.setup()
    site = web.TCPSite(runner, "127.0.0.1", 0)
    await site.start()
    actors = list[Actor]()

    async def launch(_: str) -> Actor:
        actors.append(Actor(runner.addresses[0][1]))
        return actors[-1]

    store = SessionStore(state) if state is not None else None
    with closing(store) if store is not None else nullcontext():
        pool = SessionPool("usual", launch, capacity, 600.0, store=store, spare=False, **more)
        gateway = Gateway(pool, AccessSettings(names or Names(), tokens, copies=copies))
        # no cookie jar, as a test has several visitors: each request names its visitor's cookies
        client = aiohttp.ClientSession(cookie_jar=aiohttp.DummyCookieJar(), connector=aiohttp.TCPConnector(limit=0))
        try:
            async with client, serving(gateway, "127.0.0.1", 0, **serves or {}) as port:
                yield Town(pool, gateway, client, port, actors)
        finally:
            await runner.cleanup()
