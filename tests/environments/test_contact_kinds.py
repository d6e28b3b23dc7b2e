"""Rows of the table of contacts: those that contradict themselves are refused."""

from __future__ import annotations

import pytest

from environments.contact_kinds import CONTACTS, ContactKind


@pytest.mark.parametrize(
    ("named", "properties"),
    [
        ("massive", {"massive": True}),
        ("massive", {"massive": True, "rigid": True}),
        ("rigid", {"rigid": True, "springs": True}),
        ("rigid", {"rigid": True, "springs": True, "massive": True}),
    ],
)
def test_a_row_that_contradicts_itself_is_refused(named: str, properties: dict[str, bool]) -> None:
    with pytest.raises(ValueError, match=rf"{named}: True in the kind of contact 'odd' with.*; allowed: False"):
        ContactKind("odd", "", **properties)


def test_there_is_a_surface_in_every_kind_but_free() -> None:
    assert [name for name, kind in CONTACTS.items() if not kind.touches] == ["free"]
