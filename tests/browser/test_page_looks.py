"""Looks of the whole page: under every tab and in the presentation, in both themes and two sizes, nothing is cut,
covered or faint, and all text is drawn with the fonts of the page; axe-core finds nothing."""

from __future__ import annotations

import pytest
from playwright.sync_api import Page

from app.scenario.data import shipped
from app.session.commands import Load, Pause
from drivers.pages import VIEWPORT, PageSession, each_view
from tests.support.axe import violations
from tests.support.fonts import strangers
from tests.support.layout import faults, lasting, lasting_faults

_THEME = "document.documentElement.dataset.mantineColorScheme"
_FAINT_LINES = """
() => {
  const channel = (c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
  const light = (rgb) => rgb.reduce((sum, c, i) => sum + [0.2126, 0.7152, 0.0722][i] * channel(c / 255), 0);
  return Object.values(__viserTestpoints.uplots).flatMap(({ chart }) => chart.series.slice(1)
    .map((s, i) => s.stroke(chart, i + 1).match(/[0-9.]+/g).map(Number).slice(0, 3))
    .filter((rgb) => 1.05 / (light(rgb) + 0.05) < 3).map(String));
}
"""


def wrong(page: Page, *, by_axe: bool) -> list[str]:
    return lasting_faults(page) + (lasting(page, violations) if by_axe else []) + strangers(page)


# the size whose texts have least room, and a scenario with a formula, which has the most kinds of text
@pytest.mark.parametrize(
    ("theme", "size", "name"),
    [("light", VIEWPORT, "ur5-hybrid"), ("dark", {"width": 1920, "height": 1080}, "ur5-wave")],
)
def test_everything_is_seen_on_any_tab_and_in_the_presentation(
    session: PageSession, theme: str, size: dict[str, int], name: str
) -> None:
    page = session.page
    page.locator("canvas[data-engine][role=img]").wait_for()
    page.set_viewport_size({"width": size["width"], "height": size["height"]})
    session.runner.post(Load(shipped()[name]))
    session.wait(lambda now: now.scenario.name == name and now.t > 0.3)
    session.runner.post(Pause())  # what moves makes a look slow
    page.locator(".vs-status[data-phase=paused]").wait_for()
    if theme == "light":
        page.locator('[data-key="t"]').click()
    page.wait_for_function(f"{_THEME} === '{theme}'")
    try:
        if theme == "light":
            session.wait(lambda _: not page.evaluate(_FAINT_LINES))
        # axe-core goes through all nodes of the page each time, which takes as long as all else: in the other theme it
        # has the tab with a formula, and what is faint there is seen under every tab without it
        assert {
            view: found
            for view in each_view(page)
            if (found := wrong(page, by_axe=theme == "light" or "World" in view))
        } == {}
        page.keyboard.press("v")
        page.mouse.move(0, 0)  # from a symbol, whose tip is no region of its own
        assert lasting(page, violations) + strangers(page) == []
        page.keyboard.press("v")
    finally:
        if theme == "light":
            page.keyboard.press("t")
            page.wait_for_function(f"{_THEME} === 'dark'")
    # the look itself sees a title that is too long
    page.evaluate("document.querySelector('[role=tab][title=Controller] span').style.maxWidth = '2em'")
    assert any("Controller" in line for line in faults(page))
    page.evaluate("document.querySelector('[role=tab][title=Controller] span').style.maxWidth = ''")
