"""Connection limit of a gateway, and the choice of the connection to close when there are too many."""

from __future__ import annotations

import asyncio
from collections.abc import Container, Mapping

from aiohttp import web

DEADLINE = 10.0  # s that a connection may be silent, or take for a request, before it is closed
ARRIVING = 128  # connections on which nothing is being answered, or not yet


class ConnectionLimiter:
    """Factory of the protocols of a server's connections, at most `most` at once. When there are more, the oldest one
    that is not being answered is closed, so that connections without a request keep nobody out; where all are being
    answered, the one whose answer has been read for longest, if for longer than the deadline; otherwise the new one.
    deadline: s.
    answered: the transports of requests and web sockets that are being answered.
    read: when (s, of the event loop) each of those whose answer is complete, and is only to be read, became so."""

    def __init__(
        self,
        server: web.Server,
        answered: Container[asyncio.BaseTransport],
        read: Mapping[asyncio.BaseTransport, float],
        most: int,
        deadline: float,
    ) -> None:
        self._server, self._answered, self._read = server, answered, read
        self._most, self._deadline = most, deadline

    def __call__(self) -> asyncio.Protocol:
        open_ones = [t for c in self._server.connections if (t := c.transport) is not None and not t.is_closing()]
        if len(open_ones) < self._most:
            return self._server()
        waiting = next((transport for transport in open_ones if transport not in self._answered), None)
        if waiting is None:
            waiting = min((t for t in open_ones if t in self._read), key=self._read.__getitem__, default=None)
            if waiting is None or asyncio.get_running_loop().time() - self._read[waiting] < self._deadline:
                return _Full()
        waiting.abort()
        return self._server()


class _Full(asyncio.Protocol):
    """A connection that is closed at once."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        transport.close()
