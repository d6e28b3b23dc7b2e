"""Units of quantities of the task space, as the page and the tables show them."""

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

# fields whose unit depends on that of r, and that unit where r = q
OF_R = ("motion.", "shift.by", "controller.layer", "controller.K_s", "controller.d", "controller.epsilon",
        "controller.z_0")  # fmt: skip
WITH_JOINTS = {"m": "rad", "m/s": "rad/s", "N": "N·m", "N·s/m": "N·m·s/rad"}


def label_with_joints(path: str, label: str) -> str:
    """Label of a field's control where r = q. label: where r is in metres, with its unit in brackets."""
    words, _, unit = label.removesuffix("]").rpartition(" [")
    if not path.startswith(OF_R) or unit not in WITH_JOINTS:
        return label
    return f"{words} [{WITH_JOINTS[unit]}]"
