"""Request to a session: which session it means, and how: as a page, as a web socket, to look or to steer."""

from __future__ import annotations

from aiohttp import web

from app.gateway.session import Session
from app.gateway.session_pool import SessionPool


def session_of(request: web.Request, pool: SessionPool) -> Session:
    """Session of the request's path. Raises HTTPNotFound."""
    name = request.match_info["name"]
    session = pool.watched(name) if watches(request) else pool.named(name)
    if session is None:
        raise web.HTTPNotFound
    return session


def watches(request: web.Request) -> bool:
    """Whether the session is to be looked at, and not to be steered."""
    return request.match_info.get("kind", "watch") == "watch"


def is_socket(request: web.Request) -> bool:
    """Whether the request is for a web socket."""
    return request.headers.get("Upgrade", "").lower() == "websocket"


def is_plain(request: web.Request) -> bool:
    """Whether the headers of a request for a web socket are ASCII: aiohttp repeats them when it refuses, and cannot
    repeat others."""
    headers = ("connection", "upgrade", "sec-websocket-")
    return all(value.isascii() for name, value in request.headers.items() if name.lower().startswith(headers))
