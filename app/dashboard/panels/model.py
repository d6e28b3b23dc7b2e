"""Model panel: the target model (8) by its diagonals, by omega and zeta, or by whole matrices; and its checks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np
import viser

from app.dashboard.transport.page_values import PageEvent, from_pages
from app.dashboard.widgets.fields.controls import Desk, NumberField
from app.dashboard.widgets.fields.field_binding import FieldBinding, SliderScale, log_scale
from app.dashboard.widgets.fields.matrix_editor import MatrixEditor
from app.dashboard.widgets.fields.matrix_text import written
from app.dashboard.widgets.fields.model_fields import DiagonalBinding, OscillatorBinding
from app.dashboard.widgets.target_model.equation import is_fixed
from app.dashboard.widgets.target_model.impedance_view import ImpedanceView
from app.dashboard.widgets.target_model.model_checks import checks_html, loops_html
from app.dashboard.widgets.target_model.pole_drag import PoleDrag
from app.scenario.number_text import rounded
from app.scenario.schema import Scenario
from app.scenario.units import JOINT
from app.session.commands import Edit, EditModel
from app.session.model_entries import pressed_on
from app.session.snapshot import Snapshot


@dataclass(frozen=True)
class _Quantity:
    """Quantity with a number for each task coordinate.
    binding: returns the binding of a coordinate's number; takes the coordinate, from 0, and whether alike
    ones are linked.
    scale: of the sliders.
    note: returns the text above them; unit: that of the numbers, "" for none."""

    binding: Callable[[int, Callable[[], bool]], FieldBinding]
    scale: SliderScale
    note: Callable[[Snapshot], str]
    unit: Callable[[Snapshot], str]


class _View(Protocol):
    def show(self, snapshot: Snapshot) -> None: ...


class ModelPanel:
    """Model panel: three views of the target model, of which the page shows one (state of the page), and below them
    pole map, checks and impedance."""

    holds: ClassVar = "target model: mass M_m, damping B_m, stiffness K_m, force gain K_f, ω and ζ, poles, impedance"

    def __init__(self, desk: Desk) -> None:
        self._desk, gui = desk, desk.gui
        views: dict[str, Callable[[], _View]] = {
            "diagonals": lambda: _PerCoordinate(desk, _DIAGONALS),
            "ω and ζ per axis": lambda: _PerCoordinate(desk, _OSCILLATORS),
            "full matrices": lambda: MatrixEditor(desk),
        }
        self._chosen = next(iter(views))
        hint = "How the model is shown here; the choice does not change it."
        self._choice = gui.add_dropdown("Edit by", tuple(views), initial_value=self._chosen, hint=hint)
        self._choice.on_update(from_pages(self._on_choice))
        self._folders: dict[str, viser.GuiFolderHandle] = {}
        self._views: dict[str, _View] = {}
        for title, view in views.items():
            self._folders[title] = gui.add_folder(None, visible=title == self._chosen)
            with self._folders[title]:
                self._views[title] = view()
        self._checks, self._poles, self._loops = gui.add_html(""), PoleDrag(desk), gui.add_html("")
        self._impedance = ImpedanceView(desk)
        self._checked: tuple[Scenario, float | None, Edit | EditModel | None] | None = None

    async def _on_choice(self, _: PageEvent) -> None:
        self._chosen = self._choice.value

    def show(self, snapshot: Snapshot) -> None:
        self._choice.value = self._chosen
        for title, folder in self._folders.items():
            if folder.visible != (title == self._chosen):
                folder.visible = title == self._chosen
        self._views[self._chosen].show(snapshot)
        edit = self._requested(snapshot)
        of = (snapshot.scenario, snapshot.blending, edit)  # not the revision, which does not change while looking back
        if self._checked != of:  # poles are not computed anew for every frame
            self._checked = of
            self._checks.content = checks_html(snapshot, edit)
        self._loops.content = loops_html(snapshot)
        self._impedance.show(snapshot)

    def _requested(self, snapshot: Snapshot) -> Edit | EditModel | None:
        """Edit of the model that a held slider or a draft asks for."""
        held, view = self._desk.whatif.held, self._views[self._chosen]
        match held and held.edit:
            case EditModel() | Edit("target_model") as edit:
                return edit
            case _:
                pass
        try:
            return view.edit(snapshot) if isinstance(view, MatrixEditor) else None
        except ValueError:  # the editor shows the reason
            return None


class _PerCoordinate:
    """View of the model by coordinates: a tab for each quantity, a row for each task coordinate. Rows that the mode
    fixes are disabled.

    Rows are added and hidden, never removed: viser's client fails when a widget is removed while it is being drawn.
    """

    def __init__(self, desk: Desk, quantities: Mapping[str, _Quantity]) -> None:
        self._desk, self._quantities = desk, quantities
        self._linked = False
        hint = "A slider or number also sets the other lengths, or the other angles, that have the same value."
        self._link = desk.gui.add_checkbox("Link equal axes", self._linked, hint=hint)
        self._link.on_update(from_pages(self._on_link))
        tabs = desk.gui.add_tab_group()
        self._tabs = {name: tabs.add_tab(name) for name in quantities}
        self._rows: dict[str, list[NumberField]] = {name: [] for name in quantities}
        self._notes: dict[str, viser.GuiHtmlHandle] = {}
        for name, tab in self._tabs.items():
            with tab:
                self._notes[name] = desk.gui.add_html("")

    async def _on_link(self, _: PageEvent) -> None:
        self._linked = self._link.value

    def _is_linked(self) -> bool:
        return self._linked

    def show(self, snapshot: Snapshot) -> None:
        for name, quantity in self._quantities.items():
            rows = self._rows[name]
            for i in range(len(rows), len(snapshot.coordinates)):
                with self._tabs[name]:
                    binding = quantity.binding(i, self._is_linked)
                    rows.append(NumberField(self._desk, binding, f"{name} {i + 1}", quantity.scale))
            for i, row in enumerate(rows):
                row.show(snapshot)
                if i < len(snapshot.coordinates):
                    row.set_label(f"{name} {snapshot.coordinates[i].name}")
                    row.set_enabled(enabled=not is_fixed(snapshot, name, i))
            note, unit = quantity.note(snapshot), quantity.unit(snapshot)
            self._notes[name].content = f'<div class="vs-note" data-unit="{unit}">{note}</div>'


def matrix_note(snapshot: Snapshot, name: str, meaning: str) -> str:
    """Note on a matrix as HTML: meaning, unit, and the values of angles per radian, since r holds angles times a
    length."""
    unit, angular = snapshot.system.units.of_model[name], JOINT.of_model[name]
    lines = [f"{meaning}, {unit}" if unit else meaning]
    matrix = snapshot.matrices[name]
    if np.count_nonzero(matrix - np.diag(np.diag(matrix))):
        lines.append("not diagonal: its diagonal is shown, the coupling is kept")
    turning: dict[str, list[str]] = {}
    for coordinate, value in zip(snapshot.coordinates, np.diag(matrix), strict=True):
        if coordinate.metres_per_radian is not None and angular:
            turned = rounded(value * coordinate.metres_per_radian**2, 4)
            turning.setdefault(turned, []).append(coordinate.name.removeprefix("ℓ·"))
    if turning:
        values = "; ".join(f"{', '.join(names)}: {value}" for value, names in turning.items())
        lines.append(f"times ℓ², {values} {angular}")
    return "<br>".join(lines)


def oscillator_note(snapshot: Snapshot, unit: str) -> str:
    """Note on omega and zeta as HTML: how they are set, and for which coordinates they are special."""
    lines = [f"{unit}, each axis alone. M_m is kept: K_m = M_m ω², B_m = 2ζω M_m."]
    for coordinate, K_e in zip(
        snapshot.coordinates, pressed_on(snapshot.scenario, len(snapshot.coordinates)), strict=True
    ):
        name = coordinate.name
        if np.isinf(K_e):
            lines.append(f"{name} is held by the rigid surface (42) and does not swing: no ω, no ζ.")
        elif K_e > 0.0:
            lines.append(
                f"{name} presses on K̂_e = {written(K_e)} N/m: ω² = (K_m + K_f K̂_e) / M_m is set by K_f. "
                "K_m is kept: with K_m = 0 the force error vanishes (37)."
            )
    return "<br>".join(lines)


def _diagonal(name: str, meaning: str, scale: SliderScale) -> _Quantity:
    return _Quantity(
        lambda i, linked: DiagonalBinding(f"target_model.{name}", i, linked),
        scale,
        lambda snapshot: matrix_note(snapshot, name, meaning),
        lambda snapshot: snapshot.system.units.of_model[name],
    )


_DIAGONALS = {
    "M_m": _diagonal("M_m", "inertia", log_scale(0.1, 100)),
    "B_m": _diagonal("B_m", "damping", log_scale(1, 10_000)),
    "K_m": _diagonal("K_m", "stiffness", log_scale(1, 100_000, zero=True)),
    "K_f": _diagonal("K_f", "weight of the force error", log_scale(0.01, 100, zero=True)),
}
_OSCILLATORS = {
    "ω": _Quantity(
        lambda i, linked: OscillatorBinding("target_model", "omega", i, linked),
        log_scale(1, 200),
        lambda snapshot: oscillator_note(snapshot, "rad/s"),
        lambda _: "rad/s",
    ),
    "ζ": _Quantity(
        lambda i, linked: OscillatorBinding("target_model", "zeta", i, linked),
        log_scale(0.05, 5),
        lambda snapshot: oscillator_note(snapshot, "damping ratio"),
        lambda _: "",
    ),
}
