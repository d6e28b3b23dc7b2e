"""Table of the theorem's constants: declared, found and used ones are those that the gain and the bound use."""

from __future__ import annotations

import re

import pytest

from app.dashboard.widgets.theorem.constants_table import constants_html
from app.scenario.data import edited, load
from app.scenario.schema import Declared
from app.session.snapshot import snapshot_of
from app.simulation.closed_loop import ClosedLoop
from app.simulation.omega.domain import MARGIN


def rows(scenario: str, **changes: object) -> dict[str, list[str]]:
    chosen = load(scenario)
    for path, value in changes.items():
        chosen = edited(chosen, path.replace("__", "."), value)
    html = constants_html(snapshot_of(ClosedLoop.from_scenario(chosen, history=1)))
    lines = re.findall(r"<tr title=.*?</tr>", html)
    cells = [re.findall(r"<td>(.*?)</td>", line) for line in lines]
    return {name: rest for name, *rest in cells}


def test_declared_bounds_are_used_as_they_are_and_found_ones_with_their_margin() -> None:
    shown = rows("ur5-hybrid", declared__payload_mass=1.5)
    constants = ClosedLoop.from_scenario(
        edited(load("ur5-hybrid"), "declared.payload_mass", 1.5), history=1
    ).system.constants
    assert shown["link scaling"] == ["0.15", "—", "0.15", ""]
    assert shown["payload mass"] == ["1.5", "—", "1.5", "kg"]
    stated = ("delta_M", "delta_C", "delta_G", "delta_f", "least_inertia")  # shown where they are
    assert len(shown) == len(Declared.__struct_fields__) - len(stated) + 3
    low, high = shown["k_r′"], shown["k_r″"]
    assert float(low[1]) == pytest.approx(constants.k_r_low * MARGIN, rel=1e-3)
    assert float(low[2]) < float(low[1]) < float(high[1]) < float(high[2])
    assert "k_M" not in shown


def test_what_only_remark_3_needs_is_shown_there_only() -> None:
    shown = rows("ur5-motion", controller__estimates="along-reference")
    assert {"k_M", "k_Cq", "k_G", "k_C"} <= shown.keys()
    assert shown["k_r′"][-1] == "kg"
    assert rows("ur5-motion", task_space__kind="joint")["k_r′"][-1] == "kg·m²"


def test_stated_bounds_are_shown_with_their_present_value_and_rates_where_links_are_in_doubt() -> None:
    shown = rows("planar3r-hybrid", declared__delta_C="2 + 3*speed", declared__link_shape=0.1)
    assert shown["δ_C"] == ["2 + 3*speed", "—", "—", "kg·m²/s"]  # before the first period
    assert {"k_Cc", "k_Ccc", "k_CI"} <= shown.keys()
    assert "δ_M" not in shown
