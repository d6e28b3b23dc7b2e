"""Private parts of viser that tests use, all of them here, and stand-ins for those of its parts that the program uses
through `app.dashboard.transport.viser_private`."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import viser
from viser._messages import Message

from app.dashboard.transport.viser_private import uuid_of


def widgets_of(server: viser.ViserServer) -> dict[str, Any]:
    """Widgets that all pages share, in the order in which they were made, by their names in messages."""
    return dict(server.gui._gui_input_handle_from_uuid)


def widget_labelled(server: viser.ViserServer, label: str) -> Any:
    """The first of these widgets with this label."""
    return next(each for each in widgets_of(server).values() if getattr(each, "label", "") == label)


def hotkeys_of(server: viser.ViserServer) -> dict[str, str]:
    """Names, in messages, of the commands that have a key, by their keys."""
    return {each.hotkey: uuid for uuid, each in dict(server.gui._command_handle_from_uuid).items()}


def buffer_of(server: viser.ViserServer) -> Any:
    """Buffer of the messages to all pages."""
    return server._websock_server.get_message_buffer()


def chosen(widget: Any, value: object) -> dict[str, Any]:
    """Message of a page on which a widget got this value."""
    return {"type": "GuiUpdateMessage", "uuid": uuid_of(widget), "updates": {"value": value}}


def require_readable(message: bytes) -> None:
    """Raise what viser raises for a message of a page that it cannot read."""
    Message.deserialize(message)


def scene_stand_in() -> MagicMock:
    """Stand-in for a scene, with one pose for all frames that are added to it."""
    scene = MagicMock()
    scene.add_frame.return_value._impl = SimpleNamespace(
        name="", position=np.zeros(3), wxyz=np.zeros(4), api=MagicMock()
    )
    return scene


def text_field_stand_in() -> Any:
    """Stand-in for a text field, which keeps its callbacks in `callbacks`."""
    callbacks: list[Any] = []
    return SimpleNamespace(_impl=SimpleNamespace(uuid="1"), value="", on_update=callbacks.append, callbacks=callbacks)
