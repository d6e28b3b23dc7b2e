"""Looking back, forking and pinning, as a person would."""

import re

import numpy as np
import pytest
from playwright.sync_api import expect

from app.session.commands import Edit
from drivers.pages import PATIENCE, SHOWN, PageSession


def press(session: PageSession, button: str) -> None:
    session.page.get_by_role("button", name=button, exact=True).click()


def test_looking_back_shows_what_was_and_a_fork_goes_on_from_there(session: PageSession):
    session.wait(lambda now: now.t > 1.5)
    session.runner.post(Edit("force.value", 35.0))
    session.wait(lambda now: now.scenario.force.value == 35.0 and now.t > 2.5)
    session.enter("time t [s]", "0.8")
    session.wait(lambda now: now.looking_back)
    now = session.now
    assert (now.phase, now.t) == ("paused", pytest.approx(0.8))
    np.testing.assert_array_equal(now.q, now.recording.at(0.8 + 1e-6)["q"])
    session.page.get_by_text("looking back", exact=True).wait_for()
    expect(session.number("F_d [N]")).to_have_value("20")
    session.wait(lambda _: session.ahead() <= 1e-9)  # plots follow when their turn comes; 1e-9: rounding
    session.page.locator("canvas[data-engine]").click(position={"x": 20, "y": 200})
    session.page.keyboard.press("ArrowLeft")
    session.wait(lambda now: now.t == pytest.approx(0.799))
    session.page.keyboard.press("Shift+ArrowRight")
    session.wait(lambda now: now.t == pytest.approx(0.899))
    end = session.now.end
    press(session, "fork here")
    session.wait(lambda now: not now.looking_back)
    assert session.now.end == pytest.approx(0.899)
    assert [(p.t, p.scenario.force.value) for p in session.now.pinned] == [(end, 35.0)]


@pytest.mark.usefixtures("messages_stay")
def test_a_fork_at_the_end_is_refused_with_a_button_that_forks_at_the_last_change(session: PageSession):
    page = session.page
    session.wait(lambda now: now.t > 0.5)
    session.runner.post(Edit("force.value", 35.0))
    session.wait(lambda now: now.scenario.force.value == 35.0)
    changed = session.now.state.epoch.t
    session.wait(lambda now: now.t > changed + 0.5)
    press(session, "fork here")
    page.locator(".vs-strip", has_text="fork: the run stands at its end").wait_for()
    page.get_by_role("button", name="Fork at the last change").click()
    session.wait(lambda now: bool(now.forks))
    assert (session.now.phase, session.now.t, session.now.end) == ("paused", pytest.approx(changed), session.now.t)
    assert len(session.now.pinned) == 1
    page.get_by_role("button", name="Fork at the last change").wait_for(state="detached")
    # with the fork, not only when it has been shown long enough
    page.wait_for_function("!document.querySelector('.vs-strip').innerText.includes('fork')", timeout=0.5e3 * PATIENCE)


def test_play_shows_the_past_again_and_then_goes_on(session: PageSession):
    session.wait(lambda now: now.t > 1.0)
    move, field = session.grip("time t [s]", at=0.9)
    move(0.3)
    session.page.mouse.up()
    # where the mouse was let go, not at one of the places on the way there
    session.wait(lambda now: now.looking_back and abs((now.t - now.first) / (now.end - now.first) - 0.3) < 0.03)
    session.wait(lambda now: field.input_value() == f"{now.t:.3f}")
    end, rows = session.now.end, session.now.recording.rows()
    # the time that was dragged, and a tab that was pressed, give the keys back
    session.page.wait_for_function("!document.activeElement.closest('form')")
    t = session.now.t
    session.page.keyboard.press("ArrowLeft")
    session.wait(lambda now: now.t == pytest.approx(t - 1e-3, abs=1e-9))
    session.tab("Tracking")
    session.page.keyboard.press("Space")
    session.wait(lambda now: not now.looking_back and now.t > end + 0.3)
    np.testing.assert_array_equal(session.now.recording.rows(t_to=end - 5e-4), rows)


def test_runs_are_pinned_compared_and_forgotten(session: PageSession):
    session.tab("Runs")
    session.wait(lambda now: now.t > 0.5)
    press(session, "Pin this run")
    session.wait(lambda now: len(now.pinned) == 1)
    number = session.now.pinned[0].number
    session.tab("View")
    session.page.locator(".vs-note", has_text="path error").get_by_text(f"run {number}").wait_for()
    session.tab("Runs")
    session.runner.post(Edit("controller.K_s", 33.0))
    table = session.page.locator("table.vs-runs")
    table.get_by_role("columnheader", name=f"run {number}", exact=True).wait_for()
    session.enter(f"run {number}", "<b>soft</b>")
    table.get_by_role("columnheader", name="<b>soft</b>", exact=True).wait_for()
    entry = session.page.locator(".u-series", has_text="<b>soft</b>").first
    expect(entry.locator(".u-marker")).to_have_attribute("style", re.compile("repeating-linear-gradient"))
    shown = f"{SHOWN}[0].series.filter((line) => line.dash?.length === 2 && line.dash[0] === 2 && line.show).length"
    lines = session.page.evaluate(shown)
    assert lines > 4  # the entry, and the coordinates that are solid in the present run
    entry.locator("th").click()
    session.page.wait_for_function(f"{shown} === 0")
    entry.locator("th").click()
    session.page.wait_for_function(f"{shown} === {lines}")
    # a coordinate is hidden in all runs, and a run that stands alone has all of them
    label = session.page.evaluate(
        f"{SHOWN}[0].series.findLast((line) => line.label && !line.class && !line.dash).label"
    )
    coordinate = session.page.locator(".u-legend").first.locator(".u-series:visible", has_text=label)
    coordinate.locator("th").click()
    session.page.wait_for_function(f"{shown} === {lines - 1}")
    coordinate.locator("th").click()
    session.page.wait_for_function(f"{shown} === {lines}")
    hidden = session.page.locator(".u-legend").first.locator(".u-series.u-off:visible")
    for alone, left in ((entry, lines), (coordinate, 2)):  # of the run its entry and the coordinate
        alone.locator("th").click(modifiers=["Control"])
        expect(hidden).not_to_have_count(0)
        session.page.wait_for_function(f"{shown} === {left}")
        alone.locator("th").click(modifiers=["Control"])
        expect(hidden).to_have_count(0)
        session.page.wait_for_function(f"{shown} === {lines}")
    session.page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    session.page.get_by_role("button", name="Copy the table").click()
    session.page.get_by_text("Copied", exact=True).wait_for()
    copied = session.page.evaluate("navigator.clipboard.readText()").split("\n")
    assert copied[0].split("\t") == ["", "now", "<b>soft</b>"]
    assert any(line.startswith("path error, RMS") and ("%)" in line or "×)" in line) for line in copied)
    expect(table.locator("tr", has_text="path error, RMS").locator("td")).to_have_count(3)
    session.page.get_by_text("reaching gain K_s: 100 N·s/m").wait_for()
    press(session, f"Forget run {number}")
    session.wait(lambda now: not now.pinned)
    table.wait_for(state="detached")
