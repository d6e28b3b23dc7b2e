"""What-if panel: switch and horizon of the preview, and the final values beside it."""

from __future__ import annotations

import math
import time
from html import escape

import viser

from app.dashboard.widgets.controls import Desk
from app.scenario.units import Units
from app.session.preview import Figures
from app.session.snapshot import Snapshot

_SHOWN = 20.0  # s during which an applied value can be taken back by a click


class WhatIfPanel:
    """Folder of settings in the current container, and a window that is visible while a slider is held and a little
    longer, to take the value back."""

    def __init__(self, desk: Desk) -> None:
        self._desk, gui = desk, desk.gui
        with gui.add_folder("What if", expand_by_default=False):
            hint = "While a slider is held: draw what it would do, and apply it when it is let go."
            self._on = gui.add_checkbox("Preview", desk.whatif.on, hint=hint)
            self._horizon = gui.add_slider("Ahead [s]", 1.0, 20.0, 0.5, desk.whatif.horizon, marks=())
        self._on.on_update(self._on_switch)
        self._horizon.on_update(self._on_horizon)
        self._window = gui.add_panel(visible=False)
        with self._window.add_tab("What if"):
            self._html = gui.add_html("")
            self._revert = gui.add_button("Revert", hint="Esc while the slider is held.")
        self._revert.on_click(self._on_revert)
        self._window.float(x=-12, y=12, width=330)
        self._told, self._until = "", -math.inf

    async def _on_switch(self, event: viser.GuiEvent) -> None:
        if event.client is not None:
            self._desk.whatif.on = self._horizon.visible = self._on.value

    async def _on_horizon(self, event: viser.GuiEvent) -> None:
        if event.client is not None:
            self._desk.whatif.horizon = self._horizon.value

    async def _on_revert(self, _: viser.GuiEvent) -> None:
        whatif = self._desk.whatif
        held, undo = whatif.held, whatif.undo(self._desk.snapshot())
        if held is not None:
            whatif.let_go(held.control)
        elif undo is not None:
            self._desk.post(undo)

    def show(self, snapshot: Snapshot) -> None:
        whatif, now = self._desk.whatif, time.monotonic()
        held = whatif.held
        if held is not None:
            self._until = now + _SHOWN
            self._told = f"<span>{escape(held.label)} = <b>{escape(held.value)}</b></span>"
            self._html.content = _html(self._told, "let go: apply · Esc: revert", self._body(snapshot.system.units))
        elif whatif.undo(snapshot) is None:
            self._until = -math.inf
        else:
            self._html.content = _html(self._told, "applied", "")
        visible = now < self._until
        if self._window.visible != visible:
            self._window.visible = visible

    def _body(self, units: Units) -> str:
        whatif = self._desk.whatif
        if whatif.refusal:
            return f'<div class="vs-message vs-bad">{escape(whatif.refusal)}</div>'
        if whatif.outlook is None:
            return '<div class="vs-dim">…</div>'
        figures = whatif.outlook.figures
        rows = "".join(f"<tr><td>{what}</td><td>{value}</td></tr>" for what, value in _rows(figures, units))
        notes = [f'<div class="vs-message vs-warn">{escape(figures.left)}</div>'] if figures.left else []
        if whatif.outlook.restarts:
            notes.append('<div class="vs-message vs-warn">This edit begins the scenario anew.</div>')
        span = f'<div class="vs-dim">within the next {figures.span:.1f} s:</div>'
        return f'{span}<table class="vs-facts">{rows}</table>{"".join(notes)}'


def _html(head: str, hint: str, body: str) -> str:
    row = f'<div class="vs-row">{head}<span class="vs-dim vs-right">{hint}</span></div>'
    return f'<div class="vs-held">{row}{body}</div>'


def _rows(figures: Figures, units: Units) -> list[tuple[str, str]]:
    rows = []
    if figures.force_error is not None and figures.force_settling is not None:
        predicted = figures.force_error_predicted
        told = "— (F_d varies)" if predicted is None else f"{_small(predicted, 1e-3)} N"
        rows.append(("force error at the end, by (37)", f"<b>{_small(figures.force_error, 1e-3)}</b>, {told}"))
        rows.append(("force within 2 % after", _seconds(figures.force_settling)))
    promised = f"≤ {figures.reaching_time_promised:.3g} s"
    rows += [
        ("path error at the end", f"<b>{_small(figures.motion_error * 1e3, 1e-4)}</b> {units.error}"),
        ("path within 2 % after", _seconds(figures.motion_settling)),
        ("layer reached after, s = 0 by (18)", f"{_seconds(figures.reaching_time)}, {promised}"),
        ("least margin of (17)", f"{_small(figures.gain_margin, 1e-9)} {units.force}"),
    ]
    return rows


def _seconds(value: float) -> str:
    return f"<b>{value:.2f}</b> s" if math.isfinite(value) else "not yet"


def _small(value: float, zero: float) -> str:
    return "0" if abs(value) < zero else f"{value:.3g}"
