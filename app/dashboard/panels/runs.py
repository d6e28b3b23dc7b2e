"""Runs panel: figures of the running run beside those of the pinned ones."""

from __future__ import annotations

import math
import time
from html import escape
from typing import Any

import viser

from app.analysis.metrics import FIGURES, Account, Figure, account
from app.dashboard.widgets.controls import Desk
from app.dashboard.widgets.matrix_text import written
from app.scenario.data import differences
from app.session.commands import Pin, Unpin
from app.session.snapshot import Snapshot
from app.session.timeline import Pinned
from app.storage.session_index import PINS

_EVERY = 1.0  # s, between two looks at the figures
_TOLD = 4  # differences of a pinned run that are shown


class RunsPanel:
    """Buttons to pin and forget runs, and a table of figures over the last seconds up to the instant looked at: over
    the same instants of every run that has come that far, over the last ones of every other."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        gui = desk.gui
        self._note = gui.add_html("")
        gui.add_button(
            "Pin this run", hint="Keep it as it is now, to compare it with what you change. Key: P"
        ).on_click(self._on_pin)
        self._table = gui.add_html("")
        self._forget = [gui.add_button("", visible=False, hint="Frees its place.") for _ in range(PINS)]
        self._numbers: list[int | None] = [None] * PINS
        for place, button in enumerate(self._forget):
            button.on_click(self._forgetting(place))
        self._due = -math.inf
        self._key: object = None

    async def _on_pin(self, _: viser.GuiEvent) -> None:
        self._desk.post(Pin())

    def _forgetting(self, place: int) -> Any:
        async def on_click(_: viser.GuiEvent) -> None:
            number = self._numbers[place]
            if number is not None:
                self._desk.post(Unpin(number))

        return on_click

    def show(self, snapshot: Snapshot) -> None:
        window = self._desk.viewing.window
        key = (window, tuple(pinned.number for pinned in snapshot.pinned), snapshot.revision, snapshot.run)
        if key == self._key and time.monotonic() < self._due:
            return
        self._key, self._due = key, time.monotonic() + _EVERY
        self._numbers = [pinned.number for pinned in snapshot.pinned] + [None] * (PINS - len(snapshot.pinned))
        for button, number in zip(self._forget, self._numbers, strict=True):
            if number is not None:
                button.label = f"Forget run {number}"
            if button.visible != (number is not None):
                button.visible = number is not None
        self._note.content = f'<div class="vs-note">{_note(snapshot, window)}</div>'
        self._table.content = table_html(snapshot, window) if snapshot.pinned else ""


def _note(snapshot: Snapshot, window: float) -> str:
    if not snapshot.pinned:
        return (
            f"Pin up to {PINS} runs, change something, and see both: pinned runs are the grey lines in the plots, and "
            "stand beside the running one in a table here. A fork pins what it leaves, an edit a run that has stopped."
        )
    start = max(snapshot.t - window, 0.0)
    told = f"Every run from t = {start:.2f} to {snapshot.t:.2f} s."
    ended = any(pinned.t < snapshot.t for pinned in snapshot.pinned)
    return f"{told} One that ended before: its own last {window:g} s." if ended else told


def table_html(snapshot: Snapshot, window: float) -> str:
    """Table of figures over the last `window` s, a column for each run, and the differences of each pinned run's
    scenario."""
    runs = [
        (snapshot.system, snapshot.recording, snapshot.t),
        *((p.system, p.recording, min(p.t, snapshot.t)) for p in snapshot.pinned),
    ]
    systems = tuple(system for system, _, _ in runs)
    accounts = tuple(account(system, rows, end - window, end) for system, rows, end in runs)
    heads = "".join(f"<th>{head}</th>" for head in ("now", *(str(p.number) for p in snapshot.pinned)))
    rows = "".join(_row(figure, figure.units(systems), accounts) for figure in FIGURES)
    told = "".join(_told(pinned, snapshot) for pinned in snapshot.pinned)
    return f'<table class="vs-facts vs-runs"><tr><th></th>{heads}</tr>{rows}</table>{told}'


def _row(figure: Figure, unit: str, accounts: tuple[Account | None, ...]) -> str:
    values = [figure.of(account) for account in accounts]
    if all(value is None for value in values):
        return ""
    cells = "".join(f"<td>{'—' if value is None else f'{value:.3g}'}</td>" for value in values)
    return f'<tr><td>{figure.title} <span class="vs-dim">{unit}</span></td>{cells}</tr>'


def _told(pinned: Pinned, snapshot: Snapshot) -> str:
    """Differences of the pinned run's scenario from the running one, as HTML."""
    different = differences(snapshot.scenario, pinned.scenario)
    parts = [f"{path} = {_short(theirs)}" for path, (_, theirs) in list(different.items())[:_TOLD]]
    if len(different) > _TOLD:
        parts.append(f"{len(different) - _TOLD} more")
    what = ", ".join(parts) or "as now"
    return f'<div class="vs-note"><b>{pinned.number}</b> up to {pinned.t:.2f} s: {escape(what)}</div>'


def _short(value: object) -> str:
    if value is None:
        return "the mode's own"
    if isinstance(value, bool | str):
        return str(value)
    text = written(value) if isinstance(value, float | int) else str(value)
    return text if len(text) < 40 else f"{text[:37]}…"
