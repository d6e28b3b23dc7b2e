"""Filter that every message of every page passes before viser decodes it.

A refused message is dropped, and a page that sends too much waits. Neither ends a connection, since a page that
reconnects costs more than a message. The log gets one line per page every `LOG_INTERVAL` s, never a traceback.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import structlog
import viser
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed

from app.dashboard.transport.messages import (
    CommandTriggerMessage,
    FileTransferStartUpload,
    GuiUpdateMessage,
    LongText,
    Page,
    PageVisitor,
    RefusedMessage,
    ViserWidget,
)
from app.dashboard.transport.viser_private import forget_uploads, is_form, on_connection, widget_of

log = structlog.get_logger()

RATE = 300.0  # messages a second of one page; dragging and turning at once makes a hundred
BURST = 2000.0
WEIGHT = 20_000  # bytes that count as one more message
STEERING = 4.0  # messages as which the setting of a widget counts, which costs the loop; a page sends 20 a second
WAITING = 2  # frames of a web socket that may wait to be read, of up to 50 MB each
LOG_INTERVAL = 30.0  # s between two log lines about one page


@dataclass
class PageRateLimiter:
    """Rate limiter of a page's messages.
    rate: messages per second.
    burst: largest credit.
    credit: messages that the page may still send; grows with time."""

    rate: float
    burst: float
    credit: float
    at: float  # s, of a monotonic clock

    def wait(self, cost: float, now: float) -> float:
        """Time, s, that the sender of a message that counts as `cost` messages has to wait."""
        self.credit = min(self.burst, self.credit + (now - self.at) * self.rate) - cost
        self.at = now
        return max(0.0, -self.credit / self.rate)


class MessageFilter:
    """Filter of all messages to a server; each connection is guarded from its first message on.

    complain: shows a user the sentence of a refusal.
    rate: messages per second that one page may send for long.
    """

    def __init__(self, server: viser.ViserServer, complain: Callable[[str], None], rate: float = RATE) -> None:
        self._server, self._complain, self._rate = server, complain, rate
        logging.getLogger("websockets.server").addFilter(_in_a_line)
        on_connection(server, self._stand_before)  # also for pages that were open before this program started

    def _stand_before(self, connection: ServerConnection, number: int) -> None:
        visitor, receive, tally = PageVisitor(self._page(number)), connection.recv, _Tally(number)
        meter = PageRateLimiter(self._rate, BURST, BURST, time.monotonic())
        connection.recv_messages.high, connection.recv_messages.low = WAITING, 0

        async def recv(decode: bool | None = None) -> Any:
            while True:
                try:
                    raw = await receive(decode)
                except ConnectionClosed:
                    self._forget(visitor.finished | visitor.begun)
                    raise
                # awaited also for 0 s, so that other pages have their turn after every message of this one
                await asyncio.sleep(meter.wait(1.0 + len(raw) / WEIGHT, time.monotonic()))
                try:
                    message = visitor.admit(raw)
                except RefusedMessage as refusal:
                    tally.note(refusal)
                    if isinstance(refusal, LongText):
                        self._complain(str(refusal))
                    continue
                if isinstance(message, GuiUpdateMessage | CommandTriggerMessage):
                    meter.credit -= STEERING - 1.0  # makes the next message wait
                if isinstance(message, FileTransferStartUpload):
                    self._forget(visitor.finished - {message.transfer_uuid})
                    visitor.finished &= {message.transfer_uuid}
                return raw

        connection.recv = recv

    def _page(self, number: int) -> Page:
        """Widgets of a page, those that all pages share included. number: of the page's client."""

        def widget(uuid: str) -> ViserWidget | None:
            return widget_of(self._server, number, uuid)

        return Page(widget, lambda uuid: is_form(self._server, uuid))

    def _forget(self, uploads: set[str]) -> None:
        """Forget uploads, by name: viser keeps the receipts of their parts for later pages, which do not need them."""
        forget_uploads(self._server, uploads)


class _Tally:
    """Counter of the refused messages of one page, which logs their number every `LOG_INTERVAL` s."""

    def __init__(self, number: int) -> None:
        self._number = number
        self._unlogged = 0
        self._due = 0.0

    def note(self, refusal: RefusedMessage) -> None:
        self._unlogged += 1
        now = time.monotonic()
        if now >= self._due:
            log.warning("messages refused", page=self._number, count=self._unlogged, last=str(refusal))
            self._unlogged, self._due = 0, now + LOG_INTERVAL


def _in_a_line(record: logging.LogRecord) -> bool:
    """Log filter of websockets: drops records of connections that are no web sockets, and removes tracebacks from
    those of the end of a connection."""
    if record.exc_info:
        record.msg, record.args, record.exc_info = f"{record.getMessage()}: {record.exc_info[1]}", (), None
    return not record.getMessage().startswith("opening handshake failed")
