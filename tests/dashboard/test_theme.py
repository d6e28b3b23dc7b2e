"""Colours that can be read in both themes; keys, commands and help that say the same."""

import asyncio
import re
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from app.dashboard.theme.colors import EDGE, INKS, MEASURED, PAGE, SERIES, Rgb, css, css_variables, line_css, on_white
from app.dashboard.theme.style import MARKS
from app.dashboard.widgets.fields.controls import Desk
from app.dashboard.widgets.page.help import DOCUMENTS, help_html
from app.dashboard.widgets.page.shortcuts import Shortcuts
from app.scenario.data import shipped
from app.session.commands import BeginScenario, Edit
from controllers.modes import MODES
from drivers.pages import _ROWS
from tests.support.desks import Posted

ROOT = Path(__file__).parents[2]
THEMES = ("dark", "light")


def contrast(one: Rgb, other: Rgb) -> float:
    """Contrast of two colours, 1 to 21, as WCAG 2.1 defines it; text needs 4.5, lines 3."""
    low, high = sorted((_luminance(one), _luminance(other)))
    return (high + 0.05) / (low + 0.05)


def _luminance(color: Rgb) -> float:
    channels = [c / 255 for c in color]
    r, g, b = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels)
    return 0.2126 * r + 0.7152 * g + 0.0722 * b


def test_contrast_is_that_of_wcag():
    assert contrast((0, 0, 0), (255, 255, 255)) == pytest.approx(21.0)
    assert contrast((9, 9, 9), (9, 9, 9)) == 1.0
    # the greys that the standard's own examples call just enough and just not enough on white
    assert contrast((118, 118, 118), (255, 255, 255)) == pytest.approx(4.54, abs=0.01)
    assert contrast((255, 255, 255), (119, 119, 119)) == pytest.approx(4.48, abs=0.01)


@pytest.mark.parametrize("theme", THEMES)
def test_every_ink_can_be_read_on_the_page_and_on_its_own_ground(theme):
    for name, ink in INKS[theme].items():
        assert contrast(ink.text, PAGE[theme]) >= 4.5, name
        assert contrast(ink.text, ink.ground(PAGE[theme])) >= 4.5, name


@pytest.mark.parametrize("theme", THEMES)
def test_borders_of_buttons_are_seen(theme):
    assert contrast(EDGE[theme], PAGE[theme]) >= 3.0


def test_lines_of_plots_are_seen_on_the_dark_page():
    assert min(contrast(color, PAGE["dark"]) for color in SERIES) >= 3.0


def test_lines_of_pictures_are_seen_on_the_light_page_and_stay_apart():
    dark, light = css_variables().strip().split("\n")
    inks = {color: on_white(color) for color in (*SERIES, MEASURED)}
    assert min(contrast(ink, PAGE["light"]) for ink in inks.values()) >= 3.0
    assert len({*inks.values()}) == len(inks)
    for color, ink in inks.items():
        name = line_css(color).removeprefix("var(").removesuffix(")")
        assert f"{name}: {css(color)};" in dark
        assert f"{name}: {css(ink)};" in light


def test_every_variable_of_the_style_sheet_has_a_value_in_both_themes():
    dark, light = css_variables().strip().split("\n")
    used = {
        word.partition(")")[0]
        for name in ("page.css", "phone.css")
        for word in (ROOT / "static" / "page" / name).read_text(encoding="utf-8").split("var(")[1:]
    }
    for name in used:
        assert name.startswith("--mantine") or "," in name or (f"{name}:" in dark and f"{name}:" in light), name


@dataclass
class _Gui:
    """Takes commands as viser's does, and triggers them by hotkey or label."""

    commands: dict[str, Any] = field(default_factory=dict)

    def add_command(self, label: str, description: str = "", hotkey: str | None = None) -> Any:
        del description
        return SimpleNamespace(on_trigger=lambda f: self.commands.update({hotkey or label: f}))

    def trigger(self, name: str) -> None:
        asyncio.run(self.commands[name](None))


@pytest.fixture
def desk() -> tuple[_Gui, list[Any]]:
    gui, posted = _Gui(), Posted()
    now = SimpleNamespace(scenario=shipped()["ur5-hybrid"])
    Shortcuts(cast(Desk, SimpleNamespace(gui=gui, post=posted.post, snapshot=lambda: now)))
    return gui, posted


def test_digits_choose_the_modes_in_their_order(desk):
    gui, posted = desk
    for digit in "12345":
        gui.trigger(digit)
    assert posted == [Edit("mode", mode) for mode in MODES]


def test_every_shipped_scenario_is_a_command(desk):
    gui, posted = desk
    for scenario in shipped().values():
        gui.trigger(f"Scenario: {scenario.title}")
    assert posted == [BeginScenario(scenario) for scenario in shipped().values()]


def test_help_names_modes_by_their_number_and_documents_that_exist():
    text = help_html().lower()
    for digit, title in enumerate((mode.label for mode in MODES.values()), start=1):
        assert f"<kbd>{digit}</kbd></td><td>{title.lower()}" in text
    assert all((ROOT / name).is_file() for name in DOCUMENTS)


def test_the_page_s_scripts_and_the_tests_driver_know_the_marks_of_texts() -> None:
    """The scripts write the characters, the driver takes them off what it reads."""
    page = resources.files("static.page")
    rows, menu = (page.joinpath(name).read_text("utf-8") for name in ("rows.js", "rowmenu.js"))
    written = {chr(int(code, 16)) for code in re.findall(r'"\\u([0-9a-f]{4})"', rows + menu)}
    assert written == set(MARKS)
    taken_off = re.search(r"const MARKS = /(\[.*?\])/g", rows)
    assert taken_off is not None
    driver = re.search(r"replace\(/(\[.*?\])/g", _ROWS)
    assert driver is not None
    for characters in (taken_off[1], driver[1]):
        assert re.sub(characters, "", "".join(MARKS)) == ""
