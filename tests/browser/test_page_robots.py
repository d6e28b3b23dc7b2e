"""The Robot tab in a real browser: a URDF uploaded, one refused, and the verdict on the truth."""

from pathlib import Path

import pytest
from playwright.sync_api import expect

from drivers.pages import PageSession

BENT = Path(__file__).parents[1] / "support" / "robots" / "bent3r.urdf"


@pytest.fixture
def tab(session: PageSession, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> PageSession:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    session.tab("Robot")
    return session


def test_an_uploaded_urdf_runs_with_the_tool_frame_and_posture_that_are_asked_for(tab: PageSession):
    upload = tab.page.locator("input[type=file][accept*='.urdf']")
    tab.choose("Arm", "own URDF")
    tab.page.locator(".vs-message", has_text="URDF: none is given").wait_for()
    with tab.page.expect_file_chooser() as dialog:
        tab.page.locator(".vs-acts").get_by_role("button", name="Upload a URDF").click()
    dialog.value.set_files(BENT)
    tab.wait(lambda now: now.robot.title == "bent3r" and now.t > 0.5)
    assert tab.now.phase == "running", tab.now.reason
    assert Path(tab.now.scenario.robot.urdf or "").read_bytes() == BENT.read_bytes()
    tab.page.get_by_text("bent3r: 3 joints").wait_for()
    tab.enter("posture [rad]", "0.3, 0.9, 1.9")
    tab.wait(lambda now: now.scenario.robot.posture == (0.3, 0.9, 1.9))
    tab.choose("Tool frame", "flange")
    tab.wait(lambda now: now.robot.tool_frame == "flange")
    before = tab.now
    tab.enter("posture [rad]", "0, 3, 1")
    tab.page.locator(".vs-message", has_text="3 rad for joint 'shoulder'; allowed: -1.8 to 1.8 rad").wait_for()
    evil = {"name": "<b>evil.urdf", "mimeType": "text/xml", "buffer": b"<!DOCTYPE a><robot/>"}
    upload.set_input_files(evil)
    tab.page.locator(".vs-message", has_text="<b>evil.urdf: has a DOCTYPE").wait_for()
    tab.wait(lambda now: now.t > before.t + 0.3)
    assert tab.now.scenario == before.scenario
    tab.choose("Arm", "Universal Robots UR5")
    tab.wait(lambda now: now.robot.name == "ur5" and now.scenario.robot.urdf is None and now.phase == "running")
    tab.enter("path", str(BENT))
    tab.wait(lambda now: now.scenario.robot.urdf == str(BENT))


def test_the_verdict_turns_red_names_the_inequality_and_turns_green_again(tab: PageSession):
    green = tab.page.locator(".vs-verdict").get_by_text("true arm inside the declared set")
    red = tab.page.locator(".vs-status").get_by_text("true arm outside the declared set")
    green.wait_for()
    run = tab.now.run
    tab.enter("link by link ×", "1.1, 1, 0.8, 1, 1, 1")
    tab.page.get_by_text("link scaling of link 3 |0.8 − 1| = 0.2 > declared 0.15").wait_for()
    red.wait_for()
    tab.enter("links 1 ±", "0.2")
    green.wait_for()
    red.wait_for(state="hidden")
    assert tab.now.scenario.truth.link_scaling == (1.1, 1.0, 0.8, 1.0, 1.0, 1.0)
    expect(tab.row("links ×")).to_have_count(0)
    tab.enter("link by link ×", "1.1")
    tab.wait(lambda now: now.scenario.truth.link_scaling == 1.1)
    tab.row("links ×").wait_for()
    assert tab.now.run == run
