"""Sliders of the presentation: those that were moved last, from all tabs."""

from __future__ import annotations

from app.dashboard.widgets.fields.controls import Desk, NumberField
from app.dashboard.widgets.fields.field_binding import NumberRow
from app.session.snapshot import Snapshot

MOST = 3

Names = tuple[str, ...]


class ChosenSliders:
    """Folder with a second row for each of the MOST fields that were moved last. A row keeps its place until it is
    replaced; while the task coordinates are others than those when it was moved, it is not shown, since its label may
    name one. `page.css` shows the folder in the presentation only."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._moved: tuple[tuple[NumberRow, Names], ...] = ()  # with the task coordinates at that time
        self._numbers: list[NumberField] = []
        self._folder = desk.gui.add_folder("Sliders", visible=False)
        with self._folder:
            desk.gui.add_html('<div class="vs-chosen"></div>')

    def choose(self, row: NumberRow) -> None:
        """Add a row, in place of the one that was left alone longest."""
        if row.scale is not None:
            others = tuple((other, names) for other, names in self._moved if other.binding != row.binding)
            self._moved = ((row, _names(self._desk.snapshot())), *others)[:MOST]

    def show(self, snapshot: Snapshot) -> None:
        present = _names(snapshot)
        moved = [row for row, names in self._moved if names == present]
        bindings = [row.binding for row in moved]
        for number in [number for number in self._numbers if number.row.binding not in bindings]:
            self._numbers.remove(number)
            number.remove()
        shown = [number.row.binding for number in self._numbers]
        with self._folder:
            self._numbers += [NumberField(self._desk, *row) for row in moved if row.binding not in shown]
        for number in self._numbers:
            number.show(snapshot)
        if self._folder.visible != bool(moved):
            self._folder.visible = bool(moved)


def _names(snapshot: Snapshot) -> Names:
    return tuple(coordinate.name for coordinate in snapshot.coordinates)
