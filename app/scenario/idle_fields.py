"""Fields that no run of a scenario depends on, because another field chooses otherwise."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from app.scenario.contact_sections import ContactSection
from app.scenario.schema import Scenario
from environments.contact_kinds import CONTACTS, ContactKind

# fields of a contact that only some kinds have
_OF_KINDS: dict[str, Callable[[ContactKind], bool]] = {
    "K_e": lambda kind: kind.springs,
    "B_e": lambda kind: kind.springs,
    "M_e": lambda kind: kind.massive,
    "friction_coulomb": lambda kind: kind.touches,
    "friction_viscous": lambda kind: kind.touches,
}


class IdleField(NamedTuple):
    """Reason why a field has no effect.
    choice, value: path of the field that chooses otherwise, and its value.
    needed: values of the choice with which the field has an effect."""

    choice: str
    value: str
    needed: tuple[str, ...]

    @property
    def because(self) -> str:
        """Words for the choice, after those on the field: "while contact.kind is rigid"."""
        return f"while {self.choice} is {self.value}"


def idle(scenario: Scenario, path: str) -> IdleField | None:
    """Reason why the field of a dotted path has no effect on a run of the scenario; None where it may have one."""
    if path == "controller.d" and scenario.controller.gain != "constant":
        return IdleField("controller.gain", scenario.controller.gain, ("constant",))
    section, _, name = path.rpartition(".")
    sections = {"contact": scenario.contact, "second.contact": scenario.second.contact}
    contact: ContactSection | None = (sections | {"third.contact": scenario.third.contact}).get(section)
    has = _OF_KINDS.get(name)
    if contact is None or has is None or has(contact.nature):
        return None
    return IdleField(f"{section}.kind", contact.kind, tuple(kind for kind, each in CONTACTS.items() if has(each)))
