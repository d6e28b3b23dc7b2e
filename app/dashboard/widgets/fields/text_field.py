"""Text field of the scenario, which takes effect on Enter or when it is left, as those of numbers do."""

from __future__ import annotations

import time
from dataclasses import dataclass
from html import escape

from app.dashboard.theme.style import COMMITS, without_marks
from app.dashboard.transport.page_values import PageEvent, from_pages
from app.dashboard.widgets.fields.controls import Desk
from app.dashboard.widgets.fields.field_binding import FieldBinding
from app.session.snapshot import Snapshot

KEPT = 60.0  # s that a draft stays without a keystroke: the page on which it was typed may have been closed


@dataclass(frozen=True)
class _Draft:
    """Draft: a text that the user has typed and that is not in force, or was refused. It stays until it is accepted,
    until Esc, until a new run, or until nobody has typed for KEPT.
    run: number of the run in which it was typed.
    typed: s, monotonic, of the last keystroke.
    answers: revision and number of refusals when it was posted, None before that."""

    text: str
    run: int
    typed: float
    answers: tuple[int, int] | None = None

    def over(self, snapshot: Snapshot, value: str | None) -> bool:
        """Whether the draft has been accepted, belongs to another run, or is forgotten. value: the running one, which
        may be written otherwise."""
        if self.text == value or self.run != snapshot.run or time.monotonic() > self.typed + KEPT:
            return True
        if self.answers is None:
            return False
        revision, refusals = self.answers
        return snapshot.revision != revision and snapshot.refusal_number == refusals

    def note(self, snapshot: Snapshot, value: str) -> str:
        """Words for what becomes of the draft and what is in force; "" while the answer is awaited."""
        if self.answers is None:
            state = "Not applied yet: Enter applies it, Esc drops it"
        elif snapshot.refusal_number != self.answers[1]:
            state = "Refused, not applied"
        else:
            return ""
        return f"{state}. In force: {value or 'none'}"


class TextField:
    """Wide text field of the scenario, in which a refused text stays for a while, to be corrected. As long as it shows
    another text than the one in force, a note below says so: every page shows the same text."""

    def __init__(self, desk: Desk, binding: FieldBinding, label: str) -> None:
        self._desk, self._binding, self._plain_label = desk, binding, label
        self._draft: _Draft | None = None
        self._form = desk.gui.add_form(None)
        with self._form:
            self._text = desk.gui.add_text(label, "", hint=binding.hint)
            self._text.on_update(from_pages(self._on_text))
        self._note = desk.gui.add_html("", visible=False)

    async def _on_text(self, _: PageEvent) -> None:
        snapshot, now = self._desk.snapshot(), time.monotonic()
        text, done = without_marks(self._text.value), self._text.value.endswith(COMMITS)
        self._draft = _Draft(text, snapshot.run, now)
        if not done:
            return
        self._text.value = text
        if not text.strip():  # Esc, or nothing to read
            self._draft = None
            self.show(snapshot)
        elif text != self._binding.read(snapshot) and self._desk.post(self._binding.edit(snapshot, text)):
            self._draft = _Draft(text, snapshot.run, now, (snapshot.revision, snapshot.refusal_number))

    def show(self, snapshot: Snapshot) -> None:
        value = self._binding.read(snapshot)
        if self._form.visible != (value is not None):
            self._form.visible = value is not None
        if self._draft is not None and self._draft.over(snapshot, value):
            self._draft = None
        self._text.label = self._binding.label_in(snapshot.system.units, self._plain_label)
        if value is not None and self._draft is None:
            self._text.value = value
        self._show_note("" if value is None or self._draft is None else self._draft.note(snapshot, value))

    def _show_note(self, note: str) -> None:
        if note:
            self._note.content = f'<div class="vs-note">{escape(note)}</div>'
        if self._note.visible != bool(note):
            self._note.visible = bool(note)
