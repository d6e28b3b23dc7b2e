"""Units in which the page and the tables show quantities of the task space."""

from __future__ import annotations

from typing import NamedTuple


class Units(NamedTuple):
    """Units of a task space: of a thousandth of r, of a thousandth of r_dot or s, and of a generalised force such as
    d."""

    error: str
    rate: str
    force: str


CARTESIAN = Units("mm", "mm/s", "N")
JOINT = Units("mrad", "mrad/s", "N·m")
