"""Sections of a scenario, whose fields have their bounds, unit, meaning and control beside them, and the parameters of
a user's own laws, surfaces and trajectories."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Annotated, Any, Literal

from msgspec import Meta, Struct

ONE_LINE = r"^[^\x00-\x1f\x7f-\x9f\u2028\u2029\ufffe\uffff]*\Z"  # others do not fit into an SVG, or steer a terminal
Name = Annotated[str, Meta(max_length=200, pattern=ONE_LINE)]  # shown on the page
Text = Annotated[str, Meta(max_length=1000, pattern=ONE_LINE)]  # a path; a formula has at most 500 characters
Vector = Annotated[tuple[float, ...], Meta(max_length=32)]  # an arm has at most eight joints
Vector3 = tuple[float, float, float]
Matrix = Annotated[tuple[float | Vector, ...], Meta(max_length=32)]
UnitsOf = Literal["", "joints", "r", "J_q"]  # on whose units that of a quantity depends


class Section(Struct, frozen=True, forbid_unknown_fields=True):
    """A table of the TOML file."""


@dataclass(frozen=True)
class Widget:
    """Display of a field on the page: its label; a slider from low to high where there is one, logarithmic where
    decades matter.
    zero: the left end of a logarithmic slider means exactly 0.
    options: the text shown for each allowed value."""

    label: str
    low: float | None = None
    high: float | None = None
    logarithmic: bool = False
    zero: bool = False
    options: tuple[tuple[str, object], ...] = ()


def slider(label: str, low: float, high: float) -> Widget:
    """A linear slider."""
    return Widget(label, low, high)


def decades(label: str, low: float, high: float, *, zero: bool = False) -> Widget:
    """A logarithmic slider; `zero`: its left end means exactly 0."""
    return Widget(label, low, high, logarithmic=True, zero=zero)


def field(
    meaning: str,
    unit: str,
    widget: Widget | None = None,
    *,
    title: str = "",
    of: UnitsOf = "",
    **bounds: Any,
) -> Meta:
    """Metadata of a field: meaning, unit ("1" for a pure number, "" for none), its widget on the page, its title in
    sentences, on axes and in menus where the meaning begins with other words, and its bounds (ge, gt, le, lt).
    of: on whose units its own depends, "" for the world's; `unit` is for revolute joints and where r is in metres."""
    return Meta(description=meaning, extra={"unit": unit, "widget": widget, "title": title, "of": of}, **bounds)


@dataclass(frozen=True)
class Parameter:
    """Parameter (a number) of a law, surface or trajectory of a user's own: its name, value unless the scenario has
    another, bounds, unit, meaning."""

    name: str
    value: float
    low: float
    high: float
    unit: str
    meaning: str


def allowed(given: str, names: Iterable[str], most: int | None = None) -> str:
    """End of a refusal: the names that are allowed, and which of them was probably meant. most: of them to list, None
    for all."""
    names = list(names)
    by_lower = {name.lower(): name for name in reversed(names)}
    close = [by_lower[name] for name in get_close_matches(given.lower(), by_lower, n=1)]
    listed = names if most is None or len(names) <= most else [*names[:most], "…"]
    return f"allowed: {', '.join(listed) or 'none'}" + "".join(f"; did you mean {name}?" for name in close)


def values_of(parameters: Iterable[Parameter], given: Mapping[str, float], place: str) -> dict[str, float]:
    """Values of all parameters by name: those that a scenario gives at this place, else their own. Raises ValueError
    with one sentence."""
    by_name = {parameter.name: parameter for parameter in parameters}
    for name, value in given.items():
        parameter = by_name.get(name)
        if parameter is None:
            raise ValueError(f"{place}.{name:.60}: no such parameter; {allowed(name, by_name)}")
        if not parameter.low <= value <= parameter.high:
            range_text = (
                f"{value:g} {parameter.unit}; allowed: {parameter.low:g} to {parameter.high:g} {parameter.unit}"
            )
            raise ValueError(f"{place}.{name}: {range_text}".rstrip())
    return {name: given.get(name, parameter.value) for name, parameter in by_name.items()}
