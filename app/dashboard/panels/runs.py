"""Runs panel: metrics of the running run beside those of the pinned ones."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from html import escape
from typing import ClassVar, Literal

import viser

from app.analysis.metrics import ACCOUNT_METRICS, Account, ShownMetric, account
from app.dashboard.theme.colors import RUNS, css
from app.dashboard.theme.style import COMMITS, without_marks
from app.dashboard.transport.page_values import PageEvent, from_pages
from app.dashboard.widgets.fields.controls import AwaitedAnswer, Desk
from app.dashboard.widgets.fields.field_words import differences_in_words
from app.scenario.number_text import short
from app.session.commands import Load, Pin, Rename, Unpin
from app.session.snapshot import Snapshot
from app.session.timeline import Pinned
from app.simulation.system import System
from app.storage.session_index import PINS

Over = Literal["own", "same"]
OVER: dict[str, Over] = {"each run's own last seconds": "own", "the same instants": "same"}
_EVERY = 1.0  # s, between two updates of the metrics


class RunsPanel:
    """Runs panel: buttons to pin, name and forget runs, and a table of metrics over the last seconds of each run, or
    over the same instants of all runs."""

    holds: ClassVar = "pin this run, compare runs, metrics"

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        gui = desk.gui
        self._note = gui.add_html("")
        gui.add_button(
            "Pin this run",
            hint="Keeps this run up to now, to compare others with it. Reset (R) starts a new run beside it. Key: P",
        ).on_click(self._on_pin)
        self._over = gui.add_dropdown("Metrics over", tuple(OVER), hint="Which instants of each run the metrics cover.")
        self._table = gui.add_html("")
        copy = '<button class="vs-copy" data-copy=".vs-runs">Copy the table</button>'
        self._copy = gui.add_html(copy, visible=False)
        self._rows = [_PinnedRow(desk) for _ in range(PINS)]
        self._due = -math.inf
        self._key: object = None

    async def _on_pin(self, _: viser.GuiEvent) -> None:
        self._desk.post(Pin())

    def show(self, snapshot: Snapshot) -> None:
        window, over = self._desk.viewing.window, OVER[self._over.value]
        key = (window, over, tuple((p.number, p.name) for p in snapshot.pinned), snapshot.revision, snapshot.run)
        if key == self._key and time.monotonic() < self._due:
            return
        self._key, self._due = key, time.monotonic() + _EVERY
        placed = {run.slot: run for run in snapshot.pinned}  # a run keeps its row when another one is forgotten
        for slot, row in enumerate(self._rows):
            row.show(placed.get(slot), snapshot)
        for widget in (self._over, self._copy):
            if widget.visible != bool(snapshot.pinned):
                widget.visible = bool(snapshot.pinned)
        self._note.content = f'<div class="vs-note">{_note(snapshot, window, over)}</div>'
        self._table.content = table_html(snapshot, window, over) if snapshot.pinned else ""


class _PinnedRow:
    """Row of a pinned run: a text field for its name, and buttons to go back to its settings and to forget it.

    A page may click on what it sees after another page has had that run forgotten: so a row that has lost its run stays
    empty for a while before it shows the next one, and does nothing meanwhile."""

    def __init__(self, desk: Desk) -> None:
        self._desk, self._run = desk, None
        self._typing = AwaitedAnswer()  # of the one who types a name
        self._empty_until = -math.inf
        self._form = desk.gui.add_form(None, visible=False)
        with self._form:
            self._text = desk.gui.add_text("", "", hint="What this run is called in the plots and in the table.")
        self._back = desk.gui.add_button(
            "", visible=False, hint="The present run goes on, or begins again, with these settings."
        )
        self._forget = desk.gui.add_button("", visible=False, color="gray", hint="Frees its place.")
        self._text.on_update(from_pages(self._on_text))
        self._back.on_click(self._on_back)
        self._forget.on_click(self._on_forget)

    async def _on_text(self, _: PageEvent) -> None:
        done = self._text.value.endswith(COMMITS)
        self._typing.expect(self._desk.snapshot(), 0.0 if done else 60.0)  # a page may close amid a name
        if self._run is None or not done:
            return
        name = without_marks(self._text.value).strip()
        if name:
            self._desk.post(Rename(self._run.number, "" if name == f"run {self._run.number}" else name))
        else:  # Esc, or nothing to read
            self._text.value = self._run.title

    async def _on_back(self, _: viser.GuiEvent) -> None:
        if self._run is not None:
            self._desk.lock.post(Load(self._run.scenario))

    async def _on_forget(self, _: viser.GuiEvent) -> None:
        if self._run is not None:
            self._desk.post(Unpin(self._run.number))

    def show(self, run: Pinned | None, snapshot: Snapshot) -> None:
        if self._run is not None and (run is None or run.number != self._run.number):
            self._empty_until = time.monotonic() + _EVERY
        if time.monotonic() < self._empty_until:
            run = None
        another = run is None or self._run is None or run.number != self._run.number
        self._run = run
        for widget in (self._form, self._back, self._forget):
            if widget.visible != (run is not None):
                widget.visible = run is not None
        if run is not None and (another or not self._typing.awaited(snapshot)):
            self._typing.expect(snapshot, 0.0)
            self._text.label, self._text.value = f"run {run.number}", run.title
            self._back.label = f"Settings of run {run.number}"
            self._forget.label = f"Forget run {run.number}"


def _note(snapshot: Snapshot, window: float, over: Over) -> str:
    if not snapshot.pinned:
        return (
            f"Pin up to {PINS} runs. Then change something and press reset (R): a new run starts beside the pinned "
            "run, which ends where it was pinned. Each has its own dashes in the plots, its own colour in the scene "
            "and a column in a table here. A fork pins the run that it leaves, and an edit pins a run that has stopped."
        )
    return f"{_behind(snapshot)}{_over(snapshot, window, over)}"


def _behind(snapshot: Snapshot) -> str:
    """Note on what to do to see a pinned run, where all of them have ended or none has begun; "" where one is to be
    seen. A pinned run keeps its last minute."""
    first = min(snapshot.pinned, key=lambda pinned: pinned.recording.first)
    if snapshot.t < first.recording.first:
        return (
            f"{escape(first.title)} is kept from {first.recording.first:.2f} s on: it appears in "
            f"{first.recording.first - snapshot.t:.0f} s. "
        )
    last = max(snapshot.pinned, key=lambda pinned: pinned.t)
    if snapshot.t < last.t - snapshot.scenario.controller.period:
        return ""
    return (
        f"{escape(last.title)} ends at {last.t:.2f} s: to see another run beside it, change something and press reset "
        "(R). "
    )


def _over(snapshot: Snapshot, window: float, over: Over) -> str:
    """Note on the instants that the table compares."""
    if over == "own":
        shorter = any(run.t < window for run in _shown(snapshot))
        whole = ", or all of a shorter one with its beginning" if shorter else ""
        return f"Last {window:g} s of each run{whole}; in brackets: compared with the present run."
    begin, end = _same(snapshot, window)
    if begin >= end:
        late = max(_shown(snapshot), key=lambda run: run.recording.first)
        early = min(_shown(snapshot), key=lambda run: run.t)
        return (
            f"No instant is in all runs: {_called(early)} ends at {early.t:.2f} s, {_called(late)} is kept from "
            f"{late.recording.first:.2f} s on."
        )
    span = f"t = {begin:.2f} to {end:.2f} s"
    return f"{span}, the last instants that all runs have; in brackets: compared with the present run."


def _shown(snapshot: Snapshot) -> tuple[Snapshot | Pinned, ...]:
    return snapshot, *snapshot.pinned


def _called(run: Snapshot | Pinned) -> str:
    return escape(run.title) if isinstance(run, Pinned) else "the present run"


def _same(snapshot: Snapshot, window: float) -> tuple[float, float]:
    """The last instants that all runs have, at most `window` s of them: from begin to end, s; none where begin >= end.
    A pinned run keeps its last minute, and a long run forgets its beginning."""
    end = min(run.t for run in _shown(snapshot))
    return max(end - window, *(run.recording.first for run in _shown(snapshot))), end


def table_html(snapshot: Snapshot, window: float, over: Over = "own") -> str:
    """Table of metrics over `window` s as HTML: a column for each run, with the difference of a pinned run from the
    present one in per cent; below it the differences of each pinned run's scenario.
    over: whether each run is measured over its own last seconds, or all over the same instants."""
    shown, same = _shown(snapshot), _same(snapshot, window)
    spans = [(run.t - window, run.t) if over == "own" else same for run in shown]
    systems = tuple(run.system for run in shown)
    accounts = tuple(
        account(run.system, run.recording, begin, end) for run, (begin, end) in zip(shown, spans, strict=True)
    )
    heads = "".join(f'<th><i class="vs-dot" style="background: {css(RUNS[p.slot])}"></i> {escape(p.title)}</th>'
                    for p in snapshot.pinned)  # fmt: skip
    rows = "".join(_row(metric, systems, accounts) for metric in ACCOUNT_METRICS)
    notes = "".join(_pinned_note(pinned, snapshot) for pinned in snapshot.pinned)
    return f'<table class="vs-facts vs-runs"><tr><th></th><th>now</th>{heads}</tr>{rows}</table>{notes}'


def _row(metric: ShownMetric, systems: Sequence[System], accounts: Sequence[Account | None]) -> str:
    now, *others = (metric.of(account) for account in accounts)
    if now is None and not any(value is not None for value in others):
        return ""
    unit, *units = (metric.units([system]) for system in systems)
    cells = [f"<td>{_number(now)}</td>"]
    for value, other in zip(others, units, strict=True):
        against = _against(value, now) if other == unit else ""  # numbers of two units are not compared
        own = f' <span class="vs-dim">{other}</span>' if other != unit and value is not None else ""
        cells.append(f"<td>{_number(value)}{own}{against}</td>")
    return f'<tr><td>{metric.title} <span class="vs-dim">{unit}</span></td>{"".join(cells)}</tr>'


def _number(value: float | None) -> str:
    if value is None:
        return "—"
    return short(value)


def _against(value: float | None, now: float | None) -> str:
    """Difference of a value from that of the present run, as HTML: in per cent, or as a multiple from twice on."""
    if value is None or now is None or abs(now) < 1e-12:
        return ""
    times = value / now
    per_cent = 100.0 * (value - now) / abs(now)
    multiple = f"{times:.1f} ×" if abs(times) < 10 else f"{times:.0f} ×" if abs(times) < 1000 else "over 1000 ×"
    digits = 1 if abs(per_cent) < 1 else 0
    difference = (f"{per_cent:+.{digits}f} %" if abs(per_cent) < 100 else multiple).replace("-", "−")
    if abs(per_cent) < 0.05:
        difference = "as now"
    return f' <span class="vs-dim vs-against">({difference})</span>'


def _pinned_note(pinned: Pinned, snapshot: Snapshot) -> str:
    """Differences of the pinned run's scenario from the running one, as HTML."""
    different = differences_in_words(snapshot.scenario, pinned.scenario, pinned.system.units)
    what = different or "as now"
    return f'<div class="vs-note"><b>{escape(pinned.title)}</b> up to {pinned.t:.2f} s: {escape(what)}</div>'
