"""Messages that a page may send, each checked before viser reads it. viser trusts its pages: it would set any attribute
of a widget, keep data that nobody ever asks for, and open a tunnel to the Internet.

Only the messages that the pages of this program send are admitted. A new widget with another kind of message needs a
class here.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, Protocol

import msgspec
from msgspec import Meta, Struct
from PIL import Image

LONGEST_TEXT = 20_000  # characters: a matrix of eight rows has 2000
LARGEST_UPLOAD = 8_000_000  # bytes, more than any reader of an upload takes
LARGEST_PART = 1_000_000  # bytes: the page sends half a megabyte at a time
LARGEST_PAGE = 16_384  # px
LARGEST_PICTURE = 80_000_000  # pixels of a picture of the scene; viser decodes it, and an empty one has few bytes
MOST_UPLOADS = 4  # of one page at the same time
SLACK = 1e-9  # of a range: a slider's steps do not add up exactly

Number = Annotated[float, Meta(ge=-1e12, le=1e12)]  # neither nan nor inf
Name = Annotated[str, Meta(max_length=200)]
Point = tuple[Number, Number, Number]
Pixel = tuple[Number, Number]
Modifier = Name | None


class RefusedMessage(ValueError):
    """Error of a message that no page of this program sends: one sentence with the field, the value and what is
    allowed."""


class LongText(RefusedMessage):
    """Error of a text that is too long, which a user can paste into a field of the page."""


class _Message(Struct, frozen=True, forbid_unknown_fields=True, tag=True):
    """Message of a page, tagged with viser's name of its kind."""


class _Updates(Struct, frozen=True, forbid_unknown_fields=True):
    value: bool | Annotated[int, Meta(ge=-(10**12), le=10**12)] | Number | str | list[Number]


class GuiUpdateMessage(_Message, frozen=True):
    """Message of a new value of a widget."""

    uuid: Name
    updates: _Updates


class GuiFormSubmitMessage(_Message, frozen=True):
    """Message of a form that was sent."""

    uuid: Name


class GuiFormDirtyMessage(_Message, frozen=True):
    """Message of a form whose widgets have changed."""

    uuid: Name


class CommandTriggerMessage(_Message, frozen=True):
    """Message of a command that was chosen."""

    uuid: Name


class ViewerCameraMessage(_Message, frozen=True):
    """Message of the page's camera."""

    wxyz: tuple[Number, Number, Number, Number]
    position: Point
    fov: Number
    near: Number
    far: Number
    image_height: Annotated[int, Meta(ge=0, le=LARGEST_PAGE)]
    image_width: Annotated[int, Meta(ge=0, le=LARGEST_PAGE)]
    look_at: Point
    up_direction: Point


class SceneNodeDragMessage(_Message, frozen=True):
    """Message of a pointer that drags an object of the scene."""

    phase: Literal["start", "update", "end"]
    name: Name
    instance_index: int | None
    start_position: Point
    start_screen_pos: Pixel
    end_position: Point
    end_screen_pos: Pixel
    button: Literal["left", "middle", "right"]
    modifier: Modifier
    owner: Name = ""


class FileTransferStartUpload(_Message, frozen=True):
    """Message that begins an upload."""

    source_component_uuid: Name
    transfer_uuid: Name
    filename: Annotated[str, Meta(max_length=1000)]
    mime_type: Name
    part_count: Annotated[int, Meta(ge=0, le=1000)]
    size_bytes: Annotated[int, Meta(ge=0)]


class FileTransferPart(_Message, frozen=True):
    """Message of a part of an upload."""

    source_component_uuid: Name | None
    transfer_uuid: Name
    part_index: Annotated[int, Meta(ge=0, le=1000)]
    content: bytes


class GetRenderResponseMessage(_Message, frozen=True):
    """Message of a picture of the scene that the program has asked for."""

    payload: bytes
    render_uuid: Name


Message = (
    GuiUpdateMessage
    | GuiFormSubmitMessage
    | GuiFormDirtyMessage
    | CommandTriggerMessage
    | ViewerCameraMessage
    | SceneNodeDragMessage
    | FileTransferStartUpload
    | FileTransferPart
    | GetRenderResponseMessage
)
_decoder = msgspec.msgpack.Decoder(Message)


class ViserWidget(Protocol):
    """Widget of viser, as far as it is used here; it may also have `options`, or `min` and `max`."""

    @property
    def value(self) -> Any: ...


@dataclass(frozen=True)
class Page:
    """Page, as far as messages refer to it. Its widgets change while it is open.
    widget: returns the widget of a name in messages, None for none.
    is_form: returns whether the name is that of a form."""

    widget: Callable[[str], ViserWidget | None]
    is_form: Callable[[str], bool]


@dataclass
class _Upload:
    """Upload in progress. parts: numbers of the parts that are still to come. size: bytes that are still to come."""

    parts: set[int]
    size: int


@dataclass
class PageVisitor:
    """Visitor: one connection, whose messages are checked against its page and its uploads. Used by one thread.

    finished: names of complete uploads.
    begun: names of uploads in progress.
    """

    page: Page
    finished: set[str] = field(default_factory=set)
    _uploads: dict[str, _Upload] = field(default_factory=dict)

    @property
    def begun(self) -> set[str]:
        return set(self._uploads)

    def admit(self, raw: bytes | str) -> Message:
        """The decoded message, if the page may send it now. Raises RefusedMessage."""
        if isinstance(raw, str):
            raise RefusedMessage(f"message: text of {len(raw)} characters; allowed: messages in binary form")
        try:
            message = _decoder.decode(raw)
        except ValueError as error:  # no MessagePack, no UTF-8, or no such message
            raise RefusedMessage(f"message of {len(raw)} bytes: {error}") from error
        match message:
            case GuiUpdateMessage(uuid=uuid, updates=updates):
                self._require_value(uuid, updates.value)
            case GuiFormSubmitMessage(uuid=uuid) | GuiFormDirtyMessage(uuid=uuid) if not self.page.is_form(uuid):
                raise RefusedMessage(f"form: {uuid!r:.60}; allowed: one on the page")
            case FileTransferStartUpload():
                self._begin(message)
            case FileTransferPart():
                self._take(message)
            case GetRenderResponseMessage(payload=payload):
                _require_picture(payload)
        return message

    def _require_value(self, uuid: str, value: object) -> None:
        widget = self.page.widget(uuid)
        if widget is None:
            raise RefusedMessage(f"widget: {uuid!r:.60}; allowed: one on the page")
        allowed, label = _allowed(widget), str(getattr(widget, "label", "") or type(widget).__name__)
        if getattr(widget, "disabled", False):
            raise RefusedMessage(f"{label}: {value!r:.60}; allowed: nothing, it is disabled")
        if isinstance(value, str) and len(value) > LONGEST_TEXT:
            raise LongText(
                f"{label}: {value[:30]!r} and {len(value) - 30} more characters; allowed: at most {LONGEST_TEXT} in all"
            )
        if not allowed.admits(value):
            raise RefusedMessage(f"{label}: {value!r:.60}; allowed: {allowed.sentence}")

    def _begin(self, message: FileTransferStartUpload) -> None:
        widget = self.page.widget(message.source_component_uuid)
        if widget is None or not hasattr(widget.value, "content"):
            raise RefusedMessage(
                f"upload to {message.source_component_uuid!r:.60}; allowed: an upload button of the page"
            )
        if message.size_bytes > LARGEST_UPLOAD:
            raise RefusedMessage(f"upload: {message.size_bytes} bytes; allowed: at most {LARGEST_UPLOAD}")
        if (message.part_count == 0) != (message.size_bytes == 0):
            raise RefusedMessage(
                f"upload: {message.size_bytes} bytes in {message.part_count} parts; allowed: all in parts"
            )
        if message.transfer_uuid in self._uploads or len(self._uploads) >= MOST_UPLOADS:
            raise RefusedMessage(
                f"upload {message.transfer_uuid!r:.60}: allowed: a new one, and {MOST_UPLOADS} at a time"
            )
        self._uploads[message.transfer_uuid] = _Upload(set(range(message.part_count)), message.size_bytes)
        self._end(message.transfer_uuid)

    def _take(self, message: FileTransferPart) -> None:
        upload, size = self._uploads.get(message.transfer_uuid), len(message.content)
        what = f"upload {message.transfer_uuid!r:.60}: part {message.part_index} of {size} bytes; allowed:"
        if upload is None or message.part_index not in upload.parts:
            raise RefusedMessage(f"{what} parts that this page has announced, once")
        if size > min(upload.size, LARGEST_PART) or (len(upload.parts) == 1 and size != upload.size):
            raise RefusedMessage(f"{what} at most {LARGEST_PART} bytes, and {upload.size} in all that are missing")
        upload.parts.discard(message.part_index)
        upload.size -= size
        self._end(message.transfer_uuid)

    def _end(self, name: str) -> None:
        if not self._uploads[name].parts:
            del self._uploads[name]
            self.finished.add(name)


def _require_picture(content: bytes) -> None:
    allowed = f"allowed: PNG or JPEG of at most {LARGEST_PICTURE} pixels"
    try:
        with Image.open(io.BytesIO(content), formats=("PNG", "JPEG")) as picture:  # reads the head only
            width, height = picture.size
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise RefusedMessage(f"picture of {len(content)} bytes; {allowed}") from error
    if width * height > LARGEST_PICTURE:
        raise RefusedMessage(f"picture of {width} x {height}; {allowed}")


@dataclass(frozen=True)
class _Allowed:
    sentence: str
    admits: Callable[[object], bool]


def _allowed(widget: ViserWidget) -> _Allowed:
    """Values that a widget may be set to, by the type of its present value."""
    value = widget.value
    if isinstance(value, bool):
        return _Allowed("true or false", lambda new: isinstance(new, bool))
    if isinstance(value, str):
        options = getattr(widget, "options", None)
        if options is None:
            return _Allowed(f"text of at most {LONGEST_TEXT} characters", lambda new: isinstance(new, str))
        return _Allowed(f"one of {', '.join(options)}"[:200], lambda new: new in options)
    if isinstance(value, int | float):
        low, high = (getattr(widget, end, None) for end in ("min", "max"))
        low, high = -float("inf") if low is None else low, float("inf") if high is None else high
        slack = SLACK * max(1.0, abs(value))
        return _Allowed(
            f"a number from {low:g} to {high:g}",
            lambda new: (
                isinstance(new, int | float) and not isinstance(new, bool) and low - slack <= new <= high + slack
            ),
        )
    if isinstance(value, tuple):
        count = len(value)
        return _Allowed(f"{count} numbers", lambda new: isinstance(new, list) and len(new) == count)
    return _Allowed("nothing", lambda _: False)
