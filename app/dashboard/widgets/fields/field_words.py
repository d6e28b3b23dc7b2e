"""Words for a field and its value, as the page tells them instead of a dotted path."""

from __future__ import annotations

import re

from app.analysis.glossary import GLOSSARY
from app.dashboard.widgets.fields.matrix_text import written
from app.scenario.data import differences
from app.scenario.number_text import MOST_DIGITS, plain, with_powers
from app.scenario.schema import Scenario
from app.scenario.units import Units
from app.sweep.titles import FURTHER, NONE_AT_ZERO, title_of, unit_of, value_in_words

LONGEST = 40  # letters of a value
TOLD = 4  # differences of two scenarios
FIRST = 3  # numbers of a list that is longer than that
_PER_AXIS = ("target_model.", "controller.")  # fields with a number for each axis
# a matrix of the target model as refusals name it, which may have the number of one of the paper's blocks
_MATRIX = re.compile(r"\btarget_model\.([MBK]_[mf])([12]?)\b")
# the refused field or section, with which a refusal begins
_OF = re.compile(r"^[a-z_]+(?:\.\w+)*(?=: )")
# a field in a refusal, and the value that it may have
_FIELD = re.compile(r"\b[a-z_]+(?:\.\w+)+(?: = (?:'([\w-]+)'|(true|false))(?![\w']))?")
# a number that is beyond a bound
_BEYOND = re.compile(r"(?<=\w): (-?[\d.e+-]+); allowed: a number (<=|>=|<|>) (-?[\d.e+-]+)$")
_BOUNDS = {"<=": "at most", ">=": "at least", "<": "below", ">": "above"}
# the field of a blend and its own words for a refusal
_ENTRY = re.compile(r"^([a-z_]+(?:\.\w+)+)\[(\d+)\]:")
_BLEND = re.compile(r"^blend\.\w+: refused: ")
_SYMBOLS = {symbol.field: symbol for symbol in GLOSSARY if symbol.field}
_BLOCKS = {"": "", "1": " of the pressed coordinates", "2": " of the free coordinates"}


def field_in_words(path: str, value: object, units: Units) -> str:
    """The field at a dotted path and its value in words, with the unit in a task space with these units."""
    return f"{title_of(path)}: {_value(path, value, units)}"


def differences_in_words(scenario: Scenario, other: Scenario, units: Units) -> str:
    """The first few fields in which another scenario differs, with its values, in words; "" where none does. units: in
    the other one's task space."""
    different = differences(scenario, other)
    parts = [field_in_words(path, theirs, units) for path, (_, theirs) in list(different.items())[:TOLD]]
    more = [f"{len(different) - TOLD} more"] if len(different) > TOLD else []
    return "; ".join([*parts, *more])


def _value(path: str, value: object, units: Units) -> str:
    if value is None:
        return "the mode's own" if path.startswith("target_model.") else "not given"
    if isinstance(value, bool | str) or (value == 0.0 and path in NONE_AT_ZERO):
        return value_in_words(path, value)
    unit = unit_of(path, units)
    if isinstance(value, list | tuple) and value:
        if isinstance(value[0], list | tuple):
            return f"{len(value)} × {len(value[0])} numbers"
        return _listed(path, [written(each) for each in value], unit)
    text = written(value) if isinstance(value, float | int) else str(value)
    return f"{text if len(text) < LONGEST else f'{text[: LONGEST - 3]}…'} {unit}".rstrip()


def _listed(path: str, numbers: list[str], unit: str) -> str:
    """Numbers of a list in words: the one number that all are, or the first few of many."""
    if len(numbers) > 1 and len(set(numbers)) == 1:
        return f"{f'{numbers[0]} {unit}'.rstrip()}{', all axes' if path.startswith(_PER_AXIS) else ' each'}"
    text, more = ", ".join(numbers), len(numbers) > FIRST
    return f"{', '.join([*numbers[:FIRST], '…']) if more and len(text) >= LONGEST else text} {unit}".rstrip()


def refusal_in_words(sentence: str) -> str:
    """Reason of a refusal with its fields and the matrices of the target model called as on the page; that of a blend
    without the field and the word with which it begins."""
    sentence = _BLEND.sub("", sentence)
    sentence = _MATRIX.sub(lambda found: f"{found[1]}{_BLOCKS[found[2]]}", sentence)
    sentence = _ENTRY.sub(lambda found: f"{found[1]}: number {int(found[2]) + 1} is", sentence)
    of = _OF.match(sentence)
    if of is None or not (of[0] in Scenario.__struct_fields__ or _is_field(of[0])):
        return sentence  # it begins with a file of the user, who looks for its names there
    sentence = _BEYOND.sub(lambda found: _beyond(of[0], found), sentence)
    return _FIELD.sub(_called_with_value, with_powers(sentence))


def _beyond(path: str, found: re.Match[str]) -> str:
    """Words for a number of the field at this path that is beyond a bound, with the field's unit where that is the same
    in every task space."""
    units = {unit_of(path, kind) for kind in (Units(), Units(task="joint"), Units(joints="mixed"))}
    unit = f" {units.pop()}".rstrip() if len(units) == 1 else ""
    value, bound = (plain(float(number), MOST_DIGITS) for number in (found[1], found[3]))
    return f": {value}{unit}; allowed: {_BOUNDS[found[2]]} {bound}{unit}"


def _is_field(path: str) -> bool:
    return called(path) != path


def _called_with_value(found: re.Match[str]) -> str:
    path = found[0].partition(" = ")[0]
    if not _is_field(path):
        return found[0]
    value = found[1] or {"true": "on", "false": "off"}.get(found[2] or "", "")
    return f"{called(path)} {value}".rstrip()


def called(path: str) -> str:
    """Name of the field at a dotted path in a sentence: its symbol, as on its row, and its title; the path itself of
    one that the schema does not describe. A label such as "by" or "x, y, z" means nothing away from its row."""
    if matrix := _MATRIX.fullmatch(path):
        return f"{matrix[1]}{_BLOCKS[matrix[2]]}"
    first, _, rest = path.partition(".")
    of_first = rest if first in FURTHER else path  # a further surface has the fields of the first one
    title = title_of(path)
    known = _SYMBOLS.get(of_first)
    if known is None or any(name in title for name in (known.written, *known.also)):
        return title
    return f"{known.written}, {title}"
