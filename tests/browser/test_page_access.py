"""Page for those who hear it, go through it by keyboard, touch it, or see colours otherwise."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from itertools import combinations
from pathlib import Path

import pytest
from coloraide import Color
from coloraide.everything import ColorAll
from playwright.sync_api import Browser, Locator, Page, expect

from app.dashboard.page import Dashboard
from app.dashboard.plots.charts import ChartLine, Drawing, Setup
from app.dashboard.plots.pinned_runs import RunLook, lines_of_run
from app.dashboard.plots.plot_table import TABS
from app.dashboard.theme.colors import RUN_DASHES, RUNS, css
from app.scenario.data import shipped
from app.session.commands import Edit, Pause
from app.session.runner import Runner
from drivers.pages import PHONE, PageSession, resting_box, wait_without_notice
from drivers.waiting import until
from tests.support.axe import violations
from tests.support.layout import lasting

APART = 10.0  # least CIE Delta E 2000 of two lines of one plot that have the same style; 1 is just noticeable
WIDER = 1.5  # factor between two widths that makes them different styles
SMALL = """() => {
  const targets = [...document.querySelectorAll(
    "button, [role=tab], [role=button], [role=combobox], .mantine-Input-input, .mantine-Slider-trackContainer")]
    .filter((e) => e.checkVisibility({ opacityProperty: true, visibilityProperty: true }))
    .map((e) => [e.ariaLabel || e.textContent || e.className, e.getBoundingClientRect()])
    .filter(([, box]) => box.width > 0);
  return targets.length ? targets.filter(([, box]) => Math.min(box.width, box.height) < 43.5)
    .map(([name, box]) => `${name}: ${box.width} x ${box.height}`) : ["nothing to touch is visible"];
}"""
# Where the keyboard is, and whether one sees it there: a ring, within the window and on top.
FOCUSED = """() => {
  const e = document.activeElement, ring = getComputedStyle(e), box = e.getBoundingClientRect();
  return {
    name: e.ariaLabel || e.labels?.[0]?.textContent || e.textContent.trim(),
    role: e.getAttribute("role") ?? e.tagName.toLowerCase(),
    ring: ring.outlineStyle !== "none" && parseFloat(ring.outlineWidth) >= 1 && e.matches(":focus-visible"),
    shown: e.checkVisibility({ opacityProperty: true, visibilityProperty: true })
      && box.bottom > 0 && box.top < innerHeight && box.right > 0 && box.left < innerWidth,
  };
}"""


@pytest.mark.usefixtures("from_the_start")
def test_axe_finds_nothing_on_a_phone_and_every_target_is_as_large_as_a_finger(
    served: tuple[Dashboard, Runner], open_page: Callable[..., Page]
):
    page = open_page(served[0].url, **PHONE)
    page.locator("main, [role=main]").wait_for()
    page.locator(".uplot").first.wait_for()
    served[1].post(Pause())
    page.locator(".vs-status[data-phase=paused]").wait_for(state="attached")
    assert lasting(page, violations) == []
    wait_without_notice(page)
    assert lasting(page, lambda page: page.evaluate(SMALL)) == []


def test_the_keyboard_reaches_every_control_and_shows_where_it_is(session: PageSession):
    page = session.page
    page.get_by_role("button", name="ψ₁", exact=True).wait_for()
    session.runner.post(Pause())  # what moves makes a look slow
    page.locator(".vs-status[data-phase=paused]").wait_for(state="attached")
    page.locator("canvas[data-engine]").click(position={"x": 20, "y": 200})
    reached = []
    for _ in range(200):
        page.keyboard.press("Tab")
        now = page.evaluate(FOCUSED)
        if now["role"] == "body" and reached:
            break
        reached.append(now)
    unseen = [place for place in reached if place["role"] != "body" and not (place["ring"] and place["shown"])]
    assert not unseen
    names = {(place["role"], place["name"]) for place in reached}
    assert {
        ("button", "What if"), ("button", "play / pause"), ("button", "ψ₁"), ("slider", "F_d [N]"),
        ("input", "F_d [N]"), ("tab", "Residual"), ("tab", "Export"), ("combobox", "Mode"),
        ("button", "Minimize panel"),
    } <= names  # fmt: skip
    assert not [place for place in reached if not place["name"]]


def test_lines_and_folders_answer_to_keys_and_sliders_tell_their_value(session: PageSession):
    page = session.page
    entry = page.locator(".u-label[role=button]").first
    entry.focus()
    page.keyboard.press("Enter")
    expect(entry).to_have_attribute("aria-pressed", "false")
    page.keyboard.press("Enter")
    expect(entry).to_have_attribute("aria-pressed", "true")
    folder = page.get_by_role("button", name="What if", exact=True)
    folder.focus()
    page.keyboard.press("Enter")
    expect(folder).to_have_attribute("aria-expanded", "true")
    page.keyboard.press("Enter")
    expect(folder).to_have_attribute("aria-expanded", "false")
    slider = page.get_by_role("slider", name="F_d [N]")
    expect(slider).to_have_attribute("aria-valuetext", "20 N")


def have_names_of_their_own(controls: Locator) -> bool:
    """Whether each control of a tab has a name that no other one has; the page gives them twice a second."""
    names = controls.evaluate_all("(all) => all.map((each) => each.getAttribute('aria-label') ?? '')")
    return bool(names) and "" not in names and len(set(names)) == len(names)


def test_controls_of_a_tab_have_names_of_their_own(session: PageSession):
    """What the true arm and the declared set have both is named with its folder."""
    page = session.page
    in_tab = page.locator(".mantine-ScrollArea-content .mantine-ScrollArea-content *")
    for tab in ("Task", "Model", "Controller", "World", "Robot", "View"):
        session.tab(tab)
        for role in ("slider", "textbox"):
            controls = page.get_by_role(role).locator("visible=true").and_(in_tab)
            session.wait(lambda _, controls=controls: have_names_of_their_own(controls))
    session.tab("Robot")
    page.get_by_role("slider", name="payload [kg], The true arm", exact=True).wait_for()
    page.get_by_role("slider", name="payload [kg], Bounds declared to the controller", exact=True).wait_for()


def test_the_keyboard_widens_a_dock_and_goes_through_the_cells_of_a_table(session: PageSession):
    page = session.page
    edge = page.locator("[data-dock-region-resize=left][role=separator]")
    wide = resting_box(page.locator("[data-dock-region=left]"))
    edge.focus()
    page.keyboard.press("ArrowRight")
    page.wait_for_function(f"document.querySelector('[data-dock-region=left]').offsetWidth >= {wide['width'] + 20}")
    page.keyboard.press("ArrowLeft")
    page.wait_for_function(f"document.querySelector('[data-dock-region=left]').offsetWidth <= {wide['width'] + 1}")
    session.tab("Guarantee")
    page.locator(".vs-premises td[tabindex='0']").wait_for()
    page.get_by_role("tab", name="Guarantee", exact=True).focus()
    for _ in range(10):
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement.matches('.vs-premises td')"):
            break
    tip = page.locator(".vs-symbol")
    expect(tip).to_contain_text("(25)")
    page.keyboard.press("ArrowDown")
    expect(tip).to_contain_text("Ω")
    page.keyboard.press("ArrowDown")
    expect(tip).to_contain_text("σ_min(J_q)")
    drawn = page.evaluate("window.vsmrcDrawn = document.activeElement.isConnected && document.activeElement")
    assert drawn is not None
    page.wait_for_function("!window.vsmrcDrawn.isConnected")  # the table has been sent again
    page.wait_for_function("document.activeElement.matches('.vs-premises td')")
    assert "σ" in page.evaluate("document.activeElement.textContent")
    expect(tip).to_contain_text("σ_min(J_q)")


def test_the_keyboard_leads_from_event_to_event(session: PageSession):
    session.wait(lambda now: now.t > 0.5)
    session.runner.post(Edit("force.value", 25.0))
    session.wait(lambda now: now.scenario.force.value == 25.0)
    edited = session.now.state.epoch.t
    session.wait(lambda now: now.t > edited + 0.5)
    session.runner.post(Pause())  # nothing else happens, however long the page takes
    session.page.locator(".vs-status[data-phase=paused]").wait_for()
    session.page.locator(".vs-tick.vs-edit").wait_for()
    session.page.locator("canvas[data-engine]").click(position={"x": 20, "y": 200})
    session.page.keyboard.press("PageUp")
    session.wait(lambda now: now.looking_back)
    assert session.now.t == pytest.approx(edited, abs=2e-3)
    session.page.keyboard.press("PageDown")
    session.wait(lambda now: not now.looking_back)


@pytest.mark.usefixtures("new_page", "from_the_start", "messages_stay")
def test_on_a_phone_a_held_slider_shows_its_plot_and_the_numbers_of_what_if(
    served: tuple[Dashboard, Runner], open_page: Callable[..., Page]
):
    page = open_page(served[0].url, **PHONE)
    row = page.locator("form:visible", has=page.get_by_text("F_d [N]", exact=True))
    row.locator("[role=slider][aria-valuetext]").wait_for()
    track = row.locator(".mantine-Slider-trackContainer")
    touch = page.context.new_cdp_session(page)
    plot, preview = page.locator("[data-held-plot]"), page.locator(".vs-forecast")
    begun = served[1].snapshot.scenario.force
    for _ in range(5):  # the page may still be laid out when it is touched
        row.scroll_into_view_if_needed()
        box = resting_box(track)
        at = {"x": box["x"] + 0.4 * box["width"], "y": box["y"] + box["height"] / 2}
        touch.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [at]})
        if page.locator("form[data-held]").count():
            expect(plot).to_contain_text("force on the environment")
            expect(preview).to_contain_text("mean force error at the end")
            if resting_box(track) == box:
                break
        touch.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
        expect(plot).to_have_count(0)
    page.wait_for_function("document.querySelector('[data-held-plot]').getBoundingClientRect().bottom <= "
                           "document.querySelector('.vs-forecast').getBoundingClientRect().top + 1")  # fmt: skip
    over, below = plot.bounding_box(), preview.bounding_box()
    assert over is not None
    assert below is not None
    assert over["y"] == 0
    assert over["width"] == pytest.approx(390, abs=1)
    assert over["y"] + over["height"] < box["y"]
    assert below["y"] + below["height"] < box["y"]
    assert resting_box(track) == box  # it has not moved under the finger
    touch.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    expect(plot).to_have_count(0)
    expect(preview).to_have_count(0)
    offered = page.locator(".vs-undo", has_text="Take back F_d [N]")
    expect(offered).to_be_visible()
    until(lambda: served[1].snapshot.scenario.force != begun)
    held = served[1].snapshot.scenario.force
    offered.click()
    until(lambda: served[1].snapshot.scenario.force != held)
    expect(page.locator(".vs-undo")).to_have_count(0)


@pytest.mark.usefixtures("from_the_start")
def test_a_long_touch_opens_a_row_s_menu_and_lists_stay_closed(
    served: tuple[Dashboard, Runner], open_page: Callable[..., Page]
):
    page = open_page(served[0].url, **PHONE)
    row = page.locator("form:visible", has=page.get_by_text("F_d [N]", exact=True))
    row.locator("[role=slider][aria-valuetext]").wait_for()
    page.evaluate("addEventListener('contextmenu', (e) => e.stopImmediatePropagation(), true)")  # iOS has none
    menu, name = page.locator(".vs-menu"), row.locator(".vs-set").first
    name.scroll_into_view_if_needed()
    box = resting_box(name)
    at = {"x": box["x"] + box["width"] / 2, "y": box["y"] + box["height"] / 2}
    touch = page.context.new_cdp_session(page)
    touch.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [at]})
    expect(menu).to_be_visible()
    touch.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    expect(menu.get_by_role("menuitem").first).to_be_focused()
    expect(page.locator(".vs-symbol")).to_be_hidden()  # to lift the finger is no tap
    menu.get_by_role("menuitem").first.tap()
    across = page.get_by_label("Across", exact=True).locator("visible=true")
    expect(across).to_have_value("desired force")
    expect(across).to_be_focused()
    expect(across).to_have_attribute("aria-expanded", "false")
    expect(page.get_by_role("option").locator("visible=true")).to_have_count(0)
    across.tap()
    page.get_by_role("option").locator("visible=true").first.wait_for()
    high = page.evaluate("[...document.querySelectorAll('[role=option]')].map((e) => e.offsetHeight).filter(Boolean)")
    assert min(high) >= 44


def drawings() -> Iterator[tuple[str, Drawing]]:
    """Every plot of every tab, for an arm with seven joints that presses."""
    runner = Runner(shipped()["panda-hybrid"])
    setup = Setup.of(runner.snapshot, 0, 0)
    for title, tab in TABS.items():
        for plot in tab.plots:
            if drawing := plot.draw(setup):
                yield f"{title}: {drawing.title}", drawing
    runner.close()


def alike(one: ChartLine, other: ChartLine) -> bool:
    """Whether only colour tells two lines apart."""
    thin, wide = sorted((one.width, other.width))  # without width it is a filled area
    look = one.dashed, one.dashes, one.backdrop
    return look == (other.dashed, other.dashes, other.backdrop) and wide <= WIDER * thin


def test_lines_stay_apart_for_the_colour_blind_in_both_themes(browser: Browser):
    page = browser.new_page()
    page.add_script_tag(
        content=Path("static/page/plots.js").read_text(encoding="utf-8")
    )  # has the light page's colours

    @cache
    def seen(color: str, sight: str, theme: str) -> Color:
        shown = ColorAll(page.evaluate("onWhite", color) if theme == "light" else color)
        return shown.filter(sight) if sight else shown

    near, compared = [], 0
    runs = [RunLook(f"run {i}", color, dashes) for i, (color, dashes) in enumerate(zip(RUNS, RUN_DASHES, strict=True))]
    pinned = Drawing("pinned runs", [ChartLine(run.name, run.color, lambda _: None) for run in runs])  # pyright: ignore[reportArgumentType]
    for title, drawing in (*drawings(), ("Pinned", pinned)):
        listed = [line for line in drawing.lines if line.listed]
        behind = [replace(line, name=" ".join(line.repeats)) for run in runs for line in lines_of_run(listed, run)]
        drawn = [line for line in behind if not (line.listed and len(line.repeats) > 1)]  # without the legend's entries
        for one, other in combinations([*listed, *drawn], 2):
            if not alike(one, other):
                continue
            compared += 1
            for theme in ("dark", "light"):
                for sight in ("", "protan", "deutan"):
                    pair = [seen(css(line.color), sight, theme) for line in (one, other)]
                    if (apart := pair[0].delta_e(pair[1], method="2000")) < APART:
                        near.append(f"{title}: {one.name}, {other.name}: {apart:.1f} ({theme} {sight})")
    page.close()
    assert compared > 100
    assert not near, "\n".join(near)
