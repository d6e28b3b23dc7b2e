"""Units in which the page and the tables show quantities of the task space."""

from __future__ import annotations

from typing import NamedTuple


class Units(NamedTuple):
    """Units of a task space: of a thousandth of r, of a thousandth of r_dot or s, and of a generalised force such as
    d."""

    error: str
    rate: str
    force: str

    @property
    def coordinate(self) -> str:
        """Unit of r."""
        return self.error.removeprefix("m")

    @property
    def speed(self) -> str:
        """Unit of r_dot and s."""
        return self.rate.removeprefix("m")


CARTESIAN = Units("mm", "mm/s", "N")
JOINT = Units("mrad", "mrad/s", "N·m")
