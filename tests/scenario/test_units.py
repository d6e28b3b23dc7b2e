"""Units of quantities of revolute and prismatic joints."""

from __future__ import annotations

import pytest

from app.scenario.field_info import field_info
from app.scenario.units import ANGULAR, CARTESIAN, JOINT, JointKinds, Units, kinds_of, listed


def test_revolute_joints_have_the_units_of_angles_and_prismatic_ones_those_of_lengths() -> None:
    for linear, angular in ANGULAR.items():
        assert (CARTESIAN.of_r(linear), JOINT.of_r(linear)) == (linear, angular)
        assert Units("joint", "prismatic").of_r(linear) == linear
        assert Units("joint", "mixed").of_r(linear) == f"{angular} and {linear}"
        assert [Units(joints=kinds_of(of)).of_joints(angular) for of in ((False,), (True,))] == [angular, linear]
    for units in (CARTESIAN, JOINT, Units("cartesian", "mixed")):
        assert [units.of_joints(unit) for unit in ("s", "1", "")] == ["s", "1", ""]
    assert Units("cartesian", "mixed").of_joints("kg·m²/rad") == "SI"  # of no single joint


@pytest.mark.parametrize(
    ("joints", "unit"), [("revolute", "N·m·s/rad"), ("prismatic", "N·s/m"), ("mixed", "N·m·s/rad and N·s/m")]
)
def test_fields_of_the_joints_have_the_units_of_the_joints(joints: JointKinds, unit: str) -> None:
    for section in ("truth", "declared"):
        assert field_info(f"{section}.viscous").unit_in(Units("cartesian", joints)) == unit
    assert field_info("sensor.moment_bias").unit_in(Units("cartesian", joints)) == "N·m"


def test_lengths_of_a_path_are_of_r_but_those_of_a_rotation_are_angles_of_the_tool() -> None:
    for joints, unit in (("revolute", "rad"), ("prismatic", "m")):
        assert field_info("motion.displacement").unit_in(Units("joint", joints)) == unit
        assert field_info("rotation.displacement").unit_in(Units("joint", joints)) == "rad"
    assert field_info("motion.displacement").unit_in(CARTESIAN) == "m"


def test_numbers_of_joints_of_one_kind_have_their_unit_once() -> None:
    assert listed(["1", "2"], "N·m", (False, False)) == "1, 2 N·m"
    assert listed(["1", "2"], "N·m", (True, True)) == "1, 2 N"
    assert listed(["1", "2"], "N·m", (True, False)) == "1 N, 2 N·m"
