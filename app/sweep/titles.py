"""Titles of fields that a sweep varies and of their values, with units: the words of the page, for its maps and for
figures."""

from __future__ import annotations

import re
from collections.abc import Callable

from app.scenario.field_info import FieldInfo, field_info
from app.scenario.number_text import rounded
from app.scenario.units import Units
from app.simulation.builders.controller_builder import laws
from controllers.modes import MODES
from controllers.switching import SWITCHING
from environments.contact_kinds import CONTACTS

# titles on the page of the values of fields that name a row of a table
TITLED: dict[str, Callable[[], dict[str, str]]] = {
    "mode": lambda: {name: mode.label for name, mode in MODES.items()},
    "contact.kind": lambda: {name: kind.title for name, kind in CONTACTS.items()},
    "controller.law": lambda: {name: law.title for name, law in laws().items()},
    "controller.switching": lambda: {name: function.title for name, function in SWITCHING.items()},
}
OF_TWO_SECTIONS = ("motion", "rotation")  # whose fields have one class
NONE_AT_ZERO = ("truth.torque_limit",)  # fields of which 0 stands for none
FURTHER = {"second": "second surface", "third": "third surface"}
# words for the sections whose fields' meanings do not say of what they are
SECTIONS = {
    "truth": "true arm",
    "declared": "declared",
    "motion": "desired motion",
    "rotation": "desired rotation",
    "force": "desired force",
    "surface": "surface",
    "sensor": "sensor",
    "shift": "shift",
    "blend": "blend",
}


def title_of(path: str) -> str:
    """Title of the field at a dotted path, a number at whose end is an entry of a list; the path itself of one that the
    schema does not describe."""
    field, entry = _parted(path)
    first, _, rest = field.partition(".")
    of_first = rest if first in FURTHER else field  # a further surface has the fields of the first one
    info, section = _info(field), of_first.partition(".")[0]
    if info is None or not info.doc:
        return path
    title = info.title or re.split(r"[;:]|, or (?:one|N·m)\b", info.doc)[0].strip()
    about = SECTIONS.get(section, "") if not info.title or section in OF_TWO_SECTIONS else ""
    title += f" ({about})" if about and about not in title else ""
    title += f" ({FURTHER[first]})" if first in FURTHER else ""
    return f"{title}, entry {', '.join(entry)}" if entry else title


def unit_of(path: str, units: Units) -> str:
    """Unit of the field at a dotted path in a task space with these units, "" for a plain number and for one that the
    schema does not describe."""
    field, _ = _parted(path)
    info = _info(field)
    return "" if info is None else info.unit_in(units)


def named(path: str, units: Units) -> str:
    """Title with the unit, as on an axis."""
    unit = unit_of(path, units)
    return f"{title_of(path)} [{unit}]" if unit else title_of(path)


def value_in_words(path: str, value: object) -> str:
    """Value of a field in words: of a row of a table its title on the page, of a number three digits."""
    first, _, rest = path.partition(".")
    titles = TITLED.get(rest if first in FURTHER else path)
    if titles is not None and (title := titles().get(str(value))) is not None:
        return title
    if value == 0.0 and path in NONE_AT_ZERO:
        return "none"
    return rounded(value) if isinstance(value, float) else str(value)


def _parted(path: str) -> tuple[str, tuple[str, ...]]:
    """Path of a field, and the numbers of an entry behind it."""
    parts = path.split(".")
    numbers = [part for part in parts if part.isdecimal()]
    return ".".join(part for part in parts if not part.isdecimal()), tuple(numbers)


def _info(field: str) -> FieldInfo | None:
    try:
        return field_info(field)
    except KeyError:
        return None
