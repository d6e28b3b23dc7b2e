"""Relay of a page's web socket to its session's process and back.

Each side is read only as fast as the other one accepts the data, so a page that does not read holds up nothing but
itself: viser sends it the newest values when it reads again.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable

import aiohttp
import structlog
from aiohttp import WSCloseCode, WSMsgType, web

from app.access.admission import KEY_HEADER
from app.access.rate_limits import ConnectionLimits, ConnectionRateLimiter, Overrun
from app.gateway.session_pool import Process

log = structlog.get_logger()

ANSWER = 10.0  # s that a session has to answer a page
BEAT = 30.0  # s between two signs of life asked of a page
MessageFilter = Callable[[bytes], bytes | None]


async def relay(
    request: web.Request,
    client: aiohttp.ClientSession,
    process: Process,
    meter: ConnectionRateLimiter,
    admitted_part: MessageFilter,
    taken_back: asyncio.Event,
) -> web.WebSocketResponse:
    """Relay a page's web socket until either side ends, the page sends more than `meter` allows, or its link is taken
    back.
    admitted_part: returns the part of a page's message to pass on, None for nothing.
    Where there is no process, the page is closed with code 1012 and will reconnect."""
    try:
        async with asyncio.timeout(ANSWER):
            session = await client.ws_connect(
                f"http://127.0.0.1:{process.port}/",
                protocols=_offered(request),
                headers={KEY_HEADER: process.key},
                max_msg_size=0,
                compress=0,
            )
    except (aiohttp.ClientError, OSError):
        return await closed(request, WSCloseCode.SERVICE_RESTART, "the session is not there; it is being started anew")
    async with session:
        page = web.WebSocketResponse(
            protocols=[session.protocol] if session.protocol else [],
            max_msg_size=meter.largest * 5 // 4,  # a longer message is not read, not even to refuse it
            compress=False,
            heartbeat=BEAT,
            autoping=False,  # pings are counted, too
        )
        await page.prepare(request)
        there = asyncio.create_task(_pass_on(page, session, meter, admitted_part))
        back = asyncio.create_task(_pass_back(session, page))
        revoked = asyncio.create_task(taken_back.wait())
        tasks = (there, back, revoked)
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:  # the server cancels a handler whose page is gone, and nobody else would end these
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
        overrun = next((e for task in done if isinstance(e := task.exception(), Overrun)), None)
        if overrun is not None:
            log.info("page closed", reason=str(overrun))
            await page.close(code=WSCloseCode.POLICY_VIOLATION, message=str(overrun).encode()[:120])
        elif revoked in done:
            await page.close(code=WSCloseCode.POLICY_VIOLATION, message=b"this link was taken back; ask for a new one")
        elif not page.closed:
            code = session.close_code or WSCloseCode.SERVICE_RESTART
            ended = code in (WSCloseCode.ABNORMAL_CLOSURE, 1005)
            await page.close(code=WSCloseCode.SERVICE_RESTART if ended else code, message=b"the session has ended")
        if request.transport is not None and page.close_code == WSCloseCode.ABNORMAL_CLOSURE:
            request.transport.abort()  # a page that does not read would keep the connection and the data to be sent
    return page


async def closed(request: web.Request, code: int, reason: str) -> web.WebSocketResponse:
    """Web socket that is closed with a reason at once: a browser tells its page nothing about a refused one."""
    page = web.WebSocketResponse(
        protocols=_offered(request), max_msg_size=ConnectionLimits().watchers_message, timeout=1.0
    )
    await page.prepare(request)
    await page.close(code=code, message=reason.encode()[:120])
    return page


def _offered(request: web.Request) -> list[str]:
    """Protocols that the page offers."""
    return [name.strip() for name in request.headers.get("Sec-WebSocket-Protocol", "").split(",") if name.strip()]


async def _pass_on(
    page: web.WebSocketResponse,
    session: aiohttp.ClientWebSocketResponse,
    meter: ConnectionRateLimiter,
    admitted_part: MessageFilter,
) -> None:
    """Pass on the messages of the page. Raises Overrun."""
    with contextlib.suppress(ConnectionError):
        async for message in page:
            if message.type in (WSMsgType.PING, WSMsgType.PONG):
                meter.count()
                if message.type is WSMsgType.PING:
                    await page.pong(message.data)
            elif message.type in (WSMsgType.BINARY, WSMsgType.TEXT):
                if meter.admits(message.data) and (passed := admitted_part(message.data)) is not None:
                    await session.send_bytes(passed)
            else:
                return


async def _pass_back(session: aiohttp.ClientWebSocketResponse, page: web.WebSocketResponse) -> None:
    with contextlib.suppress(ConnectionError):
        async for message in session:
            if message.type is not WSMsgType.BINARY:
                return
            await page.send_bytes(message.data)
