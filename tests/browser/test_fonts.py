"""The page brings its fonts along: it is the same picture whatever fonts a machine has."""

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import matplotlib
import pytest
from playwright.sync_api import Browser, Page

from app.session.commands import Pause
from drivers.browser import LAUNCH_ARGS, find_or_install
from drivers.pages import NO_HINTS, PATIENCE, UNDRAWN, VIEWPORT, PageSession, open_tab, wait_without_notice
from tests.support.fonts import TEXTS
from tests.support.layout import lasting

ONE_FONT = """<?xml version="1.0"?><!DOCTYPE fontconfig SYSTEM "fonts.dtd">
<fontconfig><dir>{fonts}</dir><cachedir>{cache}</cachedir></fontconfig>"""
# where every piece of text stands; numbers that go on changing are left out, and labels of the scene, which move with
# the arm
PLACES = f"""() => {TEXTS}.filter((e) => !e.closest(".vs-status, .vs-facts, .vs-labels")).map((e) => {{
  const {{ x, y, width, height }} = e.getBoundingClientRect();
  return [e.textContent, ...[x, y, width, height].map(Math.round)].join(" ");
}})"""


@pytest.fixture
def poor(browser: Browser, tmp_path: Path) -> Iterator[Browser]:
    """A browser on a machine whose only font is a wide one without proportions."""
    (tmp_path / "fonts").mkdir()
    shutil.copy(Path(matplotlib.get_data_path(), "fonts", "ttf", "DejaVuSansMono.ttf"), tmp_path / "fonts")
    (tmp_path / "fonts.conf").write_text(ONE_FONT.format(fonts=tmp_path / "fonts", cache=tmp_path / "cache"))
    environment = os.environ | {"FONTCONFIG_FILE": str(tmp_path / "fonts.conf")}
    chromium = browser.browser_type.launch(executable_path=find_or_install(), args=LAUNCH_ARGS, env=environment)
    yield chromium
    chromium.close()


def opened(browser: Browser, url: str) -> Page:
    context = browser.new_context(viewport=VIEWPORT)
    context.add_init_script(UNDRAWN)
    context.add_init_script(NO_HINTS)
    page = context.new_page()
    page.set_default_timeout(PATIENCE * 1e3)
    page.goto(url)
    page.get_by_text("real time").wait_for()
    wait_without_notice(page)
    return page


def test_the_page_is_laid_out_alike_whatever_fonts_a_machine_has(session: PageSession, poor: Browser):
    session.wait(lambda now: now.t > 0.3)
    session.runner.post(Pause())
    page = opened(poor, session.page.url)
    for title in ("Sliding", "View", "Model", "Task"):
        for one in (page, session.page):
            open_tab(one, title)
        assert lasting(page, lambda poor: sorted({*poor.evaluate(PLACES)} ^ {*session.page.evaluate(PLACES)})) == []
