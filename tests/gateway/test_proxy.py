"""Behind a TLS proxy, as docs/security.md says, its own text in a real nginx; and a page that does not read."""

from __future__ import annotations

import asyncio
import http.client
import random
import re
import socket
import ssl
import subprocess
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import aiohttp
import pytest
from aiohttp import web
from websockets.exceptions import InvalidStatus

from app.access.rate_limits import ConnectionLimits, ConnectionRateLimiter
from app.gateway.relay import relay
from drivers.visitors import PATIENCE, Server, serving, visiting
from tests.support import nginx

pytestmark = pytest.mark.slow  # servers

NAME = "lab.example.org"
PAGE = Path(__file__).parents[2] / "docs" / "security.md"


class Site(NamedTuple):
    """The proxy's port, what it is trusted by, and the server behind."""

    port: int
    trust: ssl.SSLContext
    server: Server

    @property
    def origin(self) -> str:
        return f"https://{NAME}:{self.port}"

    def wire(self) -> socket.socket:
        """To the proxy; its name is in no name server."""
        return socket.create_connection(("127.0.0.1", self.port), timeout=PATIENCE)

    def ask(self, path: str, **headers: str) -> http.client.HTTPResponse:
        connection = http.client.HTTPConnection(NAME, self.port)
        connection.sock = self.trust.wrap_socket(self.wire(), server_hostname=NAME)
        connection.request("GET", path, headers=headers)
        return connection.getresponse()

    def visiting(self, path: str, **options: Any):
        return visiting(f"{self.origin}{path}", sock=self.wire(), ssl=self.trust, server_hostname=NAME, **options)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    executable, openssl = nginx.find_or_install()
    folder = tmp_path_factory.mktemp("nginx")
    certificate, key = folder / "site.pem", folder / "site.key"
    request = f"req -x509 -newkey rsa:2048 -nodes -days 2 -subj /CN={NAME} -addext subjectAltName=DNS:{NAME}"
    subprocess.run([openssl, *request.split(), "-keyout", key, "-out", certificate], check=True, capture_output=True)
    port = _free_port()
    with serving("--shared", "--max-sessions", "1", "--origin", f"https://{NAME}:{port}", lines=2) as server:
        inner = _port_of(server)
        block = re.search(r"```nginx\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
        assert block
        text = block[1]
        for documented, here in (
            ("listen 443 ssl", f"listen 127.0.0.1:{port} ssl"),
            ("127.0.0.1:8080", f"127.0.0.1:{inner}"),
            (f"/etc/ssl/certs/{NAME}.pem", str(certificate)),
            (f"/etc/ssl/private/{NAME}.key", str(key)),
        ):
            assert documented in text
            text = text.replace(documented, here)
        temporary = "".join(
            f"{kind}_temp_path {folder};" for kind in ("client_body", "proxy", "fastcgi", "uwsgi", "scgi")
        )
        (folder / "nginx.conf").write_text(
            f"daemon off; master_process off; pid {folder}/pid; error_log stderr; events {{}}\n"
            f"http {{ access_log off; {temporary}\n{text}}}\n"
        )
        with subprocess.Popen([executable, "-p", folder, "-c", folder / "nginx.conf", "-e", "stderr"]) as proxy:
            try:
                _listening(port, proxy)
                yield Site(port, ssl.create_default_context(cafile=certificate), server)
            finally:
                proxy.terminate()


def test_pages_and_web_sockets_come_through_and_nobody_else_does(site: Site) -> None:
    assert site.server.url.startswith(f"{site.origin}/?token=")
    assert site.ask("/").status == 403
    assert site.ask("/").headers["Strict-Transport-Security"] == "max-age=31536000"
    token = site.server.url.rpartition("=")[2]
    cookie = site.ask(f"/?token={token}").headers["Set-Cookie"]
    assert "Secure" in cookie
    shown = {"Cookie": cookie.split(";")[0]}
    path = "/" + site.ask("/", **shown).headers["Location"]
    until = time.monotonic() + PATIENCE
    while b"overlay.js" not in site.ask(path, **shown).read():
        assert time.monotonic() < until
        time.sleep(0.1)
    with pytest.raises(InvalidStatus, match="403"), site.visiting(path, origin=site.origin):
        pass  # no token
    for foreign in ("https://evil.example", site.origin.replace("https", "http")):
        with (
            pytest.raises(InvalidStatus, match="403"),
            site.visiting(path, origin=foreign, additional_headers=shown),
        ):
            pass
    with site.visiting(path, origin=site.origin, additional_headers=shown) as page:
        page.wait(lambda: "running" in page.status)
        began = page.t
        page.wait(lambda: page.t > began + 0.5)
        assert page.received > 200_000  # the arm's meshes, in large messages
        page.trigger("Mode: Motion")
        page.wait(lambda: "Motion" in page.status)


def test_a_page_that_does_not_read_is_sent_no_more_and_holds_up_nobody() -> None:
    """The session's side must feel it: it is what decides, then, to send only the newest values."""
    megabyte, most = bytes(2**20), 64

    async def check() -> int:
        sent, stuck = 0, asyncio.Event()

        async def endless(request: web.Request) -> web.WebSocketResponse:
            nonlocal sent
            await (session := web.WebSocketResponse(compress=False)).prepare(request)
            while sent < most and not stuck.is_set():
                try:
                    await asyncio.wait_for(session.send_bytes(megabyte), 3.0)
                    sent += 1
                except TimeoutError:
                    stuck.set()
            stuck.set()
            return session

        async def through(request: web.Request) -> web.WebSocketResponse:
            process: Any = SimpleNamespace(port=inner, key="key")
            return await relay(
                request, client, process, ConnectionRateLimiter(ConnectionLimits()), bytes, asyncio.Event()
            )

        async with aiohttp.ClientSession() as client, _at(endless) as inner, _at(through) as outer:
            reader, writer = await asyncio.open_connection("127.0.0.1", outer, limit=2**16)
            writer.write(
                b"GET / HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                b"Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n"
            )
            await reader.readuntil(b"\r\n\r\n")
            await asyncio.wait_for(stuck.wait(), PATIENCE)
            writer.close()
        return sent

    assert asyncio.run(check()) < most


@asynccontextmanager
async def _at(handler: Any) -> AsyncIterator[int]:
    """A web socket handler at a port of its own, which is yielded."""
    app = web.Application()
    app.add_routes([web.get("/", handler)])
    runner = web.AppRunner(app, shutdown_timeout=0.1, handler_cancellation=True)
    await runner.setup()
    await web.TCPSite(runner, "127.0.0.1", 0).start()
    yield runner.addresses[0][1]
    await runner.cleanup()


def _free_port() -> int:
    """Port on which nothing listens, outside the range from which other tests get theirs meanwhile."""
    for port in random.sample(range(20_000, 32_000), 100):
        with suppress(OSError), socket.create_server(("127.0.0.1", port)):
            return port
    raise OSError("no free port among a hundred")


def _port_of(server: Server) -> int:
    """Where it listens itself: what it prints is the proxy's address."""
    found = re.search(r"127\.0\.0\.1:(\d+)", server.lines[1])
    assert found, server.lines
    return int(found[1])


def _listening(port: int, process: subprocess.Popen[bytes]) -> None:
    until = time.monotonic() + PATIENCE
    while True:
        try:
            socket.create_connection(("127.0.0.1", port)).close()
            return
        except ConnectionRefusedError:
            assert process.poll() is None, "nginx has ended"
            assert time.monotonic() < until
            time.sleep(0.05)
