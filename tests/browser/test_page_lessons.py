"""Lessons in a real browser: every kind of step, by keyboard and by mouse, and what a phone shows of it."""

import json
import re

from playwright.sync_api import expect

from app.session.commands import SetSpeed
from drivers.pages import SHOWN, PageSession, fill_in, press_by_key, resting_box, type_over
from tests.support.layout import lasting_faults

EMPTY = f"{SHOWN}.every((chart) => chart.data[0].length <= 2)"


def at_step(session: PageSession, number: int) -> None:
    session.page.locator(f".vs-lesson[data-step='{number}']").wait_for()


def press(session: PageSession, name: str) -> None:
    """Press a button by keyboard alone."""
    press_by_key(session.page.get_by_role("button", name=name))


def go_on(session: PageSession) -> None:
    """Go to the next step by key, once nothing is left to be done or computed in this one."""
    expect(session.page.get_by_role("button", name=re.compile("^(Next|Finish)$"))).to_be_enabled()
    session.page.keyboard.press("j")


def run_through(session: PageSession) -> None:
    """Run, and wait until the picture of the run is there."""
    press(session, "Run: ")
    session.page.get_by_role("button", name="Run again: ").wait_for()
    session.page.locator(".vs-lines").first.wait_for()


def test_a_whole_lesson_by_keyboard_with_every_kind_of_step(session: PageSession):
    page = session.page
    session.runner.post(SetSpeed(5.0))
    session.tab("Lessons")
    press(session, "Begin")
    at_step(session, 1)
    # at rest at its beginning, since the next steps ask what it will do
    session.wait(lambda now: now.scenario.contact.kind == "free" and now.phase == "paused" and now.t == 0.0)
    assert not lasting_faults(page)

    go_on(session)
    at_step(session, 2)
    field = page.locator("form:has(label:text('your answer')) input")
    fill_in(field, "thirty")
    press(session, "Lock my answer")
    expect(page.locator(".vs-strip")).to_contain_text("'thirty'; allowed: a number, such as 12.5")
    type_over(field, "29,5")  # and Enter
    expect(field).to_be_disabled()
    expect(page.locator(".vs-strip")).not_to_contain_text("thirty")

    go_on(session)
    at_step(session, 3)
    press(session, "Lock my line")
    expect(page.locator(".vs-strip")).to_contain_text("nothing is drawn yet")
    pad = page.locator(".vs-pad svg")
    pad.focus()
    for key in ("ArrowUp", "ArrowRight", "ArrowRight", "ArrowRight", "Shift+ArrowUp", "Shift+ArrowDown"):
        page.keyboard.press(key)
    drawn = page.locator(".vs-pad .vs-drawn").get_attribute("d") or ""
    assert drawn.count("L") == 24
    session.sent()
    hidden = page.locator("div:has(> .vs-pad) + div input")
    points = json.loads(hidden.input_value())
    assert [round(points[0][1], 6), round(points[3][1], 6)] == [32.0, 32.0]  # of −20 to 80, the middle and 2 % more
    press(session, "Lock my line")
    page.locator(".vs-pad[data-locked='1']").wait_for()

    go_on(session)
    at_step(session, 4)
    session.wait(lambda now: now.phase == "paused" and now.end == 0.0)
    page.wait_for_function(EMPTY)  # no lines of the run before
    run_through(session)
    session.wait(lambda now: now.phase == "paused" and abs(now.end - 4.0) < 1e-6)
    expect(page.locator(".vs-predicted")).to_have_count(2)  # the number as a line, and what was drawn
    assert page.get_by_text("You changed this run").count() == 0
    with page.expect_download() as download:
        page.get_by_role("button", name="SVG").last.click()
    assert download.value.suggested_filename == "01-target-model-4-10-kg.svg"
    assert "predicted" in download.value.path().read_text(encoding="utf-8")

    go_on(session)
    at_step(session, 5)
    scored = page.locator(".vs-prose .vs-scored")
    expect(scored).to_have_count(2)
    expect(scored.first).to_contain_text("measured 30 mm; it counts within 2 mm")
    expect(page.locator(".vs-prose")).to_contain_text("as far as 46.1 mm")
    expect(page.locator(".vs-prose msqrt")).to_have_count(1)

    go_on(session)
    press(session, "A) swings further")
    go_on(session)
    at_step(session, 7)
    run_through(session)
    go_on(session)
    at_step(session, 8)
    press(session, "B) how fast")
    go_on(session)
    at_step(session, 9)
    expect(scored).to_have_count(2)

    go_on(session)
    at_step(session, 10)
    page.keyboard.press("1")
    expect(page.locator(".vs-strip")).to_contain_text("locked by the goal of a lesson")
    damping = session.number("B_m along y [N·s/m]")
    type_over(damping, "290")
    session.wait(lambda now: now.matrices["B_m"][1, 1] == 290.0)
    # a run that was changed on its way is never judged, however calm it has become
    expect(page.locator(".vs-note", has_text="try it again")).to_be_visible()
    page.keyboard.press("r")
    page.get_by_text("reached", exact=True).wait_for()
    go_on(session)  # the last step: the lesson is done
    expect(page.locator(".vs-prose .vs-chip", has_text="done")).to_be_visible()
    with page.expect_download() as download:
        page.get_by_role("button", name="CSV").last.click()
    rows = download.value.path().read_text(encoding="utf-8").splitlines()
    assert rows[1].startswith("01-target-model,2,29.5,1,")
    session.runner.post(SetSpeed(1.0))


def test_a_line_is_drawn_by_mouse_and_playing_freely_is_undone(session: PageSession):
    page = session.page
    session.tab("Lessons")
    session.choose("Lesson", "8. Reaching", exact=False)
    page.get_by_role("button", name="Begin").click()
    at_step(session, 1)
    page.get_by_role("button", name="Next").click()
    at_step(session, 2)
    page.get_by_role("button", name="Skip the prediction").click()
    at_step(session, 3)
    pad = page.locator(".vs-pad svg")
    for _ in range(5):  # the page scrolls to the top of a new step, and may be laid out while it is drawn on
        pad.scroll_into_view_if_needed()
        box = resting_box(pad)
        page.mouse.move(box["x"] + 0.15 * box["width"], box["y"] + 0.2 * box["height"])
        page.mouse.down()
        page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.6 * box["height"], steps=3)
        page.mouse.move(box["x"] + 0.95 * box["width"], box["y"] + 0.8 * box["height"], steps=3)
        page.mouse.up()
        session.sent()
        if resting_box(pad) == box:
            break
    values = [value for _, value in json.loads(page.locator("div:has(> .vs-pad) + div input").input_value())]
    assert len(values) == 25
    assert values == sorted(values, reverse=True)
    assert values[0] > 200.0 > 60.0 > values[-1]
    page.get_by_role("button", name="Lock my line").click()
    page.locator(".vs-pad[data-locked='1']").wait_for()

    page.keyboard.press("v")  # the projector: scene, one plot, and the step
    expect(page.locator(".vs-question")).to_be_visible()
    expect(page.locator(".vs-equation")).to_be_hidden()
    expect(page.get_by_role("tab", name="Lessons")).to_be_hidden()
    page.keyboard.press("v")
    expect(page.locator(".vs-equation")).to_be_visible()

    page.keyboard.press("2")
    session.wait(lambda now: now.scenario.mode == "impedance")
    # by key: the panel moves while the page is drawn for the other mode
    press(session, "Return to the lesson's scene")
    session.wait(lambda now: now.scenario.mode == "hybrid")
    press_by_key(page.get_by_role("button", name="Back", exact=True))
    at_step(session, 2)
    page.get_by_role("button", name="Leave the lesson").click()
    page.get_by_role("button", name="Continue at step 2").wait_for()


def test_the_buttons_of_a_german_lesson_are_in_german(own_session: PageSession):
    page = own_session.page
    own_session.tab("Lessons")
    own_session.choose("Lesson", "3. Auf eine Wand drücken (Deutsch)")
    page.get_by_role("button", name="Beginnen").click()
    page.locator(".vs-lesson[data-step='1']", has_text="1 von 11").wait_for()
    page.get_by_role("button", name="Weiter", exact=True).click()
    page.get_by_role("button", name="Lauf: Wand wie angenommen (3 s)").wait_for()
    expect(page.get_by_role("button", name="Lauf überspringen")).to_be_visible()
    page.get_by_role("button", name="Lektion verlassen").click()
    page.get_by_role("button", name="Weiter bei Schritt 2").wait_for()
    expect(page.locator(".vs-prose .vs-chip", has_text="begonnen")).to_be_visible()
