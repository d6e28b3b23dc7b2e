"""The robustness map in a real browser: asked, filled in beside the loop, a tile opened, and cancelled."""

import re
import tomllib

import pytest
from playwright.sync_api import expect

from drivers.pages import PATIENCE, Session
from tests.support.layout import lasting_faults

SAID = re.compile(
    r"stiffness of the surface [\d.]+ N/m, boundary layer [\d.]+ m/s: force error at the end .* worst of 4 arms"
)


def write(session: Session, label: str, text: str) -> None:
    field = session.page.get_by_label(label, exact=True)
    field.fill(text)
    field.press("Enter")


@pytest.mark.usefixtures("own_page")
def test_a_map_is_filled_in_while_the_loop_runs_and_a_tile_opens_its_run(session: Session):
    page = session.page
    session.tab("Runs")
    page.get_by_text("Robustness map").click()
    session.choose("Tiles", "5 × 5")
    session.choose("True arms", "4 of the declared set")
    session.choose("Up", "boundary layer")
    write(session, "each run [s]", "0.05")
    page.get_by_role("button", name="Compute the map").click()
    expect(page.locator(".vs-strip")).to_contain_text("each run: 0.05 s; allowed: 0.2 to 10 s")
    write(session, "each run [s]", "0.3")
    page.get_by_role("button", name="Compute the map").click()
    page.get_by_text("100 of 100 runs").wait_for(timeout=PATIENCE * 1e3)
    assert session.now.phase == "running"
    tiles = page.locator(".vs-tiles [data-point]")
    expect(tiles).to_have_count(25)
    assert not lasting_faults(page)
    expect(tiles.nth(7)).to_have_attribute("aria-label", SAID)
    with page.expect_download() as download:
        page.get_by_role("button", name="This sweep as a file").click()
    assert tomllib.loads(download.value.path().read_text(encoding="utf-8"))["draw"] == 4

    tile = page.locator(".vs-tiles [data-point='7']")  # the second column from the left, the third row from below
    tile.focus()
    page.keyboard.press("Enter")
    session.wait(lambda now: abs(now.scenario.contact.K_e - 3162.28) < 0.1)
    session.wait(lambda now: abs(now.scenario.controller.layer - 0.00707107) < 1e-6 and now.phase == "running")
    assert session.now.scenario.truth.link_scaling != 1.15  # that of the worst arm
    assert session.now.scenario.simulation.duration > 0.3

    session.choose("Tiles", "13 × 13")
    page.get_by_role("button", name="Compute the map").click()
    page.get_by_role("button", name="Cancel").click()
    page.get_by_text("runs, cancelled").wait_for(timeout=PATIENCE * 1e3)
    page.get_by_role("button", name="Compute the map").wait_for()
