"""The tab Robustness in a real browser: a slider swept from its menu, a map filled in beside the loop, a tile opened,
also by keyboard alone, a search for gains with a candidate previewed and applied, and both cancelled."""

import io
import re
import zipfile
from collections.abc import Callable

import pytest
from playwright.sync_api import Page, expect

from app.sweep.plan import FILE
from drivers.pages import PATIENCE, VIEWPORT, PageSession, named, type_over
from tests.support.layout import lasting, lasting_faults

SAID = re.compile(
    r"boundary layer [\d.]+ m/s, stiffness of the surface [\d.]+ N/m: largest force error at the end .* worst of 4 arms"
)
PICKED = re.compile(
    r"candidate 3, boundary layer [\d.]+ m/s, reaching gain K_s [\d.]+ N·s/m: residual [\d.e−-]+ N, torque variation .*"
)


@pytest.fixture
def session(own_session: PageSession) -> PageSession:
    """The page of a dashboard on which nothing was chosen for another map."""
    return own_session


FOCUSED = """() => {
  const e = document.activeElement;
  return e.ariaLabel || e.labels?.[0]?.textContent || e.textContent.trim();
}"""
CUT = """[...document.querySelectorAll(".mantine-Button-label")]
  .filter((e) => e.checkVisibility() && e.scrollWidth > e.clientWidth).map((e) => e.textContent)"""
OFFERED = "[...document.querySelectorAll('[data-combobox-selected]')].find((e) => e.checkVisibility())?.textContent"


def reach(page: Page, name: str, key: str = "Tab") -> None:
    """Go on by this key until what has this name has the focus."""
    for _ in range(400):  # from the beginning again where what had the focus is drawn anew
        page.keyboard.press(key)
        if page.evaluate(FOCUSED) == name:
            return
    raise AssertionError(f"the keyboard does not reach {name}")


def pick(page: Page, menu: str, option: str) -> None:
    """Choose an option of a menu by keyboard, again where its options are drawn anew meanwhile."""
    field = page.get_by_label(menu, exact=True).locator("visible=true")
    for _ in range(5):
        reach(page, menu)
        for _ in range(20):
            before = page.evaluate(OFFERED)
            page.keyboard.press("ArrowDown")
            page.wait_for_function(f"(before) => ({OFFERED} ?? null) !== before", arg=before)
            if page.evaluate(OFFERED) == option:
                break
        page.keyboard.press("Enter")
        expect(field).to_have_attribute("aria-expanded", "false")
        if field.input_value() == option:
            break
    expect(field).to_have_value(option)


def write(session: PageSession, label: str, text: str, number: int = 0) -> None:
    type_over(session.page.get_by_label(named(label)).locator("visible=true").nth(number), text)


def test_a_slider_is_swept_the_map_fills_in_while_the_loop_runs_and_a_tile_opens_its_run(
    session: PageSession, open_page: Callable[..., Page]
):
    page, before = session.page, session.now.scenario
    session.tab("Controller")
    session.row("layer s_b [m/s]").locator("[role=slider]").focus()
    page.keyboard.press("Shift+F10")
    expect(page.get_by_role("menuitem").first).to_be_focused()
    page.keyboard.press("Enter")
    across = page.get_by_label("Across", exact=True).locator("visible=true")
    expect(across).to_have_value("boundary layer")
    expect(across).to_be_focused()  # the next key goes on there
    expect(page.get_by_label("Up", exact=True).locator("visible=true")).to_have_value("—")
    session.choose("Up", "stiffness of the surface")
    session.choose("Steps of each", "5")
    session.choose("True arms", "4 of the declared set")
    write(session, "Each run [s]", "0.05")
    page.get_by_role("button", name="Compute the map").click()
    expect(page.locator(".vs-strip")).to_contain_text("Each run: 0.05 s; allowed: 0.2 to 10 s")
    write(session, "Each run [s]", "0.2")
    page.get_by_role("button", name="Compute the map").click()
    page.get_by_text("100 of 100 runs").wait_for(timeout=PATIENCE * 1e3)
    assert session.now.phase == "running"
    tiles = page.locator(".vs-tiles[data-field=vs-tile-field] [data-point]")
    expect(tiles).to_have_count(25)
    expect(page.get_by_role("button", name="Compute the map")).to_be_visible()
    bottom = "document.querySelector('.vs-tiles[data-field=vs-tile-field]').getBoundingClientRect().bottom"
    page.wait_for_function(f"{bottom} < {VIEWPORT['height'] + 1}")  # it comes into view
    page.evaluate("document.querySelector('.mantine-ScrollArea-viewport:has(.vs-status)').scrollTop = 0")
    assert not lasting_faults(page)
    with page.expect_download() as download:
        page.get_by_role("button", name="sweep folder").click()
    with zipfile.ZipFile(io.BytesIO(download.value.path().read_bytes())) as file:
        assert {name.rpartition("/")[2] for name in file.namelist()} >= {FILE, "part-000001.parquet"}
    phone = open_page(page.url, viewport={"width": 390, "height": 844}, is_mobile=True, has_touch=True)
    phone.get_by_role("tab", name="Robustness", exact=True).click()
    phone.get_by_role("button", name="sweep folder").wait_for()
    assert lasting(phone, lambda phone: phone.evaluate(CUT)) == []
    phone.close()

    page.locator(".vs-tiles[data-field=vs-tile-field] [data-point='6']").focus()
    page.keyboard.press("ArrowUp")
    tile = page.locator(".vs-tiles[data-field=vs-tile-field] [data-point='7']")
    expect(tile).to_be_focused()
    expect(tile).to_have_attribute("aria-label", SAID)
    expect(page.locator(".vs-description").first).to_have_text(SAID)
    page.keyboard.press("Enter")
    session.wait(lambda now: abs(now.scenario.contact.K_e - 1e4) < 0.1 and now.phase == "paused")
    assert session.now.t == pytest.approx(0.2)
    assert session.now.scenario.truth.link_scaling != 1.15  # that of the worst arm
    assert session.now.scenario.simulation == before.simulation  # Omega is that of the whole path

    page.locator(".vs-tiles[data-field=vs-tile-field] [data-point='6']").click()
    session.wait(lambda now: now.scenario.contact.K_e < 9e3 and now.phase == "paused")
    page.keyboard.press(" ")  # of the run: the tile was chosen with the mouse
    session.wait(lambda now: now.phase == "running" and now.t > 0.5)
    session.tab("Runs")
    (kept,) = session.now.pinned  # the run before the tiles'
    assert kept.scenario == before
    page.get_by_role("button", name=f"Settings of run {kept.number}", exact=True).click()
    session.wait(lambda now: now.scenario == before)
    session.tab("Robustness")

    session.choose("Steps of each", "13")
    page.get_by_role("button", name="Compute the map").click()
    page.get_by_role("button", name="Cancel").click()
    page.locator(".vs-note:visible", has_text="runs, cancelled").wait_for(timeout=PATIENCE * 1e3)
    page.get_by_role("button", name="Compute the map").wait_for()


@pytest.mark.parametrize(("width", "height"), [(1280, 720), (390, 844)])
def test_the_keyboard_alone_computes_a_map_and_opens_the_run_of_a_tile(session: PageSession, width: int, height: int):
    page = session.page
    page.set_viewport_size({"width": width, "height": height})
    expect(page.locator("[data-dock-region]")).to_have_count(2 if width > 576 else 0)  # viser's layout for a phone
    page.locator("form:visible [role=slider][aria-valuetext]").first.wait_for()
    reach(page, "Task")
    reach(page, "Robustness", "ArrowRight")
    page.get_by_label("Up", exact=True).locator("visible=true").wait_for()
    pick(page, "Up", "boundary layer")
    pick(page, "Steps of each", "5")
    reach(page, "Each run [s]")
    page.keyboard.press("Control+A")
    page.keyboard.type("0.2")
    page.wait_for_function("window.vsmrcSent.some((sent) => sent.endsWith('\"0.2\"}'))")  # a moment after the last key
    reach(page, "Compute the map")
    page.keyboard.press("Enter")
    page.locator(".vs-note:visible", has_text="25 of 25 runs").wait_for(timeout=PATIENCE * 1e3)
    expect(page.locator(".vs-tiles[data-field=vs-tile-field] [data-point]")).to_have_count(25)
    session.wait(lambda _: page.evaluate(FOCUSED) == "Compute the map")  # the focus is not lost to the body
    for _ in range(5):
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement.matches('.vs-tiles[data-field=vs-tile-field] [data-point]')"):
            break
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowUp")
    tile = r"stiffness of the surface 3160 N/m, boundary layer [\d.]+ m/s: largest force error at the end [\d.]+ N"
    session.wait(lambda _: re.fullmatch(tile, page.evaluate(FOCUSED)) is not None)
    label = page.evaluate(FOCUSED)
    expect(page.locator(".vs-description").first).to_have_text(label)
    seen = "((box) => box.top >= 0 && box.bottom <= innerHeight)(document.activeElement.getBoundingClientRect())"
    session.wait(lambda _: page.evaluate(seen))
    page.keyboard.press("Enter")
    session.wait(lambda now: now.phase == "paused" and now.t == pytest.approx(0.2))
    assert session.now.scenario.contact.K_e == pytest.approx(3162.28, rel=1e-5)
    assert session.now.scenario.controller.layer == pytest.approx(0.001 * 50**0.25, rel=1e-4)
    session.wait(lambda _: page.evaluate(FOCUSED) == label)  # the next tile is an arrow away


def test_a_search_finds_candidates_of_which_one_is_previewed_and_then_applied(session: PageSession):
    page = session.page
    session.tab("Robustness")
    page.get_by_text("Search for better gains").click()
    session.choose("What counts", "residual of (8)")
    session.choose("Judged by", "the scenario's own")
    session.choose("Candidates", "128")  # enough that it has not ended before it is cancelled
    write(session, "Test arms", "1")
    write(session, "Each run [s]", "0.2", number=1)
    page.get_by_role("button", name="Search", exact=True).click()
    chart = page.locator(".vs-tiles[data-field=vs-candidate-field]")
    chart.locator("[data-point='3']").wait_for(timeout=PATIENCE * 1e3)
    page.get_by_role("button", name="Cancel the search").click()
    page.get_by_role("button", name="Search", exact=True).wait_for(timeout=PATIENCE * 1e3)
    candidate = chart.locator("[data-point='3']")
    expect(candidate).to_have_attribute("aria-label", PICKED)
    before = session.now.scenario.controller
    candidate.focus()
    page.keyboard.press("Enter")
    expect(page.locator(".vs-held")).to_contain_text("click again: apply")
    expect(page.get_by_role("button", name="Cancel", exact=True)).to_be_visible()  # nothing is applied yet
    page.locator(".vs-preview .vs-foreseen").hover()
    page.mouse.wheel(0, 500)  # on a low screen, too, all results can be scrolled to, and stay while they are drawn anew
    page.wait_for_timeout(1500)
    page.wait_for_function("""() => {
      const row = [...document.querySelectorAll(".vs-preview .vs-foreseen tr")].at(-1);
      const box = row.getBoundingClientRect();
      return row.contains(document.elementFromPoint(box.x + 20, box.y + box.height / 2));
    }""")
    expect(chart).to_have_attribute("data-previewed", "")  # until then Esc leaves nothing
    assert session.now.scenario.controller == before
    page.keyboard.press("Escape")
    expect(chart).not_to_have_attribute("data-previewed", "")
    candidate.focus()
    page.keyboard.press("Enter")
    expect(chart).to_have_attribute("data-previewed", "")
    page.keyboard.press("Enter")
    session.wait(
        lambda now: now.scenario.controller.layer != before.layer and now.scenario.controller.K_s != before.K_s
    )
