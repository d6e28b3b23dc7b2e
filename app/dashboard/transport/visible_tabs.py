"""Visible tabs of plots on each page: viser's client does not report them, so the page's script does."""

from __future__ import annotations

from collections.abc import Collection
from html import escape

import viser

from app.dashboard.transport.viser_private import uuid_of


def marker_html(tab: str, window: float = 0.0, ahead: float = 0.0, text: str = "") -> str:
    """Marker for the page's script: a tab counts as visible while its marker is on the screen.
    window, ahead: the time axes go from so many s before now to so many after it.
    text: HTML to show there."""
    ends = f'data-from="{-window:g}" data-to="{ahead:g}"'
    return f'<div class="vs-plots" data-plots="{escape(tab)}" {ends}>{text}</div>'


class VisibleTabs:
    """Visible tabs of every page: its script writes them into one of these hidden text fields. There are several
    fields, since a collapsed panel removes its own."""

    def __init__(self) -> None:
        self._tabs: dict[int, frozenset[str]] = {}
        self.fields: frozenset[str] = frozenset()

    def add_field(self, gui: viser.GuiApi) -> None:
        """Add one more field, in the current container."""
        gui.add_html('<i class="vs-looking"></i>')
        field = gui.add_text("", "")
        self.fields |= {uuid_of(field)}

        async def on_report(event: viser.GuiEvent) -> None:
            if event.client is not None:
                names, _, _ = field.value.partition("#")  # the part behind # makes every report a new value
                self._tabs[event.client.client_id] = frozenset(filter(None, names.split(",")))

        field.on_update(on_report)

    def tabs(self, clients: Collection[int]) -> frozenset[str]:
        """Tabs that are visible on any of the connected pages."""
        for gone in set(self._tabs) - set(clients):
            self._tabs.pop(gone, None)
        return frozenset().union(*self._tabs.values())
