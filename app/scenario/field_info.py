"""Facts of a scenario's fields, and of a run's metrics: bounds, unit and meaning, for the page, the refusals and the
documentation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple, cast

import msgspec
from msgspec import Struct

from app.scenario.schema import Scenario
from app.scenario.units import Units
from parameters import UnitsOf, Widget

_Metadata = msgspec.inspect.Metadata


@dataclass(frozen=True)
class FieldInfo:
    """Facts of a field that the page and the documentation show.
    least, largest: bounds, None where there are none.
    least_allowed, largest_allowed: whether the bounds themselves are allowed.
    widget: its display on the page, None where a panel of the page decides that.
    title: in sentences, "" where that is made of `doc`.
    of: on whose units its own depends; `unit` is for revolute joints and where r is in metres.
    text: whether the field is a text."""

    doc: str
    unit: str
    least: float | None
    largest: float | None
    choices: tuple[str, ...]
    widget: Widget | None = None
    title: str = ""
    text: bool = False
    least_allowed: bool = True
    largest_allowed: bool = True
    of: UnitsOf = ""

    def unit_in(self, units: Units) -> str:
        """Unit in a task space with these units, "" for a plain number."""
        unit = units.of_kind(self.of, self.unit)
        return "" if unit == "1" else unit


def field_info(path: str) -> FieldInfo:
    """Facts of the field at a dotted path; in a section of several kinds, those of the first kind that has it."""
    section, _, last = path.rpartition(".")
    place = _place(section)
    for kind in place.kinds:
        for f in _schema(kind).fields:
            if f.name == last and isinstance(f.type, _Metadata):
                return _info(f.type, place)
    raise KeyError(path)


@cache
def infos_of(struct: type[Struct]) -> dict[str, FieldInfo]:
    """Facts of the fields of a struct by name: of those that are described as a scenario's are."""
    place = _Place([struct])
    return {f.name: _info(f.type, place) for f in _schema(struct).fields if isinstance(f.type, _Metadata)}


class _Place(NamedTuple):
    """Place of fields: a section.
    kinds: its kinds, one for most sections.
    metre: unit of its lengths.
    of: on whose units those of all its fields depend, where they do not say it themselves."""

    kinds: Sequence[type[Struct]]
    metre: str = "m"
    of: UnitsOf = ""


def _place(path: str) -> _Place:
    """Place at a dotted path. The metadata of a section may have a `metre` and an `of`."""
    place = _Place([Scenario])
    for section in filter(None, path.split(".")):
        held = [f.type for kind in place.kinds for f in _schema(kind).fields if f.name == section]
        said = {name: fact for t in held if isinstance(t, _Metadata) for name, fact in (t.extra or {}).items() if fact}
        kinds = [t for kind in place.kinds for t in types_of(kind, section)]
        place = _Place(kinds, said.get("metre", place.metre), said.get("of", place.of))
    return place


def _info(metadata: msgspec.inspect.Metadata, place: _Place) -> FieldInfo:
    inner: Any = metadata.type
    if isinstance(inner, msgspec.inspect.UnionType):
        inner = inner.types[0]
    low = [b for b in (getattr(inner, "ge", None), getattr(inner, "gt", None)) if b is not None]
    high = [b for b in (getattr(inner, "le", None), getattr(inner, "lt", None)) if b is not None]
    schema, extra = metadata.extra_json_schema or {}, metadata.extra or {}
    unit = str(extra.get("unit", ""))
    return FieldInfo(
        doc=str(schema.get("description", "")),
        unit=place.metre if unit == "m" else unit,
        least=float(low[0]) if low else None,
        largest=float(high[0]) if high else None,
        choices=tuple(getattr(inner, "values", ())),
        widget=extra.get("widget"),
        title=str(extra.get("title", "")),
        text=isinstance(inner, msgspec.inspect.StrType),
        least_allowed=getattr(inner, "gt", None) is None,
        largest_allowed=getattr(inner, "lt", None) is None,
        of=extra.get("of") or place.of,
    )


def types_of(struct: type[Struct], name: str) -> list[type[Struct]]:
    """Structs that a field may hold: one for a section, several for a section of several kinds, else none."""
    kind = next((f.type for f in _schema(struct).fields if f.name == name), None)
    kind = kind.type if isinstance(kind, _Metadata) else kind
    kinds = kind.types if isinstance(kind, msgspec.inspect.UnionType) else [kind]
    return [k.cls for k in kinds if isinstance(k, msgspec.inspect.StructType)]


class FieldOfKind(NamedTuple):
    """Field in one of the kinds of a section.
    path: dotted; kind: tag of the nearest kind around it, "" where no section around it has several.
    info: its facts there; default: its value in a file that does not have it."""

    path: str
    kind: str
    info: FieldInfo
    default: Any


def fields_of_kinds(prefix: str, kinds: Sequence[type[Struct]], outer: str = "") -> list[FieldOfKind]:
    """Every field of every kind of a section, kind by kind."""
    found, place = list[FieldOfKind](), _place(prefix)
    for kind in kinds:
        tag = str(kind.__struct_config__.tag) if len(kinds) > 1 else outer
        stated = {f.name: f for f in msgspec.structs.fields(kind)}
        for f in _schema(kind).fields:
            path, field = f"{prefix}.{f.name}", stated[f.name]
            if within := types_of(kind, f.name):
                found += fields_of_kinds(path, within, tag)
            elif isinstance(f.type, _Metadata):
                default = field.default_factory() if callable(field.default_factory) else field.default
                found.append(FieldOfKind(path, tag, _info(f.type, place), default))
    return found


def paths_below(prefix: str, kinds: Sequence[type[Struct]]) -> list[str]:
    """Dotted paths of the fields of all these kinds of a section, each once: texts first, fields of inner sections
    last."""
    texts, others, nested = [], [], []
    for kind in kinds:
        for name in kind.__struct_fields__:
            path = f"{prefix}.{name}"
            if within := types_of(kind, name):
                nested += paths_below(path, within)
            else:
                (texts if field_info(path).text else others).append(path)
    return list(dict.fromkeys([*texts, *others, *nested]))


@cache
def _schema(struct: type[Struct]) -> msgspec.inspect.StructType:
    """msgspec's description of a struct, cached: msgspec translates the whole tree below the struct."""
    return cast(msgspec.inspect.StructType, msgspec.inspect.type_info(struct))
