"""Tabs of the control panel: which of them are shown anew, and when."""

from __future__ import annotations

from collections.abc import Collection

import viser

from app.dashboard.panels import PANELS, Panel
from app.dashboard.panels.robustness import RobustnessPanel
from app.dashboard.transport.visible_parts import VisibleParts
from app.dashboard.transport.widget_lock import WidgetLock
from app.dashboard.widgets.fields.controls import Desk
from app.dashboard.widgets.run.whatif import HeldControl
from app.session.snapshot import Snapshot


def _reported(title: str) -> str:
    """Name by which a page reports that the tab of controls of this title is on its screen."""
    return f"controls: {title}"


ACTING = frozenset(map(_reported, ("Lessons", "Robustness")))  # panels that follow the run also when on no screen
EVERY = 1 / 2  # s, while nobody uses a control and the run is not changed


class ControlTabs:
    """Every panel of `PANELS` in a tab of its own, in the current container.

    A panel on a screen shows the running values at once when somebody has used a control or the run has changed, else
    now and then. Other panels follow a change a little later.
    """

    def __init__(self, gui: viser.GuiApi, desk: Desk, visible_parts: VisibleParts, widget_lock: WidgetLock) -> None:
        self._visible_parts, self._widget_lock = visible_parts, widget_lock
        self._panels: dict[str, Panel] = {}
        tabs = gui.add_tab_group()
        for title, panel in PANELS.items():
            with tabs.add_tab(title):
                gui.add_html(visible_parts.panel_marker_html(_reported(title)))
                self._panels[_reported(title)] = panel(desk)
            # each page opens it for itself: static/page/palette.js
            gui.add_command(f"Controls: {title}", description=panel.holds)
        (self.robustness,) = (panel for panel in self._panels.values() if isinstance(panel, RobustnessPanel))
        self._due = 0.0
        self._of: object = None
        self._open: frozenset[str] = frozenset()  # panels on a screen when they were shown last
        self._outdated: frozenset[str] = frozenset()  # panels that do not show the last change yet

    def show(self, snapshot: Snapshot, clients: Collection[int], held: HeldControl | None, now: float) -> None:
        """Show the running values. held: control that is held, None for none. now: s, monotonic."""
        of = (
            *(snapshot.scenario, snapshot.revision, snapshot.run, snapshot.phase, snapshot.refusal_number),
            *(snapshot.blending, [(pinned.number, pinned.title) for pinned in snapshot.pinned]),
            held,
            self._widget_lock.used,
        )
        every = frozenset(self._panels)
        # the script of a page that reports no panel may not run at all
        on_screen = self._visible_parts.tabs(clients) & every or every
        shown = on_screen - self._open
        if of != self._of:
            self._of, self._outdated = of, every
            shown = on_screen
        if now >= self._due:
            self._due = now + EVERY
            shown = on_screen | self._outdated | ACTING
        self._open, self._outdated = on_screen, self._outdated - shown
        for name, panel in self._panels.items():
            if name in shown:
                with self._widget_lock.drawing:
                    panel.show(snapshot)
