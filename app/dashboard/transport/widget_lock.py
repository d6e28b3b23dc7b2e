"""Lock of the widgets: a page's new value of a widget is read before the widget is set to another value.

viser writes a page's value into the widget and then calls back. If a drawing thread set the running value in between,
the callback would read this value, and the user's choice would be lost.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from inspect import isawaitable
from typing import Any

import viser

from app.dashboard.transport.viser_private import wrap_updates

PATIENCE = 1.0  # s


class WidgetLock:
    """Lock between viser's event loop and the thread that draws: with `widget_lock.drawing` held, no page's value is
    half processed.

    A callback of a widget must therefore not wait; its slow parts are tasks of their own. The event loop waits once for
    a drawing that hangs, for PATIENCE, and from then on processes the pages' messages without the lock.

    used: number of values that pages have sent.
    ended: whether the server stops, so that values are processed no more: viser has no threads for their callbacks.
    """

    def __init__(self, server: viser.ViserServer) -> None:
        self.drawing = threading.RLock()
        self.used, self.ended = 0, False
        self._hangs = False
        wrap_updates(server, self._in_turn)

    def _in_turn(self, handler: Callable[..., Any]) -> Callable[..., Any]:
        async def handle(client: int, message: Any) -> None:
            turn = self.drawing.acquire(timeout=0.0 if self._hangs else PATIENCE)
            self._hangs = not turn
            try:
                if self.ended:
                    return
                outcome = handler(client, message)
                if isawaitable(outcome):
                    await outcome
                self.used += 1
            finally:
                if turn:
                    self.drawing.release()

        return handle
