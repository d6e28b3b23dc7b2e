"""Kinds of contact: each is a row of `CONTACTS`, and all are one law for the multiplier (`environments.contact`)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal


@dataclass(frozen=True)
class ContactKind:
    """Kind of contact.
    title: name on the page; equation: the paper's number.
    touches: whether there is a surface.
    springs, massive: whether the surface has K_e and B_e, and M_e.
    rigid: whether the surface does not yield."""

    title: str
    equation: str
    touches: bool = True
    springs: bool = False
    massive: bool = False
    rigid: bool = False

    @property
    def heavy(self) -> bool:
        """Whether its force depends on the torque."""
        return self.massive or self.rigid


def combined_kind(kinds: tuple[ContactKind, ...]) -> ContactKind:
    """Kind of the contacts with several surfaces together: that of the first one, massive where any of them is."""
    return replace(kinds[0], massive=any(kind.massive for kind in kinds))


CONTACTS = {
    "free": ContactKind("none", "", touches=False),
    "elastic": ContactKind("elastic", "(32)", springs=True),
    "mass-damper-spring": ContactKind("mass, damper, spring", "(28)", springs=True, massive=True),
    "rigid": ContactKind("rigid", "(39)", rigid=True),
}
if TYPE_CHECKING:
    ContactName = str
else:
    ContactName = Literal[tuple(CONTACTS)]
