"""Handshake in front of viser's server, which by itself answers anyone, under any name.

As viser offers no hook, the class by which it opens its socket is replaced while it does so. The messages of connected
pages are checked in `app.dashboard.transport.message_filter`.
"""

from __future__ import annotations

import contextlib
import http
import re
import secrets
from collections.abc import Callable, Iterator
from typing import Any
from urllib.parse import parse_qs, urlsplit

import websockets.asyncio.server as library
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from app.access.admission import KEY_HEADER, PAGE_HEADERS, YEAR, Names, Tokens, token_cookie
from app.access.rate_limits import ConnectionLimits

_LIMITS = ConnectionLimits()
_PROTOCOL = re.compile(r"viser-v\d{1,4}\.\d{1,4}\.\d{1,4}")


class UnguardedError(RuntimeError):
    """Error of a viser server that has opened its socket in another way than the guarded one."""


@contextlib.contextmanager
def behind_doors(
    names: Names, key: str | None = None, tokens: Tokens | None = None, fault: Callable[[], str] = str
) -> Iterator[None]:
    """Context in which a new viser server is guarded: it answers only requests under its own names and from its own
    pages, within `ConnectionLimits`. Raises UnguardedError where the server is not guarded.

    key: required in the header KEY_HEADER, None for none.
    tokens: of which visitors must show the one to steer, None for none.
    fault: returns the sentence that /healthz answers, without a token, instead of "ok"; "" where all is well.
    """
    opened: list[_Guarded] = []

    class Guarded(_Guarded):
        def __init__(self, *args: Any, **settings: Any) -> None:
            super().__init__(*args, names=names, key=key, tokens=tokens, fault=fault, **settings)
            opened.append(self)

    plain, library.serve = library.serve, Guarded
    try:
        yield
    finally:
        library.serve = plain
    if not opened:
        raise UnguardedError("this version of viser opens its socket in a way that is not guarded; allowed: viser 1.1")


class _Guarded(library.serve):
    def __init__(
        self,
        *args: Any,
        names: Names,
        key: str | None,
        tokens: Tokens | None,
        fault: Callable[[], str],
        process_request: Callable[[ServerConnection, Request], Response | None],
        **settings: Any,
    ) -> None:
        def answered(connection: ServerConnection, request: Request) -> Response | None:
            response = (
                _refused(names, key, request)
                or _health(fault, request)
                or _without_token(tokens, connection, request)
                or _with_parameters(request)
                or _full(connection, request)
                or process_request(connection, request)
            )
            if response is not None:
                response.headers.update(PAGE_HEADERS)
            return response

        settings |= {"max_size": _LIMITS.message, "server_header": PAGE_HEADERS["Server"]}
        super().__init__(*args, process_request=answered, **settings)


def _refused(names: Names, key: str | None, request: Request) -> Response | None:
    headers = request.headers
    if key is not None and not secrets.compare_digest(
        headers.get(KEY_HEADER, "").encode(errors="surrogateescape"), key.encode()
    ):
        return _answer(http.HTTPStatus.FORBIDDEN, "this session is reached through its gateway only")
    acting = "Upgrade" in headers
    if refusal := names.refusal(headers, acting=acting):
        return _answer(http.HTTPStatus(refusal.status), refusal.sentence)
    protocols = (part.strip() for line in headers.get_all("Sec-WebSocket-Protocol") for part in line.split(","))
    if not all(
        _PROTOCOL.fullmatch(protocol) for protocol in protocols
    ):  # viser would print all other requests on the terminal
        return _answer(http.HTTPStatus.BAD_REQUEST, "no protocol of viser's pages; allowed: viser-v and a version")
    return None


def _health(fault: Callable[[], str], request: Request) -> Response | None:
    if request.path != "/healthz":
        return None
    sentence = fault()
    return _answer(http.HTTPStatus.SERVICE_UNAVAILABLE if sentence else http.HTTPStatus.OK, sentence or "ok")


def _without_token(tokens: Tokens | None, connection: ServerConnection, request: Request) -> Response | None:
    """Answer to a request without the token, None where the request has its cookie or no token is needed. A request
    with the token in its address is answered with the cookie."""
    if tokens is None:
        return None
    name = token_cookie(connection.local_address[1])
    cookies = (part.strip().partition("=") for line in request.headers.get_all("Cookie") for part in line.split(";"))
    if any(key == name and tokens.opens(value) == "steer" for key, _, value in cookies):
        return None
    shown = parse_qs(urlsplit(request.path).query).get("token", [""])[0]
    if tokens.opens(shown) != "steer":
        return _answer(http.HTTPStatus.FORBIDDEN, "come in by the link with its token, as it was printed at the start")
    response = _to_page("the token is known now")
    response.headers["Set-Cookie"] = f"{name}={tokens.steer}; Max-Age={YEAR}; Path=/; HttpOnly; SameSite=Lax"
    return response


def _with_parameters(request: Request) -> Response | None:
    # viser's page would read the address of another server from the parameters, and run the scripts of that server
    has_query = urlsplit(request.path).query and "Upgrade" not in request.headers
    return _to_page("this page takes no parameters") if has_query else None


def _to_page(sentence: str) -> Response:
    response = _answer(http.HTTPStatus.SEE_OTHER, sentence)
    response.headers["Location"] = "/"
    return response


def _full(connection: ServerConnection, request: Request) -> Response | None:
    if "Upgrade" in request.headers and len(connection.server.connections) >= _LIMITS.per_session:
        return _answer(http.HTTPStatus.SERVICE_UNAVAILABLE, f"{_LIMITS.per_session} pages are open; allowed: no more")
    return None


def _answer(status: http.HTTPStatus, sentence: str) -> Response:
    body = f"{sentence}\n".encode()
    headers = Headers({"Content-Type": "text/plain; charset=utf-8", "Content-Length": str(len(body))})
    return Response(status.value, status.phrase, headers, body)
