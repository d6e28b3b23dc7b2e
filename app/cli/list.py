"""Command `vsmrc list`: shows the robots and the scenarios, the control laws, the fields of a section of scenarios, or
the signals of a recording."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Annotated

import tyro
from msgspec import Struct

from app.cli.options import NO_DEFAULT_SHOWN, one_of
from app.cli.status import DONE
from app.scenario.data import shipped
from app.scenario.errors import ScenarioError
from app.scenario.field_info import FieldInfo, fields_of_kinds, paths_below, types_of
from app.scenario.schema import Scenario

SECTIONS = tuple(name for name in Scenario.__struct_fields__ if types_of(Scenario, name))
# matrices of a target model have neither default nor bounds of their own
MODELS = {"target_model": "the mode's", "blend.to": "target_model's"}  # defaults, by section
MATRIX, MORE_ON_MATRICES = "n numbers, or n rows", "; n: joints; defaults: docs/target-model.md"


def list_(
    *,
    fields: Annotated[str | None, tyro.conf.arg(metavar="SECTION"), NO_DEFAULT_SHOWN] = None,
    signals: bool = False,
    laws: bool = False,
) -> int:
    """List the robots and the shipped scenarios, the control laws, the fields of a section of scenarios, or the signals
    of a recording.

    Args:
        fields: list the fields of this section instead, with unit, default, bounds and meaning: robot, truth, ...
        signals: list the signals of a recording instead, with unit and meaning
        laws: list the control laws instead, with what the torque of each depends on
    """
    asked = [flag for flag, given in (("--signals", signals), ("--laws", laws), ("--fields", fields)) if given]
    if len(asked) > 1:
        raise ScenarioError(f"{asked[0]} with {asked[1]}; allowed: one of them")
    if laws:
        from controllers.laws.table import LAWS

        for kind, law in LAWS.items():
            print(f"{kind:16s}  {law.title}. {law.told_in_words}")
        return DONE
    if signals:
        from app.simulation.signals import SIGNALS

        print("n: joints, or task coordinates, which are as many; units for revolute joints and where r is in metres")
        for signal in SIGNALS:
            print(f"{signal.name:16s}  {signal.width or 'n'!s:2s}  {signal.unit:8s}  {signal.doc}")
        return DONE
    if fields is not None:
        for line in _fields_of(one_of("--fields", fields, SECTIONS)):
            print(line)
        return DONE
    from environments.catalogue import CATALOGUE

    print("robots")
    for name, entry in CATALOGUE.items():
        print(f"  {name:34s} {entry.title}")
    print("scenarios")
    for name, scenario in shipped().items():
        print(f"  {name:34s} {scenario.title}")
    return DONE


def _fields_of(section: str) -> list[str]:
    """Lines on the fields of a section: path, unit, default, what is allowed, meaning, and the kinds that have it if
    few do; of a field that is not the same in all kinds, a line for each."""
    kinds = types_of(Scenario, section)
    tags = _tags(section, kinds)
    lines = [f"{path}.kind: {', '.join(known)}" for path, known in tags.items()]
    fields = fields_of_kinds(section, kinds)
    for path in paths_below(section, kinds):
        around = next((known for at, known in reversed(tags.items()) if path.startswith(f"{at}.")), [])
        alike: dict[tuple[FieldInfo, str], list[str]] = {}
        for field in fields:
            if field.path == path:
                alike.setdefault((field.info, _written(field.default)), []).append(field.kind)
        for (info, default), having in alike.items():
            kinds_having = f" ({', '.join(having)})" if len(having) < len(around) else ""
            model = MODELS.get(path.rpartition(".")[0])
            columns = (
                f"{path:34s}",
                f"{info.unit.removesuffix('1'):9s}",
                f"{model or default:16s}",
                f"{MATRIX if model else _allowed(info, default):22s}",
            )
            meaning = info.doc + (MORE_ON_MATRICES if model else kinds_having)
            lines.append("  ".join((*columns, meaning)).rstrip())
    return lines


def _tags(section: str, kinds: Sequence[type[Struct]]) -> dict[str, list[str]]:
    """Tags of the kinds of a section and of the sections in it, by path, where there are several."""
    within = {f"{section}.{name}": types_of(kind, name) for kind in kinds for name in kind.__struct_fields__}
    return {
        path: [str(kind.__struct_config__.tag) for kind in known]
        for path, known in {section: kinds, **within}.items()
        if len(known) > 1
    }


def _written(default: object) -> str:
    """Default as it would stand in a file, "" where a field has none."""
    return "" if default is None else json.dumps(default, ensure_ascii=False)


def _allowed(info: FieldInfo, default: str) -> str:
    """Allowed values of a field with this default, in a few signs."""
    if default in ("true", "false"):
        return "true, false"
    least, largest = info.least, info.largest
    low = "" if least is None else f"{'>=' if info.least_allowed else '>'} {least:g}"
    high = "" if largest is None else f"{'<=' if info.largest_allowed else '<'} {largest:g}"
    return ", ".join(filter(None, (low, high, *map(str, info.choices))))
