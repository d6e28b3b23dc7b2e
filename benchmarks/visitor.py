"""Visitor without a browser, which speaks viser's protocol: it reads the page's controls and acts as a page would."""

from __future__ import annotations

import contextlib
import random
import socket
import threading
import time
from collections.abc import Callable, Iterator

import msgspec
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.sync.connection import Connection

from app.dashboard.theme.style import COMMIT, RELEASED
from drivers.viser_protocol import CAMERA, PROTOCOL, messages

WIDGETS = ("GuiTextMessage", "GuiSliderMessage", "GuiDropdownMessage", "GuiCheckboxMessage", "RegisterCommandMessage")
DRAG, PAUSE = 20, 0.05  # messages of a drag, and s between two of them
SEEN = 1.0  # s, after which the status line shows the effect of a command


class Visitor:
    """Visitor, connected while the context of `visit` lasts. The server's messages are read all the time."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._widgets: dict[str, dict] = {}
        self._html: dict[str, str] = {}
        self._received = threading.Condition()
        threading.Thread(target=self._read, daemon=True).start()
        self._send(CAMERA)

    def slider(self, label: str) -> str:
        """Identifier of the slider in the row with this label: both are in one form."""
        row = self._find("GuiTextMessage", label)["container_uuid"]
        return self._wait(lambda w: w["type"] == "GuiSliderMessage" and w["container_uuid"] == row, label)["uuid"]

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
        self._update(self._find("GuiTextMessage", label)["uuid"], text + COMMIT)

    def choose(self, label: str, option: str) -> None:
        self._update(self._find("GuiDropdownMessage", label)["uuid"], option)

    def tick(self, label: str, value: bool) -> None:
        self._update(self._find("GuiCheckboxMessage", label)["uuid"], value)

    def press(self, key: str) -> None:
        """Trigger the command of a key, as the page does when the key is pressed."""
        command = self._wait(
            lambda w: (
                w["type"] == "RegisterCommandMessage" and (w["props"]["hotkey"], w["props"]["modifier"]) == (key, None)
            ),
            key,
        )
        self._send({"type": "CommandTriggerMessage", "uuid": command["uuid"]})

    def play(self) -> None:
        """Play if the status line says that the run is paused, as when two visitors have paused at once."""
        time.sleep(SEEN)
        if any("vs-status" in html and ">paused<" in html for html in list(self._html.values())):
            self.press("space")

    def vanish(self) -> None:
        """Vanish without closing the connection, like a machine that is switched off."""
        self._connection.socket.shutdown(socket.SHUT_RDWR)

    def _find(self, kind: str, label: str) -> dict:
        return self._wait(lambda w: w["type"] == kind and w["props"].get("label") == label, label)

    def _wait(self, is_it: Callable[[dict], bool], what: str) -> dict:
        """Widget, once the server has sent it. Raises TimeoutError. what: name of the widget, for the error."""
        with self._received:
            found = self._received.wait_for(lambda: next(filter(is_it, self._widgets.values()), None), timeout=60.0)
        if found is None:
            raise TimeoutError(f"the page has no {what!r}")
        return found

    def _read(self) -> None:
        with contextlib.suppress(ConnectionClosed):
            for frame in self._connection:
                assert isinstance(frame, bytes)
                for message in messages(frame):
                    if message["type"] in WIDGETS:
                        with self._received:
                            self._widgets[message["uuid"]] = message
                            self._received.notify_all()
                    elif message["type"] == "GuiRemoveMessage":
                        with self._received:
                            self._widgets.pop(message["uuid"], None)
                    elif message["type"] == "GuiHtmlMessage":
                        self._html[message["uuid"]] = message["props"]["content"]
                    elif message["type"] == "GuiUpdateMessage" and "content" in message["updates"]:
                        self._html[message["uuid"]] = message["updates"]["content"]

    def _update(self, uuid: str, value: object) -> None:
        self._send({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}})

    def _send(self, message: dict) -> None:
        self._connection.send(msgspec.msgpack.encode(message))


@contextlib.contextmanager
def visit(url: str) -> Iterator[Visitor]:
    with connect(url.replace("http", "ws"), subprotocols=[PROTOCOL], max_size=None, compression=None) as connection:
        yield Visitor(connection)
