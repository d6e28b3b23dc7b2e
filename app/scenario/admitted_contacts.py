"""Contacts that a mode admits, by their names in a scenario."""

from __future__ import annotations

from controllers.modes import Mode
from environments.contact_kinds import CONTACTS


def admitted_contacts(mode: Mode) -> tuple[str, ...]:
    """Names of the kinds of contact that the mode admits, in the order of `CONTACTS`."""
    return tuple(name for name, kind in CONTACTS.items() if mode.admits(touches=kind.touches, rigid=kind.rigid))
