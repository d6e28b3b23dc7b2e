"""Controls: each shows one field of the running scenario and posts an Edit when the user changes it.

No control holds state. A slider that is held only asks for a preview; when it is let go, it posts. The user's input
stays on the screen only until the runner has answered; then the control shows the snapshot's value again, which after
a refusal is still the old one.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

import viser
from msgspec import Struct

from app.dashboard.theme.style import COMMITS, ESCAPED, MOVED, RELEASED, SWEPT, without_marks
from app.dashboard.transport.page_values import PageEvent, from_pages
from app.dashboard.view_options import Viewing
from app.dashboard.widgets.fields.edit_lock import EditLock
from app.dashboard.widgets.fields.field_binding import FINE_STEP, BindingWhere, FieldBinding, NumberRow, SliderScale
from app.dashboard.widgets.fields.matrix_text import read_back, require_point, written
from app.dashboard.widgets.run.whatif import HeldControl, WhatIf
from app.export.export_jobs import ExportJobs
from app.lessons.answers import Notebook
from app.lessons.class_desk import ClassDesk
from app.scenario.data import kind_of
from app.scenario.schema import Scenario
from app.scenario.units import CARTESIAN, Units
from app.session.commands import Command, Edit, EditModel
from app.session.snapshot import Snapshot
from app.storage.uploaded_urdfs import UploadedUrdfs
from app.sweep.background_jobs import BackgroundJobs

LONGEST = 60.0  # s of waiting for an answer; the loop may have ended
SOON = 1.0  # s of waiting after another arm has been prepared


@dataclass(frozen=True)
class Desk:
    """Desk: all that panels share.
    gui: for their widgets.
    post: puts a command into the runner's queue; returns its number there, None for one that the lock refuses.
    snapshot: returns the newest one.
    whatif: previews of held sliders.
    viewing: options of the scene and the plots.
    complain: shows a sentence on every page.
    withdraw_complaint: takes back the last refusal that was shown so.
    export_jobs: make files in another process.
    uploads: store of the user's URDFs.
    choose: gets the row of a number that the user has moved.
    sweep: gets the row of a number that a robustness map should vary.
    let_move: gets the row of a number that a search for gains may vary.
    lock: on edits, while a lesson has a goal.
    notebook: progress in lessons.
    classroom: desk of the class that lessons ask.
    background_jobs: maps and searches of this session.
    scene_of: returns the size of the scene on a client's page, px of the page; None while it is not known."""

    gui: viser.GuiApi
    post: Callable[[Command], int | None]
    snapshot: Callable[[], Snapshot]
    whatif: WhatIf
    viewing: Viewing
    complain: Callable[[str], None]
    withdraw_complaint: Callable[[], None]
    export_jobs: ExportJobs
    uploads: UploadedUrdfs
    choose: Callable[[NumberRow], None]
    sweep: Callable[[NumberRow], None]
    let_move: Callable[[NumberRow], None]
    lock: EditLock
    notebook: Notebook
    classroom: ClassDesk
    background_jobs: BackgroundJobs
    scene_of: Callable[[int], tuple[int, int] | None]


class Control(Protocol):
    """Control of the page: it shows what the snapshot says."""

    def show(self, snapshot: Snapshot) -> None: ...


class AwaitedAnswer:
    """Wait for the runner's answer to an edit: as long as it is awaited, a widget keeps the user's input. Time in which
    another arm or contact is prepared does not count."""

    def __init__(self) -> None:
        self._until = -math.inf
        self._refusals = 0
        self._command: int | None = None

    def expect(self, snapshot: Snapshot, seconds: float) -> None:
        """Wait that long, or until something is refused."""
        self._until, self._command = time.monotonic() + seconds, None
        self._refusals = snapshot.refusal_number

    def expect_answer(self, command: int) -> None:
        """Wait until the command of this number is carried out or refused, but not longer than `LONGEST`."""
        self._until, self._command = time.monotonic() + LONGEST, command

    def awaited(self, snapshot: Snapshot) -> bool:
        now, answered = time.monotonic(), snapshot.refusal_number != self._refusals
        if self._command is not None:
            answered = snapshot.executed >= self._command
        if answered:
            self._until = -math.inf
        elif now < self._until and snapshot.preparing:
            self._until = max(self._until, now + SOON)
        return now < self._until


def asked(desk: Desk, snapshot: Snapshot, command: Command, answer: AwaitedAnswer) -> bool:
    """Post a command, whose answer is awaited unless a lesson locks it. Returns whether it was posted."""
    number = desk.post(command)
    if number is None:
        answer.expect(snapshot, seconds=0.0)
        return False
    answer.expect_answer(number)
    return True


def labelled(label: str, unit: str) -> str:
    """Label of a control with the unit of its numbers."""
    return label if unit in ("", "1") else f"{label} [{unit}]"


class NumberField:
    """Control of a number: a text field, which takes effect on Enter or when it is left, and a slider."""

    def __init__(self, desk: Desk, binding: FieldBinding, label: str, scale: SliderScale | None = None) -> None:
        self._desk, self._binding, self._label, self._scale = desk, binding, label, scale
        self._plain_label, self._units = label, CARTESIAN
        self._answer = AwaitedAnswer()
        self._held: float | None = None  # value of the slider that a page holds, which another page may hide
        self._held_until = -math.inf  # on the monotonic clock, s; the page may have gone
        self._hold: HeldControl | None = None  # its preview
        self._before: Snapshot | None = None  # when it was moved first, where it applies its values at once
        self._form = desk.gui.add_form(None)
        with self._form:
            self._text = desk.gui.add_text(label, "", hint=binding.hint)
            self._text.on_update(from_pages(self._on_text))
            self._slider = None
            if scale is not None:
                self._slider = desk.gui.add_slider("", 0.0, 1.0, FINE_STEP, 0.0, marks=(), hint=binding.hint)
                self._slider.on_update(from_pages(self._on_slider))

    @property
    def row(self) -> NumberRow:
        """Row of this control with its present label."""
        return NumberRow(self._binding, self._label, self._scale)

    def remove(self) -> None:
        """Remove the control from the page."""
        self._form.remove()

    async def _on_text(self, _: PageEvent) -> None:
        if self._text.value.endswith((RELEASED, ESCAPED)):
            self._let_go(apply=self._text.value.endswith(RELEASED))
            return
        if self._text.value.endswith((SWEPT, MOVED)):
            action = self._desk.sweep if self._text.value.endswith(SWEPT) else self._desk.let_move
            self._text.value = without_marks(self._text.value)
            action(self.row)
            return
        if not self._text.value.endswith(COMMITS):
            self._answer.expect(self._desk.snapshot(), seconds=60.0)
            return
        snapshot = self._desk.snapshot()
        self._text.value = text = without_marks(self._text.value).strip()
        running = self._binding.read(snapshot)
        if running is None:
            return
        try:
            if isinstance(running, int | float):
                require_point(text)
            value = read_back(text) if text else running
            edit = self._binding.edit(snapshot, value)
        except ValueError as error:
            self._desk.complain(f"{self._label}: {error}")
            self._show_again(snapshot)
            return
        if value == running or written(value) == written(running):
            self._desk.withdraw_complaint()
            self._show_again(snapshot)
        else:
            self._ask(snapshot, edit)

    async def _on_slider(self, event: PageEvent) -> None:
        if self._slider is None or self._scale is None:
            return
        snapshot, value = self._desk.snapshot(), self._scale.value(self._slider.value)
        if self._binding.read(snapshot) is None:  # the new scenario has no such field: the row is being hidden
            return
        self._text.value = written(value)
        self._desk.choose(self.row)
        edit = self._binding.edit(snapshot, value)
        self._held, self._held_until, self._hold = value, time.monotonic() + LONGEST, None
        if self._desk.whatif.on:
            value_text, client = f"{written(value)} {self._unit_beside(snapshot)}".rstrip(), event.client.client_id
            moved = self._moved(snapshot, value)
            self._hold = held = HeldControl(
                edit, self._label, value_text, self, client, snapshot.run, moved=moved, dropped=self._drop
            )
            self._desk.whatif.hold(held)
        else:
            self._before = self._before or snapshot
            self._ask(snapshot, edit)

    def _unit_beside(self, snapshot: Snapshot) -> str:
        """Unit of the number where the label has none and r is not q."""
        info = self._binding.info
        if info is None or "[" in self._label or snapshot.system.layout.joint:
            return ""
        return info.unit_in(snapshot.system.units)

    def _let_go(self, *, apply: bool) -> None:
        snapshot = self._desk.snapshot()
        running = self._binding.read(snapshot)
        if running is None:
            self._desk.whatif.let_go(self)
            return
        # another page's slider may be previewed in place of this one
        there = time.monotonic() < self._held_until or self._desk.whatif.holds(self)
        there = there and (self._held_now(snapshot) or not self._desk.whatif.on)
        held, before = self._held if there else None, self._before or snapshot
        self._forget()
        usual = self._binding.read(before)
        # a slider that was not moved shows its value only roughly
        value = usual if not apply else running if held is None else held
        self._text.value = written(value)  # removes the mark
        edit, changed = self._binding.edit(snapshot, value), written(value) != written(running)
        # before the slider counts as let go, since the page may be drawn in between
        posted = not changed or self._ask(snapshot, edit)
        if apply and posted and written(value) != written(usual):
            self._desk.whatif.remember(before, edit, self._moved(before, value))
        self._desk.whatif.let_go(self)
        if not changed:
            self._show_again(snapshot)

    def _held_now(self, snapshot: Snapshot) -> bool:
        """Whether the value of the slider is held for a preview of this run."""
        return self._hold is not None and self._hold.run == snapshot.run

    def _drop(self, held: HeldControl) -> None:
        """Forget the value of the held slider, whose preview has ended."""
        if self._hold is held:
            self._forget()

    def _forget(self) -> None:
        self._hold = None
        self._held, self._held_until, self._before = None, -math.inf, None

    def _moved(self, snapshot: Snapshot, value: float) -> dict[object, float]:
        """The value by each binding that an edit of this one sets."""
        return dict.fromkeys(self._binding.moved(snapshot), value)

    def _show_again(self, snapshot: Snapshot) -> None:
        """Show the running value, without waiting for an answer."""
        self._answer.expect(snapshot, seconds=0.0)
        self.show(snapshot)

    def _ask(self, snapshot: Snapshot, edit: Edit | EditModel) -> bool:
        """Post an edit; returns whether an answer is to be awaited."""
        return asked(self._desk, snapshot, edit, self._answer)

    def show(self, snapshot: Snapshot) -> None:
        value = self._binding.read(snapshot)
        if self._form.visible != (value is not None):
            self._form.visible = value is not None
        if value is None or self._answer.awaited(snapshot) or self._desk.whatif.holds(self):
            return
        if self._desk.whatif.on and time.monotonic() < self._held_until and self._held_now(snapshot):
            return
        if snapshot.system.units != self._units:
            self._show_units(snapshot.system.units)
        value = self._desk.whatif.moved(snapshot).get(self._binding, value)
        self._text.value = written(value)
        if self._slider is not None and self._scale is not None:
            slides = isinstance(value, float | int)  # several numbers do not fit on one slider
            if self._slider.visible != slides:
                self._slider.visible = slides
            if slides:
                self._slider.value = self._scale.position(value)

    def _show_units(self, units: Units) -> None:
        self._units = units
        label = self._binding.label_in(units, self._plain_label)
        if "[" in label:  # others have the name of their coordinate, see `set_label`
            self.set_label(label)
        for widget in (self._text, self._slider):
            if widget is not None:
                widget.hint = self._binding.hint_in(units)

    def set_label(self, label: str) -> None:
        self._label = self._text.label = label

    def set_enabled(self, *, enabled: bool) -> None:
        for widget in (self._text, self._slider):
            if widget is not None and widget.disabled == enabled:
                widget.disabled = not enabled


class Dropdown:
    """Dropdown of a field.
    options: values in the scenario by the text shown.
    applies: see `BindingWhere`, None for a field of every scenario.
    hint: what is chosen, where the field's meaning in the schema does not say it."""

    def __init__(
        self,
        desk: Desk,
        path: str,
        label: str,
        options: Mapping[str, object],
        applies: Callable[[Scenario], bool] | None = None,
        hint: str = "",
    ) -> None:
        self._desk, self._options = desk, dict(options)
        self._binding = FieldBinding(path) if applies is None else BindingWhere(path, applies)
        self._shown = {value: title for title, value in options.items()}
        self._answer = AwaitedAnswer()
        self._dropdown = desk.gui.add_dropdown(label, tuple(options), hint=hint or self._binding.hint)
        self._dropdown.on_update(from_pages(self._on_update))

    async def _on_update(self, _: PageEvent) -> None:
        snapshot = self._desk.snapshot()
        asked(self._desk, snapshot, Edit(self._binding.path, self._options[self._dropdown.value]), self._answer)

    def show(self, snapshot: Snapshot) -> None:
        value = self._binding.read(snapshot)
        value = kind_of(value) if isinstance(value, Struct) else value
        if self._dropdown.visible != (value is not None):
            self._dropdown.visible = value is not None
        if value in self._shown and not self._answer.awaited(snapshot):
            self._dropdown.value = self._shown[value]


class Switch:
    """Checkbox of a field that is true or false."""

    def __init__(self, desk: Desk, binding: FieldBinding, label: str) -> None:
        self._desk, self._binding = desk, binding
        self._answer = AwaitedAnswer()
        self._checkbox = desk.gui.add_checkbox(label, False, hint=self._binding.hint)
        self._checkbox.on_update(from_pages(self._on_update))

    async def _on_update(self, _: PageEvent) -> None:
        snapshot = self._desk.snapshot()
        asked(self._desk, snapshot, Edit(self._binding.path, self._checkbox.value), self._answer)

    def show(self, snapshot: Snapshot) -> None:
        value = self._binding.read(snapshot)
        if self._checkbox.visible != (value is not None):
            self._checkbox.visible = value is not None
        if value is not None and not self._answer.awaited(snapshot):
            self._checkbox.value = value
