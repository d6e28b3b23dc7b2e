"""A second surface in a real browser: chosen from a menu, pressed, drawn, and taken away again."""

import numpy as np
import pytest
from playwright.sync_api import expect

from drivers.pages import PageSession
from tests.support.layout import lasting_faults


@pytest.mark.usefixtures("new_page", "spent_page")
def test_a_second_surface_is_put_beside_the_tool_pressed_and_taken_away(session: PageSession):
    page = session.page
    session.tab("World")
    page.get_by_text("Second surface", exact=True).click()
    session.choose("Contact", "elastic")
    session.wait(lambda now: len(now.surfaces) == 2 and now.phase == "running")
    session.wait(lambda now: float(np.linalg.norm(now.force)) > 28.0)  # 20 N on each of two planes
    session.tab("Overview")
    expect(page.get_by_text("measured normal ₂").locator("visible=true").first).to_be_visible()
    expect(page.locator(".vs-equation").first).to_contain_text("φ₂")
    assert session.now.standing.run.verdict == "holds"
    session.tab("World")
    page.get_by_text("Coupling", exact=True).click()
    session.enter("K_e 12,13,23 [N/m]", "9000, 0, 0")
    session.wait(lambda now: now.scenario.coupling.K_e == (9000.0, 0.0, 0.0))
    session.enter("K_e 12,13,23 [N/m]", "11000, 0, 0")
    session.wait(lambda now: "symmetric positive definite" in (now.refusal or ""))
    assert session.now.system.plant.environment.coupled
    session.choose("Controlled", "the distance from it")
    session.wait(lambda now: now.system.plan.followed.sets == 0 and now.system.pressed == 1)  # believed apart
    expect(page.get_by_label("Force", exact=True).locator("visible=true")).to_have_count(0)
    session.enter("K̂_e 12,13,23 [N/m]", "2000, 0, 0")
    session.wait(lambda now: now.system.plan.followed.sets == 1)
    expect(page.get_by_text("not controlled ₂").first).to_be_attached()
    session.choose("Controlled", "its normal force")
    session.wait(lambda now: now.system.pressed == 2)
    session.choose("Contact", "none")
    session.wait(lambda now: len(now.surfaces) == 1 and now.phase == "running")
    session.tab("Task")  # at its top: what is scrolled away lies below the status
    assert not lasting_faults(page)
