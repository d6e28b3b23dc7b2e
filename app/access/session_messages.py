"""What a gateway and the process of a session tell each other: one JSON object a line, over a pair of sockets."""

from __future__ import annotations

from typing import Literal

import msgspec


class Prepare(msgspec.Struct, frozen=True, tag=True):
    """To the process, at first: have a dashboard up, reachable with this key, and this scenario (TOML) compiled."""

    scenario: str
    theme: str
    fps: float
    key: str


class Kept(msgspec.Struct, frozen=True):
    """Where a session is kept on disk. earlier: what becomes of what is there: its pinned runs are shown again, since
    this is the same session, or it is offered on the page."""

    folder: str
    earlier: Literal["shown", "offered"]


class Begin(msgspec.Struct, frozen=True, tag=True):
    """To the process: run. scenario: TOML, None for the one prepared; kept: where, None for nowhere; marks: of the
    visitor that it is for, see `Visitor.marks`."""

    scenario: str | None
    kept: Kept | None
    marks: tuple[str, ...] = ()


class Keep(msgspec.Struct, frozen=True, tag=True):
    """To the process, which runs: keep the session there from now on, where nothing is kept of it yet."""

    kept: Kept


class Remark(msgspec.Struct, frozen=True, tag=True):
    """To the process, which runs: say this on the page."""

    sentence: str


class Ready(msgspec.Struct, frozen=True, tag=True):
    """From the process: it can begin. looking: see `app.access.rate_limits.harmless`."""

    port: int
    looking: frozenset[str]


class Changed(msgspec.Struct, frozen=True, tag=True):
    """From the process: the scenario (TOML) that runs from now on, so that it can be begun again elsewhere, and how
    many runs are pinned."""

    scenario: str
    pinned: int = 0


class Alive(msgspec.Struct, frozen=True, tag=True):
    """From the process, while it prepares and while it runs, every second: its pages are answered. late: how late the
    steps of its loop were lately, their median in s; None where none is computed."""

    late: float | None = None


class Failed(msgspec.Struct, frozen=True, tag=True):
    """From the process, at last: why it cannot go on, in a sentence."""

    reason: str


ToSession = Prepare | Begin | Keep | Remark
FromSession = Ready | Changed | Alive | Failed

to_session = msgspec.json.Decoder(ToSession)
from_session = msgspec.json.Decoder(FromSession)
LONGEST = 64 * 2**20  # bytes of a line: scenarios hold no recordings


def line(message: ToSession | FromSession) -> bytes:
    """The message as it is sent."""
    return msgspec.json.encode(message) + b"\n"
