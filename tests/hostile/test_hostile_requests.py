"""Requests that are made to do harm, and what is left of them: no secret and no flood in any log, the same headers on
every answer."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from websockets import Subprotocol
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from app.access.admission import PAGE_HEADERS
from app.dashboard.page import Dashboard
from app.gateway.session_store import LINK, SessionStore
from app.process.redaction import new_secret, redacted
from drivers.visitors import PATIENCE, Server, serving
from tests.gateway.test_gateway import ask
from tests.support.raw_requests import answer_to

pytestmark = pytest.mark.slow  # servers

HOST = b"Host: 127.0.0.1\r\nConnection: close\r\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of the sessions, with one that cannot be read; its log is log."""
    folder = tmp_path_factory.mktemp("state")
    SessionStore(folder / "everyone").close()
    return folder


@pytest.fixture(scope="module")
def unreadable(folder: Path) -> str:
    """Part of the link to watch a kept session."""
    name = new_secret(16)
    (folder / "everyone" / name).mkdir()
    (folder / "everyone" / name / LINK).write_text("{")
    return name


@pytest.fixture(scope="module")
def guarded(folder: Path, unreadable: str) -> Iterator[Server]:
    assert unreadable
    arguments = ("--token", "always", "--state-dir", str(folder), "--log-file", str(folder / "log"))
    with serving("planar2r-semicircle", *arguments, "--log-level", "debug", lines=2) as server:
        yield server


def secrets_of(server: Server) -> list[str]:
    """The tokens, the parts of the session's links, and its own token."""
    printed = [match for line in server.lines for match in re.findall(r"(?:token=|/watch/)([\w-]+)", line)]
    cookie = f"vsmrc-token-{server.port}={printed[0]}"
    path = ask(server.port, "/", Cookie=cookie).headers["Location"]
    steer = json.loads(ask(server.port, f"/{path}about", Cookie=cookie).body)["links"]["steer"]
    return [*printed, path.strip("/").removeprefix("s/"), steer.rpartition("token=")[2]]


def test_no_log_holds_a_token_a_link_or_what_was_sent(guarded: Server, folder: Path, unreadable: str) -> None:
    hidden = [*secrets_of(guarded), unreadable]
    for secret in (text.encode() for text in hidden):
        cookie = b"Cookie: vsmrc-token-%d=%s" % (guarded.port, secret)
        path = b"GET /?token=" + secret
        for request in (
            b"GET / HTTP/1.1\r\n" + HOST + cookie + b"; x=" + b"y" * 9000 + b"\r\n\r\n",
            b"GET / HTTP/1.1\r\n" + HOST + b"Cookie: x=" + b"y" * 8150 + b"; vsmrc-token-1=" + secret + b"\r\n\r\n",
            b"GET / HTTP/1.1\n" + HOST.replace(b"\r", b"") + cookie + b"\n\n",
            b"GET / HTTP/1.1\r\n" + HOST + cookie + b"\nx: y\r\n\r\n",
            b"GET / HTTP/1.1\r\n" + HOST + b"Coo kie: " + cookie + b"\r\n\r\n",
            b"GET / HTTP/1.1\r\n" + HOST + cookie + b"\0\r\n\r\n",
            path + b"\xff\x01 HTTP/1.1\r\n" + HOST + b"\r\n",
            path + b"%ff%fe[ HTTP/1.1\r\n" + HOST + b"\r\n",
            path + b"\t HTTP/9\r\n" + HOST + b"\r\n",
            path + b"y" * 9000 + b" HTTP/1.1\r\n" + HOST + b"\r\n",
            b"GET //[" + secret + b"/?token=" + secret + b" HTTP/1.1\r\n" + HOST + b"\r\n",
            b"GET http://[x/s/" + secret + b"/ HTTP/1.1\r\n" + HOST + b"\r\n",
            b"GET / HTTP/1.1\r\nHost: [" + secret + b"\r\nConnection: close\r\n\r\n",
            b"GET / HTTP/1.1\r\n" + HOST + cookie + b"\r\nUpgrade: websocket\r\n\r\n",
            b"POST / HTTP/1.1\r\n" + HOST + cookie + b"\r\nContent-Length: -1\r\n\r\n",
            b"POST / HTTP/1.1\r\n" + HOST + b"Origin: http://" + secret + b"\r\n\r\n",
        ):  # fmt: skip
            answer_to(guarded.port, request)
    written = (folder / "log").read_text()
    assert 'event="request refused"' in written
    assert 'event="saved session unreadable"' in written
    for secret in hidden:
        assert secret not in written
        assert secret[:16] not in written


def test_a_header_that_is_refused_does_not_fill_the_log(guarded: Server, folder: Path) -> None:
    before = (folder / "log").stat().st_size
    for _ in range(200):
        answer_to(guarded.port, b"GET / HTTP/1.1\r\n" + HOST + b"x" * 8000 + b" y: z\r\n\r\n")
        answer_to(guarded.port, b"GET / HTTP/1.1\r\nHost: " + b"x" * 8000 + b"\r\nConnection: close\r\n\r\n")
    assert (folder / "log").stat().st_size - before < 1_000_000  # of 3 MB


@pytest.mark.parametrize(
    "request_",
    [
        b"GET / HTTP/1.1\r\n" + HOST + b"\r\n",  # no token
        b"GET / HTTP/1.1\r\nHost: evil.example\r\nConnection: close\r\n\r\n",
        b"GET /assets/none HTTP/1.1\r\n" + HOST + b"\r\n",
        b"garbage\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + HOST + b"x y: z\r\n\r\n",
    ],
)
def test_every_answer_has_the_same_headers(guarded: Server, request_: bytes) -> None:
    head = answer_to(guarded.port, request_).partition(b"\r\n\r\n")[0].decode()
    for name, value in PAGE_HEADERS.items():
        assert f"\r\n{name}: {value}" in head, head
    assert "aiohttp" not in head.lower()
    assert "python" not in head.lower()


def test_a_web_socket_asked_for_in_bytes_that_are_no_text_is_no_fault(guarded: Server, folder: Path) -> None:
    """As `make fuzz` found it: what was asked for was to be repeated in the refusal."""
    steer, *_ = secrets_of(guarded)
    cookie = b"Cookie: vsmrc-token-%d=%s\r\n" % (guarded.port, steer.encode())
    path = ask(guarded.port, "/", Cookie=cookie.decode()[8:].strip()).headers["Location"].encode()
    for asked in (
        b"Upgrade: websocket\r\nConnection: \xff",
        b"Upgrade: websocket\r\nSec-WebSocket-Version: \xbd13",
        b"Upgrade: websocket\r\nSec-WebSocket-Key: \xff",
    ):
        answer = answer_to(guarded.port, b"GET /" + path + b" HTTP/1.1\r\n" + HOST + cookie + asked + b"\r\n\r\n")
        assert answer.startswith(b"HTTP/1.1 400 ")
    assert "event=fault" not in (folder / "log").read_text()


def test_what_is_secret_is_told_from_names(monkeypatch: pytest.MonkeyPatch) -> None:
    for _ in range(300):
        for secret in (new_secret(16), new_secret()):
            for text in (f"/s/{secret}/", f"?token={secret}&x=1", f"vsmrc-token-80={secret};", f"x/shared/{secret}/y"):
                assert secret not in redacted(text)
            assert secret not in redacted(f"ValueError: b'Cookie: {secret * 2}'")
    like_names, secret = ("JgclEbaekvkUzqvbRnglig", "zqvb-ngligjgclebaekvkuz"), "JgclEbaekvk7zqvbRnglig"
    drawn = iter([*like_names, secret])
    monkeypatch.setattr("secrets.token_urlsafe", lambda _size: next(drawn))
    assert new_secret(16) == secret
    for name in ("planar2r-semicircle-discontinuous", "WebsockClientConnection", "run-0f" + "a1" * 15 + ".npz"):
        assert redacted(f"file={name}:") == f"file={name}:"


def test_what_a_page_calls_its_version_is_not_printed(capfd: pytest.CaptureFixture[str]) -> None:
    dashboard = Dashboard(port=0)
    try:
        address = f"ws://127.0.0.1:{dashboard.port}"
        for asked in ("viser-v0.my-own", "viser-v1.1.1my-own", f"viser-v{'9' * 5000}", "my-own"):
            with pytest.raises(InvalidStatus, match="400"), connect(address, subprotocols=[Subprotocol(asked)]):
                pass
        # a page of another version is told so, as viser does it
        with (
            connect(address, subprotocols=[Subprotocol("viser-v0.0.1")], open_timeout=PATIENCE) as socket,
            pytest.raises(ConnectionClosed, match="Version mismatch"),
        ):
            socket.recv(timeout=PATIENCE)
    finally:
        dashboard.close()
    output = capfd.readouterr()
    assert "my-own" not in output.out + output.err
    assert "99999" not in output.out + output.err
