"""A pole that is dragged: the model then has it, and nothing else has moved."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
import viser

from app.dashboard.transport.page_values import PageEvent
from app.dashboard.widgets.fields.controls import Desk
from app.dashboard.widgets.run.whatif import HeldControl
from app.dashboard.widgets.target_model.model_checks import judge_requested
from app.dashboard.widgets.target_model.pole_drag import PoleDrag, draggable, numbered_poles, others_of, pole_edit
from app.scenario.data import edited, load
from app.session.snapshot import Snapshot, snapshot_of
from app.simulation.closed_loop import ClosedLoop
from controllers.second_order import moved, poles_of
from tests.support.desks import Posted


def seen(scenario: str, **matrices: object) -> Snapshot:
    chosen = load(scenario)
    for name, value in matrices.items():
        chosen = edited(chosen, f"target_model.{name}", value)
    return snapshot_of(ClosedLoop.from_scenario(chosen, history=1))


@pytest.mark.parametrize(("omega", "zeta"), [(10.0, 0.2), (3.0, 1.0), (40.0, 2.5)])
def test_an_oscillators_poles_are_the_roots_of_its_polynomial(omega: float, zeta: float) -> None:
    roots = np.sort_complex(np.roots([1.0, 2.0 * zeta * omega, omega**2]))
    assert np.sort_complex(np.array(poles_of(omega, zeta))) == pytest.approx(roots, abs=1e-6)


def test_a_moved_pole_takes_its_conjugate_along_or_leaves_the_other_real_one_where_it_is() -> None:
    assert moved(-3.0 + 4.0j, -3.0 - 4.0j) == pytest.approx((5.0, 0.6))
    omega, zeta = moved(-8.0 + 0.0j, -2.0 + 0.0j)
    assert sorted(pole.real for pole in poles_of(omega, zeta)) == pytest.approx([-8.0, -2.0])
    omega, zeta = moved(-5.0 + 0.0j, -3.0 - 4.0j)  # from a pair onto the real axis: a double pole
    assert (omega, zeta) == pytest.approx((5.0, 1.0))


@pytest.mark.parametrize("scenario", ["ur5-impedance", "ur5-motion", "ur5-hybrid", "planar2r-semicircle"])
@pytest.mark.parametrize("pole", [-6.0 + 8.0j, -9.0 + 0.0j, 5.0 + 1.0j])
def test_the_model_then_has_the_pole_where_it_was_dropped(scenario: str, pole: complex) -> None:
    snapshot = seen(scenario)
    numbers = draggable(snapshot)
    assert numbers
    for number in numbers:
        others = others_of(snapshot, numbered_poles(snapshot)[number])
        edit, _, _ = pole_edit(others, pole)
        asked = judge_requested(snapshot, edit)
        near = np.abs(asked.poles - pole).min()
        if pole.real < 0.0:
            assert near <= 0.02 * abs(pole)  # omega and zeta have three digits
        assert asked.slowest < 0.0  # never right of the imaginary axis, wherever it is dropped
        kept = [i for i in range(len(snapshot.coordinates)) if i not in others]
        for name in ("M_m", "B_m", "K_m", "K_f"):
            diagonal = np.diag(getattr(asked.model, name))
            assert diagonal[kept] == pytest.approx(np.diag(snapshot.matrices[name])[kept])
        assert np.diag(asked.model.M_m) == pytest.approx(np.diag(snapshot.matrices["M_m"]))


def test_a_drag_that_never_ended_spoils_none_of_another_model(viser_server: viser.ViserServer) -> None:
    """The page vanished with the pole held, and another arm with fewer coordinates runs now."""
    runs = seen("ur5-impedance"), seen("planar3r-hybrid")
    number = min(draggable(runs[0]) & draggable(runs[1]))
    shown = [runs[0]]
    held, posted = list[HeldControl](), Posted()
    whatif = SimpleNamespace(on=True, hold=held.append, let_go=lambda _: None, remember=lambda *_: None)

    desk = SimpleNamespace(gui=viser_server.gui, post=posted.post, snapshot=lambda: shown[-1], whatif=whatif)
    drag = PoleDrag(cast(Desk, desk))

    def report(phase: str, page: int) -> None:
        drag._field.value = f"{number} -6 8 {phase}"
        asyncio.run(drag._on_report(cast(PageEvent, SimpleNamespace(client=SimpleNamespace(client_id=page)))))

    report("held", 1)
    shown.append(runs[1])
    report("held", 2)
    report("dropped", 2)
    others = others_of(runs[1], numbered_poles(runs[1])[number])
    assert posted == [pole_edit(others, -6.0 + 8.0j)[0]]
    assert [control.client for control in held] == [1, 2]


def test_poles_of_coupled_or_fixed_coordinates_cannot_be_dragged() -> None:
    coupled = np.diag([2000.0] * 6)
    coupled[0, 1] = coupled[1, 0] = 300.0
    snapshot = seen("ur5-impedance", K_m=coupled.tolist())
    found = {i for number in draggable(snapshot) for i in others_of(snapshot, numbered_poles(snapshot)[number])}
    assert found == {2, 3, 4, 5}
    rigid = seen("ur5-constrained")
    assert 0 not in {i for number in draggable(rigid) for i in others_of(rigid, numbered_poles(rigid)[number])}
