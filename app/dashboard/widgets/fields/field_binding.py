"""Places of the numbers that controls show: a field of the scenario, its row on the page and its slider's scale."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from app.scenario.field_info import FieldInfo, field_info
from app.scenario.number_text import plain
from app.scenario.schema import Scenario
from app.scenario.units import CARTESIAN, Units
from app.session.commands import Edit, EditModel
from app.session.snapshot import Snapshot

FINE_STEP = 0.0002  # share of a slider's length: step with Shift
STEP = 0.002  # step without Shift; `rows.js` makes it of ten FINE_STEP


@dataclass(frozen=True)
class FieldBinding:
    """Binding of a control's value in the scenario: a field by its dotted path."""

    path: str

    def read(self, snapshot: Snapshot) -> Any:
        """The running value, or None when this scenario has no such field."""
        value: Any = snapshot.scenario
        for name in self.path.split("."):
            value = getattr(value, name, None)
        return value

    def edit(self, snapshot: Snapshot, value: Any) -> Edit | EditModel:
        """Command that sets this number. A number that is part of a field takes the rest of it from the
        snapshot; where one number is shown of a field that holds a list, one number can be typed.

        Raises ValueError with a sentence for a value that the field cannot hold.
        """
        running = self.read(snapshot)
        alone = isinstance(running, tuple) and len(running) == 1 and not isinstance(value, list | tuple)
        return Edit(self.path, [value] if alone else value)

    def moved(self, snapshot: Snapshot) -> tuple[FieldBinding, ...]:
        """Bindings of all numbers that an edit of this one sets: itself, and those linked to it."""
        del snapshot
        return (self,)

    def entry(self, snapshot: Snapshot) -> tuple[str, Mapping[str, Any]]:
        """Path by which a sweep varies this number (see `app.scenario.data.with_value`), and values by path that the
        scenario must get before. Raises ValueError with a sentence where this is no single number."""
        del snapshot
        return self.path, {}

    @property
    def info(self) -> FieldInfo | None:
        """Meaning, unit and bounds in the scenario's schema; None for a field that it does not describe."""
        try:
            return field_info(self.path)
        except KeyError:
            return None

    @property
    def hint(self) -> str:
        """Meaning, unit and bounds in words, for an arm of revolute joints in a Cartesian task space."""
        return self.hint_in(CARTESIAN)

    def hint_in(self, units: Units) -> str:
        """Meaning, unit and bounds in words, in a task space with these units."""
        info = self.info
        if info is None:
            return self.path
        unit = info.unit_in(units)
        low, high = (None if bound is None else plain(bound) for bound in (info.least, info.largest))
        if low is None and high is None:
            return f"{info.doc} [{unit}]" if unit else info.doc
        if low and high and info.least_allowed and info.largest_allowed:
            bounds = f"from {low} to {high}"
        else:
            least = f"{'at least' if info.least_allowed else 'above'} {low}" if low else ""
            most = f"{'at most' if info.largest_allowed else 'below'} {high}" if high else ""
            bounds = ", ".join(filter(None, (least, most)))
        return f"{info.doc}; allowed: {bounds} {unit}".rstrip()

    def label_in(self, units: Units, label: str) -> str:
        """Label of its control, with the unit in brackets in a task space with these units. label: with that of an arm
        of revolute joints, where r is in metres."""
        words, bracket, unit = label.removesuffix("]").rpartition(" [")
        if not bracket or self.info is None:
            return label
        beside = units.of_kind(self.info.of, unit).replace(" and ", ", ")  # there is little room
        return f"{words} [{beside}]"


@dataclass(frozen=True)
class BindingWhere(FieldBinding):
    """Binding of a field that has a meaning only in the scenarios for which `applies` returns True; in others its
    control is hidden."""

    applies: Callable[[Scenario], bool]

    def read(self, snapshot: Snapshot) -> Any:
        return super().read(snapshot) if self.applies(snapshot.scenario) else None


@dataclass(frozen=True)
class SliderScale:
    """Scale of a slider.
    low, high: values at its ends.
    logarithmic: equal ways along the slider are equal factors of the value.
    zero: the left end means exactly 0."""

    low: float
    high: float
    logarithmic: bool = False
    zero: bool = False

    def value(self, position: float) -> float:
        """Value at a position, 0 to 1, of the slider: of three digits at multiples of STEP, of four between them."""
        if self.zero and position <= 0:
            return 0.0
        value = self.low + position * (self.high - self.low)
        if self.logarithmic:
            value = self.low * (self.high / self.low) ** position
        whole = abs(position - STEP * round(position / STEP)) < 0.1 * FINE_STEP
        return float(f"{value:.3g}" if whole else f"{value:.4g}")

    def position(self, value: float) -> float:
        if not self.logarithmic:
            fraction = (value - self.low) / (self.high - self.low)
        elif value <= 0:
            fraction = 0.0
        else:
            fraction = math.log(value / self.low) / math.log(self.high / self.low)
        return min(max(fraction, 0.0), 1.0)


def log_scale(low: float, high: float, *, zero: bool = False) -> SliderScale:
    """A logarithmic scale; `zero`: its left end means exactly 0."""
    return SliderScale(low, high, logarithmic=True, zero=zero)


class NumberRow(NamedTuple):
    """Row of a number on the page: its binding, its label, and the scale of its slider, None without a slider."""

    binding: FieldBinding
    label: str
    scale: SliderScale | None
