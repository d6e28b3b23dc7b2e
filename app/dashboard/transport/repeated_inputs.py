"""Filter of repeated inputs: the end of an input takes effect once, however often the page reports it.

viser's client may drop a message, so `static/page/rows.js` reports the end of an input again until it sees an answer,
which on a busy machine comes late. An input that took effect twice would undo the changes in between.
"""

from __future__ import annotations

from collections.abc import Callable
from inspect import isawaitable
from typing import Any

import viser

from app.dashboard.theme.style import MARKS
from app.dashboard.transport.viser_private import wrap_updates


class RepeatedInputs:
    """Filter of the values that pages send. Texts of successive inputs end with an odd and an even number of marks in
    turn; a repetition has two marks more."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._last: dict[str, tuple[int, str, bool]] = {}
        wrap_updates(server, self._once)

    def _once(self, handler: Callable[..., Any]) -> Callable[..., Any]:
        async def handle(client: int, message: Any) -> None:
            value = message.updates.get("value")
            if isinstance(value, str) and value.endswith(MARKS):
                text = value.rstrip("".join(MARKS))
                entry = client, text + value[-1], (len(value) - len(text)) % 2 == 0
                if self._last.get(message.uuid) == entry:
                    return
                self._last[message.uuid] = entry
            outcome = handler(client, message)
            if isawaitable(outcome):
                await outcome

        return handle
