"""What pages may send, and what a server makes of pages that send anything else, a hundred thousand times."""

from __future__ import annotations

import asyncio
import functools
import logging
import resource
import struct
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import cycle, islice
from typing import Any

import msgspec
import pytest
import viser
import websockets
from hypothesis import given, settings
from hypothesis import strategies as st
from websockets.asyncio.client import ClientConnection

from app.dashboard.page import Dashboard
from app.dashboard.theme.style import ENTERED
from app.dashboard.transport import handshake
from app.dashboard.transport.message_filter import BURST, RATE, STEERING, PageRateLimiter
from app.dashboard.transport.messages import LARGEST_UPLOAD, Page, PageVisitor, RefusedMessage
from app.scenario.data import shipped
from app.session.commands import Load
from app.session.runner import Runner
from drivers.viser_protocol import PROTOCOL
from drivers.waiting import PATIENCE
from tests.support.drawn import drawn
from tests.support.viser_insides import chosen, hotkeys_of, require_readable, widget_labelled, widgets_of

pytestmark = pytest.mark.slow  # servers

pack = msgspec.msgpack.encode
POINT, PIXEL = [0.0, 0.0, 0.0], [0.0, 0.0]
CAMERA = {"type": "ViewerCameraMessage", "wxyz": [1, 0, 0, 0], "position": [1, 1, 1], "look_at": POINT, "fov": 1.0}
CAMERA |= {"near": 0.1, "far": 100, "image_height": 720, "image_width": 1280, "up_direction": [0, 0, 1]}
DRAG = {"type": "SceneNodeDragMessage", "phase": "end", "name": "/hand/handle", "instance_index": None}
DRAG |= {"start_position": POINT, "end_position": POINT, "start_screen_pos": PIXEL, "end_screen_pos": PIXEL}
DRAG |= {"button": "left", "modifier": None, "owner": ""}


@dataclass
class Field:
    value: Any
    label: str = "w"
    disabled: bool = False
    min: float = 0.0
    max: float = 1.0


@dataclass
class Choice:
    value: str = "a"
    options: tuple[str, ...] = ("a", "b")


WIDGETS: dict[str, Any] = {
    "slider": Field(0.5),
    "fixed": Field(0.5, disabled=True),
    "text": Field(""),
    "box": Field(False),
    "row": Field((0.0, 1.0, 2.0)),
    "choice": Choice(),
    "file": Field(viser.UploadedFile("", b"")),
}


def visitor() -> PageVisitor:
    return PageVisitor(Page(WIDGETS.get, lambda uuid: uuid == "form"))


def update(uuid: str, value: object, name: str = "value") -> dict[str, Any]:
    return {"type": "GuiUpdateMessage", "uuid": uuid, "updates": {name: value}}


def upload(name: str = "t", parts: int = 2, size: int = 4, to: str = "file") -> dict[str, Any]:
    return {"type": "FileTransferStartUpload", "source_component_uuid": to, "transfer_uuid": name} | {
        "filename": "f", "mime_type": "", "part_count": parts, "size_bytes": size,
    }  # fmt: skip


def part(index: int, content: bytes = b"ab", name: str = "t") -> dict[str, Any]:
    fields = {"part_index": index, "content": content}
    return {"type": "FileTransferPart", "source_component_uuid": "file", "transfer_uuid": name} | fields


def png(width: int, height: int) -> bytes:
    """All of a picture but what is on it."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", b"") + chunk(b"IEND", b"")


def picture(content: bytes) -> dict[str, Any]:
    return {"type": "GetRenderResponseMessage", "payload": content, "render_uuid": "r"}


@pytest.mark.parametrize(
    "message",
    [
        CAMERA, DRAG, update("slider", 1), update("slider", 0.0), update("text", "<b>"), update("box", True),
        update("row", [1, 2.5, 3]), update("choice", "b"), upload(parts=0, size=0), picture(png(30, 20)),
        {"type": "GuiFormDirtyMessage", "uuid": "form"}, {"type": "CommandTriggerMessage", "uuid": "k"},
    ],
)  # fmt: skip
def test_what_pages_send_is_admitted(message: dict[str, Any]) -> None:
    visitor().admit(pack(message))


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (b"", "message of 0 bytes: "),
        (b"\xc1", "malformed"),
        ("text", "text of 4 characters; allowed: messages in binary form"),
        (b"\xdd\xff\xff\xff\xff", "message of 5 bytes"),
        (b"\x91" * 100_000, "message of 100000 bytes"),
        (b"\x81\xa4type\xa3\xff\xfe\xfd", "message of 10 bytes"),
        (pack([1]), "Expected `object`"),
        (pack({"type": "ShareUrlRequest"}), "Invalid value 'ShareUrlRequest'"),
        (pack({"type": "RunJavascriptMessage", "source": "x"}), "Invalid value"),
        (pack(update("slider", 1, "update_cb")), "update_cb"),
        (pack(update("slider", True, "removed")), "removed"),
        (pack(update("nobody", 1)), "widget: 'nobody'; allowed: one on the page"),
        (pack(update("fixed", 0.1)), "w: 0.1; allowed: nothing, it is disabled"),
        (pack(update("slider", "1")), "w: '1'; allowed: a number from 0 to 1"),
        (pack(update("slider", True)), "w: True; allowed: a number from 0 to 1"),
        (pack(update("slider", 1.01)), "w: 1.01; allowed: a number from 0 to 1"),
        (pack(update("slider", float("nan"))), "Expected `float` >="),
        (pack(update("slider", float("inf"))), "Expected `float` <="),
        (pack(update("slider", 1e308)), "Expected `float` <="),
        (pack(update("slider", [[0.5]])), "Expected `float`, got `array`"),
        (pack(update("slider", None)), "got `None`"),
        (pack(update("slider", {})), "got `object`"),
        (pack(update("text", 1)), "w: 1; allowed: text of at most 20000 characters"),
        (pack(update("text", "x" * 30_000)), "w: 'x{30}' and 29970 more characters; allowed: at most 20000 in all"),
        (pack(update("box", 1)), "w: 1; allowed: true or false"),
        (pack(update("row", [1, 2])), r"w: \[1.0, 2.0\]; allowed: 3 numbers"),
        (pack(update("row", [1, 2, float("nan")])), "Expected `float` >="),
        (pack(update("choice", "c")), "'c'; allowed: one of a, b"),
        (pack(update("file", "x")), "allowed: nothing"),
        (pack({"type": "GuiFormDirtyMessage", "uuid": "x"}), "form: 'x'; allowed: one on the page"),
        (pack(CAMERA | {"position": [float("nan"), 0, 0]}), r"\$.position"),
        (pack(CAMERA | {"wxyz": [1]}), r"\$.wxyz"),
        (pack(DRAG | {"end_position": [0, float("inf"), 0]}), r"\$.end_position"),
        (pack(DRAG | {"phase": "middle"}), r"\$.phase"),
        (pack(upload(to="text")), "allowed: an upload button"),
        (pack(upload(size=LARGEST_UPLOAD + 1)), "bytes; allowed: at most"),
        (pack(upload(parts=10**9)), r"\$.part_count"),
        (pack(upload(parts=0, size=10)), "10 bytes in 0 parts; allowed: all in parts"),
        (pack(upload(parts=1, size=0)), "0 bytes in 1 parts; allowed: all in parts"),
        (pack(picture(b"<svg/>")), "picture of 6 bytes; allowed: PNG or JPEG"),
        (pack(picture(png(9_000, 9_000))), "picture of 9000 x 9000; allowed: PNG or JPEG of at most 80000000 pixels"),
        (pack(picture(png(90_000, 90_000))), "allowed: PNG or JPEG of at most 80000000 pixels"),
        (pack(part(0)), "parts that this page has announced"),
    ],
)  # fmt: skip
def test_what_no_page_sends_is_refused_in_a_sentence(message: bytes | str, reason: str) -> None:
    with pytest.raises(RefusedMessage, match=reason) as caught:
        visitor().admit(message)
    assert len(str(caught.value)) < 400


def test_uploads_hold_no_more_than_was_announced() -> None:
    page = visitor()
    page.admit(pack(upload() | {"part_count": 3, "size_bytes": 5}))
    page.admit(pack(part(1)))
    for again in (part(1), part(7), part(0, b"four"), part(0, name="other")):
        with pytest.raises(RefusedMessage, match="allowed"):
            page.admit(pack(again))
    page.admit(pack(part(0)))
    with pytest.raises(RefusedMessage, match="1 in all that are missing"):
        page.admit(pack(part(2, b"")))
    page.admit(pack(part(2, b"a")))
    assert page.finished == {"t"}
    for number in range(4):
        page.admit(pack(upload(str(number))))
    with pytest.raises(RefusedMessage, match="4 at a time"):
        page.admit(pack(upload("5")))


ANYTHING = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**63)
    | st.floats()
    | st.text(max_size=8)
    | st.binary(max_size=4),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=6), inner, max_size=3),
    max_leaves=8,
)
HONEST = [CAMERA, DRAG, update("slider", 0.5), update("row", [1, 2, 3]), upload(), part(0)]


@st.composite
def nearly_honest(draw: st.DrawFn) -> bytes:
    message = dict(draw(st.sampled_from(HONEST)))
    message[draw(st.sampled_from([*message, "x"]))] = draw(ANYTHING)
    return pack(message)


@given(st.one_of(st.binary(max_size=60), ANYTHING.map(pack), nearly_honest()))
@settings(max_examples=400, deadline=None)
def test_what_is_admitted_viser_can_read(raw: bytes) -> None:
    with suppress(RefusedMessage):
        visitor().admit(raw)
        require_readable(raw)


def test_a_page_that_sends_too_much_waits_and_an_honest_one_never_does() -> None:
    meter = PageRateLimiter(
        RATE, BURST, BURST, at=0.0
    )  # 100 movements and 20 steps of a slider a second, for five minutes
    assert not any(meter.wait(100 + 20 * STEERING, now=float(second)) for second in range(300))
    meter = PageRateLimiter(RATE, BURST, BURST, at=0.0)
    now = 0.0
    for _ in range(50_000):
        now += meter.wait(1.0, now)
    assert now == pytest.approx((50_000 - BURST) / RATE, rel=0.01)


# a server


@pytest.fixture
def unmetered(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Dashboard, Runner]]:
    """A dashboard whose pages may send as fast as they can: harder than any that is served."""
    monkeypatch.setattr(PageRateLimiter, "wait", lambda *_: 0.0)
    # a sign of life waits behind thousands of messages
    begun = functools.partialmethod(handshake._Guarded.__init__, ping_interval=None)
    monkeypatch.setattr(handshake._Guarded, "__init__", begun)
    runner = Runner(shipped()["ur5-hybrid"])
    dashboard = Dashboard(runner, port=0, fps=8.0)
    runner.start()
    with drawn(dashboard):
        yield dashboard, runner
    runner.close()


async def page(dashboard: Dashboard) -> tuple[ClientConnection, asyncio.Task[None]]:
    """A page that reads what it is sent, as the task, and has told where it looks from."""
    known = set(dashboard.clients)
    connection = await websockets.connect(
        f"ws://127.0.0.1:{dashboard.port}/",
        subprotocols=[PROTOCOL],
        max_size=None,
        open_timeout=PATIENCE,
        ping_interval=None,
    )

    async def read() -> None:
        with suppress(websockets.ConnectionClosed):  # a server that is busy may not say goodbye in time
            async for _ in connection:
                pass

    reading = asyncio.create_task(read())
    await connection.send(pack(CAMERA))
    await until(lambda: bool(set(dashboard.clients) - known))
    return connection, reading


async def until(condition: Callable[[], bool], patience: float = PATIENCE) -> None:
    last = time.monotonic() + patience
    while not condition():
        assert time.monotonic() < last
        await asyncio.sleep(0.02)


def attacks(dashboard: Dashboard) -> list[bytes | str]:
    """What there is to send: to every widget of the page values that it may hold, and that it may not."""
    widgets = widgets_of(dashboard._server)
    values = [
        True,
        0,
        0.5,
        1e308,
        float("nan"),
        "",
        "1; 2",
        f"1{ENTERED}",
        f"nan{ENTERED}",
        f"<b>{ENTERED}",
        [1, 2, 3],
        [[1]],
        None,
    ]
    sent = [pack(update(uuid, value)) for uuid in widgets for value in values]
    sent += [pack(update(uuid, 1, name)) for uuid in list(widgets)[:5] for name in ("update_cb", "removed", "sync_cb")]
    sent += [pack(update("nobody", 1)), pack(part(0)), pack(upload(parts=10**9)), pack({"type": "ShareUrlRequest"})]
    sent += [
        b"",
        b"\xc1",
        "text",
        b"\x91" * 1000,
        pack(CAMERA | {"fov": float("nan")}),
        pack(CAMERA)[:-9],
        bytes(20_000),
    ]
    for phase in ("update", "end", "start", "start", "update"):  # as no hand does it, and 1e11 m away
        sent += [
            pack(DRAG | {"phase": phase, "end_position": [x, 0, 0], "modifier": m})
            for x in (0.5, 1e11)
            for m in (None, "shift")
        ]
    return sent  # fmt: skip


def test_thirty_thousand_messages_do_no_harm(
    capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture, unmetered: tuple[Dashboard, Runner]
) -> None:
    # in this order: while the server stops its threads may still print, into what `capfd` must not have closed yet
    dashboard, runner = unmetered
    first = runner.snapshot.scenario
    caplog.set_level(logging.WARNING)

    def key(name: str) -> dict[str, Any]:
        """The message of a key that is a command of the page."""
        return {"type": "CommandTriggerMessage", "uuid": hotkeys_of(dashboard._server)[name]}

    async def flood(first: int) -> None:
        connection, reading = await page(dashboard)
        sent = attacks(dashboard)
        assert len(sent) < 7_500  # so all of them are sent
        for message in islice(cycle(sent), first, first + 7_500):
            await connection.send(message)
        assert not reading.done()
        await connection.close()

    async def scribble() -> None:
        for text in (
            bytes(200),
            b"\xff" * 200,
            b"GET / HTTP/9.9\r\n\r\n",
            b"GET /\r\n" * 2000,
            b"POST / HTTP/1.1\r\n\r\n",
        ):
            for _ in range(10):
                _, writer = await asyncio.open_connection("127.0.0.1", dashboard.port)
                writer.write(text)
                writer.close()

    async def act() -> None:
        honest, reading = await page(dashboard)
        used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        await asyncio.gather(scribble(), *(flood(first) for first in (0, 700, 1400, 2100)))
        await until(lambda: len(dashboard.clients) == 1)
        assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - used < 150_000  # kB
        # what the attacks have left depends on their order; in a scenario of theirs the arm may fall at once
        runner.post(Load(first))
        await until(lambda: runner.snapshot.scenario == first)
        await honest.send(pack(chosen(widget_labelled(dashboard._server, "noise [N]"), f"0.125{ENTERED}")))
        await until(lambda: runner.snapshot.scenario.sensor.noise == 0.125)
        await honest.send(pack(key("R")))
        await until(lambda: runner.snapshot.t < 0.01 or runner.snapshot.phase == "running")
        if runner.snapshot.phase != "running":
            await honest.send(pack(key("space")))
        await until(lambda: runner.snapshot.phase == "running" and runner.snapshot.t > 0.1)
        assert not reading.done()
        await honest.close()

    asyncio.run(act())
    assert "internal error" not in runner.snapshot.reason
    assert len(caplog.records) < 60, [record.getMessage() for record in caplog.records][:60]
    assert not [record.getMessage() for record in caplog.records if record.levelno >= logging.ERROR or record.exc_info]
    assert "Traceback" not in "".join(capfd.readouterr())
