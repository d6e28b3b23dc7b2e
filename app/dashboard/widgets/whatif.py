"""What if: the value of a slider that is held, and the preview of its effect. State of the page, not of a run."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from app.scenario.data import edited, with_values
from app.scenario.schema import Scenario, ScenarioError
from app.session.commands import Edit, EditAll, Load
from app.session.preview import Outlook, Refusal
from app.session.preview_client import Previewer
from app.session.snapshot import Snapshot

HORIZON, PUSH, ARMS = 5.0, 30.0, 16  # s, N, and true arms of the band, until the user says otherwise


@dataclass(frozen=True)
class Held:
    """A slider that is held, or something else whose effect is previewed: the edit that it asks for, its control, and
    the client whose page it is on.
    then: what the user can do, in words.
    moved: the value of every place that the edit sets, by place."""

    edit: Edit | EditAll
    label: str
    value: str
    control: object
    client: int
    then: str = "let go: apply · Esc: revert"
    moved: Mapping[object, float] = field(default_factory=dict)


def changed(scenario: Scenario, edit: Edit | EditAll) -> Scenario:
    """The scenario after this edit. Raises ScenarioError."""
    if isinstance(edit, EditAll):
        return with_values(scenario, dict(edit.values))
    return edited(scenario, edit.path, edit.value)


@dataclass(frozen=True)
class _Asked:
    """Subject of the newest question."""

    edit: Edit | EditAll
    base: Scenario
    horizon: float
    push: float
    arms: int
    t: float


@dataclass(frozen=True)
class _Applied:
    """The scenario before and after the last edit by a slider, the places that it sets, and the counts of the runner's
    answers at that time."""

    before: Scenario
    after: Scenario
    moved: Mapping[object, float]
    asked_at: tuple[int, int]


def _answers(snapshot: Snapshot) -> tuple[int, int]:
    return snapshot.revision, snapshot.refusal_number


class WhatIf:
    """Previews of one slider at a time, whoever holds it. Callbacks `hold` and `let_go`; the drawing loop calls `look`.

    wake: called where the drawing loop should not wait for its next frame: a slider has moved, or an answer has come.
    push, arms: see `Question`.
    outlook: preview to draw, None for nothing; refusal: reason why there is nothing, in a sentence.
    """

    def __init__(self, previewer: Previewer, wake: Callable[[], None] = lambda: None) -> None:
        self._previewer, self._wake = previewer, wake
        previewer.answered = wake
        self.on = True
        self.horizon, self.push, self.arms = HORIZON, PUSH, ARMS
        self.held: Held | None = None
        self.outlook: Outlook | None = None
        self.refusal = ""
        self._asked: _Asked | None = None
        self._applied: _Applied | None = None
        self._run = -1

    def hold(self, held: Held) -> None:
        """Note that a slider has moved."""
        self.held, self._applied = held, None
        self._wake()

    def holds(self, control: object) -> bool:
        """Whether this control's value is only previewed."""
        held = self.held
        return held is not None and held.control is control

    def let_go(self, control: object) -> None:
        """Note that the control's slider is no longer held."""
        if self.holds(control):
            self.held = None

    def moved(self, snapshot: Snapshot) -> Mapping[object, float]:
        """Values by place that controls show: of the slider that is held, or, until the runner has answered, of the one
        that was let go."""
        if self.held is not None:
            return self.held.moved
        applied = self._applied
        return {} if applied is None or applied.asked_at != _answers(snapshot) else applied.moved

    def remember(
        self, snapshot: Snapshot, edit: Edit | EditAll, moved: Mapping[object, float] = MappingProxyType({})
    ) -> None:
        """Remember an edit that is being applied; `undo` takes it back.
        moved: see `Held`."""
        try:
            after = changed(snapshot.scenario, edit)
        except ScenarioError:  # the runner will refuse it, too, and say so
            self._applied = None
        else:
            self._applied = _Applied(snapshot.scenario, after, moved, _answers(snapshot))

    def undo(self, snapshot: Snapshot) -> Load | None:
        """Command that takes the last applied slider back, None when it was refused or something else has changed
        since."""
        applied = self._applied
        if applied is None or (applied.after != snapshot.scenario and applied.asked_at != _answers(snapshot)):
            return None
        return Load(applied.before)

    def look(self, snapshot: Snapshot, clients: Collection[int]) -> bool:
        """Ask open questions and take answers; True when there is something else to draw."""
        held = self.held
        if held is not None and (held.client not in clients or snapshot.run != self._run):
            self.held = held = None  # the page was closed with the slider held, or another run has begun
        if held is None:
            return self._rest(snapshot)
        drawn, refused = self.outlook, self.refusal
        self._ask(held, snapshot)
        match self._previewer.newest:
            case Outlook() as outlook:
                self.outlook, self.refusal = outlook, ""
            case Refusal(_, sentence):
                self.outlook, self.refusal = None, sentence
            case None if self._previewer.failure:
                self.outlook, self.refusal = None, self._previewer.failure
        return self.outlook is not drawn or self.refusal != refused

    def _rest(self, snapshot: Snapshot) -> bool:
        if self._asked is not None:
            self._previewer.drop()
            self._asked, self.outlook, self.refusal = None, None, ""
            return True
        if snapshot.run != self._run:
            self._run = snapshot.run
            if self.on:
                self._previewer.warm_up(snapshot.state)
        return False

    def _ask(self, held: Held, snapshot: Snapshot) -> None:
        asked, now = self._asked, _Asked(held.edit, snapshot.scenario, self.horizon, self.push, self.arms, snapshot.t)
        moved = asked is None or replace(asked, base=now.base, t=now.t) != now
        if not moved and (now == asked or not self._previewer.idle):
            return
        self._asked = now
        try:
            scenario = changed(snapshot.scenario, held.edit)
        except ScenarioError as error:
            self._previewer.drop()
            self.outlook, self.refusal = None, str(error)
        else:
            # the same question from a later state replaces a complete drawing, which must not grow from nothing again
            self._previewer.ask(
                snapshot.state, scenario, self.horizon, partial=moved, push=self.push, compared=True, arms=self.arms
            )
