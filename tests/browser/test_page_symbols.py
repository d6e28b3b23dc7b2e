"""Every symbol explains itself where it stands: by mouse, by keyboard and by touch; and the glossary."""

from __future__ import annotations

from collections.abc import Callable

from playwright.sync_api import Locator, Page, TimeoutError, expect

from app.dashboard.page import Dashboard
from app.session.runner import Runner
from drivers.pages import CHARTS, PATIENCE, PageSession, resting_box

ALPHAS = f"{CHARTS}.flatMap((plot) => plot.series.slice(1).map((series) => [series.label, series.alpha ?? 1]))"


def alphas(page: Page) -> dict[str, float]:
    """How strongly each line of the plots is drawn, by its name in the legend."""
    return dict(page.evaluate(ALPHAS))


def closed_by_escape(page: Page, shown: Locator) -> None:
    """Press Escape until this is gone: a busy page may still be closing what was above it."""
    for _ in range(10):
        page.keyboard.press("Escape")
        try:
            expect(shown).to_have_count(0, timeout=10e3)
        except AssertionError:
            continue
        return
    raise AssertionError("Escape does not close it")


def explained(page: Page, symbol: Locator, text: str) -> None:
    """Let the mouse rest on a symbol until its tip says this; again where the symbol has moved away from the mouse."""
    tip = page.locator("#vs-symbol", has_text=text).locator("visible=true")
    for _ in range(10):
        symbol.hover()
        try:
            tip.wait_for(timeout=10e3)
        except TimeoutError:
            page.mouse.move(640, 200)
        else:
            return
    raise AssertionError(f"no tip says {text}")


def test_a_symbol_explains_itself_under_the_mouse_and_its_line_stands_out(session: PageSession) -> None:
    page, tip = session.page, session.page.locator("#vs-symbol")
    session.wait(lambda now: now.t > 1.0)
    explained(page, page.locator('.vs-equation [data-symbol="K_m"]'), "Stiffness of the target model (8).")
    expect(tip).to_contain_text("Stiffness of the target model (8). [N/m or N·m/rad] equation (8) of the paper")
    expect(tip).to_contain_text("now 0, 4000, 4000")
    page.keyboard.press("Escape")
    expect(tip).to_be_hidden()
    explained(page, page.locator(".u-legend .u-series:visible th", has_text="‖s‖"), "Norm of the sliding variable")
    drawn = alphas(page)
    assert drawn["‖s‖"] == 1
    assert drawn["bound (20) + band"] < 0.5
    page.mouse.move(640, 200)
    expect(tip).to_be_hidden()
    assert alphas(page)["bound (20) + band"] == 1
    session.tab("Controller")  # its table is sent again ten times a second
    explained(page, page.locator(".vs-verdicts td", has_text="gain d"), "Least gain d by (17)")
    before = session.now.t
    session.wait(lambda now: now.t > before + 1.0)
    expect(tip).to_be_visible()


def test_a_symbol_explains_itself_by_keyboard_and_labels_have_indices(session: PageSession) -> None:
    page, tip = session.page, session.page.locator("#vs-symbol")
    session.tab("Controller")
    expect(session.row("K_s [N·s/m]").locator(".vs-set sub")).to_have_text("s")
    session.number("K_s [N·s/m]").click()
    page.mouse.move(640, 200)
    expect(tip).to_be_hidden()
    page.keyboard.press("Tab")
    page.keyboard.press("Shift+Tab")
    expect(tip).to_contain_text("Gain of the linear reaching term (15)")
    page.keyboard.press("Escape")
    expect(tip).to_be_hidden()
    page.locator('.vs-equation [data-symbol="M_m"]').focus()
    page.keyboard.press("Tab")
    expect(tip).to_contain_text("Second derivative of the tracking error")


def test_a_symbol_explains_itself_by_touch(
    session: PageSession, served: tuple[Dashboard, Runner], open_page: Callable[..., Page]
) -> None:
    session.wait(lambda now: now.t > 0.5)
    page = open_page(served[0].link, viewport={"width": 390, "height": 844}, is_mobile=True, has_touch=True)
    title = page.locator(".u-title:visible").first
    title.wait_for(timeout=PATIENCE * 1e3)
    resting_box(title)  # what scrolls takes the tip away
    title.tap()
    expect(page.locator("#vs-symbol")).to_contain_text("Tracking error r − r_d")
    expect(page.locator("#vs-symbol")).to_be_visible()
    box = resting_box(page.locator("#vs-symbol"))
    assert box["x"] >= 0
    assert box["x"] + box["width"] <= 390
    # as a table that is sent again, which takes its elements with it
    title.evaluate("(old) => { old.removeAttribute('aria-describedby'); old.replaceWith(old.cloneNode(true)); }")
    expect(title).to_have_attribute("aria-describedby", "vs-symbol")
    expect(page.locator("#vs-symbol")).to_be_visible()
    page.locator(".vs-title").first.tap()
    expect(page.locator("#vs-symbol")).to_be_hidden()


def test_the_help_leads_to_every_symbol(session: PageSession) -> None:
    page = session.page
    page.keyboard.press("?")
    page.locator("[data-glossary]").click()
    glossary = page.get_by_role("dialog", name="Symbols")
    expect(glossary.locator("dt", has_text="ε")).to_be_visible()
    expect(glossary).to_contain_text(
        "Sliding variable (10): 0 means that the arm obeys the target model. [m/s or rad/s] equation (10)"
    )
    assert glossary.evaluate("(dialog) => dialog.scrollTop") == 0
    page.keyboard.press("Escape")
    expect(glossary).to_be_hidden()
    closed_by_escape(page, page.locator(".vs-help"))  # the help, below it
