"""Filter of repeated inputs: the end of an input takes effect once, however often the page reports it.

viser's client may drop a message, so `static/page/rows.js` reports the end of an input again until it sees an answer,
which on a busy machine comes late. An input that took effect twice would undo the changes in between.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from inspect import isawaitable
from typing import Any, NamedTuple

import viser

from app.dashboard.theme.style import MARKS, without_marks
from app.dashboard.transport.viser_private import wrap_updates

REPEATS = 5.0  # s, longer than the page waits between two reports of one input


class _Input(NamedTuple):
    """Input that has taken effect: its text with the kind of its marks, whether their number is even, and when it was
    reported last, s."""

    text: str
    even: bool
    at: float


class RepeatedInputs:
    """Filter of the values that pages send. Texts of successive inputs end with an odd and an even number of marks in
    turn; a repetition has two marks more.

    Each page counts for itself, and anew in a field that was hidden meanwhile: what it reports later than the
    repetitions of an input is another one.
    """

    def __init__(self, server: viser.ViserServer, clock: Callable[[], float] = time.monotonic) -> None:
        self._last: dict[tuple[str, int], _Input] = {}  # by field and page
        self._clock = clock
        wrap_updates(server, self._once)

    def _once(self, handler: Callable[..., Any]) -> Callable[..., Any]:
        async def handle(client: int, message: Any) -> None:
            value = message.updates.get("value")
            if isinstance(value, str) and value.endswith(MARKS) and self._repeats(message.uuid, client, value):
                return
            outcome = handler(client, message)
            if isawaitable(outcome):
                await outcome

        return handle

    def _repeats(self, field: str, client: int, value: str) -> bool:
        """Whether a page reports an input of this field again; notes the input."""
        text, now = without_marks(value), self._clock()
        given = _Input(text + value[-1], (len(value) - len(text)) % 2 == 0, now)
        self._last = {key: known for key, known in self._last.items() if now - known.at < REPEATS}
        before = self._last.get((field, client))
        self._last[field, client] = given
        return before is not None and before[:2] == given[:2]
