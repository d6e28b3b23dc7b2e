"""Sentence on what a change of mode, arm or surface has adapted besides, in the words of the page."""

from __future__ import annotations

from operator import attrgetter
from typing import Any

from app.scenario.contact_sections import ContactSection
from app.scenario.data import differences
from app.scenario.field_info import field_info
from app.scenario.number_text import rounded
from app.scenario.schema import Scenario
from app.scenario.units import Units

_SECTION_WORDS = {
    "motion": "path",
    "rotation": "rotation",
    "contact": "contact",
    "task_space": "task space",
    "surface": "surface",
    "second.surface": "second surface",
    "third.surface": "third surface",
    "truth": "true arm:",
}
_GAINS = ("K_s", "A", "F_1", "F_2")


def adaptation_sentence(requested: Scenario, done: Scenario, units: Units) -> str:
    """Sentence on the fields that a change of mode, arm or surface has adapted; "" for none.
    requested: the scenario with that change alone.
    done: the scenario that runs; units: of its task space."""
    adaptations: list[str] = []
    different = differences(requested, done)
    for section, word in _SECTION_WORDS.items():
        changed = {path: values for path, values in different.items() if path.startswith(f"{section}.")}
        if f"{section}.kind" in changed:
            old, new = (attrgetter(section)(of) for of in (requested, done))
            adaptations.append(f"{word} {_kind_title(new)} instead of {_kind_title(old)}")
        elif list(changed) == [f"{section}.origin"]:
            adaptations.append(f"{word} brought to the tool")
        else:
            adaptations += [f"{word} {_field_phrase(path, *values, units)}" for path, values in changed.items()]
    for each in ("second", "third"):
        old, new = (getattr(of, each).contact for of in (requested, done))
        if old.kind != new.kind and getattr(done, each).present:
            adaptations.append(f"{each} surface {_kind_title(new)} instead of {_kind_title(old)}")
    taken = [each for each in ("second", "third") if getattr(requested, each).present > getattr(done, each).present]
    adaptations += [f"{each} surface taken away" for each in taken]
    if requested.face.flat and not done.face.flat:
        adaptations.append("the tool touches with a point")
    if requested.target_model != done.target_model:
        adaptations.append("target model back at the mode's defaults")
    gains = [name for name in _GAINS if f"controller.{name}" in different]
    if requested.controller.layer != done.controller.layer:
        layer = f"{rounded(done.controller.layer)} {units.of_r('m/s')}"
        d = ", d" if "controller.d" in different else ""
        adaptations.append(f"boundary layer {layer}{d} and K_s, converted by the characteristic length ℓ")
        gains = [name for name in gains if name != "K_s"]
    if gains:
        adaptations.append(f"{', '.join(gains)}: one number for all coordinates")
    if requested.controller.gain != done.controller.gain:
        adaptations.append(f"gain d is {done.controller.gain} now")
    return f"Adapted: {'; '.join(adaptations)}." if adaptations else ""


def _field_phrase(path: str, before: object, after: object, units: Units) -> str:
    """Label of the field at a dotted path, and its value after and before."""
    info = field_info(path)
    label = info.widget.label if info.widget else path.rpartition(".")[2].replace("_", " ")
    titles = {_hashable(value): title for title, value in info.widget.options} if info.widget else {}
    was, now = (titles.get(_hashable(value), _value_text(value)) for value in (before, after))
    return f"{label} {now} instead of {was} {info.unit_in(units)}".rstrip()


def _kind_title(section: Any) -> str:
    """Title, on the page, of the kind of a section."""
    described = section.nature if isinstance(section, ContactSection) else section
    return described.title if hasattr(described, "title") else str(section.kind)


def _hashable(value: object) -> object:
    return tuple(value) if isinstance(value, list) else value


def _value_text(value: object) -> str:
    if isinstance(value, list | tuple):
        return ", ".join(_value_text(each) for each in value)
    return rounded(value, 4) if isinstance(value, float) else str(value)
