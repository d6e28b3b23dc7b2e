"""Messages between a gateway and the process of a session: one JSON object a line, over a pair of sockets."""

from __future__ import annotations

from typing import Literal

import msgspec

from app.access.classroom import ClassQuestion, Given


class Prepare(msgspec.Struct, frozen=True, tag=True):
    """Message to the process, the first: set up a dashboard that is reachable with this key, and compile this scenario
    (TOML).
    shared: whether the machine is shared with other sessions of the server."""

    scenario: str
    theme: str
    fps: float
    key: str
    shared: bool = False


class KeptFolder(msgspec.Struct, frozen=True):
    """Folder in which a session is kept on disk.
    earlier: what becomes of a session that is already in the folder. "shown": this is the same session, and its pinned
    runs are shown again; "offered": it is another one, and the page offers to continue it."""

    folder: str
    earlier: Literal["shown", "offered"]


class Begin(msgspec.Struct, frozen=True, tag=True):
    """Message to the process: run.
    scenario: TOML, None for the one prepared.
    kept: folder of the session, None where it is not kept.
    marks: of the visitor of this session, see `Visitor.marks`.
    classes: whether its lessons may ask a class.
    asked: number of the question that an earlier process of the session asked its class, and that is still open; 0
    without one."""

    scenario: str | None
    kept: KeptFolder | None
    marks: tuple[str, ...] = ()
    classes: bool = False
    asked: int = 0


class Keep(msgspec.Struct, frozen=True, tag=True):
    """Message to the process, which runs: keep the session in this folder from now on, where it has not been kept
    before."""

    kept: KeptFolder


class Remark(msgspec.Struct, frozen=True, tag=True):
    """Message to the process, which runs: show this sentence on the page."""

    sentence: str


class Answers(msgspec.Struct, frozen=True, tag=True):
    """Message to the process, which runs: all answers of the class so far to its question of this number."""

    number: int
    given: tuple[Given, ...]


class Asks(msgspec.Struct, frozen=True, tag=True):
    """Message from the process: the class is asked this question from now on, or none."""

    question: ClassQuestion | None


class Ready(msgspec.Struct, frozen=True, tag=True):
    """Message from the process: it is ready for `Begin`. report_fields: see `app.access.rate_limits.harmless`."""

    port: int
    report_fields: frozenset[str]


class Changed(msgspec.Struct, frozen=True, tag=True):
    """Message from the process: the scenario (TOML) that runs from now on, with which the session can be begun again
    elsewhere, and the number of pinned runs."""

    scenario: str
    pinned: int = 0


class Alive(msgspec.Struct, frozen=True, tag=True):
    """Message from the process every second, while it prepares and while it runs: its pages are answered.
    late: delay of the last steps of its loop, their median in s; None where no steps are computed."""

    late: float | None = None


class Failed(msgspec.Struct, frozen=True, tag=True):
    """Message from the process, the last: the reason why it cannot go on, in a sentence."""

    reason: str


ToSession = Prepare | Begin | Keep | Remark | Answers
FromSession = Ready | Changed | Alive | Failed | Asks

to_session = msgspec.json.Decoder(ToSession)
from_session = msgspec.json.Decoder(FromSession)
LONGEST = 64 * 2**20  # bytes of a line: scenarios hold no recordings


def line(message: ToSession | FromSession) -> bytes:
    """Line (bytes) in which the message is sent."""
    return msgspec.json.encode(message) + b"\n"
