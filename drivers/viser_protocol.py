"""Protocol between viser's pages and its server, for clients without a browser."""

from __future__ import annotations

from typing import Any

import msgspec
import viser
import zstandard
from websockets.typing import Subprotocol

PROTOCOL = Subprotocol(f"viser-v{viser.__version__}")
CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (1.0, 1.0, 1.0),
    "fov": 1.0,
    "near": 0.1,
    "far": 10.0,
    "image_height": 720,
    "image_width": 1280,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}  # viser counts a client as connected only when it has sent its camera


def messages(frame: bytes) -> list[dict[str, Any]]:
    """Messages of a frame, which has two lengths of 8 bytes, the packed messages, then the arrays that they name."""
    packed = int.from_bytes(frame[8:16], "little")
    return msgspec.msgpack.decode(zstandard.decompress(frame[16 : 16 + packed]))["messages"]
