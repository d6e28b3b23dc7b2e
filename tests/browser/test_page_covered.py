"""Controls that can be pressed: at every size of the window, width of a dock and zoom, and in the presentation."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from playwright.sync_api import Page, expect

from app.dashboard.page import Dashboard
from app.session.commands import Pause
from app.session.runner import Runner
from drivers.pages import PageSession, resting_box
from tests.support.layout import lasting

# Controls that something else would take the press of, each after it was scrolled into view: name and what lies there.
COVERED = """() => {
  const controls = [...document.querySelectorAll(
    "button, [role=tab], [role=button], [role=combobox], [role=slider], .mantine-Input-input, input[type=checkbox]")];
  const faults = [], SLIDER = ".mantine-Slider-root";
  let seen = 0;
  for (const control of controls) {
    if (!control.checkVisibility({ opacityProperty: true, visibilityProperty: true })) continue;
    if (control.closest(".uplot-container") && !control.matches(".u-label")) continue; // shown under the mouse
    control.scrollIntoView({ block: "nearest", inline: "nearest" });
    const box = control.getBoundingClientRect();
    if (box.width < 1 || box.height < 1) continue;
    seen += 1;
    const label = (e) => e?.ariaLabel || e?.textContent?.trim().slice(0, 40) || e?.className || "the window's edge";
    // over and under the scene nothing may lie on a part of one, either
    const outside = control.matches(".vs-timeline *, .vs-acts *, .vs-legend-button, .vs-coarse-button");
    for (const down of outside ? [0.15, 0.5, 0.85] : [0.5]) {
      const there = document.elementFromPoint(box.x + box.width / 2, box.y + box.height * down);
      const own = there && (control.contains(there) || (control.matches("[role=slider]") && there.closest(SLIDER)));
      if (own) continue;
      faults.push(`${label(control)} is under ${label(there)}`);
      break;
    }
  }
  return seen ? faults : ["no control is visible"];
}"""
SIZES = ((1024, 768), (1280, 720), (1920, 1080), (853, 480), (390, 844))  # 853 x 480 is 1280 x 720 at 150 %


def require_nothing_covered(session: PageSession, where: str) -> None:
    """Nothing is covered once the page has been laid out."""
    assert lasting(session.page, lambda page: page.evaluate(COVERED)) == [], where


def drag_dock(session: PageSession, side: str, to: float) -> None:
    """Pull the edge of a dock to this place of the window, px."""
    box = resting_box(session.page.locator(f"[data-dock-region-resize={side}]"))
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] * 0.7
    session.page.mouse.move(x, y)
    session.page.mouse.down()
    session.page.mouse.move(to, y, steps=4)
    session.page.mouse.up()


@pytest.mark.usefixtures("spent_page")
def test_no_control_is_covered_at_any_size_and_dock_width(session: PageSession):
    page = session.page
    session.runner.post(Pause())  # what moves makes a look slow
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        require_nothing_covered(session, f"{width} x {height}")
    page.set_viewport_size({"width": 1280, "height": 720})
    for left, right in ((250, 800), (560, 900), (620, 860)):
        drag_dock(session, "left", left)
        drag_dock(session, "right", right)
        require_nothing_covered(session, f"docks to {left} and {right} of 1280")


@pytest.mark.usefixtures("from_the_start")
@pytest.mark.parametrize(("width", "height"), [(1024, 768), (768, 1024), (844, 390), (390, 844)])
def test_no_control_is_covered_under_a_finger(
    width: int, height: int, served: tuple[Dashboard, Runner], open_page: Callable[..., Page]
):
    """A tablet and a phone, both ways, also in the presentation."""
    dashboard, runner = served
    page = open_page(dashboard.url, viewport={"width": width, "height": height}, is_mobile=True, has_touch=True)
    page.locator(".uplot").first.wait_for()
    runner.post(Pause())
    page.locator(".vs-status[data-phase=paused]").wait_for(state="attached")
    assert lasting(page, lambda page: page.evaluate(COVERED)) == []
    if width > 1000:
        page.keyboard.press("v")
        page.locator("html[data-stage]").wait_for()
        assert lasting(page, lambda page: page.evaluate(COVERED)) == []


def fold(page: Page, press: Callable[[], None]) -> None:
    """Fold the controls away, which a press does at once; again where the handle was drawn anew between focus and
    key, or between press and release."""
    for _ in range(20):
        press()
        if page.locator("html[data-folded]").count():
            return
    raise AssertionError("the controls cannot be folded away")


@pytest.mark.usefixtures("spent_page")
def test_controls_that_are_folded_away_leave_timeline_buttons_and_style(session: PageSession):
    """viser takes down what it collapses. By mouse and by key; a plot is then enlarged over the whole window."""
    page = session.page
    handle = page.locator('[data-dock-region-collapse="right"]')
    scene, title = page.locator("canvas[data-engine]"), page.locator(".u-title:visible").first
    before = title.evaluate("(e) => getComputedStyle(e).fontFamily")
    plot = page.locator(".uplot-container:visible").first
    for by in (handle.click, lambda: handle.press("Enter")):
        fold(page, by)
        page.wait_for_function("document.querySelector('canvas[data-engine]').getBoundingClientRect().right > 1240")
        expect(handle).to_have_attribute("aria-expanded", "false")
        for kept in (".vs-timeline", ".vs-acts button", ".vs-legend-button"):
            expect(page.locator(kept).first).to_be_visible()
        expect(page.get_by_role("tab", name="Task", exact=True)).to_be_hidden()
        assert title.evaluate("(e) => getComputedStyle(e).fontFamily") == before
        require_nothing_covered(session, "folded")
        page.get_by_role("button", name="step", exact=True).click()
        session.wait(lambda now: now.phase == "paused")
        plot.hover()
        plot.locator(".mantine-ActionIcon-root").click()
        page.wait_for_function("document.querySelector('[data-large]')?.getBoundingClientRect().width > 1150")
        page.keyboard.press("Escape")
        page.mouse.click(1268, 400)  # the strip that is left of them
        expect(page.get_by_role("tab", name="Task", exact=True)).to_be_visible()
        expect(handle).to_have_attribute("aria-expanded", "true")
    expect(scene).to_be_visible()


@pytest.mark.usefixtures("spent_page")
def test_the_presentation_has_the_sliders_moved_last_of_any_tab_and_covers_nothing(session: PageSession):
    page = session.page
    session.choose("Scenario", "Panda presses, elbow angle added (Remark 5)")
    session.wait(lambda now: len(now.coordinates) == 7)
    session.runner.post(Pause())
    for tab, label in (
        ("Task", "F_d [N]"),
        ("Controller", "K_s [N·s/m]"),
        ("Robot", "Coulomb [N·m]"),
        ("Robot", "viscous [N·m·s]"),
    ):
        session.tab(tab)
        session.row(label).first.locator(".mantine-Slider-root").click(position={"x": 30, "y": 4})
        page.locator("div:has(> .vs-chosen) ~ form", has=page.get_by_text(label, exact=True)).wait_for(state="attached")
        page.locator("form[data-held]").wait_for(state="detached")
    session.tab("View")
    page.keyboard.press("v")
    chosen = page.locator("form[data-staged]:visible label:not(:empty)")
    expect(chosen).to_have_text(["K_s [N·s/m]", "Coulomb [N·m]", "viscous [N·m·s]"])
    expect(page.locator("form:has(.mantine-Slider-root):visible")).to_have_count(4)  # these, and the time
    for width, height in SIZES[:-1]:
        page.set_viewport_size({"width": width, "height": height})
        require_nothing_covered(session, f"the presentation at {width} x {height}")
        page.wait_for_function("""() => {
          const math = document.querySelector(".vs-equation math"), box = math?.getBoundingClientRect();
          const scene = document.querySelector("canvas[data-engine]").getBoundingClientRect();
          return box && math.scrollWidth <= math.clientWidth + 1 && math.scrollHeight <= math.clientHeight + 1
            && box.left >= 0 && (box.top >= scene.bottom - 1 || box.left >= scene.right - 1)
            && box.bottom <= innerHeight && scene.height > 150
            && document.querySelector(".vs-equation").textContent.includes("q₃");
        }""")  # the equation is whole and beside the scene
    session.enter("Coulomb [N·m]", "2.5")
    session.wait(lambda now: now.scenario.truth.coulomb == 2.5)
