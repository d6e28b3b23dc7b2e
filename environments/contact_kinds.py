"""Kinds of contact: each is a row of `CONTACTS`, all of them one law for the multiplier (`environments.contact`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal


@dataclass(frozen=True)
class ContactKind:
    """title: how the page calls it; equation: the paper's number. touches: whether there is a surface at all; springs:
    whether K_e and B_e are its own; massive: whether M_e is; rigid: whether nothing gives way."""

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
