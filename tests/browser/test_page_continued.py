"""A page that offers to continue where the last session was left off."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from playwright.sync_api import Page

from app.dashboard.page import Dashboard
from app.dashboard.widgets.page.last_session import left_by
from app.scenario.data import edited, load
from app.session.autosave import Autosave, StateFolder
from app.session.runner import Runner
from app.session.timeline import Timeline
from app.simulation.closed_loop import ClosedLoop
from app.storage.session_index import OFFER, SESSION
from drivers.pages import PATIENCE, VIEWPORT, open_tab, resting_box, wait_without_notice
from drivers.waiting import until
from tests.support.drawn import drawn

SCENARIO = load("planar2r-semicircle")
CHANGED = edited(SCENARIO, "controller.layer", 0.02)


def test_a_page_continues_where_it_was_left_off(tmp_path: Path, open_page: Callable[..., Page]) -> None:
    line = Timeline(ClosedLoop.from_scenario(SCENARIO, 10_000))
    for _ in range(2):
        for _ in range(100):
            line.step()
        line.pin()
    folder = StateFolder(tmp_path)
    folder.save(CHANGED, line.pinned)
    folder.close()
    folder = StateFolder(tmp_path)
    dashboard, runner = Dashboard(port=0, fps=4.0), Runner(load("ur5-hybrid"))
    runner.start()
    autosave = Autosave(folder, lambda: runner.snapshot, dashboard.fail)
    dashboard.attach(runner)
    left = left_by(folder, autosave, runner.snapshot.scenario)
    assert left is not None
    dashboard.offer(left)
    with closing(runner), closing(autosave), drawn(dashboard):
        page = open_page(dashboard.url, viewport=VIEWPORT)
        page.set_default_timeout(PATIENCE * 1e3)
        offer = page.get_by_text("with 2 pinned runs, saved")
        offer.wait_for()
        run = page.get_by_role("button", name="play / pause")
        places = [resting_box(place) for place in (page.get_by_text("real time"), offer, run)]
        heights = [place["y"] for place in places]
        assert heights == sorted(heights)  # below the status, above the controls
        if where := os.environ.get("VSMRC_SCREENSHOTS"):
            wait_without_notice(page)
            page.evaluate("window.undrawn = false")
            page.wait_for_timeout(3000)
            page.screenshot(path=f"{where}/last-session.png")
        assert runner.snapshot.scenario == load("ur5-hybrid")  # nothing is applied by itself
        page.get_by_role("button", name="Continue where you left off").click()
        until(lambda: runner.snapshot.scenario == CHANGED and len(runner.snapshot.pinned) == 2)
        offer.wait_for(state="hidden")
        until(lambda: (tmp_path / SESSION).exists() and not (tmp_path / OFFER).exists())
        open_tab(page, "Runs")
        page.get_by_role("button", name="Forget run 2").wait_for()
