"""Server in front of the sessions: access control, the session of each path, and the way to its process.

    /                    a session of one's own: leads to its link
    /s/NAME/             a session, to steer
    /watch/NAME/         the same, to look at; NAME is another one
    .../about            state of the session, as JSON
    /s/NAME/again        POST: begin a session anew that has failed
    /s/NAME/renew        POST: new links for the session; the old ones are taken back
    /watch/NAME/copy     POST: a session of one's own with the same scenario
    /class/NAME/         questions of a lesson to a class, for whoever may watch; NAME is that of /watch/
    /class/NAME/question the present one, as JSON
    /class/NAME/answer   POST: the answer to it, as JSON
    /s/NAME/qr           QR code of a link to the class
    /assets/...          files that the gateway's own pages load
    /healthz, /metrics   state of the server, for its operator; a server for oneself has the first one, too

All links within are relative, so that a proxy may put the whole below any path.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass, field, replace
from typing import Any

import aiohttp
import msgspec
import structlog
from aiohttp import WSCloseCode, web

from app.access.admission import KEY_HEADER, YEAR, Names, Pass, PortTaken, Tokens, session_token_cookie, token_cookie
from app.access.classroom import AnswerRefusal
from app.access.rate_limits import ConnectionLimits, ConnectionRateLimiter, harmless
from app.access.session_messages import Answers
from app.gateway import pages
from app.gateway.connections import ARRIVING, DEADLINE, Door
from app.gateway.metrics import TYPE, metrics
from app.gateway.relay import ANSWER, closed, relay
from app.gateway.responses import ApplicationRunner, with_headers
from app.gateway.session import Session
from app.gateway.session_pool import HURRIED, Excess, SessionPool
from app.gateway.visitor_origin import asks_status, is_local, port_of, visitor_cookie, visitor_of
from app.gateway.visitors import Viewer, Visitor
from app.process.redaction import new_secret

log = structlog.get_logger()

TICK = 1.0  # s
FAREWELL = 0.1  # s, twice: at the end, for pages whose sessions have ended; their last messages are not read
GATHERED = 0.1  # s that answers of a class wait for others: each time all of them are handed over
WAITS = 0.5  # s that a page is kept waiting for its session, rather than being told to wait
_PASS = web.RequestKey("pass", str)
_GREETING = web.RequestKey("greeting", str)
_QUERIED = ("/about", "/qr")  # what is asked there may stand behind a '?'
LONGEST_LINK = 500
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


@dataclass(frozen=True)
class AccessSettings:
    """Settings of access control.
    names: names of the server.
    tokens: tokens that visitors have to show, None for none.
    everyone: the session that all who may steer share, None when each has one of their own.
    limits: of each connection, and of the pages of a session.
    copies: whether visitors who watch may take a private copy."""

    names: Names
    tokens: Tokens | None = None
    everyone: Session | None = None
    limits: ConnectionLimits = field(default_factory=ConnectionLimits)
    copies: bool = True


class Gateway:
    """Gateway: the web application for `aiohttp.web`. answered: the connections whose request is being answered."""

    def __init__(self, pool: SessionPool, access_settings: AccessSettings) -> None:
        self._pool, self._access_settings = pool, access_settings
        self._copies = access_settings.copies and access_settings.everyone is None
        self._refusals = Counter[str]()
        self.answered = set[asyncio.BaseTransport]()
        self._document: pages.Document | None = None
        self._client: aiohttp.ClientSession | None = None
        self.app = web.Application(middlewares=[self._guard], client_max_size=64 * 1024)
        self.app.cleanup_ctx.append(self._living)
        self.app.on_shutdown.append(self._end)
        self.app.on_response_prepare.append(with_headers)
        self.app.add_routes(
            [
                web.get("/", self._front),
                web.get("/assets/{name}", self._asset),
                web.get("/healthz", self._health),
                web.get("/metrics", self._metrics),
                web.get("/{kind:s|watch}/{name}", self._session),
                web.get("/{kind:s|watch}/{name}/", self._session),
                web.get("/{kind:s|watch}/{name}/about", self._about),
                web.get("/{kind:s}/{name}/qr", self._qr),
                web.get("/class/{name}", self._class),
                web.get("/class/{name}/", self._class),
                web.get("/class/{name}/question", self._question),
                web.post("/class/{name}/answer", self._answer_question),
                web.post("/{kind:s}/{name}/again", self._again),
                web.post("/{kind:s}/{name}/renew", self._renew),
                web.post("/watch/{name}/copy", self._copy),
            ]
        )

    @property
    def most_pages(self) -> int:
        """Largest number of pages that are open at once."""
        return self._pool.shares.pages.total

    async def _living(self, _: web.Application) -> AsyncIterator[None]:
        async with aiohttp.ClientSession(connector=aiohttp.TCPConnector(limit=0)) as self._client:
            ticking = asyncio.create_task(self._tick())
            yield
            ticking.cancel()

    async def _end(self, _: web.Application) -> None:
        """End the sessions, before the server waits for the pages: they end with their sessions."""
        await self._pool.close()

    async def _tick(self) -> None:
        while True:
            if self._access_settings.everyone is not None:
                self._pool.want(self._access_settings.everyone)
            self._pool.tick()
            await asyncio.sleep(TICK)

    # who may come in

    @web.middleware
    async def _guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        transport = request.transport
        if transport is None:
            raise web.HTTPBadRequest  # nobody is there any more
        self.answered.add(transport)
        try:
            return await self._answer(request, handler)
        finally:
            self.answered.discard(transport)

    async def _answer(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        socket = _is_socket(request)
        refusal = self._access_settings.names.refusal(
            request.headers, acting=socket or request.method not in ("GET", "HEAD")
        )
        if refusal:
            self._refusals["foreign name or page"] += 1
            log.info("request refused", reason=refusal.sentence)
            return _notice("This request is refused", refusal.sentence, refusal.status)
        response = self._without_token(request)
        if response is None and request.query_string and not socket and not request.path.endswith(_QUERIED):
            # viser's page would read another server's address from the query, and run the scripts of that server
            response = _to_clean(request)
        if response is None:
            response = self._not_steered(request)
        if response is None:
            try:
                response = await handler(request)
            except web.HTTPException as error:
                sentence = "The link is not complete, or it was taken back: ask for a new one."
                response = _notice("There is nothing here", sentence, error.status)
        if not response.prepared and (greeting := request.get(_GREETING)):
            self._remember(response, request, visitor_cookie(request), greeting)
        return response

    def _without_token(self, request: web.Request) -> web.StreamResponse | None:
        """Answer to a visitor without a token; None for one who has shown a token, now or before, or need not."""
        tokens = self._access_settings.tokens
        if tokens is None:
            request[_PASS] = "steer"
            return None
        cookie, said = token_cookie(port_of(request)), request.query.get("token", "")
        known, shown = tokens.opens(request.cookies.get(cookie, "")), tokens.opens(said)
        if of_session := self._opens_session(request, said):
            shown = "watch"  # beside this session, what its link to watch opens, which its page shows
        if asks_status(request):  # as Prometheus shows it
            known = known or tokens.opens(request.headers.get("Authorization", "").removeprefix("Bearer "))
        kind: Pass | None = "steer" if "steer" in (known, shown) else known or shown
        if kind is None and asks_status(request) and is_local(request):
            kind = "steer"  # whoever runs the server, on its machine
        if kind is None:
            self._refusals["no token"] += 1
            log.info("request refused", reason="no token, or a wrong one")
            missing = "this one is not complete, or it was taken back" if said else "as it was printed at the start"
            return _notice("Please come in by the link", f"This server needs the link with its token; {missing}.", 403)
        request[_PASS] = kind
        if shown is None or _is_socket(request):
            return None
        response = _to_clean(request)
        self._remember(response, request, cookie, tokens.of(kind))
        if of_session:
            # by default a browser sends it to this session's addresses only, wherever a proxy has put them
            self._remember(response, request, session_token_cookie(port_of(request)), said, path="")
        return response

    def _opens_session(self, request: web.Request, shown: str) -> bool:
        """Whether this is the token to steer the session that is asked for."""
        tokens, name = self._access_settings.tokens, request.match_info.get("name", "")
        asked = request.match_info.get("kind") == "s" and self._pool.named(name) is not None
        return tokens is not None and asked and tokens.opens_session(name, shown)

    def _not_steered(self, request: web.Request) -> web.StreamResponse | None:
        """Refusal of a request to steer; None for visitors who may steer (with the pass for it or the session's own
        token, or as the owner of a copy), for requests that do not steer, and where there is no such session."""
        if request[_PASS] == "steer" or request.match_info.get("kind") != "s":
            return None
        session = self._pool.named(request.match_info["name"])
        shown = (request.query.get("token", ""), request.cookies.get(session_token_cookie(port_of(request)), ""))
        if session is None or self._owns(request, session) or any(self._opens_session(request, s) for s in shown):
            return None
        self._refusals["pass to watch"] += 1
        log.info("request refused", reason="steering asked for with the pass to watch")
        return _notice("This link is for steering", "To steer, ask for the link with the token to steer.", 403)

    def _owns(self, request: web.Request, session: Session) -> bool:
        """Whether the session was made for the browser that asks."""
        browser = visitor_of(request, self._access_settings.names).browser
        return bool(browser) and browser == session.owner.browser

    def _may_renew(self, request: web.Request, session: Session) -> bool:
        """Whether the visitor may take links back: the owner of the session, and visitors with the token to steer
        everything. Without a token, only the owner, if there is one, so that no guest can."""
        above = self._access_settings.tokens is not None or not session.owner.browser
        return self._owns(request, session) or (request[_PASS] == "steer" and above)

    def _greeted(self, request: web.Request) -> Visitor:
        """Visitor of a request; the answer sets a cookie by which to recognize the browser, unless it has one."""
        visitor = visitor_of(request, self._access_settings.names)
        if not visitor.browser:
            visitor = visitor._replace(browser=new_secret(16))
            request[_GREETING] = visitor.browser
        return visitor

    def _remember(
        self, response: web.StreamResponse, request: web.Request, cookie: str, value: str, path: str = "/"
    ) -> None:
        secure = request.secure or self._access_settings.names.encrypted(request.host)
        response.set_cookie(cookie, value, max_age=YEAR, httponly=True, samesite="Lax", secure=secure, path=path)

    # the handlers

    async def _front(self, request: web.Request) -> web.StreamResponse:
        """Redirect to the visitor's session; a new one takes no place before its page is loaded."""
        if request[_PASS] != "steer":
            return _notice("No session of your own", "For one, ask for the link with the token to steer.", 403)
        if request.headers.get("Sec-Fetch-Dest", "document") != "document":  # a picture on a foreign page, say
            return _notice("This request is refused", "Sec-Fetch-Dest is not a page; allowed: document", 403)
        cookie = f"vsmrc-session-{port_of(request)}"
        visitor = self._greeted(request)
        session = (
            self._access_settings.everyone
            or self._pool.named(request.cookies.get(cookie, ""))
            or self._pool.new(visitor)
        )
        response = web.Response(status=303, headers={"Location": f"s/{session.name}/"})
        self._remember(response, request, cookie, session.name)
        return response

    async def _session(self, request: web.Request) -> web.StreamResponse:
        if _is_socket(request):
            if not _is_plain(request):
                raise web.HTTPBadRequest
            return await self._socket(request)
        session = self._meant(request)
        if not request.path.endswith("/"):
            return web.Response(status=303, headers={"Location": f"{request.match_info['name']}/"})
        self._greeted(request)
        self._pool.want(session)
        if await self._pool.soon(session, WAITS) and (document := await self._page(session)):
            return _sent(document, request)
        return _html(pages.waiting())

    async def _page(self, session: Session) -> pages.Document | None:
        """Page of a session, None when its process has ended."""
        if self._document is None and session.process is not None and self._client is not None:
            address, headers = f"http://127.0.0.1:{session.process.port}/", {KEY_HEADER: session.process.key}
            try:
                async with asyncio.timeout(ANSWER), self._client.get(address, headers=headers) as response:
                    response.raise_for_status()
                    page = await response.read()
            except (aiohttp.ClientError, OSError):
                return None
            self._document = await asyncio.to_thread(pages.with_overlay, page)
        return self._document

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        session, limits = self._meant(request), self._access_settings.limits
        taken_back = session.taken_back  # of the link as it is now
        self._pool.want(session)
        if (process := session.process) is None or self._client is None:
            return await closed(request, WSCloseCode.SERVICE_RESTART, "the session is being started")
        watches = _watches(request)
        viewer = Viewer(visitor_of(request, self._access_settings.names), "watch" if watches else "steer")
        if reason := self._pool.crowded(session, viewer):
            self._refusals["too many pages"] += 1
            log.info("page refused", reason=reason)
            return await closed(request, WSCloseCode.TRY_AGAIN_LATER, reason)
        limits = replace(limits, message=limits.watchers_message) if watches else limits
        meter = ConnectionRateLimiter(limits)

        def watching(raw: bytes) -> bytes | None:
            return harmless(raw, process.looking)

        with self._pool.viewing(session, viewer):
            judge = watching if watches else bytes
            return await relay(request, self._client, process, meter, judge, taken_back)

    async def _about(self, request: web.Request) -> web.StreamResponse:
        session = self._meant(request)
        if "wait" in request.query:
            self._pool.want(session)
        refusal = self._pool.refusal(session)
        about = {
            "phase": session.phase,
            "place": self._pool.place(session),
            "full": session.phase == "resting" and bool(refusal),
            "why": refusal,
            "rest": round(HURRIED),
            "told": session.told,
            "crashes": session.crashes,
            "viewers": len(session.pages),
            "copy": self._copies,
        }
        if not _watches(request):
            tokens = self._access_settings.tokens
            about["links"] = {
                "watch": f"../../watch/{session.watch}/" + (f"?token={tokens.watch}" if tokens else ""),
                "steer": f"../../s/{session.name}/" + (f"?token={tokens.of_session(session.name)}" if tokens else ""),
            }
            about["renew"] = self._may_renew(request, session)
            if self._pool.classes:
                about["links"]["class"] = f"../../class/{session.watch}/" + (f"?token={tokens.watch}" if tokens else "")
        return web.json_response(about)

    async def _qr(self, request: web.Request) -> web.StreamResponse:
        link = request.query.get("link", "")
        self._meant(request)
        if not link.startswith(("http://", "https://")) or len(link) > LONGEST_LINK:
            return _notice("No such code", f"link: allowed: an address of at most {LONGEST_LINK} letters", 400)
        return web.Response(body=pages.qr(link), content_type="image/svg+xml")

    async def _class(self, request: web.Request) -> web.StreamResponse:
        self._of_class(request)
        if not request.path.endswith("/"):
            return web.Response(status=303, headers={"Location": f"{request.match_info['name']}/"})
        self._greeted(request)
        return _html(pages.classroom())

    async def _question(self, request: web.Request) -> web.StreamResponse:
        """Response with the present question of a class, and the visitor's own answer to it."""
        session = self._of_class(request)
        own = session.room.own(self._greeted(request).browser)
        return web.json_response({"question": msgspec.to_builtins(session.room.question), "own": own})

    async def _answer_question(self, request: web.Request) -> web.StreamResponse:
        session, visitor = self._of_class(request), visitor_of(request, self._access_settings.names)
        room = session.room
        body = await request.read()
        try:
            said = msgspec.json.decode(body, type=dict[str, Any])
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            return web.json_response({"refused": f"answer: {error}"}, status=400)
        try:
            room.give(visitor.browser, visitor.address, said.get("number"), said.get("given"))
        except AnswerRefusal as error:
            self._refusals["answers of a class"] += 1
            return web.json_response({"refused": str(error)}, status=409)
        if not session.gathers:
            session.gathers = True
            asyncio.get_running_loop().call_later(GATHERED, _hand_over, session)
        return web.json_response({"own": room.own(visitor.browser)})

    def _of_class(self, request: web.Request) -> Session:
        """Session whose class is meant. Raises HTTPNotFound, also where there are no classes."""
        if not self._pool.classes:
            raise web.HTTPNotFound
        return self._meant(request)

    async def _again(self, request: web.Request) -> web.StreamResponse:
        self._pool.again(self._meant(request))
        return web.Response(status=204)

    async def _renew(self, request: web.Request) -> web.StreamResponse:
        session, cookie = self._meant(request), f"vsmrc-session-{port_of(request)}"
        if not self._may_renew(request, session):
            self._refusals["new links"] += 1
            log.info("request refused", reason="new links asked for with the link of one session")
            return _notice("No new links", "To take links back, come in by the link printed at the start.", 403)
        comes_back = request.cookies.get(cookie) == session.name
        try:
            await self._pool.renew(session)
        except OSError as error:
            return _notice("The links are the old ones", f"New ones cannot be kept on disk: {error.strerror}.", 503)
        response = web.Response(status=303, headers={"Location": f"../../s/{session.name}/"})
        if comes_back:
            self._remember(response, request, cookie, session.name)
        return response

    async def _copy(self, request: web.Request) -> web.StreamResponse:
        watched = self._meant(request)
        if self._access_settings.everyone is not None:
            return _notice("This server has one session only", "Private copies need one started with --shared.", 403)
        if not self._copies:
            return _notice("No private copies", "This server was started with --no-copies.", 403)
        try:
            session = self._pool.copy(watched, self._greeted(request))
        except Excess as error:
            self._refusals["too many copies"] += 1
            log.info("request refused", reason=str(error))
            return _notice("No private copy now", f"{str(error)[0].upper()}{str(error)[1:]}.", 429)
        response = web.Response(status=303, headers={"Location": f"../../s/{session.name}/"})
        self._remember(response, request, f"vsmrc-session-{port_of(request)}", session.name)
        return response

    async def _asset(self, request: web.Request) -> web.StreamResponse:
        name = request.match_info["name"]
        try:
            body = pages.asset(name)
        except KeyError:
            raise web.HTTPNotFound from None
        return web.Response(
            body=body, content_type=pages.ASSETS[name], charset="utf-8", headers={"Cache-Control": "no-cache"}
        )

    async def _health(self, request: web.Request) -> web.StreamResponse:
        return self._status(request, "ok\n", "text/plain")

    async def _metrics(self, request: web.Request) -> web.StreamResponse:
        return self._status(request, metrics(self._pool, self._refusals), TYPE)

    def _status(self, request: web.Request, text: str, kind: str) -> web.StreamResponse:
        if request[_PASS] != "steer" or not (self._access_settings.tokens is not None or is_local(request)):
            return _notice("This page is for whoever runs the server", "It wants the token to steer.", 403)
        return web.Response(body=text.encode(), headers={"Content-Type": kind})

    def _meant(self, request: web.Request) -> Session:
        """Session of the request's path. Raises HTTPNotFound."""
        name = request.match_info["name"]
        session = self._pool.watched(name) if _watches(request) else self._pool.named(name)
        if session is None:
            raise web.HTTPNotFound
        return session


def _hand_over(session: Session) -> None:
    """Hand the answers of a session's class to its process."""
    session.gathers = False
    if session.process is not None and session.room.question is not None:
        session.process.answer(Answers(session.room.number, session.room.given))


def _watches(request: web.Request) -> bool:
    return request.match_info.get("kind", "watch") == "watch"


def _is_socket(request: web.Request) -> bool:
    return request.headers.get("Upgrade", "").lower() == "websocket"


def _is_plain(request: web.Request) -> bool:
    """Whether the headers of a request for a web socket are ASCII: aiohttp repeats them when it refuses, and cannot
    repeat others."""
    asked = ("connection", "upgrade", "sec-websocket-")
    return all(value.isascii() for name, value in request.headers.items() if name.lower().startswith(asked))


def _to_clean(request: web.Request) -> web.Response:
    """Redirect to the same page, without the part of the address behind the '?'."""
    return web.Response(status=303, headers={"Location": f"./{request.rel_url.raw_path.rpartition('/')[2]}"})


def _html(text: str, status: int = 200) -> web.Response:
    return web.Response(text=text, status=status, content_type="text/html")


def _notice(title: str, sentence: str, status: int) -> web.Response:
    return _html(pages.notice(title, sentence), status)


def _sent(document: pages.Document, request: web.Request) -> web.Response:
    headers = {"ETag": document.tag, "Cache-Control": "no-cache", "Vary": "Accept-Encoding"}
    if document.tag in request.headers.get("If-None-Match", ""):
        return web.Response(status=304, headers=headers)
    if "gzip" in request.headers.get("Accept-Encoding", ""):
        headers["Content-Encoding"] = "gzip"
        return web.Response(body=document.compressed, content_type="text/html", charset="utf-8", headers=headers)
    return web.Response(body=document.plain, content_type="text/html", charset="utf-8", headers=headers)


@contextlib.asynccontextmanager
async def serving(
    gateway: Gateway, host: str, port: int, *, deadline: float = DEADLINE, connections: int | None = None
) -> AsyncIterator[int]:
    """Context in which the gateway answers at the port that is yielded; port 0 takes any. Raises PortTaken.

    deadline: s for a request to be complete; connections: largest number, None for all pages and new connections.
    """
    runner = ApplicationRunner(
        gateway.app,
        access_log=None,
        shutdown_timeout=FAREWELL,
        handler_cancellation=True,
        keepalive_timeout=deadline,
        lingering_time=deadline,
    )
    await runner.setup()
    try:
        assert runner.server is not None
        door = Door(runner.server, gateway.answered, connections or gateway.most_pages + ARRIVING)
        try:
            listening = await asyncio.get_running_loop().create_server(door, host, port)
        except OSError as error:
            raise PortTaken(f"port {port} of {host} cannot be used: {error.strerror or error}") from error
        try:
            yield listening.sockets[0].getsockname()[1]
        finally:
            listening.close()
    finally:
        await runner.cleanup()
