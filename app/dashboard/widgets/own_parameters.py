"""Numbers that a law, surface or trajectory of the user's own has."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from app.dashboard.widgets.controls import Desk, Number, Place, Scale, decades, labelled
from app.scenario.schema import FieldInfo
from app.session.snapshot import Snapshot
from parameters import Parameter

WIDE = 100.0  # from the ratio of its bounds on a slider is logarithmic


@dataclass(frozen=True)
class OwnPlace(Place):
    """Such a number in the scenario; running: what it is now, None where what it belongs to is not in use."""

    parameter: Parameter
    running: Callable[[Snapshot], float | None]

    def read(self, snapshot: Snapshot) -> float | None:
        return self.running(snapshot)

    @property
    def info(self) -> FieldInfo:
        p = self.parameter
        return FieldInfo(p.meaning, p.unit, p.low, p.high, choices=())


def own_number(desk: Desk, path: str, p: Parameter, running: Callable[[Snapshot], float | None]) -> Number:
    """The control of such a number, at a dotted path of the scenario."""
    scale = decades(p.low, p.high) if p.low > 0.0 and p.high >= WIDE * p.low else Scale(p.low, p.high)
    return Number(desk, OwnPlace(path, p, running), labelled(p.name, p.unit), scale)
