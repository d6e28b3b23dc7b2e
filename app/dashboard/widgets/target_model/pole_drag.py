"""Dragging of a pole on the pole map: changes omega and zeta of the coordinates that have the pole; previewed while the
pole is held.

The page's script (static/page/poles.js) writes into a hidden text field: number of the pole, real and imaginary part
(1/s), and whether the mouse still holds it.
"""

from __future__ import annotations

import numpy as np

from app.dashboard.transport.page_values import PageEvent, from_pages
from app.dashboard.widgets.fields.controls import Desk
from app.dashboard.widgets.fields.matrix_text import written
from app.dashboard.widgets.fields.model_fields import oscillators_of
from app.dashboard.widgets.run.whatif import HeldControl
from app.dashboard.widgets.target_model.equation import is_fixed
from app.dashboard.widgets.target_model.pole_map import grouped
from app.session.commands import EditModel
from app.session.model_entries import pressed_on
from app.session.snapshot import Snapshot
from app.simulation.builders.controller_builder import stiffness_met
from controllers.second_order import moved, poles_of
from controllers.target_model import TargetModel

SAME = 1e-2  # relative distance below which a coordinate's pole counts as the dragged one
REAL = 0.12  # share of a pole's size: imaginary parts below it count as zero, so that a pole can be dragged to real
LEAST_ZETA, SLOWEST, FASTEST = 0.02, 0.1, 2000.0  # 1; 1/s


def draggable(snapshot: Snapshot) -> frozenset[int]:
    """Numbers, in the pole map, of the poles that belong to coordinates that swing alone."""
    poles = numbered_poles(snapshot)
    return frozenset(number for number in range(len(poles)) if others_of(snapshot, poles[number]))


def pole_edit(others: dict[int, complex], pole: complex) -> tuple[EditModel, float, float]:
    """Command that moves a pole of some coordinates, and omega (rad/s) and zeta of the first of them afterwards.
    others: their other poles, see `others_of`. pole: to which it is moved, 1/s."""
    wanted = {i: moved(_admitted(pole), other) for i, other in others.items()}
    omega, zeta = ({i: float(f"{pair[k]:.3g}") for i, pair in wanted.items()} for k in (0, 1))
    first = next(iter(wanted))
    return EditModel({"omega": omega, "zeta": zeta}), omega[first], zeta[first]


class PoleDrag:
    """Receiver of the reports by the page's script on a dragged pole; its text field is in the current container."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        desk.gui.add_html('<i class="vs-pole-field"></i>')
        self._field = desk.gui.add_text("", "")
        self._field.on_update(from_pages(self._on_report))
        self._held: HeldControl | None = None  # the dragged pole, as long as its preview goes on

    async def _on_report(self, event: PageEvent) -> None:
        words = self._field.value.split()
        try:
            number, pole, phase = int(words[0]), complex(float(words[1]), abs(float(words[2]))), words[3]
        except (IndexError, ValueError):
            return  # not written by the page's script
        snapshot = self._desk.snapshot()
        poles = numbered_poles(snapshot)  # those of the running model, which a pole that is held does not change
        others = others_of(snapshot, poles[number]) if 0 <= number < len(poles) else {}
        if not np.isfinite(pole) or not others or phase == "left":
            self._held = None
            self._desk.whatif.let_go(self)
            return
        edit, omega, zeta = pole_edit(others, pole)
        if phase == "held" and self._desk.whatif.on:
            value = f"ω = {written(omega)} rad/s, ζ = {written(zeta)}"
            client = event.client.client_id
            self._held = held = HeldControl(edit, "pole", value, self, client, snapshot.run, dropped=self._forget)
            self._desk.whatif.hold(held)
        elif phase == "dropped":
            applies = not self._desk.whatif.on or (self._held is not None and self._held.run == snapshot.run)
            if applies and self._desk.post(edit) is not None:
                self._desk.whatif.remember(snapshot, edit)
            self._held = None
            self._desk.whatif.let_go(self)

    def _forget(self, held: HeldControl) -> None:
        """Forget the dragged pole, whose preview has ended."""
        if self._held is held:
            self._held = None


def numbered_poles(snapshot: Snapshot) -> list[complex]:
    """Poles (1/s) of the running model as the pole map numbers them."""
    model = TargetModel(**snapshot.matrices)
    found = snapshot.system.mode.poles(model, stiffness_met(snapshot.scenario))
    return [pole.value for pole in grouped(found)]


def others_of(snapshot: Snapshot, pole: complex) -> dict[int, complex]:
    """Other pole (1/s) of each coordinate, by number, that has a pole (1/s), is free and is not coupled with others."""
    oscillators, pressed = oscillators_of(snapshot), pressed_on(snapshot.scenario, len(snapshot.coordinates))
    found = {}
    for i, (omega, zeta) in enumerate(zip(oscillators.omega, oscillators.zeta, strict=True)):
        fixed = is_fixed(snapshot, "K_f" if pressed[i] > 0.0 else "K_m", i) or is_fixed(snapshot, "B_m", i)
        if not np.isfinite(omega) or fixed or _coupled(snapshot, i):
            continue
        pair = poles_of(float(omega), float(zeta))
        for own, other in (pair, pair[::-1]):
            if abs(complex(own.real, abs(own.imag)) - pole) <= SAME * abs(pole):
                found[i] = other
                break
    return found


def _coupled(snapshot: Snapshot, i: int) -> bool:
    return any(
        np.count_nonzero(np.delete(matrix[i], i)) or np.count_nonzero(np.delete(matrix[:, i], i))
        for matrix in snapshot.matrices.values()
    )


def _admitted(pole: complex) -> complex:
    """Pole (1/s) to which a dragged one is moved: left of the imaginary axis, not too slow or fast, and real where its
    imaginary part is small."""
    size = min(max(abs(pole), SLOWEST), FASTEST)
    turned = pole * size / abs(pole) if pole else complex(-size, 0.0)
    real = min(turned.real, -LEAST_ZETA * size)
    if abs(turned.imag) < REAL * size:
        return complex(-size, 0.0)
    return complex(real, float(np.sqrt(max(size**2 - real**2, 0.0))))
