"""Fields that a robustness map or a search for gains varies, each with its range, and the widgets that choose them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from app.dashboard.transport.page_values import PageEvent, from_pages
from app.dashboard.widgets.fields.controls import Desk
from app.dashboard.widgets.fields.field_binding import FieldBinding, NumberRow
from app.scenario.data import found_at, with_value, with_values
from app.scenario.errors import ScenarioError
from app.scenario.idle_fields import idle
from app.scenario.schema import Scenario
from app.scenario.units import CARTESIAN, Units
from app.session.snapshot import Snapshot
from app.sweep.axes import Axis, fitted
from app.sweep.plan import Sweep, arms_differ, stated_bound
from app.sweep.titles import title_of, unit_of

NONE = "—"
DECADE = 10.0  # factor by which the initial range of a logarithmic slider reaches to both sides of the present value


@dataclass(frozen=True)
class Field:
    """Field that may be varied.
    name: on the page.
    path: dotted.
    low, high: initial range.
    logarithmic: whether its values are even steps of the logarithm.
    binding: of the control from which the field was chosen, None for a field that is always offered."""

    name: str
    path: str
    low: float
    high: float
    logarithmic: bool = False
    binding: FieldBinding | None = None

    def needs(self, snapshot: Snapshot) -> Mapping[str, Any]:
        """Values, by path, that the scenario must get before this field can be set: a matrix that it leaves to the
        mode."""
        return {} if self.binding is None else self.binding.entry(snapshot)[1]

    def value(self, snapshot: Snapshot) -> float | None:
        """Present value, None where the scenario has no such number."""
        found: Any = found_at(snapshot.scenario, self.path) if self.binding is None else self.binding.read(snapshot)
        return float(found) if isinstance(found, int | float) else None

    def require_there(self, scenario: Scenario) -> None:
        """Raise ScenarioError where the scenario has no such number, or no run depends on it."""
        if (field := idle(scenario, self.path)) is not None:
            raise ScenarioError(
                f"{self.name}: it has no effect while {title_of(field.choice)} is {field.value}; allowed: another field"
            )
        value: Any = scenario
        for part in self.path.split("."):
            if isinstance(value, dict):  # a scenario may leave out parameters of the user's own code
                return
            if part.isdecimal():
                break
            value = getattr(value, part, None)
        if value is None:
            raise ScenarioError(f"{self.name}: this scenario has none; allowed: another field")


FIELDS = tuple(
    Field(title_of(path), path, low, high, logarithmic)
    for path, low, high, logarithmic in (
        ("contact.K_e", 1e3, 1e5, True),
        ("truth.link_scaling", 0.7, 1.4, False),
        ("truth.payload_mass", 0.0, 2.0, False),
        ("truth.coulomb", 0.0, 4.0, False),
        ("contact.friction_coulomb", 0.0, 0.6, False),
        ("controller.K_e_hat", 1e3, 1e5, True),
        ("controller.layer", 1e-3, 0.05, True),
        ("controller.period", 5e-4, 5e-3, True),
        ("controller.K_s", 20.0, 400.0, True),
        ("controller.F_1", 3.0, 40.0, True),
        ("sensor.noise", 0.0, 1.0, False),
        ("sensor.delay", 0.0, 0.02, False),
        ("force.value", 5.0, 60.0, False),
        ("motion.period", 1.0, 8.0, False),
    )
)
GAINS = tuple(each for each in FIELDS if each.path.startswith("controller.") and each.path != "controller.period")


def field_of_row(row: NumberRow, snapshot: Snapshot) -> Field:
    """Field of a control's row, around its present value. Raises ScenarioError where it is no single number."""
    value, scale = row.binding.read(snapshot), row.scale
    if scale is None or not isinstance(value, int | float):
        raise ScenarioError(f"{row.label}: it has no slider now; allowed: a field with one")
    try:
        path, _ = row.binding.entry(snapshot)
    except ValueError as error:
        raise ScenarioError(f"{row.label}: {error}") from error
    low, high = scale.low, scale.high
    if scale.logarithmic and value > 0.0:
        low, high = max(low, float(f"{value / DECADE:.1g}")), min(high, float(f"{value * DECADE:.1g}"))
        if not low < high:  # the present value was typed, and is beyond the slider's ends
            low, high = scale.low, scale.high
    return Field(title_of(path), path, low, high, scale.logarithmic, row.binding)


class FieldChoice:
    """Menu of fields, with the range of the chosen one. State of the page.

    first: name of the field that is chosen at first, or `NONE`.
    """

    def __init__(self, desk: Desk, label: str, fields: tuple[Field, ...], first: str, *, optional: bool) -> None:
        self._fields = {each.name: each for each in fields}
        self._label, self._of, self._first, self._optional = label, first, first, optional
        self._field = desk.gui.add_dropdown(label, self._names, initial_value=first)
        self._range = desk.gui.add_text(
            label, self._range_of(first), hint="From, to: two numbers, in the unit beside it."
        )
        self._field.on_update(from_pages(self._on_field))
        self._units = CARTESIAN
        self._show()

    @property
    def _names(self) -> tuple[str, ...]:
        return (*((NONE,) if self._optional else ()), *self._fields)

    def _range_of(self, name: str) -> str:
        return "" if name == NONE else f"{self._fields[name].low:g}, {self._fields[name].high:g}"

    @property
    def field(self) -> Field | None:
        """The chosen field, None for none."""
        return self._fields.get(self._field.value)

    def avoid(self, scenario: Scenario, taken: Field | None) -> None:
        """Choose another field in place of the initial one, if no run of this scenario depends on that, and not the one
        that is taken."""
        if self.field is not None and self._of == self._first and idle(scenario, self.field.path):
            others = [each for each in self._fields.values() if each != taken and not idle(scenario, each.path)]
            self.choose(others[0])

    def choose(self, field: Field) -> None:
        """Choose a field with its range; the menu offers it from now on."""
        self._fields[field.name] = field
        if self._field.options != self._names:
            self._field.options = self._names
        self._of = self._field.value = field.name
        self._range.value = self._range_of(field.name)
        self._show()

    def leave(self) -> None:
        """Choose no field."""
        self._of = self._field.value = NONE
        self._show()

    async def _on_field(self, _: PageEvent) -> None:
        if self._field.value != self._of:
            self._of = self._field.value
            self._range.value = self._range_of(self._of)
            self._show()

    def show(self, units: Units) -> None:
        """Show the range where a field is chosen, with its unit in a task space with these units."""
        if units != self._units:
            self._units = units
            self._show()

    def _show(self) -> None:
        unit = unit_of(self.field.path, self._units) if self.field else ""
        self._range.label = f"{self._label} from, to [{unit}]" if unit else f"{self._label} from, to"
        if self._range.visible != (self.field is not None):
            self._range.visible = self.field is not None

    def show_whole(self, *, visible: bool) -> None:
        """Show or hide both widgets."""
        if self._field.visible != visible:
            self._field.visible = visible

    @property
    def _typed(self) -> str:
        return self._range.value.strip()

    def range(self, scenario: Scenario) -> Axis:
        """Axis over the range that the user has typed, without values. Raises ScenarioError."""
        field = self.field
        assert field is not None
        field.require_there(scenario)
        parts = self._typed.split(",")
        if len(parts) != 2:
            raise ScenarioError(f"{field.name}: {self._typed!r:.60}; allowed: two numbers with a comma between")
        low, high = (number_of(field.name, part) for part in parts)
        if not low < high:
            raise ScenarioError(f"{field.name}: {low:g} to {high:g}; allowed: low before high")
        axis = Axis(field.path, (), low, high, field.logarithmic and low > 0.0)
        try:
            return fitted(axis, scenario)
        except ScenarioError as error:
            raise ScenarioError(f"{field.name}: {low:g} to {high:g}; allowed: whole numbers") from error

    def axis(self, scenario: Scenario, count: int) -> Axis:
        """Axis over the range that the user has typed. count: of its values. Raises ScenarioError."""
        span = self.range(scenario)
        spaced = np.geomspace if span.logarithmic else np.linspace
        values = [float(f"{value:.6g}") for value in spaced(span.low, span.high, count)]
        if len(set(values)) < count:
            raise ScenarioError(f"{self._field.value}: {self._typed!r:.60}; allowed: ends further apart")
        return Axis(span.path, tuple(dict.fromkeys(map(round, values)) if span.whole else values))


def prepared(snapshot: Snapshot, fields: list[Field]) -> Scenario:
    """The running scenario with the values that it must have before these fields can be set, see `Field.needs`. Raises
    ScenarioError."""
    needed: dict[str, Any] = {}
    for field in fields:
        needed |= field.needs(snapshot)
    return with_values(snapshot.scenario, needed)


def require_arms(sweep: Sweep, asked: str, instead: str) -> None:
    """Raise ScenarioError, in the page's words, where true arms cannot be drawn from the declared set, or are alike.
    asked: label and value of the control that asks for them.
    instead: value of the control that needs no declared set."""
    if sweep.drawn and (stated := stated_bound(sweep)):
        own = f", or {instead}" if sweep.arms == sweep.draw else ""  # not in a search, which always draws some
        raise ScenarioError(
            f"{asked}: {title_of(stated)} is stated, and only its run shows whether a true arm is within it; allowed: "
            f"in its place bounds of links, payload and friction on the tab Robot{own}"
        )
    if sweep.drawn > 1 and not arms_differ(sweep):
        raise ScenarioError(
            f"{asked}: they are all alike, since no quantity that is drawn is declared; allowed: a bound above 0 on "
            f"the tab Robot, such as that of the links, or {instead}"
        )


def require_ends(scenario: Scenario, name: str, axis: Axis) -> None:
    """Raise ScenarioError where the field of an axis, which the page calls `name`, does not allow an end of it."""
    for end in (0.0, 1.0):
        try:
            with_value(scenario, axis.path, axis.at(end))
        except ScenarioError as error:
            raise ScenarioError(f"{name}: {str(error).removeprefix(f'{axis.path}: ')}") from error


def number_of(name: str, text: str) -> float:
    """Number of a text. name: of the text field, for the error's sentence. Raises ScenarioError."""
    text = text.strip()
    try:
        value = float(text.replace("−", "-"))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ScenarioError(f"{name}: {text!r:.40}; allowed: a number")
    return value
