"""What a lecture is staged with: the timeline under the scene, the guided minute, and the presentation."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import expect

from app.dashboard.widgets.fields.chosen_sliders import MOST
from app.dashboard.widgets.lesson.guided_minute import steps
from app.session.commands import Edit, Pause, PushNow
from controllers.modes import MODES
from drivers.pages import SHOWN, PageSession, resting_box

# Whether one of these parts lies on another, or is not there.
OVER = """(parts) => {
  const boxes = parts.map((part) => [...document.querySelectorAll(part)].filter((e) => e.checkVisibility()));
  const rects = boxes.flat().map((e) => e.getBoundingClientRect());
  return boxes.some((found) => !found.length) || rects.some((a, i) => rects.some((b, j) => i < j &&
    Math.min(a.right, b.right) - Math.max(a.left, b.left) > 1 &&
    Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 1));
}"""


def test_the_timeline_has_a_tick_for_what_has_happened_and_leads_there(session: PageSession):
    page = session.page
    session.wait(lambda now: now.t > 0.5)
    session.runner.post(PushNow())
    session.wait(lambda now: any(now.scenario.truth.push))
    pushed = session.now.scenario.truth.push_start
    session.wait(lambda now: now.t > pushed + 1.0)  # far enough that neither tick lies on the other
    session.runner.post(Edit("force.value", 25.0))
    session.wait(lambda now: now.scenario.force.value == 25.0)
    tick = page.locator(".vs-tick.vs-push").last
    tick.wait_for()
    page.locator(".vs-tick.vs-edit[title*='desired force: 25 N']").wait_for()
    session.wait(lambda now: now.t > pushed + 2.0)
    tick.click()
    session.wait(lambda now: now.looking_back)
    assert session.now.t == pytest.approx(pushed, abs=2e-3)
    page.get_by_role("button", name="fork here", exact=True).click()
    session.wait(lambda now: now.forks != ())
    page.locator(".vs-tick.vs-fork").wait_for()
    page.get_by_role("button", name="play / pause").click()
    session.wait(lambda now: now.phase == "running" and now.t > pushed + 0.2)


def test_nothing_lies_over_the_timeline_whatever_the_window(session: PageSession):
    session.runner.post(Pause())  # what moves makes a look slow
    parts = [".vs-timeline button", "div:has(> .vs-timeline) + div input", "div:has(> .vs-ticks) + form input"]
    scenario = session.page.get_by_label("Scenario", exact=True)
    for width, height in ((1024, 768), (1280, 720), (1920, 1080), (390, 844)):
        session.page.set_viewport_size({"width": width, "height": height})
        session.page.wait_for_function(f"!({OVER})({parts})")
        session.page.wait_for_function("""(width) => {
          const boxes = [...document.querySelectorAll(".vs-timeline button")].map((e) => e.getBoundingClientRect());
          return boxes.length === 7 && boxes.every((b) => b.left >= 0 && b.right <= width && b.width >= 20);
        }""", arg=width)  # fmt: skip
        if width > 500:  # controls begin high enough to see many
            session.wait(lambda _: (scenario.bounding_box() or {"y": 999})["y"] < 250)


def test_the_guided_minute_leads_through_the_five_modes(session: PageSession):
    page = session.page
    page.locator("canvas[data-engine]").click(position={"x": 20, "y": 200})
    page.keyboard.press("g")
    minute = page.locator(".vs-minute")
    for number, step in enumerate(steps(), start=1):
        minute.get_by_text(f"{number} of {len(MODES)}").wait_for()
        session.wait(lambda now, step=step: now.scenario == step.scenario and now.phase == "running")
        if number < len(MODES):
            page.get_by_role("button", name=f"Next: {steps()[number].title}").click()
    page.get_by_role("button", name="Done", exact=False).click()
    minute.wait_for(state="hidden")


def test_a_presentation_has_one_plot_the_chosen_sliders_and_large_type(session: PageSession):
    page = session.page
    session.runner.post(Pause())
    font = "Number(getComputedStyle(document.querySelector('.vs-title')).fontSize.replace('px', ''))"
    small = page.evaluate(font)
    rows = page.locator("form:has(.mantine-Slider-root):visible")
    plots = page.locator(".uplot-container:visible")
    resting_box(plots.last)
    many, before = rows.count(), plots.count()
    heights = f"{SHOWN}.map((c) => c.height)"
    own = page.evaluate(heights)
    session.row("F_d [N]").locator(".mantine-Slider-root").click(position={"x": 40, "y": 5})
    page.locator("form[data-held]").wait_for(state="detached")
    plots.nth(1).click(position={"x": 5, "y": 5})
    page.keyboard.press("v")
    expect(plots).to_have_count(1)
    assert "force" in plots.locator(".u-title").inner_text()
    expect(session.number("F_d [N]")).to_be_visible()
    page.wait_for_function(f"[...document.querySelectorAll('form[data-staged]')].length <= {MOST}")
    assert page.evaluate(font) > 1.2 * small
    page.wait_for_function(f"Math.max(...{heights}) > {2 * max(own)}")
    for width, height in ((1024, 768), (1280, 720)):
        page.set_viewport_size({"width": width, "height": height})
        page.wait_for_function(f"!({OVER})({['.vs-timeline', '.vs-equation', '.vs-acts button', 'form[data-staged]']})")
        page.wait_for_function("""(width) => {
          const inputs = [...document.querySelectorAll("form[data-staged] input")];
          return inputs.every((input) => input.getBoundingClientRect().right <= width);
        }""", arg=width)  # fmt: skip
    page.keyboard.press("Escape")
    expect(plots).to_have_count(before)
    expect(rows).to_have_count(many)
    page.wait_for_function(f"JSON.stringify({heights}) === '{own}'.replaceAll(' ', '')")
    assert page.evaluate(font) == small
    page.keyboard.press("v")  # on the projector; back at the desk every time axis has its numbers
    expect(plots).to_have_count(1)
    page.set_viewport_size({"width": 1920, "height": 1080})
    page.wait_for_function(f"Math.max(...{heights}) > {2 * max(own)}")
    page.keyboard.press("v")
    page.set_viewport_size({"width": 1280, "height": 720})
    expect(plots).to_have_count(before)
    page.wait_for_function(f"{SHOWN}.every((c) => c.axes[0]._found[1] > 0 && c.axes[0]._splits.length > 1)")


def test_a_presentation_leads_from_plot_to_plot_through_all_tabs_in_a_circle(session: PageSession):
    page = session.page
    tabs = page.locator("[data-dock-group]:has(.vs-plots) [role=tab]").all_inner_texts()
    place, plots = page.locator(".vs-turns span"), page.locator(".uplot-container:visible")
    plots.first.click(position={"x": 5, "y": 5})
    page.keyboard.press("v")
    expect(place).to_have_text(f"{tabs[0]} 1 / 4")
    page.keyboard.press(",")
    expect(place).to_have_text(re.compile(rf"{tabs[-1]} (\d+) / \1"))
    page.get_by_role("button", name="The next plot (.)").click()
    for number in (1, 2, 3, 4):
        expect(place).to_have_text(f"{tabs[0]} {number} / 4")
        expect(plots).to_have_count(1)
        page.keyboard.press(".")
    expect(place).to_have_text(re.compile(rf"{tabs[1]} 1 / "))
    expect(plots).to_have_count(1)
    page.keyboard.press("Escape")
    expect(page.get_by_role("button", name="The next plot (.)")).to_be_hidden()
    session.tab(tabs[0])


def test_a_presentation_begun_from_a_tab_without_sliders_has_those_of_the_first_tab(session: PageSession):
    page = session.page
    session.tab("Runs")
    expect(session.number("F_d [N]")).to_be_hidden()
    page.keyboard.press("v")
    expect(session.number("F_d [N]")).to_be_visible()
    page.keyboard.press("Escape")
    expect(page.get_by_role("tab", name="Runs", exact=True)).to_have_attribute("aria-selected", "true")


def test_large_buttons_of_a_presentation_in_a_small_window_stand_in_a_row(session: PageSession):
    page = session.page
    page.set_viewport_size({"width": 1024, "height": 768})
    page.keyboard.press("v")
    tops = "[...document.querySelectorAll('.vs-acts button')].map((e) => e.getBoundingClientRect().top)"
    session.wait(lambda _: page.locator("html[data-stage]").count() == 1)
    session.wait(lambda _: len(set(page.evaluate(tops)[:2])) == 1)  # else they cover the arm
    page.get_by_role("button", name="Leave the presentation (Esc, V)").click()
    session.wait(lambda _: page.locator("html[data-stage]").count() == 0)


def test_the_presentation_is_begun_from_the_help(session: PageSession):
    """Without a keyboard there is no other way."""
    page = session.page
    page.get_by_role("button", name="help").click()
    page.locator(".vs-help").get_by_role("button", name="Presentation").click()
    page.locator("html[data-stage]").wait_for()
    page.locator(".vs-help").wait_for(state="detached")
    page.keyboard.press("Escape")
    page.locator("html:not([data-stage])").wait_for()


@pytest.mark.parametrize(
    ("key", "code", "modifiers", "does"),
    [
        ("é", "Digit2", 0, "mode"),  # a French keyboard, whose digits need Shift
        ("2", "Digit2", 8, "mode"),
        ("@", "Digit2", 8, ""),  # an American one, where Shift makes another sign of it
        ("к", "KeyR", 0, "reset"),  # a Russian one
        ("м", "KeyV", 0, "presentation"),
        ("р", "KeyH", 0, "help"),
        (";", "KeyR", 0, ""),  # a Latin one that has another sign there
        ("ı", "KeyR", 0, ""),
    ],
)
def test_keys_count_by_their_place_where_the_keyboard_has_other_signs(
    session: PageSession, key: str, code: str, modifiers: int, does: str
):
    page = session.page
    session.wait(lambda now: now.t > 0.3)
    run = session.now.run
    page.locator("canvas[data-engine]").click(position={"x": 20, "y": 200})
    keyboard = page.context.new_cdp_session(page)

    def press() -> None:
        for kind in ("keyDown", "keyUp"):
            typed = {"key": key, "code": code, "modifiers": modifiers, "text": key}
            keyboard.send("Input.dispatchKeyEvent", {"type": kind, **typed})

    press()
    match does:
        case "mode":
            session.wait(lambda now: now.scenario.mode == "impedance")
        case "reset":
            session.wait(lambda now: now.run == run + 1)
        case "presentation":
            page.locator("html[data-stage]").wait_for()
            press()
            page.locator("html:not([data-stage])").wait_for()
        case "help":
            page.locator(".vs-help").wait_for()
            press()
            page.locator(".vs-help").wait_for(state="detached")
        case _:
            page.keyboard.press("Space")  # a later key is heard after it
            session.wait(lambda now: now.phase == "paused")
            assert (session.now.run, session.now.scenario.mode) == (run, "hybrid")
