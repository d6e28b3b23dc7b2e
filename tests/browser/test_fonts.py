"""The page brings its fonts along: it is the same picture whatever fonts a machine has."""

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import matplotlib
import pytest
from playwright.sync_api import Browser, Page

from app.dashboard.theme.fonts import FACES
from app.session.commands import Pause
from drivers.browser import LAUNCH_ARGS, find_or_install
from drivers.pages import NO_HINTS, PATIENCE, UNDRAWN, VIEWPORT, PageSession, wait_without_notice
from drivers.visitors import serving
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
LOADED = """async (families) => {
  for (const family of families) await document.fonts.load(`12px "${family}"`);
  const loaded = [...document.fonts].filter((font) => font.status === "loaded").map((font) => font.family).join();
  return families.every((family) => loaded.includes(family));
}"""


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
            one.get_by_role("tab", name=title, exact=True).click()
        assert lasting(page, lambda poor: sorted({*poor.evaluate(PLACES)} ^ {*session.page.evaluate(PLACES)})) == []


def test_fonts_come_through_the_gateway_under_its_rules(open_page):
    with serving("--shared", "--max-sessions", "1", lines=2, fps=4) as server:
        page = open_page(server.url, viewport=VIEWPORT, console_errors_allowed=True)  # at the end nobody answers
        asked: list[str] = []
        page.on("request", lambda request: asked.append(request.url))
        page.get_by_text("real time").wait_for(timeout=PATIENCE * 1e3)
        page.wait_for_function(LOADED, arg=[face.family for face in FACES])
        assert [url for url in asked if "127.0.0.1" not in url and not url.startswith(("data:", "blob:"))] == []
        page.close()  # before its server ends
