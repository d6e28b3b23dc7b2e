"""Server in front of the sessions: the session of each path, and the way to its process.

    /                    a session of one's own: leads to its link
    /s/NAME/             a session, to steer
    /watch/NAME/         the same, to look at; NAME is another one
    .../about            state of the session, as JSON
    /s/NAME/again        POST: begin a session anew that has failed
    /s/NAME/renew        POST: new links for the session; the old ones are taken back
    /watch/NAME/copy     POST: a session of one's own with the same scenario
    /class/NAME/...      questions of a lesson to a class (`app.gateway.class_pages`)
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
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import aiohttp
import structlog
from aiohttp import WSCloseCode, web

from app.access.admission import KEY_HEADER, PortTaken, session_cookie
from app.access.rate_limits import ConnectionRateLimiter, harmless
from app.gateway import pages
from app.gateway.access_control import AccessControl, AccessSettings
from app.gateway.class_pages import ClassPages
from app.gateway.connections import ARRIVING, DEADLINE, ConnectionLimiter
from app.gateway.metrics import TYPE, metrics
from app.gateway.relay import ANSWER, closed, relay
from app.gateway.responses import ApplicationRunner, html, notice, session_page, with_headers
from app.gateway.session import Session
from app.gateway.session_pool import HURRIED, Excess, SessionPool
from app.gateway.session_request import is_plain, is_socket, session_of, watches
from app.gateway.visitor_origin import port_of
from app.gateway.visitors import Viewer

log = structlog.get_logger()

TICK = 1.0  # s
FAREWELL = 0.1  # s, twice: at the end, for pages whose sessions have ended; their last messages are not read
WAITS = 0.5  # s that a page is kept waiting for its session, rather than being told to wait
LONGEST_LINK = 500
READ_WITHIN = 60.0  # s in which a visitor, whose connection may be slow, must have read an answer
QR_QUEUE = 8  # QR codes that are drawn or wait for that
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class Gateway:
    """Gateway: the web application for `aiohttp.web`. answered, read: see `ConnectionLimiter`."""

    def __init__(self, pool: SessionPool, access_settings: AccessSettings) -> None:
        self._pool, self._access_settings = pool, access_settings
        self._copies = access_settings.copies and access_settings.everyone is None
        self._refusals = Counter[str]()
        self._access = AccessControl(access_settings, pool, self._refusals)
        self.answered = set[asyncio.BaseTransport]()
        self.read = dict[asyncio.BaseTransport, float]()
        self._drawer, self._drawing = ThreadPoolExecutor(1, "qr"), 0  # codes that are being drawn
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
                *ClassPages(pool, self._access, self._refusals).routes,
                web.post("/{kind:s}/{name}/again", self._again),
                web.post("/{kind:s}/{name}/renew", self._renew),
                web.post("/watch/{name}/copy", self._copy),
            ]
        )

    @property
    def most_pages(self) -> int:
        """Largest number of pages that are open at once."""
        return self._pool.limits.pages.total

    async def _living(self, _: web.Application) -> AsyncIterator[None]:
        async with aiohttp.ClientSession(connector=aiohttp.TCPConnector(limit=0)) as self._client:
            ticking = asyncio.create_task(self._tick())
            yield
            ticking.cancel()

    async def _end(self, _: web.Application) -> None:
        """End the sessions, before the server waits for the pages: they end with their sessions."""
        await self._pool.close()
        self._drawer.shutdown(wait=False, cancel_futures=True)

    async def _tick(self) -> None:
        while True:
            try:
                if self._access_settings.everyone is not None:
                    self._pool.want(self._access_settings.everyone)
                self._pool.tick()
            except Exception as error:  # the other sessions must not pay for it
                log.error("fault", stage="the sessions' tick", exc_info=error)
            await asyncio.sleep(TICK)

    @web.middleware
    async def _guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        transport = request.transport
        if transport is None:
            raise web.HTTPBadRequest  # nobody is there any more
        self.answered.add(transport)
        try:
            response = await self._answer(request, handler)
            # sent here, since until then the connection must not make room for another one
            self.read[transport] = asyncio.get_running_loop().time()
            with contextlib.suppress(ConnectionError):  # the visitor has gone
                try:
                    async with asyncio.timeout(READ_WITHIN):
                        await response.prepare(request)
                        await response.write_eof()
                except TimeoutError:
                    transport.abort()
            return response
        finally:
            self.answered.discard(transport)
            self.read.pop(transport, None)

    async def _answer(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        response = self._access.refusal(request)
        if response is None:
            try:
                response = await handler(request)
            except web.HTTPNotFound as error:
                sentence = "The link is not complete, or it was taken back: ask for a new one."
                response = notice("There is nothing here", sentence, error.status)
            except web.HTTPException as error:
                response = notice("This is not possible", f"{error.reason}: go back to the page.", error.status)
                if allow := error.headers.get("Allow"):
                    response.headers["Allow"] = allow
        self._access.keep_greeting(response, request)
        return response

    async def _front(self, request: web.Request) -> web.StreamResponse:
        """Redirect to the visitor's session; a new one takes no place before its page is loaded."""
        if not self._access.steers(request):
            return notice("No session of your own", "For one, ask for the link with the token to steer.", 403)
        if request.headers.get("Sec-Fetch-Dest", "document") != "document":  # a picture on a foreign page, say
            return notice("This request is refused", "Sec-Fetch-Dest is not a page; allowed: document", 403)
        cookie = session_cookie(port_of(request))
        visitor = self._access.greeted(request)
        session = (
            self._access_settings.everyone
            or self._pool.named(request.cookies.get(cookie, ""))
            or self._pool.new(visitor)
        )
        response = web.Response(status=303, headers={"Location": f"s/{session.name}/"})
        self._access.remember(response, request, cookie, session.name)
        return response

    async def _session(self, request: web.Request) -> web.StreamResponse:
        if is_socket(request):
            if not is_plain(request):
                raise web.HTTPBadRequest
            return await self._socket(request)
        session = session_of(request, self._pool)
        if not request.path.endswith("/"):
            return web.Response(status=303, headers={"Location": f"{request.match_info['name']}/"})
        self._access.greeted(request)
        self._pool.want(session)
        if await self._pool.soon(session, WAITS) and (document := await self._page(session)):
            return session_page(document, request)
        return html(pages.waiting())

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
        session, limits = session_of(request, self._pool), self._access_settings.limits
        taken_back = session.taken_back  # of the link as it is now
        self._pool.want(session)
        if (process := session.process) is None or self._client is None:
            return await closed(request, WSCloseCode.SERVICE_RESTART, "the session is being started")
        looks_only = watches(request)
        viewer = Viewer(self._access.visitor(request), "watch" if looks_only else "steer")
        if reason := self._pool.crowded(session, viewer):
            self._refusals["too many pages"] += 1
            log.info("page refused", reason=reason)
            return await closed(request, WSCloseCode.TRY_AGAIN_LATER, reason)
        limits = replace(limits, message=limits.watchers_message) if looks_only else limits
        meter = ConnectionRateLimiter(limits)

        def watching(raw: bytes) -> bytes | None:
            return harmless(raw, process.report_fields)

        with self._pool.viewing(session, viewer):
            admitted_part = watching if looks_only else bytes
            return await relay(request, self._client, process, meter, admitted_part, taken_back)

    async def _about(self, request: web.Request) -> web.StreamResponse:
        session = session_of(request, self._pool)
        if "wait" in request.query:
            self._pool.want(session)
        refusal = self._pool.refusal(session)
        about = {
            "phase": session.phase,
            "place": self._pool.queue_position(session),
            "full": session.phase == "resting" and bool(refusal),
            "why": refusal,
            "rest": round(HURRIED),
            "told": session.notice,
            "crashes": session.crashes,
            "viewers": len(session.pages),
            "copy": self._copies,
        }
        if not watches(request):
            tokens = self._access_settings.tokens
            about["links"] = {
                "watch": f"../../watch/{session.watch}/" + (f"?token={tokens.watch}" if tokens else ""),
                "steer": f"../../s/{session.name}/" + (f"?token={tokens.of_session(session.name)}" if tokens else ""),
            }
            about["renew"] = self._access.may_renew(request, session)
            if self._pool.classes:
                about["links"]["class"] = f"../../class/{session.watch}/" + (f"?token={tokens.watch}" if tokens else "")
        return web.json_response(about)

    async def _qr(self, request: web.Request) -> web.StreamResponse:
        link = request.query.get("link", "")
        session_of(request, self._pool)
        if not link.startswith(("http://", "https://")) or len(link.encode(errors="replace")) > LONGEST_LINK:
            return notice("No such code", f"link: allowed: an address of at most {LONGEST_LINK} bytes", 400)
        if self._drawing >= QR_QUEUE:
            return notice("Not now", "Too many codes are asked for: try again in a moment.", 429)
        self._drawing += 1
        try:  # takes a tenth of a second and more, in a thread of its own, so that nothing else waits for it
            picture = await asyncio.get_running_loop().run_in_executor(self._drawer, pages.qr, link)
        finally:
            self._drawing -= 1
        return web.Response(body=picture, content_type="image/svg+xml")

    async def _again(self, request: web.Request) -> web.StreamResponse:
        self._pool.again(session_of(request, self._pool))
        return web.Response(status=204)

    async def _renew(self, request: web.Request) -> web.StreamResponse:
        session, cookie = session_of(request, self._pool), session_cookie(port_of(request))
        if not self._access.may_renew(request, session):
            self._refusals["new links"] += 1
            log.info("request refused", reason="new links asked for with the link of one session")
            return notice("No new links", "To take links back, come in by the link printed at the start.", 403)
        comes_back = request.cookies.get(cookie) == session.name
        try:
            await self._pool.renew(session)
        except OSError as error:
            return notice("The links are the old ones", f"New ones cannot be kept on disk: {error.strerror}.", 503)
        response = web.Response(status=303, headers={"Location": f"../../s/{session.name}/"})
        if comes_back:
            self._access.remember(response, request, cookie, session.name)
        return response

    async def _copy(self, request: web.Request) -> web.StreamResponse:
        watched = session_of(request, self._pool)
        if self._access_settings.everyone is not None:
            return notice("This server has one session only", "Private copies need one started with --shared.", 403)
        if not self._copies:
            return notice("No private copies", "This server was started with --no-copies.", 403)
        try:
            session = self._pool.copy(watched, self._access.greeted(request))
        except Excess as error:
            self._refusals["too many copies"] += 1
            log.info("request refused", reason=str(error))
            return notice("No private copy now", f"{str(error)[0].upper()}{str(error)[1:]}.", 429)
        response = web.Response(status=303, headers={"Location": f"../../s/{session.name}/"})
        self._access.remember(response, request, session_cookie(port_of(request)), session.name)
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
        if not self._access.reads_status(request):
            return notice("This page is for whoever runs the server", "It wants the token to steer.", 403)
        return web.Response(body=text.encode(), headers={"Content-Type": kind})


@contextlib.asynccontextmanager
async def serving(
    gateway: Gateway, host: str, port: int, *, deadline: float = DEADLINE, connections: int | None = None
) -> AsyncIterator[int]:
    """Context in which the gateway answers at the port that is yielded; port 0 takes any. Raises PortTaken.

    deadline: s for a request to be complete, and for an answer to be read where there are too many connections;
    connections: largest number, None for all pages and new connections.
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
        most = connections or gateway.most_pages + ARRIVING
        limiter = ConnectionLimiter(runner.server, gateway.answered, gateway.read, most, deadline)
        try:
            listening = await asyncio.get_running_loop().create_server(limiter, host, port)
        except (OSError, UnicodeError) as error:  # the latter for a host that is no name
            reason = getattr(error, "strerror", None) or error
            raise PortTaken(f"port {port} of {host} cannot be used: {reason}") from error
        try:
            yield listening.sockets[0].getsockname()[1]
        finally:
            listening.close()
    finally:
        await runner.cleanup()
