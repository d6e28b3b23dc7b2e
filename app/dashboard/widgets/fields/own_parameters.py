"""Controls of the own parameters of a user's law, surface or trajectory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from app.dashboard.widgets.fields.controls import Desk, NumberField, labelled
from app.dashboard.widgets.fields.field_binding import FieldBinding, SliderScale, log_scale
from app.scenario.field_info import FieldInfo
from app.session.snapshot import Snapshot
from parameters import Parameter, UnitsOf

WIDE = 100.0  # ratio of its bounds from which on a slider is logarithmic


@dataclass(frozen=True)
class OwnBinding(FieldBinding):
    """Binding of an own parameter in the scenario.
    running: returns its present value, None where the law, surface or trajectory is not in use.
    of: on whose units its own depends."""

    parameter: Parameter
    running: Callable[[Snapshot], float | None]
    of: UnitsOf = ""

    def read(self, snapshot: Snapshot) -> float | None:
        return self.running(snapshot)

    @property
    def info(self) -> FieldInfo:
        p = self.parameter
        return FieldInfo(p.meaning, p.unit, p.low, p.high, choices=(), of=self.of)


def own_number(
    desk: Desk, path: str, p: Parameter, running: Callable[[Snapshot], float | None], of: UnitsOf = ""
) -> NumberField:
    """Control of an own parameter. path: of its place in the scenario, dotted. running, of: see `OwnBinding`."""
    scale = log_scale(p.low, p.high) if p.low > 0.0 and p.high >= WIDE * p.low else SliderScale(p.low, p.high)
    return NumberField(desk, OwnBinding(path, p, running, of), labelled(p.name, p.unit), scale)
