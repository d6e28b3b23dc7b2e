"""Units beside the controls."""

import pytest

from app.dashboard.widgets.fields.field_binding import FieldBinding
from app.scenario.units import CARTESIAN, JOINT, Units


@pytest.mark.parametrize(
    ("path", "label", "with_joints"),
    [
        ("motion.displacement", "by [m]", "by [rad]"),
        ("motion.period", "period [s]", "period [s]"),
        ("controller.layer", "layer s_b [m/s]", "layer s_b [rad/s]"),
        ("controller.K_s", "K_s [N·s/m]", "K_s [N·m·s/rad]"),
        ("controller.epsilon", "margin ε [N]", "margin ε [N·m]"),
        ("controller.F_1", "F_1 [1/s]", "F_1 [1/s]"),
        ("contact.K_e", "K_e [N/m]", "K_e [N/m]"),
        ("truth.push", "x, y, z [N]", "x, y, z [N]"),
        ("controller.F_2", "F_2", "F_2"),
    ],
)
def test_fields_measured_in_r_are_in_radians_where_r_is_the_joints(path: str, label: str, with_joints: str) -> None:
    assert FieldBinding(path).label_in(JOINT, label) == with_joints
    assert FieldBinding(path).label_in(CARTESIAN, label) == label


def test_fields_of_the_joints_are_in_the_units_of_the_joints() -> None:
    assert FieldBinding("declared.coulomb").label_in(Units("joint", "prismatic"), "Coulomb [N·m]") == "Coulomb [N]"
    viscous = FieldBinding("truth.viscous")
    assert viscous.label_in(Units("joint", "mixed"), "viscous [N·m·s]") == "viscous [N·m·s, N·s]"
    moment = FieldBinding("sensor.moment_bias")
    assert moment.label_in(Units("cartesian", "prismatic"), "bias [N·m]") == "bias [N·m]"


def test_a_label_without_a_unit_and_one_that_is_of_no_field_stay() -> None:
    assert FieldBinding("target_model.K_m").label_in(Units("joint", "prismatic"), "K_m 1") == "K_m 1"
    assert FieldBinding("target_model").label_in(JOINT, "ω [rad/s]") == "ω [rad/s]"
