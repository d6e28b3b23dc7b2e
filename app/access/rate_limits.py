"""Rate limits and filters for messages from a page, applied before viser sees them.

viser's client sends msgpack maps with a `type`; a file comes as one `FileTransferStartUpload` and then parts.
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any, TypeVar

import msgspec

MEGABYTE = 2**20
MOST_PARTS = 10_000  # of one file; pages send parts of half a megabyte


@dataclass(frozen=True)
class ConnectionLimits:
    """Limits of one connection, and of a session's process.
    message, watchers_message: size of a message in bytes; the largest are pictures of the scene.
    rate, burst: messages per second in the long run, and messages at once.
    upload, uploads: bytes of one file, and of all files that are not yet complete.
    per_session: connections of a session's process."""

    message: int = 12 * MEGABYTE
    watchers_message: int = 64 * 1024
    rate: float = 300.0
    burst: float = 3000.0
    upload: int = 8 * MEGABYTE
    uploads: int = 16 * MEGABYTE
    per_session: int = 64


class Overrun(ValueError):
    """A limit exceeded: one sentence, short enough for the reason of a closed web socket (123 bytes)."""


_T = TypeVar("_T")


class _Envelope(msgspec.Struct):
    type: str
    transfer_uuid: str = ""
    part_count: int = 0
    size_bytes: int = 0


class _Part(msgspec.Struct):
    transfer_uuid: str
    content: memoryview


class _Camera(msgspec.Struct, forbid_unknown_fields=True):
    type: str
    wxyz: tuple[float, float, float, float]
    position: tuple[float, float, float]
    fov: float
    near: float
    far: float
    image_height: int
    image_width: int
    look_at: tuple[float, float, float]
    up_direction: tuple[float, float, float]


class _Update(msgspec.Struct, forbid_unknown_fields=True):
    type: str
    uuid: str
    updates: dict[str, Any]


_envelope = msgspec.msgpack.Decoder(_Envelope, strict=False)
_part = msgspec.msgpack.Decoder(_Part)
_camera = msgspec.msgpack.Decoder(_Camera, strict=False)
_update = msgspec.msgpack.Decoder(_Update)

# no page of this program sends them: viser would make the server known to a public one
_NEVER = frozenset({"ShareUrlRequest", "ShareUrlDisconnect"})
_REPORT = re.compile(r"""(?P<tabs>[^#<>&"'\x00-\x1f]{0,200})#[0-9x]{0,11}#(?P<number>[0-9.e-]{0,30})""")
_LARGEST_PAGE = 16384  # px


class ConnectionRateLimiter:
    """Rate limiter: counts the messages of one connection."""

    def __init__(self, limits: ConnectionLimits, clock: Callable[[], float] = time.monotonic) -> None:
        self._limits, self._clock = limits, clock
        self._left, self._counted = limits.burst, clock()
        self._files: dict[str, int] = {}

    @property
    def largest(self) -> int:
        """Bytes of the largest message."""
        return self._limits.message

    def count(self) -> None:
        """Count one more message. Raises Overrun, to close the connection."""
        limits, now = self._limits, self._clock()
        self._left = min(self._left + (now - self._counted) * limits.rate, limits.burst) - 1.0
        self._counted = now
        if self._left < 0.0:
            raise Overrun(f"too many messages; allowed: {limits.rate:g} per second")

    def admits(self, raw: bytes | str) -> bool:
        """Whether to pass this message on, False for one to leave out; the message is counted. Raises Overrun."""
        self.count()
        limits = self._limits
        if len(raw) > limits.message:
            raise Overrun(f"a message of {len(raw) / MEGABYTE:.1f} MB; allowed: {_megabytes(limits.message)}")
        envelope = _opened(raw, _envelope)
        if envelope.type == "FileTransferStartUpload":
            self._begin(envelope)
        elif envelope.type == "FileTransferPart":
            return self._take(raw)
        return envelope.type not in _NEVER

    def _begin(self, envelope: _Envelope) -> None:
        size, limits = envelope.size_bytes, self._limits
        if envelope.part_count > MOST_PARTS:
            raise Overrun(f"a file in {envelope.part_count} parts; allowed: at most {MOST_PARTS}")
        if not 0 <= size <= limits.upload:
            raise Overrun(f"a file of {size / MEGABYTE:.1f} MB; allowed: {_megabytes(limits.upload)}")
        if sum(self._files.values()) + size > limits.uploads or len(self._files) >= 100:
            raise Overrun(f"files of more than {_megabytes(limits.uploads)} at once; allowed: one after the other")
        if size:
            self._files[envelope.transfer_uuid] = size

    def _take(self, raw: bytes | str) -> bool:
        part = _opened(raw, _part)
        left = self._files.pop(part.transfer_uuid, None)
        if left is None:
            return False
        left -= max(len(part.content), 1)
        if left < 0:
            raise Overrun("a file longer than it was said to be")
        if left:
            self._files[part.transfer_uuid] = left
        return True


def harmless(raw: bytes, report_fields: Collection[str]) -> bytes | None:
    """Part of a watcher's message that may reach the session, None for nothing: the watcher's camera, and the tabs of
    plots on the watcher's screen, so that they are drawn. The run depends on neither.
    report_fields: ids of the fields that take the tabs."""
    try:
        kind = _opened(raw, _envelope).type
        if kind == "ViewerCameraMessage":
            camera = _camera.decode(raw)
            numbers = (*camera.wxyz, *camera.position, *camera.look_at, *camera.up_direction)
            if not all(map(math.isfinite, (*numbers, camera.fov, camera.near, camera.far))):
                return None
            if not (0 < camera.image_height <= _LARGEST_PAGE and 0 < camera.image_width <= _LARGEST_PAGE):
                return None
            return msgspec.msgpack.encode(camera)  # its numbers, in place of texts that say numbers
        if kind == "GuiUpdateMessage":
            update = _update.decode(raw)
            value = update.updates.get("value")
            if update.uuid in report_fields and update.updates.keys() == {"value"} and isinstance(value, str):
                if (report := _REPORT.fullmatch(value)) is None:
                    return None
                # the plots of all are fitted to the lowest scene: a watcher's does not count
                tabs = msgspec.structs.replace(update, updates={"value": f"{report['tabs']}##{report['number']}"})
                return msgspec.msgpack.encode(tabs)
    except (Overrun, msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        return None
    return None


def _opened(raw: bytes | str, decoder: msgspec.msgpack.Decoder[_T]) -> _T:
    """Decoded message. Raises Overrun for a message that no page of this program sends."""
    if isinstance(raw, bytes):
        try:
            return decoder.decode(raw)
        except (msgspec.MsgspecError, RecursionError, ValueError):
            pass
    raise Overrun("not a message of the page")


def _megabytes(size: int) -> str:
    return f"{size / MEGABYTE:g} MB"
