"""Watch on stalled clients, which no longer read: viser would keep their connections and data for a quarter of an hour.

The messages that wait for a client in that time are bounded, since viser keeps one of each kind; a file that is being
sent is not.
"""

from __future__ import annotations

import math
import time

import structlog
import viser

from app.dashboard.transport.viser_private import connections

log = structlog.get_logger()

PATIENCE = 20.0  # s without a byte: a page that is busy, or far away, reads at least some
EVERY = 1.0  # s between two looks


class StalledClients:
    """Watch that drops stalled clients: connections on which bytes wait and none has gone for `patience` s. A page that
    still works reconnects by itself.

    Not to be used by two threads at once.
    """

    def __init__(self, server: viser.ViserServer, patience: float = PATIENCE) -> None:
        self._server, self._patience = server, patience
        self._waiting: dict[int, tuple[int, float]] = {}  # by client: waiting bytes, and since when their number is so
        self._due = -math.inf

    def drop(self) -> None:
        """Drop the stalled clients, if it is time to look."""
        now = time.monotonic()
        if now < self._due:
            return
        self._due = now + EVERY
        before, self._waiting = self._waiting, {}
        for client, size in self._sizes().items():
            known, since = before.get(client, (0, now))
            self._waiting[client] = size, since if size == known else now
            if size and now - self._waiting[client][1] > self._patience:
                log.info("client dropped", client=client, reason="it does not read", waiting_bytes=size)
                self._abort(client)

    def drop_all(self) -> None:
        """Drop every client on whose connection bytes wait; to be called at the end, since a client that does not read
        would not answer the close of its connection either."""
        for client, size in self._sizes().items():
            if size:
                self._abort(client)

    def _sizes(self) -> dict[int, int]:
        found = connections(self._server).items()
        return {client: connection.transport.get_write_buffer_size() for client, connection in found}

    def _abort(self, client: int) -> None:
        connection = connections(self._server).get(client)
        if connection is not None:
            self._server.get_event_loop().call_soon_threadsafe(connection.transport.abort)
