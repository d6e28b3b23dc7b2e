"""Units of quantities of the joints and of the task space, as the page, the tables and the files show them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import Literal, NamedTuple

from app.scenario.number_text import rounded
from parameters import UnitsOf

# units of lengths and of what belongs to them, and those of the same quantities of angles
ANGULAR = {"m": "rad", "mm": "mrad", "m/s": "rad/s", "mm/s": "mrad/s", "m/s^2": "rad/s^2", "N": "N·m", "N/s": "N·m/s",
           "N·s/m": "N·m·s/rad", "N/m": "N·m/rad", "kg": "kg·m²", "kg/s": "kg·m²/s"}  # fmt: skip
LINEAR = {angular: linear for linear, angular in ANGULAR.items()} | {"N·m·s": "N·s"}
_COMPOUND = ("kg·m²/rad", "kg·m/rad", "kg/rad")  # of constants for a change of all joints at once

SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")

JointKinds = Literal["revolute", "prismatic", "mixed"]


def kinds_of(slides: Collection[bool]) -> JointKinds:
    """Kinds of joints among these. slides: whether each is prismatic."""
    if any(slides):
        return "prismatic" if all(slides) else "mixed"
    return "revolute"


def indexed(symbol: str, number: int) -> str:
    """Symbol with a number as its index: τ₂."""
    return symbol + str(number).translate(SUBSCRIPTS)


def unit_of_joint(unit: str, *, slides: bool) -> str:
    """Unit of a quantity of one joint. unit: of a revolute one."""
    return LINEAR.get(unit, unit) if slides else unit


def listed(numbers: Iterable[str], unit: str, slides: Sequence[bool], between: str = ", ") -> str:
    """Numbers of the joints with their units, which stand once where all joints are of a kind. unit: of a revolute
    joint. between: what stands between two numbers."""
    units = [unit_of_joint(unit, slides=each) for each in slides]
    if len(set(units)) == 1:
        return f"{between.join(numbers)} {units[0]}"
    return between.join(f"{number} {each}" for number, each in zip(numbers, units, strict=True))


class Units(NamedTuple):
    """Units in a task space of an arm.
    task: whether r comes from the tool's pose, in metres, or r = q.
    joints: kinds of joints that the arm has."""

    task: Literal["cartesian", "joint"] = "cartesian"
    joints: JointKinds = "revolute"

    def of_joints(self, unit: str) -> str:
        """Unit of a number or a list of all joints, both units where there are joints of both kinds. unit: of revolute
        joints."""
        if unit in _COMPOUND:
            return unit if self.joints == "revolute" else "SI"
        units = (unit,) if self.joints == "revolute" else (LINEAR.get(unit, unit),)
        return " and ".join(dict.fromkeys((unit, *units) if self.joints == "mixed" else units))

    def of_r(self, unit: str) -> str:
        """Unit of a quantity of r. unit: where r is in metres."""
        return self.of_joints(ANGULAR.get(unit, unit)) if self.task == "joint" else unit

    def of_kind(self, kind: UnitsOf, unit: str) -> str:
        """Unit of a quantity of this kind, "" for one whose unit is the same for all arms. unit: of an arm of revolute
        joints, where r is in metres."""
        match kind:
            case "joints":
                return self.of_joints(unit)
            case "r":
                return self.of_r(unit)
            case "J_q":
                return self.jacobian
            case "":
                return unit

    def with_unit(self, number: float, unit: str) -> str:
        """Number of all joints with its unit. unit: of revolute joints."""
        return f"{rounded(number, 4)} {self.of_joints(unit)}".rstrip()

    @property
    def jacobian(self) -> str:
        """Unit of J_q, "1" for none."""
        return "1" if self.task == "joint" else {"revolute": "m", "prismatic": "1", "mixed": "m and 1"}[self.joints]

    @property
    def error(self) -> str:
        """Unit of a thousandth of r."""
        return self.of_r("mm")

    @property
    def rate(self) -> str:
        """Unit of a thousandth of r_dot or s."""
        return self.of_r("mm/s")

    @property
    def force(self) -> str:
        """Unit of a generalised force, such as d."""
        return self.of_r("N")

    @property
    def of_model(self) -> dict[str, str]:
        """Units of the target model's matrices by name; "" for K_f, which has none."""
        return {"M_m": self.of_r("kg"), "B_m": self.of_r("N·s/m"), "K_m": self.of_r("N/m"), "K_f": ""}


CARTESIAN = Units()
JOINT = Units("joint")
