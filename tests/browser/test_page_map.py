"""The tab Robustness in a real browser: a slider swept from its menu, a map filled in beside the loop, a tile opened, a
search for gains with a candidate previewed and applied, and both cancelled."""

import io
import re
import zipfile

import pytest
from playwright.sync_api import expect

from app.sweep.question import FILE
from drivers.pages import PATIENCE, Session
from tests.support.full_speed import full_speed  # noqa: F401
from tests.support.layout import lasting_faults

SAID = re.compile(
    r"boundary layer [\d.]+ m/s, stiffness of the surface [\d.]+ N/m: force error at the end .* worst of 4 arms"
)
PICKED = re.compile(r"boundary layer [\d.]+, reaching gain K_s [\d.]+: residual [\d.e−-]+ N, torque variation .*")


def write(session: Session, label: str, text: str, number: int = 0) -> None:
    field = session.page.get_by_label(label, exact=True).locator("visible=true").nth(number)
    field.fill(text)
    field.press("Enter")


@pytest.mark.usefixtures("own_page", "full_speed")
def test_a_slider_is_swept_the_map_fills_in_while_the_loop_runs_and_a_tile_opens_its_run(session: Session):
    page = session.page
    session.tab("Controller")
    session.row("layer s_b [m/s]").locator("[role=slider]").focus()
    page.keyboard.press("Shift+F10")
    expect(page.get_by_role("menuitem").first).to_be_focused()
    page.keyboard.press("Enter")
    expect(page.get_by_label("Across", exact=True).locator("visible=true")).to_have_value("boundary layer")
    expect(page.get_by_label("Up", exact=True).locator("visible=true")).to_have_value("—")
    session.choose("Up", "stiffness of the surface")
    session.choose("Steps of each", "5")
    session.choose("True arms", "4 of the declared set")
    write(session, "each run [s]", "0.05")
    page.get_by_role("button", name="Compute the map").click()
    expect(page.locator(".vs-strip")).to_contain_text("each run: 0.05 s; allowed: 0.2 to 10 s")
    write(session, "each run [s]", "0.2")
    page.get_by_role("button", name="Compute the map").click()
    page.get_by_text("100 of 100 runs").wait_for(timeout=PATIENCE * 1e3)
    assert session.now.phase == "running"
    tiles = page.locator(".vs-tiles [data-point]")
    expect(tiles).to_have_count(25)
    assert not lasting_faults(page)
    with page.expect_download() as download:
        page.get_by_role("button", name="sweep folder").click()
    with zipfile.ZipFile(io.BytesIO(download.value.path().read_bytes())) as file:
        assert {name.rpartition("/")[2] for name in file.namelist()} >= {FILE, "part-000001.parquet"}

    page.locator(".vs-tiles [data-point='6']").focus()
    page.keyboard.press("ArrowUp")
    tile = page.locator(".vs-tiles [data-point='7']")
    expect(tile).to_be_focused()
    expect(tile).to_have_attribute("aria-label", SAID)
    expect(page.locator(".vs-said").first).to_have_text(SAID)
    page.keyboard.press("Enter")
    session.wait(lambda now: abs(now.scenario.contact.K_e - 1e4) < 0.1 and now.phase == "paused")
    assert session.now.t == pytest.approx(0.2)
    assert session.now.scenario.truth.link_scaling != 1.15  # that of the worst arm

    session.choose("Steps of each", "13")
    page.get_by_role("button", name="Compute the map").click()
    page.get_by_role("button", name="Cancel").click()
    page.get_by_text("runs, cancelled").wait_for(timeout=PATIENCE * 1e3)
    page.get_by_role("button", name="Compute the map").wait_for()


@pytest.mark.usefixtures("own_page", "full_speed")
def test_a_search_finds_candidates_of_which_one_is_previewed_and_then_applied(session: Session):
    page = session.page
    session.tab("Robustness")
    page.get_by_text("Search for better gains").click()
    session.choose("What counts", "residual of (8)")
    session.choose("Judged by", "the scenario's own")
    write(session, "arms not seen", "1")
    write(session, "each run [s]", "0.2", number=1)
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
