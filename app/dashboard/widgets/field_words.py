"""Words for a field and its value, as the page tells them instead of a dotted path."""

from __future__ import annotations

from app.dashboard.widgets.matrix_text import written
from app.scenario.units import Units
from app.sweep.titles import said, title_of, unit_of

LONGEST = 40  # letters of a value


def field_in_words(path: str, value: object, units: Units) -> str:
    """The field at a dotted path and its value in words, with the unit in a task space with these units."""
    return f"{title_of(path)}: {_value(path, value, units)}"


def _value(path: str, value: object, units: Units) -> str:
    if value is None:
        return "the mode's own" if path.startswith("target_model.") else "not given"
    if isinstance(value, bool | str):
        return said(path, value)
    text = written(value) if isinstance(value, float | int) else str(value)
    return f"{text if len(text) < LONGEST else f'{text[: LONGEST - 3]}…'} {unit_of(path, units)}".rstrip()
