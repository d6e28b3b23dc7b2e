"""The glossary of the page: complete sentences, equations as in docs/symbols.md, values of the run."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from html import unescape
from pathlib import Path

import pytest

from app.analysis.glossary import GLOSSARY
from app.dashboard.widgets.theorem.symbols import values_html
from app.scenario.data import edited, load
from app.session.headless_run import simulate
from app.session.snapshot import snapshot_of

SYMBOLS = Path(__file__).parents[2] / "docs" / "symbols.md"
BY_NAME = {symbol.written: symbol for symbol in GLOSSARY}


def test_equations_are_those_of_the_table_of_symbols() -> None:
    rows = [line.strip("|").split("|") for line in SYMBOLS.read_text(encoding="utf-8").splitlines() if "| (" in line]
    cited = {name.strip(): re.findall(r"\(\d+\)", row[5]) for row in rows for name in row[0].split(",")}
    compared = [symbol for symbol in GLOSSARY if symbol.written in cited and symbol.written != "z"]  # here a coordinate
    assert len(compared) > 15
    for symbol in compared:
        assert symbol.equation in cited[symbol.written], symbol.written


def test_every_symbol_has_a_sentence_in_words_and_no_name_stands_twice() -> None:
    names = [name for symbol in GLOSSARY for name in (symbol.written, *symbol.also)]
    assert len(set(names)) == len(names)
    for symbol in GLOSSARY:
        assert 10 < len(symbol.meaning) < 110, symbol.written
        assert not re.search(r"\w\w_|_\w{4}|\|\||`", symbol.meaning), symbol.meaning


def test_every_signal_of_the_glossary_has_a_present_value_at_the_end_and_when_looking_back() -> None:
    loop, _ = simulate(edited(load("ur5-hybrid"), "simulation.duration", 0.2))
    snapshot = snapshot_of(loop)
    signals = {symbol.written for symbol in GLOSSARY if symbol.signal and symbol.where(loop.system)}
    assert {symbol.written for symbol in GLOSSARY if symbol.signal} - signals == {"φ₂", "φ₃", "λ₂", "λ₃"}
    for t in (snapshot.t, 0.1):
        values = json.loads(unescape(values_html(replace(snapshot, t=t)).split('"')[3]))
        assert signals <= values.keys(), signals - values.keys()


@pytest.mark.parametrize(("space", "unit"), [("cartesian", "mm"), ("joint", "mrad")])
def test_values_are_those_of_the_run_in_the_units_of_the_page(space: str, unit: str) -> None:
    scenario = edited(edited(load("planar3r-hybrid"), "simulation.duration", 0.2), "controller.layer", 0.02)
    if space == "joint":
        scenario = edited(edited(load("ur5-motion"), "simulation.duration", 0.2), "task_space.kind", "joint")
    loop, _ = simulate(scenario)
    rows = loop.recording.signals(tuple(loop.recording.columns))
    row = {name: values[-1] for name, values in rows.items()}
    model = {name: getattr(loop.system.controller.model, name) for name in ("M_m", "B_m", "K_m", "K_f")}

    def value_of(name: str) -> str:
        return BY_NAME[name].value(row, loop.system, model)

    *errors, of = value_of("e_r").replace(",", "").replace("−", "-").split()
    assert of == unit
    assert [float(error) for error in errors] == pytest.approx(list(1e3 * row["e_r"]), rel=6e-3, abs=1e-6)
    assert value_of("‖s‖").endswith(f" {unit}/s")
    layer, of = value_of("layer s_b").split()
    assert (float(layer), of) == (scenario.controller.layer, f"{unit[1:]}/s")
    assert value_of("K_m").removesuffix(", each").endswith("N·m/rad" if space == "joint" else "N/m")
    assert value_of("(8)") == ""
