"""What stands before viser's server: it answers whoever asks, under any name, and offers no hook.

So the one class by which it opens its socket is replaced while it does so. What a page says once it is in is the
affair of `app.dashboard.gate`.
"""

from __future__ import annotations

import contextlib
import http
import secrets
from collections.abc import Callable, Iterator
from typing import Any
from urllib.parse import urlsplit

import websockets.asyncio.server as library
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from app.access import KEY_HEADER, PAGE_HEADERS, Names
from app.traffic import Limits

_LIMITS = Limits()


class UnguardedError(RuntimeError):
    """viser has opened its socket in another way than the one that is guarded here."""


@contextlib.contextmanager
def behind_doors(names: Names, key: str | None = None) -> Iterator[None]:
    """A viser server made within answers only requests under its own names and from its own pages, keeps to Limits,
    and, when a key is given, wants it in the header KEY_HEADER. Raises UnguardedError when it would not."""
    opened: list[_Guarded] = []

    class Guarded(_Guarded):
        def __init__(self, *args: Any, **settings: Any) -> None:
            super().__init__(*args, names=names, key=key, **settings)
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
        process_request: Callable[[ServerConnection, Request], Response | None],
        **settings: Any,
    ) -> None:
        def judged(connection: ServerConnection, request: Request) -> Response | None:
            response = (
                _refused(names, key, request) or _full(connection, request) or process_request(connection, request)
            )
            if response is not None:
                response.headers.update(PAGE_HEADERS)
            return response

        settings |= {"max_size": _LIMITS.message, "server_header": PAGE_HEADERS["Server"]}
        super().__init__(*args, process_request=judged, **settings)


def _refused(names: Names, key: str | None, request: Request) -> Response | None:
    headers = request.headers
    if key is not None and not secrets.compare_digest(headers.get(KEY_HEADER, "").encode(), key.encode()):
        return _answer(http.HTTPStatus.FORBIDDEN, "this session is reached through its gateway only")
    acting = "Upgrade" in headers
    if refusal := names.refusal(headers, acting=acting):
        return _answer(http.HTTPStatus(refusal.status), refusal.sentence)
    path = urlsplit(request.path)
    if path.query and not acting:
        # viser's page would take another server's address from there, and run the scripts that it sends
        response = _answer(http.HTTPStatus.SEE_OTHER, "this page takes no parameters")
        response.headers["Location"] = "/"
        return response
    return None


def _full(connection: ServerConnection, request: Request) -> Response | None:
    if "Upgrade" in request.headers and len(connection.server.connections) >= _LIMITS.per_session:
        return _answer(http.HTTPStatus.SERVICE_UNAVAILABLE, f"{_LIMITS.per_session} pages are open; allowed: no more")
    return None


def _answer(status: http.HTTPStatus, sentence: str) -> Response:
    body = f"{sentence}\n".encode()
    headers = Headers({"Content-Type": "text/plain; charset=utf-8", "Content-Length": str(len(body))})
    return Response(status.value, status.phrase, headers, body)
