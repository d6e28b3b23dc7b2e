"""Visitor without a browser that acts on the page's controls by their labels, as a user does."""

from __future__ import annotations

import contextlib
import random
import socket
import time
from collections.abc import Callable, Iterator
from typing import Any

from websockets.sync.connection import Connection

from app.dashboard.theme.style import ENTERED, RELEASED
from drivers.visitors import VisitingPage, connected

WIDGETS = ("GuiTextMessage", "GuiSliderMessage", "GuiDropdownMessage", "GuiCheckboxMessage", "RegisterCommandMessage")
DRAG, PAUSE = 20, 0.05  # messages of a drag, and s between two of them
SEEN = 1.0  # s, after which the status line shows the effect of a command
OPENING, WAITING = 10.0, 60.0  # s that a page may take to open, and to have a widget


class Visitor(VisitingPage):
    """Visitor, connected while the context of `visit` lasts."""

    def __init__(self, socket: Connection) -> None:
        self._widgets: dict[str, dict[str, Any]] = {}
        super().__init__(socket)

    def slider(self, label: str) -> str:
        """Identifier of the slider in the row with this label: both are in one form."""
        row = self._find("GuiTextMessage", label)["container_uuid"]
        return self._widget(lambda w: w["type"] == "GuiSliderMessage" and w["container_uuid"] == row, label)["uuid"]

    def move(self, slider: str, to: float) -> None:
        """Move a slider to a position between 0 and 1."""
        self._update(slider, to)

    def drag(self, label: str, chance: random.Random) -> None:
        """Drag a slider over half of its range, and let go."""
        slider, start = self.slider(label), chance.uniform(0.1, 0.6)
        for k in range(DRAG):
            self.move(slider, start + 0.4 * k / DRAG)
            time.sleep(PAUSE)
        self._update(self._find("GuiTextMessage", label)["uuid"], RELEASED)

    def type(self, label: str, text: str) -> None:
        """Type into the row with this label, with Enter."""
        self._update(self._find("GuiTextMessage", label)["uuid"], text + ENTERED)

    def choose(self, label: str, option: str) -> None:
        self._update(self._find("GuiDropdownMessage", label)["uuid"], option)

    def tick(self, label: str, value: bool) -> None:
        self._update(self._find("GuiCheckboxMessage", label)["uuid"], value)

    def strike(self, key: str) -> None:
        """Trigger the command of a key, as the page does when the key is pressed."""
        command = self._widget(
            lambda w: (
                w["type"] == "RegisterCommandMessage" and (w["props"]["hotkey"], w["props"]["modifier"]) == (key, None)
            ),
            key,
        )
        self.send({"type": "CommandTriggerMessage", "uuid": command["uuid"]})

    def play(self) -> None:
        """Play if the status line says that the run is paused, as when two visitors have paused at once."""
        time.sleep(SEEN)
        if any("vs-status" in html and ">paused<" in html for html in list(self.html.values())):
            self.strike("space")

    def vanish(self) -> None:
        """Vanish without closing the connection, like a machine that is switched off."""
        self._socket.socket.shutdown(socket.SHUT_RDWR)

    def take(self, message: dict[str, Any]) -> None:
        super().take(message)
        if message["type"] in WIDGETS:
            self._widgets[message["uuid"]] = message
        elif message["type"] == "GuiRemoveMessage":
            self._widgets.pop(message["uuid"], None)

    def _find(self, kind: str, label: str) -> dict[str, Any]:
        return self._widget(lambda w: w["type"] == kind and w["props"].get("label") == label, label)

    def _widget(self, is_it: Callable[[dict[str, Any]], bool], what: str) -> dict[str, Any]:
        """Widget, once the server has sent it. Raises ConnectionClosed, and AssertionError where the page has none.
        what: name of the widget, for the error."""
        found: list[dict[str, Any]] = []

        def there() -> bool:
            found[:] = filter(is_it, self._widgets.values())
            return bool(found)

        self.wait(there, WAITING, describe=lambda: f"the page has no {what!r}")
        return found[0]

    def _update(self, uuid: str, value: object) -> None:
        self.send({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}})


@contextlib.contextmanager
def visit(url: str) -> Iterator[Visitor]:
    """Context with a visitor of the page at this address."""
    with connected(url, open_timeout=OPENING) as connection:
        yield Visitor(connection)
