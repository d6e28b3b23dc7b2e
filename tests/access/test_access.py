"""Who may speak to a server of ours, how much, and what a watcher's words are worth."""

from __future__ import annotations

import math
import socket
from typing import Any

import msgspec
import pytest

from app.access.admission import Names, OriginError, Tokens
from app.access.rate_limits import ConnectionLimits, ConnectionRateLimiter, Overrun, harmless
from drivers.viser_protocol import CAMERA

PUBLIC = Names(public=("https://lab.example.org",))
LOOKING = frozenset({"field"})


def packed(**message: Any) -> bytes:
    return msgspec.msgpack.encode(message)


@pytest.mark.parametrize(
    ("names", "headers", "status"),
    [
        (Names(), {"Host": "127.0.0.1:8080"}, None),
        (Names(), {"Host": "localhost:9000", "Origin": "http://localhost:9000"}, None),  # through an SSH tunnel
        (Names(), {"Host": "[::1]:8080", "Origin": "http://[::1]:8080"}, None),
        (Names(), {"Host": "127.0.0.1:8080", "Origin": "http://evil.example"}, 403),
        (Names(), {"Host": "127.0.0.1:8080", "Origin": "http://127.0.0.1:9999"}, 403),  # another server of this machine
        (Names(), {"Host": "127.0.0.1:8080", "Origin": "null"}, 403),
        (Names(), {"Host": "evil.example:8080", "Origin": "http://evil.example:8080"}, 421),  # DNS rebinding
        (Names(), {"Host": "192.0.2.7:8080"}, 421),
        (Names(), {}, 421),
        (Names(), {"Host": "[::1"}, 421),
        (Names("0.0.0.0"), {"Host": "192.0.2.7:8080", "Origin": "http://192.0.2.7:8080"}, None),
        (Names("0.0.0.0"), {"Host": "evil.example", "Origin": "http://evil.example"}, 421),
        (PUBLIC, {"Host": "lab.example.org", "Origin": "https://lab.example.org"}, None),
        (PUBLIC, {"Host": "127.0.0.1:80", "Origin": "https://lab.example.org"}, None),
        (PUBLIC, {"Host": "lab.example.org", "Origin": "https://evil.example"}, 403),
        (PUBLIC, {"Host": "127.0.0.1:80", "Origin": "https://[x"}, 403),
        (PUBLIC, {"Host": "lab.example.org", "Origin": "http://lab.example.org"}, 403),
        (PUBLIC, {"Host": "lab.example.org", "Origin": "https://lab.example.org:8443"}, 403),
        (PUBLIC, {"Host": "lab.example.org:8443", "Origin": "http://lab.example.org:8443"}, 403),
        (PUBLIC, {"Host": "lab.example.org", "Origin": "https://lab.example.org:443"}, None),
        (PUBLIC, {"Host": "lab.example.org", "Origin": "https://me@lab.example.org"}, 403),
        (PUBLIC, {"Host": "localhost:8080", "Origin": "http://localhost:8080"}, None),  # beside the proxy
        (Names(), {"Host": "127.0.0.1:8080", "Origin": "https://127.0.0.1:8080"}, 403),
        (Names(), {"Host": "127.0.0.1:80", "Origin": "http://127.0.0.1"}, None),
        (Names(public=("https://Lab.example.org/",)), {"Host": "localhost", "Origin": "https://lab.example.org"}, None),
    ],
)  # fmt: skip
def test_names_and_origins(names: Names, headers: dict[str, str], status: int | None) -> None:
    refusal = names.refusal(headers, acting=True)
    assert (refusal.status if refusal else None) == status
    if refusal:
        assert "allowed" in refusal.sentence


def test_an_origin_that_is_none_is_refused() -> None:
    for text in ("lab.example.org", "ftp://lab.example.org", "https://lab.example.org/page", "https://[x"):
        with pytest.raises(OriginError, match="allowed: scheme and name"):
            Names(public=(text,))


def test_no_request_waits_for_the_resolver(monkeypatch: pytest.MonkeyPatch) -> None:
    names = Names("0.0.0.0")
    own = socket.gethostname()
    monkeypatch.setattr(socket, "getfqdn", lambda: pytest.fail("asked"))
    assert names.refusal({"Host": f"{own}:8080"}, acting=False) is None
    assert names.refusal({"Host": "evil.example"}, acting=False) is not None


def test_tokens_differ_and_open_what_they_are_for() -> None:
    tokens = Tokens()
    assert tokens.opens(tokens.steer) == "steer"
    assert tokens.opens(tokens.watch) == "watch"
    for wrong in ("", tokens.steer[:-1], tokens.steer + "x", "é"):
        assert tokens.opens(wrong) is None


def test_more_messages_than_allowed_end_the_connection_and_the_usual_ones_do_not() -> None:
    now = 0.0
    meter = ConnectionRateLimiter(ConnectionLimits(rate=100.0, burst=50.0), clock=lambda: now)
    message = packed(**CAMERA)
    for _ in range(500):  # a drag
        now += 1 / 60
        assert meter.admits(message)
    with pytest.raises(Overrun, match="too many messages; allowed: 100 per second"):
        all(meter.admits(message) for _ in range(100))
    with pytest.raises(Overrun, match="too many messages"):  # pings count as well
        meter.count()


def test_files_are_bounded_alone_together_and_by_what_was_announced() -> None:
    limits = ConnectionLimits(upload=1000, uploads=1500)

    def start(meter: ConnectionRateLimiter, name: str, size: int) -> bool:
        return meter.admits(packed(type="FileTransferStartUpload", transfer_uuid=name, size_bytes=size, part_count=1))

    def part(meter: ConnectionRateLimiter, name: str, size: int) -> bool:
        return meter.admits(packed(type="FileTransferPart", transfer_uuid=name, part_index=0, content=bytes(size)))

    with pytest.raises(Overrun, match="a file of"):
        start(ConnectionRateLimiter(limits), "a", 1001)
    with pytest.raises(Overrun, match="one after the other"):
        [
            start(ConnectionRateLimiter(limits), "a", 1000),
            (two := ConnectionRateLimiter(limits)),
            start(two, "b", 1000),
            start(two, "c", 1000),
        ]
    meter = ConnectionRateLimiter(limits)
    assert not part(meter, "never announced", 10)
    for name in "abcdef":  # one after the other, complete
        assert start(meter, name, 1000)
        assert part(meter, name, 1000)
    start(meter := ConnectionRateLimiter(limits), "long", 1000)
    assert part(meter, "long", 900)
    with pytest.raises(Overrun, match="longer than it was said"):
        part(meter, "long", 101)
    start(meter := ConnectionRateLimiter(limits), "crumbs", 1000)
    assert sum(part(meter, "crumbs", 0) for _ in range(2000)) == 1000


@pytest.mark.parametrize("raw", [b"", b"garbage", b"\xc1", packed(no="type"), packed(type=5), "text", b"\x91" * 5000])
def test_what_is_no_message_of_a_page_ends_the_connection(raw: bytes | str) -> None:
    with pytest.raises(Overrun, match="not a message of the page"):
        ConnectionRateLimiter(ConnectionLimits()).admits(raw)


def test_visers_public_share_server_is_never_asked_for() -> None:
    assert not ConnectionRateLimiter(ConnectionLimits()).admits(packed(type="ShareUrlRequest"))


def test_a_watcher_has_a_camera_and_tabs_and_nothing_else() -> None:
    for camera in (CAMERA, CAMERA | {"image_height": str(CAMERA["image_height"])}):
        passed = harmless(packed(**camera), LOOKING)
        assert passed is not None
        assert msgspec.msgpack.decode(passed) == msgspec.msgpack.decode(packed(**CAMERA))
    for tabs in ("Force", "Overview,controls: Task", "‖s‖ (20),κ, ℓ·θ + x/y"):
        report = {"type": "GuiUpdateMessage", "uuid": "field", "updates": {"value": f"{tabs}#1280x300#0.25"}}
        passed = harmless(packed(**report), LOOKING)
        assert passed is not None  # without the scene's size: the plots are not fitted to it
        assert msgspec.msgpack.decode(passed) == report | {"updates": {"value": f"{tabs}##0.25"}}
    for message in (
        CAMERA | {"fov": math.nan},
        CAMERA | {"image_height": 10**9},
        CAMERA | {"position": (0.0, 0.0)},
        CAMERA | {"more": 1},
        {"type": "GuiUpdateMessage", "uuid": "slider", "updates": {"value": 5.0}},
        {"type": "GuiUpdateMessage", "uuid": "field", "updates": {"value": "<b>##1"}},
        {"type": "GuiUpdateMessage", "uuid": "field", "updates": {"value": "Force##1", "visible": False}},
        {"type": "GuiUpdateMessage", "uuid": "field", "updates": {"value": "x" * 9000}},
        {"type": "CommandTriggerMessage", "uuid": "reset"},
        {"type": "SceneNodeDragMessage"},
        {"type": "FileTransferStartUpload"},
        {"type": "GuiFormSubmitMessage", "uuid": "field"},
    ):
        assert harmless(packed(**message), LOOKING) is None, message
    assert harmless(b"\xc1", LOOKING) is None
