"""Titles of varied fields: the page's words on every map and figure, never a raw name of the file format."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from app.scenario.data import shipped, to_plain
from app.scenario.units import CARTESIAN, JOINT
from app.sweep.titles import named, title_of, value_in_words


@pytest.mark.parametrize(
    ("path", "title"),
    [
        ("truth.link_scaling", "mass of the true links, factor"),
        ("controller.layer", "boundary layer [m/s]"),
        ("second.contact.K_e", "stiffness of the surface (second surface) [N/m]"),
        ("declared.link_scaling", "links 1 ± (declared)"),
        ("truth.rotor_scaling", "factor on every joint's rotor inertia (true arm)"),
        ("truth.torque_limit", "largest torque of the drives (true arm)"),
        ("target_model.K_m.2", "stiffness of the target model (8), entry 2 [N/m]"),
        ("blend.to.K_m.2.3", "stiffness of the target model (8) (blend), entry 2, 3 [N/m]"),
        ("rotation.period", "time of one turn (desired rotation) [s]"),
        ("controller.own.mine.gain", "controller.own.mine.gain"),
    ],
)
def test_a_field_has_the_words_of_the_page_and_its_unit(path: str, title: str) -> None:
    assert named(path, CARTESIAN) == title


@pytest.mark.parametrize(
    ("path", "title"),
    [
        ("controller.layer", "boundary layer [rad/s]"),
        ("target_model.K_m.2", "stiffness of the target model (8), entry 2 [N·m/rad]"),
        ("blend.to.K_m.2.3", "stiffness of the target model (8) (blend), entry 2, 3 [N·m/rad]"),
        ("truth.viscous", "viscous friction per joint (true arm) [N·m·s/rad]"),
    ],
)
def test_where_r_is_the_joints_a_field_has_another_unit(path: str, title: str) -> None:
    assert named(path, JOINT) == title


def test_a_value_is_in_words_too() -> None:
    assert value_in_words("controller.law", "vsmrc") == "robust (25)"
    assert value_in_words("controller.law", "of-my-own") == "of-my-own"
    assert value_in_words("contact.K_e", 12345.678) == "12300"
    assert value_in_words("truth.torque_limit", 0.0) == "none"


def paths_of(table: dict[str, Any], before: str = "") -> Iterator[str]:
    """Paths of all numbers of a scenario."""
    for name, value in table.items():
        if isinstance(value, dict):
            yield from paths_of(value, f"{before}{name}.")
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield f"{before}{name}"


def test_no_number_of_a_shipped_scenario_shows_its_raw_name_and_no_two_have_the_same_title() -> None:
    for name, scenario in shipped().items():
        paths = list(paths_of(to_plain(scenario)))
        titles = [title_of(path) for path in paths]
        assert not [
            title
            for title, path in zip(titles, paths, strict=True)
            if path in title
            or "_"
            in title.replace("J_q", "").replace("K_s", "").replace("F_1", "").replace("M_hat", "").replace("δ_M", "")
        ], name
        assert len(set(titles)) == len(titles), name
