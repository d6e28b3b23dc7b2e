"""What a page says of a widget is heard before the widget is set to something else.

viser writes a page's value into the widget and then calls back; a drawing thread that shows the running value just in
between would have the callback read that one, and what was chosen would be lost.
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
    """Lock between viser's event loop and the thread that draws: `with widget_lock.drawing` no page's value is on its
    way.

    So a callback of a widget must not wait for anything: what takes longer is a task of its own. A drawing that hangs
    is waited for once; meanwhile pages, whose messages all come through one event loop, are heard all the same.
    """

    def __init__(self, server: viser.ViserServer) -> None:
        self.drawing = threading.RLock()
        self._hangs = False
        wrap_updates(server, self._in_turn)

    def _in_turn(self, handler: Callable[..., Any]) -> Callable[..., Any]:
        async def handle(client: int, message: Any) -> None:
            turn = self.drawing.acquire(timeout=0.0 if self._hangs else PATIENCE)
            self._hangs = not turn
            try:
                outcome = handler(client, message)
                if isawaitable(outcome):
                    await outcome
            finally:
                if turn:
                    self.drawing.release()

        return handle
