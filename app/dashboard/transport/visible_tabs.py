"""Who looks at which tabs of plots: viser's client does not tell, so the page's script reports it."""

from __future__ import annotations

from collections.abc import Collection
from html import escape

import viser

from app.dashboard.transport.viser_private import uuid_of


def marker_html(tab: str, window: float = 0.0, ahead: float = 0.0, text: str = "") -> str:
    """What the script looks for: a tab counts as looked at while this is on the screen. window, ahead: the time axes go
    from so many s before now to so many after it. text: HTML to show there."""
    ends = f'data-from="{-window:g}" data-to="{ahead:g}"'
    return f'<div class="vs-plots" data-plots="{escape(tab)}" {ends}>{text}</div>'


class VisibleTabs:
    """Visible tabs of every page: its script writes them into one of these text fields, which nobody sees. There are
    several since a collapsed panel takes its own away."""

    def __init__(self) -> None:
        self._tabs: dict[int, frozenset[str]] = {}
        self.fields: frozenset[str] = frozenset()

    def add_field(self, gui: viser.GuiApi) -> None:
        """One more, in the current container."""
        gui.add_html('<i class="vs-looking"></i>')
        field = gui.add_text("", "")
        self.fields |= {uuid_of(field)}

        async def on_report(event: viser.GuiEvent) -> None:
            if event.client is not None:
                names, _, _ = field.value.partition("#")  # behind it something that makes every report a new value
                self._tabs[event.client.client_id] = frozenset(filter(None, names.split(",")))

        field.on_update(on_report)

    def tabs(self, clients: Collection[int]) -> frozenset[str]:
        """What anyone of those who are connected looks at."""
        for gone in set(self._tabs) - set(clients):
            self._tabs.pop(gone, None)
        return frozenset().union(*self._tabs.values())
