"""Complaint: the sentence in the strip over the scene that says what was refused, or what has failed."""

from __future__ import annotations

from collections.abc import Callable

import structlog

from app.dashboard.transport.callback_errors import Fault
from app.dashboard.widgets.fields.field_words import refusal_in_words
from app.lessons.words import ENGLISH, LessonWords
from app.session.commands import DropWayOut
from app.session.runner import Runner
from app.session.snapshot import Snapshot
from app.session.ways_out import WayOut

log = structlog.get_logger()
SHOWN = 12.0  # s


class Complaint:
    """The last refusal, or failure of this program. It is shown until another edit is accepted, another run begins, or
    SHOWN is over since a page was first drawn with it; a refusal stays as long as its way out is offered, which nobody
    would understand without it, and comes back after a failure that was shown meanwhile.

    words: of the lesson that is open, which the sentence begins with."""

    def __init__(self, runner: Runner, words: Callable[[], LessonWords] = lambda: ENGLISH) -> None:
        self._runner, self._words = runner, words
        self._text = ""
        self._failed = ""  # the last failure
        self._until: float | None = None  # s, monotonic; None as long as no page has been drawn with it
        self._posted = 0  # number of commands that had been posted before
        # revision and run after these commands, None until the runner has executed them: later ones end the complaint
        self._of: tuple[int, int] | None = None
        self._refusals = runner.snapshot.refusal_number
        self._refused = ""  # the runner's last refusal
        self._offered: WayOut | None = None  # with it

    def tell(self, sentence: str) -> None:
        """Show a complaint of the page: a refusal, or a failure where it is a `Fault`."""
        if isinstance(sentence, Fault):
            self.fail(sentence)
        else:
            self.refuse(sentence)

    def refuse(self, sentence: str) -> None:
        """Show a refusal by the page, which takes back the way out of the one before."""
        log.info("refused", sentence=sentence)
        self._runner.post(DropWayOut())
        self._offered = None
        self._show(self._words().refused.format(refusal_in_words(sentence)))

    def fail(self, sentence: str) -> None:
        """Show a failure of this program, which leaves the way out as it is; not again while the same one is shown."""
        if self._text != (text := self._words().failed.format(sentence)):
            self._failed = text
            self._show(text)

    def withdraw(self) -> None:
        """Take back the last refusal and its way out: there has been a right value since."""
        if self._text not in ("", self._failed):
            self._runner.post(DropWayOut())
            self._text, self._offered = "", None

    def text(self, snapshot: Snapshot, now: float) -> str:
        """Text that is shown at this instant (s, monotonic), with a new refusal by the runner; "" for none."""
        if snapshot.refusal_number != self._refusals:
            self._refusals = snapshot.refusal_number
            self._refused = self._words().refused.format(refusal_in_words(snapshot.refusal or ""))
            self._offered = snapshot.way_out
            self._show(self._refused)
        of = snapshot.revision, snapshot.run
        if self._of is None and snapshot.executed >= self._posted:
            self._of = of
        if self._until is None:
            self._until = now + SHOWN
        offers = self._offered is not None and self._offered is snapshot.way_out
        if now > self._until or self._of not in (None, of):
            self._text = self._refused if offers else ""
        return self._text

    def _show(self, text: str) -> None:
        # the text last: a page that is drawn in between must not take it for that of the run before
        self._posted, self._of, self._until = self._runner.posted, None, None
        self._text = text
