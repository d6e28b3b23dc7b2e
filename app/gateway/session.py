"""Session of a gateway: a run that has links, and the interface of its process."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from typing import Literal, Protocol

from app.access.admission import Pass
from app.access.classroom import Classroom
from app.access.session_messages import Answers, Asks, Begin, Changed, KeptFolder
from app.gateway.visitors import NOBODY, Viewer, Visitor
from app.process.redaction import new_secret

STALE = 24 * 3600.0  # s
Phase = Literal["resting", "waiting", "starting", "running", "failed"]


class Process(Protocol):
    """Interface of a session's process, as `Worker` has it."""

    port: int
    key: str
    report_fields: frozenset[str]
    late: float | None

    @property
    def alive(self) -> bool: ...
    def begin(self, begin: Begin) -> None: ...
    def keep(self, kept: KeptFolder) -> None: ...
    def remark(self, sentence: str) -> None: ...
    def answer(self, answers: Answers) -> None: ...
    def changes(self) -> AsyncIterator[Changed | Asks]: ...
    async def end(self) -> str: ...


@dataclass(eq=False)
class Session:
    """Session: a run that has links, whether or not a process runs it now.

    name, watch: parts of the links to steer and to watch; neither can be guessed, nor computed from the other.
    folder: name of its folder on disk, the first value of `watch`.
    taken_back: event that is set when the links are renewed; the session has a new event then.
    scenario: TOML, the last one known; pinned: number of runs that were pinned then.
    offers: whether the folder has another session, to be offered on the page.
    owner: the visitor that it was made for; original: folder of the session that it is a copy of, "" for none.
    pages: the open ones.
    notice: how its last process ended, or why none started; "" for neither.
    crashes: number of its processes that ended unexpectedly.
    looked_at: whether a page has been open once.
    kept: whether it has a folder.
    classroom: the class that its lecturer asks.
    hands_over_soon: whether answers of the class are about to be handed to its process.
    requested: when a visitor last requested it; seen: when it was last requested, started, or left by a page; s of the
    pool's clock.
    life: task of the pool that looks after it as long as it has a place, None while it has none.
    opened: whether a page has been open in this life.
    runs: event that is set while its process runs.
    retried: whether it was begun anew with its own scenario, and has not run since.
    crash_times: when its processes of the last minute ended unexpectedly, s of the pool's clock.
    closing: whether its process is to end, and no other one to begin.
    """

    scenario: str
    name: str = field(default_factory=lambda: new_secret(16))
    watch: str = field(default_factory=lambda: new_secret(16))
    pinned: int = 0
    folder: str = ""
    taken_back: asyncio.Event = field(default_factory=asyncio.Event)
    offers: bool = False
    owner: Visitor = NOBODY
    original: str = ""
    phase: Phase = "resting"
    process: Process | None = None
    pages: list[Viewer] = field(default_factory=list)
    notice: str = ""
    crashes: int = 0
    looked_at: bool = False
    kept: bool = False
    classroom: Classroom = field(default_factory=Classroom)
    hands_over_soon: bool = False
    retried: bool = False
    requested: float = 0.0
    seen: float = 0.0
    life: asyncio.Task[None] | None = None
    opened: bool = False
    runs: asyncio.Event = field(default_factory=asyncio.Event)
    crash_times: list[float] = field(default_factory=list)
    closing: bool = False

    def __post_init__(self) -> None:
        self.folder = self.folder or self.watch

    def rank(self, now: float) -> int:
        """Rank of the session when others must be removed: highest with pinned runs, and higher when somebody has
        looked at it. Without a folder it has none after `STALE` without a visitor: what nobody comes back to is not in
        the way of newcomers. now: s of the pool's clock."""
        if not self.kept and not self.pages and now - self.seen > STALE:
            return 0
        return 2 if self.pinned else 1 if self.looked_at else 0

    def visitors(self, *kinds: Pass) -> list[Visitor]:
        """Visitors of the open pages of these kinds, one entry for each page."""
        return [page.visitor for page in self.pages if page.kind in kinds]

    @property
    def log_name(self) -> str:
        """Name of the session in the log, whatever its links are: neither link can be made from this name."""
        return self.folder[:6]
