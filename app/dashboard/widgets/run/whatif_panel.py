"""What-if panel: switch and horizon of the preview, and the final values beside it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape

from app.dashboard.transport.page_values import PageEvent, from_pages
from app.dashboard.widgets.fields.controls import Desk
from app.dashboard.widgets.fields.field_words import refusal_in_words
from app.dashboard.widgets.run.whatif import WhatIf
from app.scenario.number_text import rounded
from app.scenario.units import Units
from app.session.preview_messages import Preview, PreviewMetrics
from app.session.snapshot import Snapshot
from controllers.switching import SWITCHING

BANDS = {"none": 0, "16 of the declared set": 16, "64 of the declared set": 64}
WEAK, FINE = 0.1, 1e-5  # N, m: below them mN and µm are easier to read
NO_FORCE = 1e-6  # N
Value = Callable[[PreviewMetrics], float | None]
Text = Callable[[PreviewMetrics], str | None]
_SHOWN = 20.0  # s during which an applied value can be taken back by a click


class WhatIfPanel:
    """Folder of settings in the current container, and a window that is visible while a slider is held, and a little
    longer, so that its value can be taken back."""

    def __init__(self, desk: Desk) -> None:
        self._desk, gui = desk, desk.gui
        with gui.add_folder("What if", expand_by_default=False):
            hint = "While a slider is held: draw what it would do, and apply it when it is let go."
            self._on = gui.add_checkbox("Preview", desk.whatif.on, hint=hint)
            self._horizon = gui.add_slider("Ahead [s]", 1.0, 20.0, 0.5, desk.whatif.horizon, marks=())
            hint = (
                "Pushes the tool for a second where nothing else moves the arm, so that there is something to compare."
            )
            self._push = gui.add_slider("Push at rest [N]", 0.0, 100.0, 1.0, desk.whatif.push, marks=(), hint=hint)
            hint = "Shaded behind the preview: all, 5 % to 95 %, and the median. The same arms at every value."
            self._arms = gui.add_dropdown("True arms", tuple(BANDS), initial_value=_named(desk.whatif.arms), hint=hint)
        self._arms.on_update(from_pages(self._on_arms))
        self._on.on_update(from_pages(self._on_switch))
        self._horizon.on_update(from_pages(self._on_horizon))
        self._push.on_update(from_pages(self._on_push))
        self._window = gui.add_panel(visible=False)
        with self._window.add_tab("What if"):
            self._html = gui.add_html("")
            self._take_back_button = gui.add_button("Cancel")
        self._take_back_button.on_click(self._on_take_back)
        gui.add_command("Revert the last slider", hotkey="Z").on_trigger(self._on_key)
        self._window.float(x=-12, y=12, width=330)
        self._head, self._until = "", -math.inf

    async def _on_switch(self, _: PageEvent) -> None:
        self._desk.whatif.on = self._horizon.visible = self._push.visible = self._on.value
        self._arms.visible = self._on.value

    async def _on_horizon(self, _: PageEvent) -> None:
        self._desk.whatif.horizon = self._horizon.value

    async def _on_push(self, _: PageEvent) -> None:
        self._desk.whatif.push = self._push.value

    async def _on_arms(self, _: PageEvent) -> None:
        self._desk.whatif.arms = BANDS[self._arms.value]

    async def _on_take_back(self, _: object) -> None:
        self._take_back()

    async def _on_key(self, _: object) -> None:
        if not self._take_back():
            self._desk.complain("revert: nothing; allowed: after a slider has applied its value, until the next edit")

    def _take_back(self) -> bool:
        """Let go of the held slider, or take back what one has applied; returns whether there was either."""
        whatif = self._desk.whatif
        held, undo = whatif.held, whatif.undo(self._desk.snapshot())
        if held is not None:
            whatif.drop(held)
        elif undo is not None:
            self._desk.post(undo)
        return held is not None or undo is not None

    def show(self, snapshot: Snapshot) -> None:
        whatif, now = self._desk.whatif, time.monotonic()
        held = whatif.held
        if held is not None:
            self._until = now + _SHOWN
            self._name_button("Cancel", "Esc does the same.")
            self._head = f"<span>{escape(held.label)} = <b>{escape(held.value)}</b></span>"
            hint = f'{escape(held.then)}<span class="vs-by-key"> · Esc: cancel</span>'
            body = body_html(whatif, snapshot.system.units)
            self._html.content = f'<div class="vs-held vs-preview">{_headed(self._head, hint)}{body}</div>'
        elif whatif.undo(snapshot) is None:
            self._until = -math.inf
        else:
            self._html.content = f'<div class="vs-held">{_headed(self._head, "applied")}</div>'
            self._name_button("Revert", "Z does the same.")
        visible = now < self._until
        if self._window.visible != visible:
            self._window.visible = visible

    def _name_button(self, label: str, hint: str) -> None:
        self._take_back_button.label, self._take_back_button.hint = label, hint


def body_html(whatif: WhatIf, units: Units) -> str:
    """Table of the preview with what is to be said of it, or why there is none, as HTML."""
    preview = whatif.preview
    if whatif.refusal:
        return f'<div class="vs-message vs-bad">{escape(refusal_in_words(whatif.refusal))}</div>'
    if preview is None:
        return '<div class="vs-dim">…</div>'
    metrics = preview.metrics
    notes = [f'<div class="vs-message vs-warn">{escape(metrics.left)}</div>'] if metrics.left else []
    if preview.restarts:
        anew = "This edit restarts the scenario: both columns are of a run from its beginning."
        notes.append(f'<div class="vs-message vs-warn">{anew}</div>')
    pushed = f", with a push of {metrics.push:g} N" if metrics.push else ""
    which = "first" if preview.restarts else "next"
    span = f'<div class="vs-dim">within the {which} {metrics.span:.1f} s{pushed}:</div>'
    return f"{span}{_table(preview, units)}{_of_band(preview)}{''.join(notes)}"


def _named(arms: int) -> str:
    return next(name for name, count in BANDS.items() if count == arms)


def _of_band(preview: Preview) -> str:
    """Sentence on the band of true arms, as HTML."""
    band = preview.band
    if preview.bandless:
        return f'<div class="vs-dim">No band of true arms: {escape(preview.bandless)}.</div>'
    if band is None:
        return ""
    so_far = "" if band.reach >= preview.metrics.span else f", the next {band.reach:.1f} s"
    arms = f"{band.arms} true arms of the declared set{so_far}"
    html = f'<div class="vs-dim">shaded: {arms}; darker: 5 % to 95 % of them</div>'
    if band.stopped:
        html += f'<div class="vs-message vs-warn">{band.stopped} of them stop: {escape(band.because)}</div>'
    return html


@dataclass(frozen=True)
class _Row:
    """Row of the table of final values.
    value: returns the row's value as text, None where it has no meaning; in the same unit for both columns.
    note: returns a text beside the title, such as a predicted value, None for none."""

    title: str
    value: Text
    note: Text = lambda _: None


def _rows(units: Units, reached: str, columns: Sequence[PreviewMetrics]) -> tuple[_Row, ...]:
    """Rows of the table. reached: what the reaching time is the time of. columns: metrics of all columns."""

    def largest_of(value: Value) -> float:
        return max((abs(found) for each in columns if (found := value(each)) is not None), default=math.inf)

    def length(value: Value) -> Text:
        fine = units.error == "mm" and largest_of(value) < FINE
        factor, zero, unit = (1e6, 1e-3, "µm") if fine else (1e3, 1e-4, units.error)
        return lambda f: None if (found := value(f)) is None else f"{_small(found * factor, zero)} {unit}"

    def newtons(value: Value) -> Text:
        weak = NO_FORCE < largest_of(value) < WEAK
        factor, zero, unit = (1e3, 1e-3, "mN") if weak else (1.0, NO_FORCE, "N")
        return lambda f: None if (found := value(f)) is None else f"{_small(found * factor, zero)} {unit}"

    def force(value: float | None) -> str | None:
        return None if value is None else f"{_small(value, 1e-9)} {units.force}"

    def predicted(metrics: PreviewMetrics) -> str | None:
        by_37 = newtons(lambda f: f.force_error_predicted)(metrics)
        return "F_d varies" if by_37 is None else f"by (37) {by_37}"

    def largest(metrics: PreviewMetrics) -> str | None:
        most = length(lambda f: f.motion_largest)(metrics)
        return None if most is None else f"{'≥ ' if metrics.motion_grows else ''}{most}"

    def angle(value: float | None) -> str | None:
        return None if value is None else f"{_small(value * 1e3, 1e-4)} mrad"

    return (
        _Row("mean force error at the end", newtons(lambda f: f.force_error), predicted),
        _Row("force within 2 % after", lambda f: _seconds(f.force_settling)),
        _Row("force overshoot", newtons(lambda f: f.force_overshoot)),
        _Row("largest force on the surface", newtons(lambda f: f.contact_largest)),
        _Row("mean force on it at the end", newtons(lambda f: f.contact_final)),
        _Row("largest path error (≥: it still grows)" if _grows(columns) else "largest path error", largest),
        _Row("largest path error at the end", length(lambda f: f.motion_error)),
        _Row("path within 2 % after", lambda f: _seconds(f.motion_settling)),
        _Row("swing to the other side", length(lambda f: f.motion_overshoot)),
        _Row("largest angle error", lambda f: angle(f.angle_largest)),
        _Row("largest angle error at the end", lambda f: angle(f.angle_error)),
        _Row("largest torque of a joint", lambda f: f"{_small(f.torque_largest, 1e-3)} {units.of_joints('N·m')}"),
        _Row(
            f"{reached} reached after",
            lambda f: _seconds(f.reaching_time),
            lambda f: (
                "(18) promises nothing"
                if f.reaching_time_promised is None
                else f"s = 0 by (18): ≤ {rounded(f.reaching_time_promised)} s"
            ),
        ),
        _Row("least margin of (17)", lambda f: force(f.gain_margin)),
    )


def _table(preview: Preview, units: Units) -> str:
    """Table of the preview's metrics as HTML, of the rows that have a meaning; beside them those of the running
    scenario."""
    metrics, today = preview.metrics, preview.today
    reached = "layer" if SWITCHING[preview.scenario.controller.switching].has_layer else "band"
    lines = ["<tr><th></th><th>with it</th><th>without</th></tr>"]
    for row in _rows(units, reached, [metrics] if today is None else [metrics, today]):
        if (value := row.value(metrics)) is None:
            continue
        beside = f'<br><span class="vs-dim">{text}</span>' if (text := row.note(metrics)) else ""
        before = "…" if today is None else row.value(today) or "—"
        lines.append(f"<tr><td>{row.title}{beside}</td><td><b>{value}</b></td><td>{before}</td></tr>")
    return f'<table class="vs-facts vs-foreseen">{"".join(lines)}</table>'


def _headed(head: str, hint: str) -> str:
    return f'<div class="vs-row">{head}<span class="vs-dim vs-right">{hint}</span></div>'


def _grows(columns: Sequence[PreviewMetrics]) -> bool:
    return any(each.motion_largest is not None and each.motion_grows for each in columns)


def _seconds(value: float | None) -> str | None:
    if value is None:
        return None
    if not math.isfinite(value):
        return "not yet"
    return f"{value:.2f} s" if value >= 0.1 else f"{value:.2g} s"


def _small(value: float, zero: float) -> str:
    return "0" if abs(value) < zero else rounded(value)
