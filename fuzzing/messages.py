"""Fuzzing of the messages of a page: viser must be able to read every admitted one."""

from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import msgspec
from viser._messages import Message

from app.dashboard.transport.messages import Page, PageVisitor, RefusedMessage


@dataclass
class _Widget:
    value: Any
    min: float = 0.0
    max: float = 1.0


@dataclass
class _File:
    content: bytes = b""


WIDGETS = {
    "slider": _Widget(0.5),
    "text": _Widget(""),
    "box": _Widget(False),
    "row": _Widget((0.0, 1.0)),
    "file": _Widget(_File()),
}
_POINT, _PIXEL = [0.0, 0.0, 0.0], [0.0, 0.0]
_UPLOAD = {"source_component_uuid": "file", "transfer_uuid": "a"}
_MESSAGES: tuple[tuple[str, dict[str, object]], ...] = (
    *(("GuiUpdateMessage", {"uuid": name, "updates": {"value": 1}}) for name in WIDGETS),
    ("CommandTriggerMessage", {"uuid": "k"}),
    (
        "SceneNodeDragMessage",
        {"phase": "start", "name": "/hand", "instance_index": None, "button": "left", "modifier": None, "owner": ""}
        | {"start_position": _POINT, "end_position": _POINT, "start_screen_pos": _PIXEL, "end_screen_pos": _PIXEL},
    ),
    (
        "ViewerCameraMessage",
        {"wxyz": [1, 0, 0, 0], "position": _POINT, "look_at": _POINT, "up_direction": _POINT}
        | {"fov": 1.0, "near": 0.1, "far": 9.0, "image_height": 1, "image_width": 1},
    ),
    ("FileTransferStartUpload", _UPLOAD | {"filename": "f", "mime_type": "", "part_count": 1, "size_bytes": 1}),
    ("FileTransferPart", _UPLOAD | {"part_index": 0, "content": b"x"}),
)
SEEDS = tuple(msgspec.msgpack.encode({"type": name, **fields}) for name, fields in _MESSAGES)
DICTIONARY = ("GuiUpdateMessage", "ShareUrlRequest", "updates", "value", "update_cb", *WIDGETS)


def read(data: bytes) -> None:
    with suppress(RefusedMessage):
        PageVisitor(Page(WIDGETS.get, lambda uuid: uuid == "form")).admit(data)
        Message.deserialize(data)
