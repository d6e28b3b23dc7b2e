"""Units of quantities of the task space, as the page and the tables show them."""

from __future__ import annotations

from typing import NamedTuple


class Units(NamedTuple):
    """Units of a task space: of a thousandth of r, of a thousandth of r_dot or s, of a generalised force such as d, and
    of the target model's matrices."""

    error: str
    rate: str
    force: str
    M_m: str
    B_m: str
    K_m: str
    K_f: str = ""

    @property
    def of_model(self) -> dict[str, str]:
        """Units of the target model's matrices by name; "" for K_f, which has none."""
        return {"M_m": self.M_m, "B_m": self.B_m, "K_m": self.K_m, "K_f": self.K_f}


CARTESIAN = Units("mm", "mm/s", "N", "kg", "N·s/m", "N/m")
JOINT = Units("mrad", "mrad/s", "N·m", "kg·m²", "N·m·s/rad", "N·m/rad")

# fields whose unit depends on that of r, and that unit where r = q
OF_R = ("motion.", "shift.by", "controller.layer", "controller.K_s", "controller.d", "controller.epsilon",
        "controller.z_0")  # fmt: skip
WITH_JOINTS = {"m": "rad", "m/s": "rad/s", "N": "N·m", "N·s/m": "N·m·s/rad"}


def unit_in(units: Units, path: str, unit: str) -> str:
    """Unit of a field in a task space with these units. unit: where r is in metres."""
    section, _, name = path.rpartition(".")
    if section in ("target_model", "blend.to") and name in units.of_model:
        return units.of_model[name]
    return WITH_JOINTS.get(unit, unit) if units == JOINT and path.startswith(OF_R) else unit


def label_with_joints(path: str, label: str) -> str:
    """Label of a field's control where r = q. label: where r is in metres, with its unit in brackets."""
    words, _, unit = label.removesuffix("]").rpartition(" [")
    if not path.startswith(OF_R) or unit not in WITH_JOINTS:
        return label
    return f"{words} [{WITH_JOINTS[unit]}]"
