"""Words for a field and its value, as the page tells them instead of a dotted path."""

from __future__ import annotations

import re

from app.dashboard.widgets.matrix_text import written
from app.scenario.data import differences
from app.scenario.field_info import field_info
from app.scenario.schema import Scenario
from app.scenario.units import Units
from app.sweep.titles import TITLES, title_of, unit_of, value_in_words

LONGEST = 40  # letters of a value
TOLD = 4  # differences of two scenarios
FIRST = 3  # numbers of a list that is longer than that
_PER_AXIS = ("target_model.", "controller.")  # fields with a number for each axis
# a matrix of the target model as refusals name it, which may have the number of one of the paper's blocks
_MATRIX = re.compile(r"\btarget_model\.([MBK]_[mf])([12]?)\b")
# the field of which a refusal is, which stands first
_FIELD = re.compile(r"^[a-z_]+(?:\.\w+)+(?=: )")
# the field of a blend and its own words for a refusal
_BLEND = re.compile(r"^blend\.\w+: refused: ")
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
    if isinstance(value, bool | str):
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
    """Reason of a refusal with its field and the matrices of the target model called as on the page; that of a blend,
    which says by itself that it is refused, without both."""
    sentence = _BLEND.sub("", sentence)
    sentence = _MATRIX.sub(lambda found: f"{found[1]}{_BLOCKS[found[2]]}", sentence)
    return _FIELD.sub(lambda found: _label(found[0]), sentence)


def _label(path: str) -> str:
    """Label of the row of the field at a dotted path, else its short title, as of a label that means nothing away from
    its row, such as "from t ="; the path itself where it has neither."""
    try:
        shown = field_info(path).widget
    except KeyError:
        shown = None
    return TITLES.get(path, path) if shown is None or shown.label.endswith("=") else shown.label
