"""Refusals of plain data that are no struct of a kind, such as a scenario or a lesson's block, in plain words."""

from __future__ import annotations

import re
from typing import Any, TypeVar

import msgspec
from msgspec import Struct, inspect

from parameters import allowed

Known = TypeVar("Known", bound=inspect.Type)


def struct_refusal(error: msgspec.ValidationError, data: object, kind: type[Struct], whole: str = "") -> str:
    """Refusal in one sentence, with the place, the value and what is allowed. data: that msgspec refused; kind: that
    was asked for; whole: what the data are called where no part of them is to blame, "" for nothing."""
    reason, _, place = str(error).partition(" - at `")
    steps = re.findall(r"\.([^.\[\]]+)|\[(\d+|\.\.\.)\]", place.rstrip("`").removeprefix("$"))
    there, known, path = data, inspect.type_info(kind), ""
    holder: inspect.Type | None = None
    for name, number in steps:
        key = number or name
        if key == "..." and known is not None:
            key = next((_first_wrong(there, each.value_type) for each in _types(known, inspect.DictType)), "*")
        path += f"[{number}]" if number.isdecimal() else f".{key:.60}"
        holder, known, there = known, _type_within(known, key, there), _within(there, key)
    path = path.removeprefix(".")
    if reason.startswith("Invalid value") and (tags := _tags(holder)):
        return f"{path}: {there!r:.60}; {allowed(str(there), tags)}"
    return _refusal(reason, path, there, known, whole)


def _refusal(reason: str, path: str, there: object, known: inspect.Type | None, whole: str) -> str:
    where = f"{path}." if path else ""
    if unknown := re.fullmatch("Object contains unknown field `(.*)`", reason, re.DOTALL):
        return f"{where}{unknown[1]:.60}: no such field; {allowed(unknown[1], _fields_of(known, there))}"
    if missing := re.fullmatch("Object missing required field `(.*)`", reason, re.DOTALL):
        tags = _tags(known) if missing[1] in {each.tag_field for each in _types(known, inspect.StructType)} else []
        return f"{where}{missing[1]}: missing; allowed: {', '.join(tags) or 'a value'}"
    if not path:
        sentence = _plain(reason)
        return f"{whole}: {sentence}" if whole else f"{sentence[:1].lower()}{sentence[1:]}"
    shown = "" if isinstance(there, dict) else f"{_number(there)}; " if isinstance(there, float) else f"{there!r:.60}; "
    choices = next((each.values for each in _types(known, inspect.LiteralType)), ())
    if reason.startswith("Invalid enum value") and choices:
        sentence = allowed(str(there), map(str, choices))
    else:
        sentence = _plain(re.sub(", got .*$", "", reason) if shown else reason)  # the value says what it is
    return f"{path}: {shown}{sentence[:1].lower()}{sentence[1:]}"


def _number(value: float) -> str:
    return f"{value:g}" if abs(value) >= 1e6 else repr(value)


def _plain(reason: str) -> str:
    """Reason of msgspec in plain words."""
    if "x00" in reason:  # the form of texts in one line
        reason = re.sub(" matching regex .*", " in one line, without control characters", reason, flags=re.DOTALL)
    reason = reason.replace(" matching regex ", " of the form ")
    for technical, plain in _PLAIN.items():
        reason = reason.replace(technical, plain)
    return reason.removesuffix(".0")  # of a bound


def _first_wrong(table: object, kind: inspect.Type) -> str:
    """Key of the first value of a table that is not of this kind."""
    wrong = (key for key, value in table.items() if not _fits(value, kind)) if isinstance(table, dict) else iter(())
    return next(wrong, "*")


def _fits(value: object, kind: inspect.Type) -> bool:
    """Whether a value is of a kind: a struct, a number or a table of these."""
    if tables := _types(kind, inspect.DictType):
        return isinstance(value, dict) and all(_fits(each, tables[0].value_type) for each in value.values())
    if _types(kind, inspect.FloatType):
        return isinstance(value, int | float) and not isinstance(value, bool)
    structs = _structs(kind, value)
    try:
        for each in structs[:1]:
            msgspec.convert(value, each.cls)
    except msgspec.ValidationError:
        return False
    return True


def _within(data: Any, key: str) -> object:
    try:
        return data[int(key)] if isinstance(data, list | tuple) else data[key]
    except (KeyError, IndexError, TypeError, ValueError):
        return {}


def _type_within(kind: inspect.Type | None, key: str, data: object) -> inspect.Type | None:
    """Type of what stands at a key of data of this type, None where that is not known."""
    for struct in _structs(kind, data):
        for field in struct.fields:
            if field.encode_name == key:
                return field.type
    for table in _types(kind, inspect.DictType):
        return table.value_type
    for row in (*_types(kind, inspect.VarTupleType), *_types(kind, inspect.ListType)):
        return row.item_type
    return None


def _fields_of(kind: inspect.Type | None, data: object) -> list[str]:
    """Fields that data of this type may have: those of the kind that they say, and that itself where there are
    several."""
    structs = _structs(kind, data)
    tag = [str(structs[0].tag_field)] if len(structs) > 1 else []
    return tag + [field.encode_name for each in structs[:1] for field in each.fields]


def _structs(kind: inspect.Type | None, data: object) -> list[inspect.StructType]:
    """Structs of a type, the one that the data name as their kind first."""
    given = data if isinstance(data, dict) else {}
    return sorted(_types(kind, inspect.StructType), key=lambda each: given.get(each.tag_field) != each.tag)


def _tags(kind: inspect.Type | None) -> list[str]:
    """Kinds among which data of this type say theirs."""
    return [str(each.tag) for each in _types(kind, inspect.StructType) if each.tag is not None]


def _types(kind: inspect.Type | None, of: type[Known]) -> list[Known]:
    """Alternatives of a type that are of this class."""
    while isinstance(kind, inspect.Metadata):
        kind = kind.type
    if isinstance(kind, inspect.UnionType):
        return [found for each in kind.types for found in _types(each, of)]
    return [kind] if isinstance(kind, of) else []


_PLAIN = {
    "Expected ": "allowed: ",
    "`float | array`": "numbers or rows of numbers",
    "`array | float`": "a number, or a list of numbers or rows",
    "`array | null`": "a list of numbers, or of rows where it is a matrix",
    "`object | null`": "a table",
    "`str | null`": "text",
    "`float | str | null`": "a number or text",
    "`float`": "a number",
    "`int`": "a whole number",
    "`str`": "text",
    "`bool`": "true or false",
    "`array`": "a list",
    "`object`": "a table",
}
