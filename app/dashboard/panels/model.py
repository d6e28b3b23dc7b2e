"""Model: the target model (8) by the diagonals of its matrices."""

from __future__ import annotations

import viser

from app.dashboard.controls import Desk, DiagonalPlace, Number, decades
from app.dashboard.equation import is_fixed, symbol
from app.runner import Snapshot

_MATRICES = {
    "M_m": ("inertia, kg", decades(0.1, 100)),
    "B_m": ("damping, N·s/m", decades(1, 10_000)),
    "K_m": ("stiffness, N/m", decades(1, 100_000, zero=True)),
    "K_f": ("weight of the force error", decades(0.01, 100, zero=True)),
}


class ModelPanel:
    """One tab per matrix, one row per task coordinate; rows that the mode fixes are disabled."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._folder = desk.gui.add_folder(None)
        self._rows: list[tuple[str, int, Number]] = []
        self._coordinates: object = None

    def _build(self, snapshot: Snapshot) -> None:
        gui: viser.GuiApi = self._desk.gui
        for child in list(self._folder._children.values()):
            child.remove()
        self._rows.clear()
        with self._folder:
            tabs = gui.add_tab_group()
            for name, (meaning, scale) in _MATRICES.items():
                with tabs.add_tab(name):
                    gui.add_html(f'<div class="vs-note">{meaning}</div>')
                    for i, coordinate in enumerate(snapshot.coordinates):
                        place = DiagonalPlace(f"target_model.{name}", i)
                        row = Number(self._desk, place, f"{name} {symbol(coordinate.name)}", scale)
                        self._rows.append((name, i, row))

    def show(self, snapshot: Snapshot) -> None:
        if tuple(snapshot.coordinates) != self._coordinates:
            self._coordinates = tuple(snapshot.coordinates)
            self._build(snapshot)
        for name, i, row in self._rows:
            row.show(snapshot)
            row.enable(not is_fixed(snapshot, name, i))
