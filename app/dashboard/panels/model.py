"""Model: the target model (8) by the diagonals of its matrices."""

from __future__ import annotations

from dataclasses import dataclass

import viser

from app.dashboard.controls import Desk, DiagonalPlace, Number, Scale, decades
from app.dashboard.equation import is_fixed, symbol
from app.runner import Snapshot

_MATRICES = {
    "M_m": ("inertia, kg", decades(0.1, 100)),
    "B_m": ("damping, N·s/m", decades(1, 10_000)),
    "K_m": ("stiffness, N/m", decades(1, 100_000, zero=True)),
    "K_f": ("weight of the force error", decades(0.01, 100, zero=True)),
}


@dataclass(frozen=True)
class _Matrix:
    """The tab of one matrix, and its rows so far."""

    name: str
    scale: Scale
    tab: viser.GuiTabHandle
    rows: list[Number]


class ModelPanel:
    """One tab per matrix, one row per task coordinate; rows that the mode fixes are disabled.

    Rows are added and hidden, never removed: viser's client complains when a widget goes while it is being drawn.
    """

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        tabs = desk.gui.add_tab_group()
        self._matrices: list[_Matrix] = []
        for name, (meaning, scale) in _MATRICES.items():
            tab = tabs.add_tab(name)
            with tab:
                desk.gui.add_html(f'<div class="vs-note">{meaning}</div>')
            self._matrices.append(_Matrix(name, scale, tab, []))

    def show(self, snapshot: Snapshot) -> None:
        for matrix in self._matrices:
            self._add_missing(matrix, len(snapshot.coordinates))
            for i, row in enumerate(matrix.rows):
                row.show(snapshot)
                if i < len(snapshot.coordinates):
                    row.set_label(f"{matrix.name} {symbol(snapshot.coordinates[i].name)}")
                    row.enable(not is_fixed(snapshot, matrix.name, i))

    def _add_missing(self, matrix: _Matrix, count: int) -> None:
        for i in range(len(matrix.rows), count):
            with matrix.tab:
                place = DiagonalPlace(f"target_model.{matrix.name}", i)
                matrix.rows.append(Number(self._desk, place, f"{matrix.name} {i + 1}", matrix.scale))
