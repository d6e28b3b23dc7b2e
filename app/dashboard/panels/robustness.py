"""Robustness panel: a map over fields and true arms, and a search for better gains."""

from __future__ import annotations

from typing import ClassVar

from app.dashboard.widgets.families.gain_search import GainSearch
from app.dashboard.widgets.families.robustness_map import RobustnessMap
from app.dashboard.widgets.fields.controls import Desk
from app.dashboard.widgets.fields.field_binding import NumberRow
from app.scenario.errors import ScenarioError
from app.session.snapshot import Snapshot


class RobustnessPanel:
    """Robustness panel: the map, and below it the search. Both are computed beside the loop."""

    holds: ClassVar = "robustness map, sweep, search for better gains"

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        desk.gui.add_html(
            '<div class="vs-note">To put a slider of any tab in here, press the right mouse button on its row, touch '
            "and hold its name, or press Shift+F10 while it has the focus. The menu there has <i>Sweep this</i>, for "
            "the map, and <i>Let a search move this</i>.</div>"
        )
        with desk.gui.add_folder("Robustness map"):
            self._map = RobustnessMap(desk)
        with desk.gui.add_folder("Search for better gains", expand_by_default=False):
            self._search = GainSearch(desk)

    def show(self, snapshot: Snapshot) -> None:
        self._map.show(snapshot)
        self._search.show(snapshot)

    def sweep(self, row: NumberRow) -> None:
        """Choose the field of this row for the map."""
        try:
            self._map.sweep(row)
        except ScenarioError as error:
            self._desk.complain(str(error))

    def let_move(self, row: NumberRow) -> None:
        """Let the search vary the field of this row."""
        try:
            self._search.let_move(row)
        except ScenarioError as error:
            self._desk.complain(str(error))
