"""Units beside the controls."""

import pytest

from app.scenario.units import CARTESIAN, JOINT, label_in


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
    assert label_in(JOINT, path, label) == with_joints
    assert label_in(CARTESIAN, path, label) == label
