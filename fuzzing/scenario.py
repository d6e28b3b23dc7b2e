"""Fuzzing of uploaded TOML files, and of a field that is set to anything that a page may type."""

from contextlib import suppress

from app.dashboard.widgets.fields.matrix_text import read_back
from app.scenario.data import edited, from_file, load, shipped, to_toml
from app.scenario.errors import ScenarioError

SEEDS = tuple(to_toml(scenario).encode() for scenario in shipped().values())
DICTIONARY = ("[motion]", 'kind = "', "nan", "inf", "1e999", "1979-05-27", "[[1, 2]]", "formula", "\\u0000", "{}", ".")
BASE = load("ur5-hybrid")


def read(data: bytes) -> None:
    with suppress(ScenarioError):
        scenario = from_file(data)
        assert from_file(to_toml(scenario).encode()) == scenario
    with suppress(ScenarioError, UnicodeDecodeError, ValueError):
        path, _, value = data.decode().partition("=")
        edited(BASE, path, read_back(value))
