"""Present values that the page's symbols tell: only of what is there; and a symbol for every coordinate."""

from __future__ import annotations

import json
from html import unescape

import pytest

from app.analysis.glossary import GLOSSARY
from app.dashboard.widgets.theorem.symbols import values_html
from app.scenario.data import edited, load, shipped
from app.session.snapshot import snapshot_of
from app.simulation.closed_loop import ClosedLoop

TOUCH = {"φ", "λ", "K_e", "B_e", "K̂_e"}
ROBUST = {"d", "(17)", "s", "‖s‖", "ε", "K_s", "F_1", "F_2", "A", "layer s_b"}


def told(name: str, changes: dict[str, object]) -> dict[str, str]:
    """Present values after the first periods of a shipped scenario with these values by path."""
    scenario = load(name)
    for path, value in changes.items():
        scenario = edited(scenario, path, value)
    loop = ClosedLoop.from_scenario(scenario)
    for _ in range(5):
        loop.step()
    return json.loads(unescape(values_html(snapshot_of(loop)).split('"')[3]))


@pytest.mark.parametrize(
    ("name", "changes", "there", "absent"),
    [
        ("ur5-hybrid", {}, TOUCH | ROBUST, {"φ₂", "λ₂", "φ₃", "λ₃", "K_t", "K̂_t"}),
        ("ur5-hybrid", {"controller.law": "computed-torque"}, TOUCH | {"τ", "e_r"}, ROBUST | {"(20)", "band"}),
        ("ur5-hybrid", {"controller.switching": "discontinuous"}, ROBUST - {"layer s_b"}, {"layer s_b"}),
        ("ur5-motion", {}, ROBUST | {"e_r", "ℓ"}, TOUCH),
        ("ur5-joint", {}, ROBUST | {"q"}, {"ℓ"}),
        ("ur5-corner", {}, TOUCH | {"φ₂", "λ₂"}, {"φ₃", "λ₃"}),
        ("panda-align", {}, TOUCH | {"K_t", "K̂_t"}, {"φ₂", "λ₂"}),
    ],
)
def test_only_what_is_there_has_a_present_value(
    name: str, changes: dict[str, object], there: set[str], absent: set[str]
) -> None:
    values = told(name, changes)
    assert there <= values.keys(), there - values.keys()
    assert not absent & values.keys()


@pytest.mark.parametrize("name", list(shipped()))
def test_every_coordinate_explains_itself(name: str) -> None:
    known = {each for symbol in GLOSSARY for each in (symbol.written, *symbol.also)}
    names = [each.name for each in snapshot_of(ClosedLoop.from_scenario(load(name))).coordinates]
    assert {each if each in known else each.removeprefix("ℓ·") for each in names} <= known
