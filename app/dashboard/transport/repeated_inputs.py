"""Filter of repeated inputs: the end of an input takes effect once, however often the page says it.

viser's client may drop a message, so `static/page/rows.js` says the end of an input again until it sees an answer, and
on a busy machine the answer comes late. Taken twice, the input would undo what has happened in between.
"""

from __future__ import annotations

from collections.abc import Callable
from inspect import isawaitable
from typing import Any

import viser

from app.dashboard.theme.style import MARKS
from app.dashboard.transport.viser_private import wrap_updates


class RepeatedInputs:
    """Filter of the values that pages send. Of two inputs one after the other, one has an odd number of marks behind
    its text, and one an even number; a repetition has two more."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._last: dict[str, tuple[int, str, bool]] = {}
        wrap_updates(server, self._once)

    def _once(self, handler: Callable[..., Any]) -> Callable[..., Any]:
        async def handle(client: int, message: Any) -> None:
            value = message.updates.get("value")
            if isinstance(value, str) and value.endswith(MARKS):
                text = value.rstrip("".join(MARKS))
                told = client, text + value[-1], (len(value) - len(text)) % 2 == 0
                if self._last.get(message.uuid) == told:
                    return
                self._last[message.uuid] = told
            outcome = handler(client, message)
            if isawaitable(outcome):
                await outcome

        return handle
