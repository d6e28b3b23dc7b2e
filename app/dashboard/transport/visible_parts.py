"""Visible tabs and size of the scene on each page: viser's client does not report them, so the page's script does."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Collection
from html import escape

import viser

from app.dashboard.transport.page_values import PageEvent, from_pages
from app.dashboard.transport.viser_private import uuid_of

AWAY = "-"  # instead of tabs, of a page that is not on the screen: `static/page/visible_parts.js`
NARROW = 576  # px: phones are up to this wide
_SIZE = re.compile(r"([1-9]\d{0,4})x([1-9]\d{0,4})")


def takes_part(width: int, height: int) -> bool:
    """Whether a page with a scene of this size (px) takes part in how high the plots are. A phone does not: its scene
    is narrow and low, while one between two docks may be narrow and is high."""
    return width > NARROW or height > width


class VisibleParts:
    """Visible tabs and scene of every page: the page's script writes them into one of several hidden text fields, since
    a collapsed panel removes the field in it. on_report: called after every report."""

    def __init__(self, on_report: Callable[[], None] = lambda: None) -> None:
        self._on_report = on_report
        self._marked = {AWAY}  # a page may report any other name, and would fill the memory with them
        self._tabs: dict[int, frozenset[str]] = {}
        self._scenes: dict[int, tuple[int, int]] = {}
        self._reports: Counter[str] = Counter()
        self.fields: frozenset[str] = frozenset()

    def marker_html(self, tab: str, window: float = 0.0, ahead: float = 0.0, text: str = "") -> str:
        """Marker of a tab of plots for the page's script: the tab counts as visible while its marker is on the screen.
        window, ahead: s before and after now, the ends of the time axes.
        text: HTML that the marker shows."""
        self._marked.add(tab)
        ends = f'data-from="{-window:g}" data-to="{ahead:g}"'
        return f'<div class="vs-plots" data-plots="{escape(tab)}" {ends}>{text}</div>'

    def panel_marker_html(self, name: str) -> str:
        """Marker of a tab of controls for the page's script. name: of the tab, as `tabs` returns it."""
        self._marked.add(name)
        return f'<i class="vs-panel" data-plots="{escape(name)}"></i>'

    def add_field(self, gui: viser.GuiApi) -> None:
        """Add one more field, in the current container."""
        gui.add_html('<i class="vs-visible"></i>')
        field = gui.add_text("", "")
        self.fields |= {uuid_of(field)}

        async def on_report(event: PageEvent) -> None:
            names, _, rest = field.value.partition("#")
            size, _, _ = rest.partition("#")  # the part behind only makes every report a new value
            self._tabs[event.client.client_id] = tabs = frozenset(self._marked.intersection(names.split(",")))
            if found := _SIZE.fullmatch(size):
                self._scenes[event.client.client_id] = int(found[1]), int(found[2])
            self._reports.update(tabs)
            self._on_report()

        field.on_update(from_pages(on_report))

    def reports(self, tab: str) -> int:
        """Number of reports in which this tab was visible; when it grows, a page may not have the tab's data yet."""
        return self._reports[tab]

    def tabs(self, clients: Collection[int]) -> frozenset[str]:
        """Tabs that are visible on any of the connected pages."""
        for gone in set(self._tabs) - set(clients):
            self._tabs.pop(gone, None)
            self._scenes.pop(gone, None)
        return frozenset().union(*self._tabs.values()) - {AWAY}

    def scene_of(self, client: int) -> tuple[int, int] | None:
        """Width and height of the scene on a client's page, px of the page; None while they are not known."""
        return self._scenes.get(client)

    def scene_height(self, clients: Collection[int]) -> int:
        """Height of the lowest scene on any of the connected pages, px of the page, phones left out; 0 while none is
        known."""
        scenes = [size for client, size in list(self._scenes.items()) if client in clients]
        return min((height for width, height in scenes if takes_part(width, height)), default=0)

    def all_away(self, clients: Collection[int]) -> bool:
        """Whether none of the connected pages is on its screen: each has said so."""
        return all(AWAY in self._tabs.get(client, ()) for client in clients)
