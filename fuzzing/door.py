"""Fuzzing of a gateway: requests of all kinds, some with tokens, links and web sockets that it knows.

Its sessions are no processes. Whatever comes, the gateway answers or ends the connection, with the promised headers,
and its log has no traceback and no secret.
"""

import asyncio
import atexit
import logging
import tempfile
from contextlib import AsyncExitStack, suppress
from pathlib import Path

from app.access.admission import PAGE_HEADERS, Tokens
from app.gateway.session import Session
from app.process import log
from drivers.town import town

TOKENS = Tokens("Steer7" * 7, "Watch7" * 7)
NAME, WATCH = "Name7x" * 4, "Look7x" * 4
OWN = TOKENS.of_session(NAME)
SECRETS = (TOKENS.steer, TOKENS.watch, OWN, NAME, WATCH)
DEADLINE = 0.05  # s for a request to be complete
PATIENCE = 10.0  # s until the connection ends: a longer time is a finding
_AFTER = b"\r\n\r\nGET /none HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n"  # ends what has been complete
_HEADERS = tuple(f"\r\n{name}: {value}".encode() for name, value in PAGE_HEADERS.items())


async def _begun() -> int:
    """Port of a gateway with one session; its cookies are named after that port."""
    lab = await _lasting.enter_async_context(town(tokens=TOKENS, serves={"deadline": DEADLINE}))
    lab.pool._known.add(Session("usual", NAME, WATCH))
    return lab.port


_folder = tempfile.TemporaryDirectory(prefix="vsmrc-fuzz-")
_log = Path(_folder.name) / "log"
log.configure("debug", _log)
logging.getLogger().setLevel(logging.DEBUG)
_lasting, _loop = AsyncExitStack(), asyncio.new_event_loop()
_port = _loop.run_until_complete(_begun())
atexit.register(lambda: _loop.run_until_complete(_lasting.aclose()))

_COOKIE = f"Cookie: vsmrc-token-{_port}={TOKENS.steer}; vsmrc-visitor-{_port}={'v' * 22}".encode()
_OWN = f"Cookie: vsmrc-token-{_port}={TOKENS.watch}; vsmrc-steer-{_port}={OWN}".encode()
_SOCKET = (
    b"Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: " + b"A" * 22 + b"=="
)


def _request(line: str, *headers: bytes) -> bytes:
    return b"\r\n".join((f"{line} HTTP/1.1".encode(), b"Host: 127.0.0.1", *headers)) + b"\r\n\r\n"


SEEDS = (
    _request("GET /", _COOKIE),
    _request(f"GET /?token={TOKENS.steer}"),
    _request(f"GET /s/{NAME}/?token={OWN}"),
    _request(f"GET /s/{NAME}/about", _OWN),
    _request(f"GET /s/{NAME}/", _OWN, _SOCKET),
    _request(f"GET /watch/{WATCH}/", _COOKIE, _SOCKET) + b"\x82\x81\0\0\0\0x\x88\x80\0\0\0\0",
    _request(f"POST /watch/{WATCH}/copy", _COOKIE, b"Content-Length: 2", b"Origin: http://127.0.0.1") + b"ab",
    _request("POST /s/x/again", _COOKIE, b"Transfer-Encoding: chunked") + b"2\r\nab\r\n0\r\n\r\n",
    _request("GET /metrics", b"Authorization: Bearer " + TOKENS.steer.encode()) + _request("GET /assets/overlay.js"),
)
DICTIONARY = (
    *("GET ", "POST ", "HEAD ", "OPTIONS ", "CONNECT ", " HTTP/1.1", " HTTP/1.0", "\r\n", "\n", "\0", "\xff", "%00"),
    *("Host: ", "Cookie: ", "Origin: ", "Authorization: Bearer ", "X-Forwarded-For: ", "Expect: 100-continue"),
    *("Upgrade: ", "Connection: ", "Sec-WebSocket-Protocol: ", "Content-Length: -1", "Transfer-Encoding: chunked"),
    *("http://", "https://", "[::1]", "[", "//", "..", "?token=", "/s/", "/watch/", "/about", "/renew", *SECRETS),
)


def read(data: bytes) -> None:
    before = _log.stat().st_size
    answer = _loop.run_until_complete(_answer(data))
    with _log.open("rb") as file:
        file.seek(before)
        written = file.read().decode()
    for what in ("traceback", "Traceback", "event=fault", "never retrieved", *SECRETS):
        assert what not in written, written
    if answer and not answer.startswith(b"HTTP/1.1 100 "):
        head = answer.partition(b"\r\n\r\n")[0]
        assert head.startswith(b"HTTP/"), answer
        assert all(header in head for header in _HEADERS), head


async def _answer(data: bytes) -> bytes:
    """All bytes that come until the gateway ends the connection. Raises TimeoutError."""
    reader, writer = await asyncio.open_connection("127.0.0.1", _port)
    answer = b""
    async with asyncio.timeout(PATIENCE):
        with suppress(ConnectionError):
            writer.write(data + _AFTER)
            while more := await reader.read(65536):
                answer += more
    writer.close()
    return answer
