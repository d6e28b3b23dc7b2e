"""Kinds of contact: each is a row of `CONTACTS`, and all are one law for the multiplier (`environments.contact`)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal


@dataclass(frozen=True)
class ContactKind:
    """Kind of contact.
    title: name on the page; equation: the paper's number.
    springs, massive: whether the surface has K_e and B_e, and M_e beside them.
    rigid: whether the surface does not yield.

    With neither springs nor rigid there is no surface. Raises ValueError for a row that contradicts itself."""

    title: str
    equation: str
    springs: bool = False
    massive: bool = False
    rigid: bool = False

    def __post_init__(self) -> None:
        if self.massive and not self.springs:
            raise ValueError(f"massive: True in the kind of contact {self.title!r} without springs; allowed: False")
        if self.rigid and self.springs:
            raise ValueError(f"rigid: True in the kind of contact {self.title!r} with springs; allowed: False")

    @property
    def touches(self) -> bool:
        """Whether there is a surface."""
        return self.springs or self.rigid

    @property
    def heavy(self) -> bool:
        """Whether its force depends on the torque."""
        return self.massive or self.rigid


def combined_kind(kinds: tuple[ContactKind, ...]) -> ContactKind:
    """Kind of the contacts with several surfaces together: that of the first one, massive where any of them is."""
    return replace(kinds[0], massive=any(kind.massive for kind in kinds))


FREE = "free"  # without a surface
CONTACTS = {
    FREE: ContactKind("none", ""),
    "elastic": ContactKind("elastic", "(32)", springs=True),
    "mass-damper-spring": ContactKind("mass, damper, spring", "(28)", springs=True, massive=True),
    "rigid": ContactKind("rigid", "(39)", rigid=True),
}
if TYPE_CHECKING:
    ContactName = str
else:
    ContactName = Literal[tuple(CONTACTS)]
