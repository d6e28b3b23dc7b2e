"""Scenarios as plain data and as TOML: read, written, edited by dotted path. Each error is one sentence."""

from __future__ import annotations

import datetime
import os
import re
import tomllib
from functools import cache
from importlib import resources
from itertools import takewhile
from pathlib import Path
from typing import Any

import msgspec
import tomli_w
from msgspec import Struct

from app.scenario.errors import ScenarioError, UnknownChoice, UnknownField, WrongKind
from app.scenario.schema import Scenario
from app.scenario.struct_refusals import struct_refusal
from parameters import allowed

LARGEST = 100_000  # bytes of a TOML file; the shipped ones have 2000, and readers of TOML are slow
MOST_DOTS = 300  # in a line: a key a.b.c... of 50,000 parts keeps tomllib busy for minutes
OWN = "own"  # kind of a section from a file of the user's own: "own:spiral" is the one named "spiral" there
# Sections whose fields such a file names.
OWN_PARAMETERS = (
    "controller.own.",
    "surface.parameters.",
    "second.surface.parameters.",
    "third.surface.parameters.",
    "motion.parameters.",
)
DEEPEST = 16  # tables and lists within each other: a scenario has four
MOST_DIGITS = 9  # of the number of an entry; Python refuses to read thousands
OPENING = "ur5-heavy"  # what `vsmrc serve` shows first


def from_plain(data: object) -> Scenario:
    """Scenario from nested dicts. Raises ScenarioError with the path of the first field that is wrong."""
    _refuse_unfit(data, "", 0)
    try:
        return msgspec.convert(data, Scenario)
    except msgspec.ValidationError as error:
        raise _kind_of_refusal(str(error))(_sentence(error, data)) from error


def to_plain(scenario: Scenario) -> dict[str, Any]:
    """Nested dicts of plain values, without the fields that are not set."""
    return _without_none(msgspec.to_builtins(scenario))


def from_toml(text: str) -> Scenario:
    """Scenario from TOML. Raises ScenarioError for text that is no TOML or no scenario, or sets no field of one."""
    if len(text) > LARGEST:
        raise ScenarioError(f"a TOML file of {len(text)} characters; allowed: at most {LARGEST}")
    require_few_dots(text)
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(f"not a TOML file: {error}") from error
    except RecursionError as error:
        raise ScenarioError(f"not a scenario: nested without end; allowed: at most {DEEPEST} deep") from error
    except ValueError as error:  # Python reads no more digits than these
        raise ScenarioError("not a scenario: a whole number of thousands of digits; allowed: at most 19") from error
    scenario = from_plain(data)
    if not _fields(data, ""):
        raise ScenarioError("an empty scenario; allowed: a text that sets at least one field")
    return scenario


def require_few_dots(text: str) -> None:
    """Raise ScenarioError for a line with so many dots that Python would read its TOML for hours."""
    for number, line in enumerate(text.split("\n"), start=1):
        if line.count(".") > MOST_DOTS:
            raise ScenarioError(f"line {number} has {line.count('.')} dots; allowed: at most {MOST_DOTS}")


def from_file(content: bytes) -> Scenario:
    """Scenario from a TOML file's content, as it was uploaded or read. Raises ScenarioError."""
    if len(content) > LARGEST:
        raise ScenarioError(f"a file of {len(content) / 1e6:.3g} MB or more; allowed: at most {LARGEST / 1e6:g} MB")
    try:
        text = text_of(content)
    except ValueError as error:
        raise ScenarioError(f"not a TOML file: {error}") from error
    return from_toml(text)


def text_of(content: bytes) -> str:
    """Text of a file's content, whose lines end with a line feed alone. Raises ValueError, with a sentence, for content
    that is not in UTF-8."""
    try:
        return content.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        raise ValueError("it is no UTF-8 text; allowed: a text in UTF-8") from error


def to_toml(scenario: Scenario) -> str:
    """TOML of the whole scenario, with every field."""
    return tomli_w.dumps(to_plain(scenario))


def edited(scenario: Scenario, path: str, value: object) -> Scenario:
    """Copy of the scenario with the field at a dotted path replaced by plain data, e.g. ("controller.layer", 0.02).

    Raises ScenarioError.
    """
    data = msgspec.to_builtins(scenario)
    _replace(data, path, value)
    return from_plain(_without_none(data))


def with_values(scenario: Scenario, values: dict[str, Any]) -> Scenario:
    """Copy of the scenario with other values of fields by dotted path, see `with_value`. Raises ScenarioError."""
    data = msgspec.to_builtins(scenario)
    for path, value in values.items():
        names = _names_of_field(path) or [path]
        held: Any = data
        for name in names:
            held = held.get(name) if isinstance(held, dict) else None
        if path == ".".join(names):
            _require_no_section(path, held, value)
        _replace(data, ".".join(names), _with_entry(held, path.split(".")[len(names) :], value, path))
    return from_plain(_without_none(data))


def _require_no_section(path: str, held: Any, value: object) -> None:
    """Raise WrongKind for a number or a list at the path of a section, of which only a field can have one. held: what
    stands there now."""
    section = isinstance(held, dict) and not f"{path}.".startswith(OWN_PARAMETERS)
    if section and isinstance(value, int | float | list | tuple):
        numeric = isinstance(value, int | float) and not isinstance(value, bool)
        names = [name for name, each in held.items() if isinstance(each, float)] if numeric else []
        example = f"{path}.{names[0]}={value}" if names else f"{path}.{next(iter(held))}"
        raise WrongKind(f"{path:.200}: {value!r:.60}; allowed: a field of this section, such as {example:.200}")


def found_at(scenario: Scenario, path: str) -> object:
    """Value at a dotted path without numbers of an entry, None where the scenario has no such field."""
    found: object = scenario
    for name in path.split("."):
        found = getattr(found, name, None)
    return found


def field_of(path: str) -> str:
    """Dotted path of a field, without the numbers of an entry at the end of `path`."""
    return ".".join(_names_of_field(path))


def _names_of_field(path: str) -> list[str]:
    return list(takewhile(lambda part: not part.isdecimal(), path.split(".")))


def with_value(scenario: Scenario, path: str, value: object) -> Scenario:
    """Copy of the scenario with another value of a field; numbers at the path's end are an entry of a list, or row and
    column of a matrix, from 1. Raises ScenarioError."""
    return with_values(scenario, {path: value})


def _replace(data: object, path: str, value: object) -> None:
    """Replace the field at a dotted path of a scenario in plain data. Raises ScenarioError."""
    *sections, last = path.split(".")
    table: Any = data
    for section in sections:
        if path.startswith(OWN_PARAMETERS) and isinstance(table, dict):
            table[section] = table.get(section) or {}
        if not isinstance(table, dict) or not isinstance(table.get(section), dict):
            raise UnknownField(f"{path}: no such field; {_fields_of(table, section)}")
        table = table[section]
    if path.startswith(OWN_PARAMETERS):
        table.setdefault(last, 0.0)
    if not isinstance(table, dict) or last not in table:
        raise UnknownField(f"{path}: no such field; {_fields_of(table, last)}")
    table[last] = of_kind(value) if isinstance(table[last], dict) and isinstance(value, str) else value


def _with_entry(table: object, places: list[str], value: object, path: str) -> object:
    """Copy of a table of lists with another value at these places, from 1."""
    if not places:
        return value
    place, *rest = places
    numbered = place.isdecimal() and len(place) <= MOST_DIGITS
    if not numbered or not isinstance(table, list | tuple) or not table:
        raise UnknownField(
            f"{path:.200}: no such entry; allowed: an entry, from 1, of a list that the scenario has, or the whole list"
        )
    if not 1 <= int(place) <= len(table):
        held = ".".join(path.split(".")[: -len(places)])
        raise UnknownField(f"{path:.200}: no such entry; allowed: {held:.200}.1 to {held:.200}.{len(table)}")
    at = int(place) - 1
    return [*table[:at], _with_entry(table[at], rest, value, path), *table[at + 1 :]]


def of_kind(kind: str) -> dict[str, str]:
    """Section of this kind at its defaults, as plain data; "own:name" is one of the user's own."""
    own, _, name = kind.partition(":")
    return {"kind": own, "name": name} if own == OWN else {"kind": kind}


def kind_of(section: Struct) -> str:
    """Kind of a section, the inverse of `of_kind`."""
    tag = str(section.__struct_config__.tag)
    return f"{tag}:{section.name}" if tag == OWN else tag  # pyright: ignore[reportAttributeAccessIssue]


def differences(scenario: Scenario, other: Scenario) -> dict[str, tuple[Any, Any]]:
    """Fields, by dotted path, in which two scenarios differ, with both values as plain data; None for an absent one.
    Name and title do not count."""
    one, two = _fields(to_plain(scenario), ""), _fields(to_plain(other), "")
    paths = [path for path in {**one, **two} if path not in ("name", "title")]
    return {path: (one.get(path), two.get(path)) for path in paths if one.get(path) != two.get(path)}


def _fields(table: dict[str, Any], prefix: str) -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in table.items():
        flat |= _fields(value, f"{prefix}{name}.") if isinstance(value, dict) else {f"{prefix}{name}": value}
    return flat


def shipped() -> dict[str, Scenario]:
    """The scenarios of `static/scenarios`, by name."""
    return dict(_shipped())


@cache
def _shipped() -> dict[str, Scenario]:
    folder = resources.files("static").joinpath("scenarios")
    files = sorted((f for f in folder.iterdir() if f.name.endswith(".toml")), key=lambda f: f.name)
    return {f.name.removesuffix(".toml"): from_toml(f.read_text(encoding="utf-8")) for f in files}


def load(name_or_file: str) -> Scenario:
    """A shipped scenario by name, or one from a TOML file. Raises ScenarioError."""
    scenarios = shipped()
    if name_or_file in scenarios:
        return scenarios[name_or_file]
    path = Path(name_or_file)
    if path.suffix != ".toml":
        named = allowed(name_or_file, scenarios).replace("allowed: ", "allowed: a .toml file or ", 1)
        raise ScenarioError(f"scenario {name_or_file!r:.200}: unknown; {named}")
    # os.path takes names that no file can have for files that are not there
    if os.path.exists(path) and not os.path.isfile(path):  # a pipe would never end
        what = "a folder" if os.path.isdir(path) else "a pipe or a device"
        raise ScenarioError(f"scenario {name_or_file!r:.200}: is {what}; allowed: a file")
    try:
        with path.open("rb") as file:
            content = file.read(LARGEST + 1)
    except (OSError, ValueError) as error:  # ValueError: a zero in the name
        reason = error.strerror if isinstance(error, OSError) else error
        raise ScenarioError(f"scenario {name_or_file!r:.200}: cannot be read: {reason}") from error
    try:
        return from_file(content)
    except ScenarioError as error:
        raise ScenarioError(f"scenario {name_or_file!r:.200}: {error}") from error


def _fields_of(table: object, given: str) -> str:
    return allowed(given, table) if isinstance(table, dict) else "it has no fields"


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _without_none(v) for k, v in value.items() if v is not None}
    return list(value) if isinstance(value, tuple) else value


def _refuse_unfit(value: object, path: str, depth: int) -> None:
    """Raise ScenarioError for values that msgspec would accept, or fail on: numbers beyond float and 64 bits, dates,
    nesting that is too deep, and what was typed in another encoding, which no file can hold."""
    if depth > DEEPEST:
        raise ScenarioError(f"{path:.60}…: {depth} tables or lists within each other; allowed: at most {DEEPEST}")
    if isinstance(value, float) and not (float("-inf") < value < float("inf")):
        raise ScenarioError(f"{path:.200}: {value}; allowed: a finite number")
    if isinstance(value, int) and not -(2**63) <= value < 2**63:
        raise ScenarioError(f"{path:.200}: a whole number of {value.bit_length()} bits; allowed: at most 63")
    if isinstance(value, str) and not value.isascii() and any("\ud800" <= letter <= "\udfff" for letter in value):
        raise WrongKind(f"{path:.200}: {value!r:.60}; allowed: a text in UTF-8")
    if isinstance(value, datetime.date | datetime.time):
        raise WrongKind(f"{path:.200}: {value}, a date or a time; allowed: a number, or a text in quotes")
    if isinstance(value, dict):
        for key, item in value.items():
            name = key if str(key).isprintable() else repr(key)
            _refuse_unfit(item, f"{path}.{name}" if path else str(name), depth + 1)
    elif isinstance(value, list | tuple):
        for index, item in enumerate(value):
            _refuse_unfit(item, f"{path}[{index}]", depth + 1)


def _kind_of_refusal(message: str) -> type[ScenarioError]:
    """Class of the error for a message of msgspec, which has one class for all."""
    if message.startswith("Object contains unknown field"):
        return UnknownField
    if message.startswith(("Invalid enum value", "Invalid value")):
        return UnknownChoice
    return WrongKind if ", got `" in message else ScenarioError


def _sentence(error: msgspec.ValidationError, data: object) -> str:
    """Refusal of data that are no scenario."""
    refusal = struct_refusal(error, data, Scenario, "scenario")
    # the kinds of the laws' parameters are no fields of the schema: their form is said, too
    return re.sub(
        r"^(controller\.own\.[^.:]+: (?:.*; )?)allowed: a table\b",
        r"\1allowed: a table, in the form controller.own.<law>.<parameter>",
        refusal,
        flags=re.DOTALL,
    )
