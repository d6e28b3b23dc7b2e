"""Window of what-if in a real browser: a preview, and what was applied, each in a place of its own."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from playwright.sync_api import Locator, Page, expect

from app.dashboard.page import Dashboard
from app.session.commands import Play
from app.session.runner import Runner
from app.session.snapshot import Snapshot
from drivers.pages import PHONE, PageSession, resting_box


def window_of(session: PageSession) -> Locator:
    return session.page.locator("[data-floating-window]", has=session.page.locator(".vs-held"))


def drag_away(session: PageSession) -> None:
    """Drag the window by its grip, 70 px to the left and 50 px down."""
    window = window_of(session)
    handle = window.locator("[data-dock-griphandle]")

    def dragged(_: Snapshot) -> bool:
        """Whether a drag has moved it: a notice on a slow loop, which comes by itself, may push it from the mouse."""
        handle.hover()
        grip = handle.bounding_box()
        assert grip is not None
        x, y = grip["x"] + grip["width"] / 2, grip["y"] + grip["height"] / 2
        session.page.mouse.move(x, y)
        session.page.mouse.down()
        session.page.mouse.move(x - 70.0, y + 50.0, steps=3)
        session.page.mouse.up()
        return window.evaluate("(window) => getComputedStyle(window).translate") == "-70px 50px"

    session.wait(dragged)


def corner(window: Locator) -> tuple[int, int]:
    """Lower right corner of the window at rest, px."""
    box = resting_box(window)
    return round(box["x"] + box["width"]), round(box["y"] + box["height"])


@pytest.mark.usefixtures("messages_stay", "spent_page")
def test_the_window_of_what_was_applied_can_be_moved_away_and_takes_the_value_back(session: PageSession):
    move, _ = session.grip("F_d [N]")
    move(0.9)
    session.page.mouse.up()
    session.wait(lambda now: now.scenario.force.value > 40.0)
    window = window_of(session)
    window.get_by_text("applied").wait_for()
    drag_away(session)
    window.get_by_role("button", name="Revert").click()
    session.wait(lambda now: now.scenario.force.value == 20.0)
    move, _ = session.grip("F_d [N]")
    move(0.8)
    session.page.mouse.up()
    session.wait(lambda now: now.scenario.force.value > 40.0)
    session.page.keyboard.press("z")
    session.wait(lambda now: now.scenario.force.value == 20.0)


@pytest.mark.usefixtures("messages_stay", "spent_page")
def test_a_preview_keeps_its_place_and_so_does_what_was_applied_while_the_time_is_held(session: PageSession):
    page, window = session.page, window_of(session)
    session.pause_after(1.0)

    def hold(at: float) -> tuple[int, int]:
        move, _ = session.grip("F_d [N]")
        move(at)
        page.get_by_text("within the next").wait_for()
        return corner(window)

    previewed = hold(0.75)
    page.mouse.up()
    window.get_by_text("applied").wait_for()
    drag_away(session)
    applied = corner(window)
    assert applied != previewed
    session.runner.post(Play())
    session.pause_after(session.now.t + 2.0)
    session.grip("time t [s]", at=0.95)  # after the edit: before it nothing could be taken back
    session.wait(lambda now: now.looking_back)
    assert corner(window) == applied
    expect(window.get_by_role("button", name="Revert")).to_be_visible()
    page.mouse.up()
    page.locator("form[data-held]").wait_for(state="detached")
    assert hold(0.6) == previewed
    page.keyboard.press("Escape")
    page.mouse.up()


def test_a_phone_ends_the_preview_of_another_page_and_hears_of_no_key(
    session: PageSession, served: tuple[Dashboard, Runner], open_page: Callable[..., Page]
):
    phone = open_page(served[0].url, **PHONE)
    before = session.now
    move, text = session.grip("F_d [N]")
    move(0.75)
    session.page.get_by_text("let go: apply · Esc: cancel").wait_for()
    offered = phone.locator(".vs-undo", has_text="Take back F_d [N]")
    offered.wait_for()
    expect(phone.locator(".vs-held .vs-by-key")).to_be_hidden()
    offered.click()
    expect(offered).to_have_count(0)
    expect(text).to_have_value("20")
    session.page.mouse.up()
    session.page.wait_for_timeout(500)
    assert session.now.revision == before.revision
