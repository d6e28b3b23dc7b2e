"""Axes of a sweep: fields of a scenario that are varied, and the values that they take."""

from __future__ import annotations

import math
import tomllib
from collections import Counter

import msgspec
import numpy as np
from msgspec import Struct

from app.scenario.data import with_value
from app.scenario.errors import ScenarioError, WrongKind
from app.scenario.number_text import counted
from app.scenario.schema import Scenario

MOST_VALUES = 100_000  # of one axis
EVEN = 1e-4  # share by which the steps of a logarithm may differ: the page rounds the values
SHAPE = "allowed: PATH=LOW:HIGH:COUNT, with :log behind for even steps of the logarithm, or PATH=VALUE,VALUE,..."
LARGEST_INTEGER = 2**53  # up to it, a float holds every integer
Value = float | int | str | bool


class Axis(Struct, frozen=True, omit_defaults=True, forbid_unknown_fields=True):
    """Field that is varied.

    path: dotted, as with `--set`; a number at its end is an entry of a list, from 1.
    values: that it takes; empty for a range.
    low, high: of the range; logarithmic: whether it is drawn evenly in its logarithm.
    whole: whether a value of the range is a whole number.
    """

    path: str
    values: tuple[Value, ...] = ()
    low: float = 0.0
    high: float = 0.0
    logarithmic: bool = False
    whole: bool = False

    def at(self, fraction: float) -> Value:
        """Value at a share, 0 to 1, of the axis."""
        if self.values:
            return self.values[min(int(fraction * len(self.values)), len(self.values) - 1)]
        low, high = (self.low - 0.5, self.high + 0.5) if self.whole else (self.low, self.high)
        if self.logarithmic:
            value = math.exp(math.log(low) + fraction * (math.log(high) - math.log(low)))
        else:
            value = low + fraction * (high - low)
        return min(max(round(value), round(self.low)), round(self.high)) if self.whole else float(value)

    def __str__(self) -> str:
        if self.values:
            return f"{self.path}={','.join(map(_formatted, self.values))}"
        return f"{self.path}={self.low:g}:{self.high:g}" + (":log" if self.logarithmic else "")

    @property
    def numeric(self) -> bool:
        """Whether all its values are numbers."""
        return all(isinstance(value, int | float) and not isinstance(value, bool) for value in self.values)

    @property
    def on_log_scale(self) -> bool:
        """Whether charts show its values on a logarithmic scale: they are even steps of the logarithm, or a range that
        is drawn evenly in it."""
        if self.logarithmic or not self.numeric:
            return self.logarithmic
        values = np.sort(np.array(self.values, dtype=float))
        if len(values) < 3 or values[0] <= 0.0:
            return False
        steps = np.diff(np.log(values))
        return float(np.ptp(steps)) < EVEN * float(steps.mean())


def require_axis(axis: Axis, at: str = "vary:") -> None:
    """Raise ScenarioError unless an axis has different finite values, or a range of them. at: where it was given."""
    for value in axis.values or (axis.low, axis.high):
        if isinstance(value, float) and not math.isfinite(value):
            raise ScenarioError(f"{at} {axis.path}: {value}; allowed: finite numbers")
        if isinstance(value, int) and abs(value) > LARGEST_INTEGER:
            raise ScenarioError(f"{at} {axis.path}: {value}; allowed: at most {LARGEST_INTEGER}")
    for value, times in Counter(axis.values).most_common(1):
        if times > 1:
            raise ScenarioError(f"{at} {axis.path}: {value} twice; allowed: different values")
    if not axis.values and not axis.low < axis.high:
        raise ScenarioError(f"{at} {axis.path}: {axis.low:g} to {axis.high:g}; allowed: low before high")
    if axis.logarithmic and axis.low <= 0.0:
        raise ScenarioError(f"{at} {axis.path}: logarithmic from {axis.low:g}; allowed: from above 0")


def axis_of(text: str, flag: str = "--vary", shape: str = SHAPE) -> Axis:
    """Axis of a text: PATH=LOW:HIGH:COUNT, PATH=LOW:HIGH:COUNT:log, PATH=LOW:HIGH or PATH=LOW:HIGH:log for a range, or
    PATH=VALUE,VALUE,.... Raises ScenarioError.
    flag: behind which the text was typed. shape: what the flag allows."""
    path, equals, spec = text.partition("=")
    path, spec = path.strip(), spec.strip()
    if not equals or not path or not spec:
        raise ScenarioError(f"{flag} {text!r:.100}; {shape}")
    parts = spec.split(":")
    if len(parts) == 1:
        return Axis(path, tuple(_value(each.strip(), flag) for each in spec.split(",")))
    logarithmic = parts[-1] == "log"
    numbers = parts[:-1] if logarithmic else parts
    try:
        low, high, *rest = (float(number) for number in numbers)
        count = int(rest[0]) if rest else None
    except (ValueError, OverflowError) as error:
        raise ScenarioError(f"{flag} {text!r:.100}; {shape}") from error
    if len(rest) > 1 or (rest and rest[0] != count):
        raise ScenarioError(f"{flag} {text!r:.100}; {shape}")
    whole = Axis(path, (), low, high, logarithmic)
    require_axis(whole, flag)
    if count is None:
        return whole
    if not 2 <= count <= MOST_VALUES:
        raise ScenarioError(f"{flag} {path}: {counted(count, 'value')}; allowed: 2 to {MOST_VALUES}")
    spaced = np.geomspace(low, high, count) if logarithmic else np.linspace(low, high, count)
    return Axis(path, tuple(float(f"{value:.12g}") for value in spaced))


def require_uncounted(text: str, design: str) -> None:
    """Raise ScenarioError for a text PATH=LOW:HIGH:COUNT in a design that is no grid and chooses its points itself."""
    path, _, spec = (part.strip() for part in text.partition("="))
    low, *ends = spec.split(":")
    if design != "grid" and ends and axis_of(text).values:
        steps = ":log" if ends[-1] == "log" else ""
        raise ScenarioError(
            f"--vary {path}: {spec} with --design {design}, whose number of points is --points; allowed: "
            f"{path}={low}:{ends[0]}{steps}, without a number of values"
        )


def fitted(axis: Axis, scenario: Scenario) -> Axis:
    """The axis with whole numbers where its field in the scenario takes no others. Raises ScenarioError."""
    try:
        with_value(scenario, axis.path, 0.5)
        return axis
    except WrongKind:
        pass
    except ScenarioError:
        return axis
    values = [float(value) for value in axis.values] if axis.numeric else []
    if len(values) < len(axis.values) or not all(map(math.isfinite, (*values, axis.low, axis.high))):
        return axis
    try:
        with_value(scenario, axis.path, round(values[0] if values else axis.low))
    except WrongKind:
        return axis  # no field for numbers at all
    except ScenarioError:
        pass
    if uneven := [value for value in values or (axis.low, axis.high) if value != round(value)]:
        raise ScenarioError(f"vary: {axis.path}: {uneven[0]:g}; allowed: whole numbers")
    if values:
        return msgspec.structs.replace(axis, values=tuple(map(round, values)))
    return msgspec.structs.replace(axis, whole=True)


def _formatted(value: Value) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _value(text: str, flag: str) -> Value:
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        return text
    if not isinstance(value, int | float | str | bool):
        raise ScenarioError(f"{flag}: {text!r:.60}; allowed: numbers and words")
    return value
