"""The one place that every message of every page passes before viser decodes it.

What is refused is dropped, whoever sends too much waits, and neither ends a connection: a page that comes back costs
more than a message that is not read. The log gets one line per page and while, never a traceback.
"""

from __future__ import annotations

import asyncio
import logging
import time
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
    Page,
    Refused,
    Visitor,
    Widget,
)
from app.dashboard.transport.viser_private import forget_uploads, is_form, on_connection, widget_of

log = structlog.get_logger()

RATE = 300.0  # messages a second of one page; one that is dragged and turned at once makes a hundred
BURST = 2000.0
WEIGHT = 20_000  # bytes that count as one message more
STEERING = 4.0  # messages that one counts as that sets a widget, of which a page sends 20 a second: they cost the loop
WAITING = 2  # frames of a page that may wait to be read, of up to 50 MB each
TELLING = 30.0  # s between two lines of the log about one page


@dataclass
class Meter:
    """Messages that a page has to its credit, refilled with time. rate: per second."""

    rate: float
    burst: float
    credit: float
    at: float  # s, of a monotonic clock

    def wait(self, cost: float, now: float) -> float:
        """How long, in s, the sender of what counts as `cost` messages has to wait."""
        self.credit = min(self.burst, self.credit + (now - self.at) * self.rate) - cost
        self.at = now
        return max(0.0, -self.credit / self.rate)


class MessageFilter:
    """Filter of the messages to a server, from its beginning; each connection is guarded from its first message on.

    rate: messages a second that one page may send for long.
    """

    def __init__(self, server: viser.ViserServer, rate: float = RATE) -> None:
        self._server, self._rate = server, rate
        logging.getLogger("websockets.server").addFilter(_in_a_line)
        on_connection(server, self._stand_before)  # pages that were open and waited for us, too

    def _stand_before(self, connection: ServerConnection, number: int) -> None:
        visitor, receive, tally = Visitor(self._page(number)), connection.recv, _Tally(number)
        meter = Meter(self._rate, BURST, BURST, time.monotonic())
        connection.recv_messages.high, connection.recv_messages.low = WAITING, 0

        async def recv(decode: bool | None = None) -> Any:
            while True:
                try:
                    raw = await receive(decode)
                except ConnectionClosed:
                    self._forget(visitor.finished | visitor.begun)
                    raise
                # 0, too: other pages have their turn after every message of this one
                await asyncio.sleep(meter.wait(1.0 + len(raw) / WEIGHT, time.monotonic()))
                try:
                    message = visitor.admit(raw)
                except Refused as refusal:
                    tally.note(refusal)
                    continue
                if isinstance(message, GuiUpdateMessage | CommandTriggerMessage):
                    meter.credit -= STEERING - 1.0  # the next one waits for it
                if isinstance(message, FileTransferStartUpload):
                    self._forget(visitor.finished - {message.transfer_uuid})
                    visitor.finished &= {message.transfer_uuid}
                return raw

        connection.recv = recv

    def _page(self, number: int) -> Page:
        """What everybody sees, and what this page alone does."""

        def widget(uuid: str) -> Widget | None:
            return widget_of(self._server, number, uuid)

        return Page(widget, lambda uuid: is_form(self._server, uuid))

    def _forget(self, uploads: set[str]) -> None:
        """viser keeps the receipts of every part of an upload for pages to come, which have no use for them."""
        forget_uploads(self._server, uploads)


class _Tally:
    """Counts what is refused of one page, and tells now and then."""

    def __init__(self, number: int) -> None:
        self._number = number
        self._untold = 0
        self._due = 0.0

    def note(self, refusal: Refused) -> None:
        self._untold += 1
        now = time.monotonic()
        if now >= self._due:
            log.warning("messages refused", page=self._number, count=self._untold, last=str(refusal))
            self._untold, self._due = 0, now + TELLING


def _in_a_line(record: logging.LogRecord) -> bool:
    """What is no web socket is nobody's page and not worth a line; the end of one is worth one, without a traceback."""
    if record.exc_info:
        record.msg, record.args, record.exc_info = f"{record.getMessage()}: {record.exc_info[1]}", (), None
    return not record.getMessage().startswith("opening handshake failed")
