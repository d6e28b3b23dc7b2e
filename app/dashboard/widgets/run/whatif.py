"""What-if questions: the value of a held slider, and the preview of its effect. State of the page, not of a run."""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from app.scenario.data import differences, edited, with_values
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.session.commands import Edit, EditAll, EditModel, FieldEdit
from app.session.model_entries import with_model_entries
from app.session.preview_client import Previewer
from app.session.preview_messages import Preview, PreviewRefusal
from app.session.snapshot import Snapshot
from app.simulation.builders.restarts import begins_anew

HORIZON, PUSH, ARMS = 5.0, 30.0, 16  # s, N, and number of true arms of the band, until the user changes them
OPENING = 3.0  # s after the first look, in which the cores are left to the page that opens


@dataclass(frozen=True)
class HeldControl:
    """Held slider, or another control whose effect is previewed.
    edit: that the control asks for.
    label, value: of the control, as text.
    control: by identity.
    client: whose page the control is held on; run: in which it is held.
    then: way to go on, in words for the user; Esc cancels.
    moved: value of every place that the edit sets.
    dropped: called with this where the hold ends without the control: its value is not applied any more."""

    edit: FieldEdit
    label: str
    value: str
    control: object
    client: int
    run: int
    then: str = "let go: apply"
    moved: Mapping[object, float] = field(default_factory=dict)
    dropped: Callable[[HeldControl], None] = lambda _: None


def changed(scenario: Scenario, edit: FieldEdit) -> Scenario:
    """The scenario after this edit. Raises ScenarioError."""
    match edit:
        case Edit(path, value):
            return edited(scenario, path, value)
        case EditAll(values):
            return with_values(scenario, dict(values))
        case EditModel(entries):
            return with_model_entries(scenario, entries)


def around(snapshot: Snapshot, edit: FieldEdit) -> tuple[Scenario, Scenario]:
    """The scenario before and after this edit: both with the own push of the scenario where the edit begins the run
    anew. Raises ScenarioError."""
    after = changed(snapshot.scenario, edit)
    if snapshot.phase == "stopped" or begins_anew(snapshot.scenario, after):
        return snapshot.own_push.restored_in(snapshot.scenario), snapshot.own_push.restored_in(after)
    return snapshot.scenario, after


@dataclass(frozen=True)
class _RequestKey:
    """Subject of the newest request.
    base: running scenario.
    horizon: s, length of the preview.
    push, arms: see `PreviewRequest`.
    t: instant at which the preview begins, s."""

    edit: FieldEdit
    base: Scenario
    horizon: float
    push: float
    arms: int
    t: float


@dataclass(frozen=True)
class _Applied:
    """Last edit that a slider has applied.
    before, after: scenario before and after the edit.
    moved: value of every place that the edit sets.
    answers: counts of the runner's answers when the edit was posted."""

    before: Scenario
    after: Scenario
    moved: Mapping[object, float]
    answers: tuple[int, int]


def _answers(snapshot: Snapshot) -> tuple[int, int]:
    return snapshot.revision, snapshot.refusal_number


class WhatIf:
    """Previews of one slider at a time, from all pages. Widgets call `hold` and `let_go`, the drawing loop `look`.

    wake: called where the drawing loop should not wait for its next frame: a slider has moved, or an answer has come.
    push, arms: see `PreviewRequest`.
    preview: preview to draw, None for none.
    refusal: reason why there is no preview, in a sentence.
    """

    def __init__(self, previewer: Previewer, wake: Callable[[], None] = lambda: None) -> None:
        self._previewer, self._wake = previewer, wake
        previewer.answered = wake
        self.on = True
        self.horizon, self.push, self.arms = HORIZON, PUSH, ARMS
        self.held: HeldControl | None = None
        self._holding = threading.Lock()  # pages hold and let go in one thread, the drawing drops in another
        self.preview: Preview | None = None
        self.refusal = ""
        self._request: _RequestKey | None = None
        self._applied: _Applied | None = None
        self._run = -1
        self._first_look: float | None = None

    def hold(self, held: HeldControl) -> None:
        """Preview the effect of a slider that has been moved and is held."""
        with self._holding:
            self.held, self._applied = held, None
        self._wake()

    def holds(self, control: object) -> bool:
        """Whether this control's value is only previewed."""
        held = self.held
        return held is not None and held.control is control

    def let_go(self, control: object) -> None:
        """Note that the control's slider is no longer held."""
        with self._holding:
            if self.holds(control):
                self.held = None

    def drop(self, held: HeldControl) -> None:
        """End a hold without its control, unless another one has taken its place."""
        with self._holding:
            if self.held is not held:
                return
            self.held = None
        held.dropped(held)

    def moved(self, snapshot: Snapshot) -> Mapping[object, float]:
        """Values that controls show in place of the running ones, by place: those of the held slider, or, until the
        runner has answered, of the slider that was let go."""
        if self.held is not None:
            return self.held.moved
        applied = self._applied
        return {} if applied is None or applied.answers != _answers(snapshot) else applied.moved

    def remember(
        self, snapshot: Snapshot, edit: FieldEdit, moved: Mapping[object, float] = MappingProxyType({})
    ) -> None:
        """Remember an edit that is posted, for `undo`. moved: see `HeldControl`."""
        try:
            before, after = around(snapshot, edit)
        except ScenarioError:  # the runner will refuse it, too, and say so
            self._applied = None
        else:
            self._applied = _Applied(before, after, moved, _answers(snapshot))

    def undo(self, snapshot: Snapshot) -> EditAll | None:
        """Command that takes back the last edit by a slider, None where it was refused or the scenario has been changed
        since."""
        applied = self._applied
        if applied is None or (applied.after != snapshot.scenario and applied.answers != _answers(snapshot)):
            return None
        return EditAll({path: old for path, (old, _) in differences(applied.before, applied.after).items()})

    def look(self, snapshot: Snapshot, clients: Collection[int], now: float) -> bool:
        """Request the preview of the held slider, and take answers. Returns whether the preview to draw has changed.

        now: time of a clock, s.
        """
        held = self.held
        if held is not None and (held.client not in clients or snapshot.run > held.run):
            self.drop(held)  # the page was closed with the slider held, or another run has begun
            held = None
        if held is None:
            return self._rest(snapshot, now)
        drawn, refused = self.preview, self.refusal
        self._ask(held, snapshot)
        match self._previewer.newest:
            case Preview() as preview:
                self.preview, self.refusal = preview, ""
            case PreviewRefusal(_, sentence):
                self.preview, self.refusal = None, sentence
            case None if self._previewer.failure:
                self.preview, self.refusal = None, self._previewer.failure
        return self.preview is not drawn or self.refusal != refused

    def _rest(self, snapshot: Snapshot, now: float) -> bool:
        if self._request is not None:
            self._previewer.drop()
            self._request, self.preview, self.refusal = None, None, ""
            return True
        if self._first_look is None:
            self._first_look = now
        if snapshot.run != self._run and now - self._first_look > OPENING:
            self._run = snapshot.run
            if self.on:
                self._previewer.warm_up(snapshot.state)
        return False

    def _ask(self, held: HeldControl, snapshot: Snapshot) -> None:
        now = _RequestKey(held.edit, snapshot.scenario, self.horizon, self.push, self.arms, snapshot.t)
        request = self._request
        moved = request is None or replace(request, base=now.base, t=now.t) != now
        if not moved and (now == request or not self._previewer.idle):
            return
        self._request = now
        try:
            _, scenario = around(snapshot, held.edit)
        except ScenarioError as error:
            self._previewer.drop()
            self.preview, self.refusal = None, str(error)
        else:
            # the same request from a later state replaces a complete drawing, which must not grow from nothing again
            # an edit of a past instant lets go of the tool
            state = replace(snapshot.state, grip=None) if snapshot.looking_back else snapshot.state
            self._previewer.ask(
                state, scenario, self.horizon, partial=moved, push=self.push, compared=True, arms=self.arms
            )
