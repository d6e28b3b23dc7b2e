"""Command `vsmrc list`: shows the robots and the scenarios, the fields of a section of scenarios, or the signals of a
recording."""

from __future__ import annotations

from typing import Annotated

import tyro

from app.cli.options import one_of
from app.cli.status import DONE
from app.scenario.data import shipped
from app.scenario.errors import ScenarioError
from app.scenario.field_info import FieldInfo, field_info, paths_below, types_of
from app.scenario.schema import Scenario

SECTIONS = tuple(name for name in Scenario.__struct_fields__ if types_of(Scenario, name))


def list_(*, fields: Annotated[str | None, tyro.conf.arg(metavar="SECTION")] = None, signals: bool = False) -> int:
    """List the robots and the shipped scenarios, the fields of a section of scenarios, or the signals of a recording.

    Args:
        fields: list the fields of this section instead, with unit, bounds and meaning: robot, truth, surface, ...
        signals: list the signals of a recording instead, with unit and meaning
    """
    if signals:
        if fields is not None:
            raise ScenarioError("--signals with --fields; allowed: one of them")
        from app.simulation.signals import SIGNALS

        print("n: joints, or task coordinates, which are as many; units for revolute joints and where r is in metres")
        for signal in SIGNALS:
            print(f"{signal.name:16s}  {signal.width or 'n'!s:2s}  {signal.unit:8s}  {signal.doc}")
        return DONE
    if fields is not None:
        for line in _fields_of(one_of("--fields", fields, SECTIONS)):
            print(line)
        return DONE
    from environments.robots import CATALOGUE

    print("robots")
    for name, entry in CATALOGUE.items():
        print(f"  {name:34s} {entry.title}")
    print("scenarios")
    for name, scenario in shipped().items():
        print(f"  {name:34s} {scenario.title}")
    return DONE


def _fields_of(section: str) -> list[str]:
    """Lines on the fields of a section: path, unit, what is allowed, meaning, and the kinds that have it if few do."""
    kinds = types_of(Scenario, section)
    having = {str(kind.__struct_config__.tag): set(paths_below(section, [kind])) for kind in kinds}
    lines = [f"{section}.kind: {', '.join(having)}"] if len(kinds) > 1 else []
    for path in paths_below(section, kinds):
        info, of = field_info(path), [kind for kind, paths in having.items() if path in paths]
        meaning = info.doc + (f" ({', '.join(of)})" if len(of) < len(kinds) else "")
        columns = f"{path:34s}", f"{info.unit.removesuffix('1'):8s}", f"{_allowed(info):22s}", meaning
        lines.append("  ".join(columns).rstrip())
    return lines


def _allowed(info: FieldInfo) -> str:
    """What is allowed in a field, in a few signs."""
    least, largest = info.least, info.largest
    low = "" if least is None else f"{'>=' if info.least_allowed else '>'} {least:g}"
    high = "" if largest is None else f"{'<=' if info.largest_allowed else '<'} {largest:g}"
    return ", ".join(filter(None, (low, high, *map(str, info.choices))))
