"""A browser, the dashboard that it shows, and pages of both."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field

import pytest
from playwright.sync_api import Browser, BrowserContext, ConsoleMessage, Page, sync_playwright

from app.dashboard.page import Dashboard
from app.scenario.data import shipped
from app.session.commands import Load, Pause, Play, Reset, SetSpeed
from app.session.runner import Runner
from drivers.browser import LAUNCH_ARGS, find_or_install
from drivers.pages import NO_HINTS, PATIENCE, UNDRAWN, VIEWPORT, Session
from tests.support.drawn import drawn

# viser's own client says so at every drag in the scene (SceneTree.tsx); it does no harm
VISERS_OWN = "Unable to preventDefault inside passive event listener"
PASSED = pytest.StashKey[bool]()


def pytest_itemcollected(item: pytest.Item) -> None:
    if "browser" in getattr(item, "fixturenames", ()):
        item.add_marker(pytest.mark.browser)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item):
    report = yield
    if report.when == "call":
        item.stash[PASSED] = report.passed
    return report


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    executable = find_or_install()
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=executable, args=LAUNCH_ARGS)
        yield chromium
        chromium.close()


@dataclass
class Desk:
    """Pages in contexts of their own, and what their consoles said that should not be there."""

    browser: Browser
    contexts: list[BrowserContext] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)

    def open(
        self, url: str, *, console_errors_allowed: bool = False, first_visit: bool = False, **context_options
    ) -> Page:
        self.contexts.append(context := self.browser.new_context(**context_options))
        context.add_init_script(UNDRAWN)
        if not first_visit:
            context.add_init_script(NO_HINTS)
        page = context.new_page()
        if not console_errors_allowed:
            page.on("pageerror", lambda error: self.errors.append(error.stack or str(error)))
            page.on("console", self._note)
        page.goto(url)
        return page

    def _note(self, message: ConsoleMessage) -> None:
        if message.type == "error" and VISERS_OWN not in message.text:
            self.errors.append(message.text)

    def close(self) -> None:
        while self.contexts:
            self.contexts.pop().close()

    def judge(self) -> None:
        found, self.errors = self.errors, []
        assert not found, "the browser's console shows errors"


@pytest.fixture
def open_page(browser: Browser) -> Iterator[Callable[..., Page]]:
    """`open_page(url, **context_options)`: each page in a context of its own, its console free of errors.

    A test that expects errors there says so with `console_errors_allowed=True`, and one that wants the first steps,
    which lie over the scene, with `first_visit=True`.
    """
    desk = Desk(browser)
    with closing(desk):
        yield desk.open
    desk.judge()


@pytest.fixture(scope="session")
def served() -> Iterator[tuple[Dashboard, Runner]]:
    """A dashboard on a free port, with the loop that it shows."""
    dashboard = Dashboard(port=0, fps=8.0)  # software draws these pages, on the cores that the tests need
    dashboard.show_progress("compiling the control law…")
    runner = Runner(shipped()["ur5-hybrid"])
    dashboard.attach(runner)
    runner.start()
    runner.post(Pause())  # until a test wants it
    with drawn(dashboard):
        yield dashboard, runner
    runner.close()


@dataclass
class Kept:
    """The page that the tests of a file use one after the other; opening one takes as long as such a test."""

    desk: Desk
    page: Page | None = None
    first: list[str] = field(default_factory=list)  # the tabs that are open in the beginning

    def opened(self, url: str) -> Page:
        if self.page is None:
            self.page = page = self.desk.open(url, viewport=VIEWPORT)
            page.set_default_timeout(PATIENCE * 1e3)
            page.get_by_text("real time").wait_for()
            warning = page.locator("#webgl-software-rendering")  # viser's own, and it lies over the scene
            warning.locator("button").click()
            warning.wait_for(state="detached")
            self.first = page.locator(OPEN_TABS).all_inner_texts()
        return self.page

    def tidy(self) -> None:
        """As it was in the beginning: nothing held or pressed, the first tabs open."""
        page = self.page
        assert page is not None
        page.mouse.up()
        page.keyboard.press("Escape")
        page.evaluate("document.activeElement?.blur()")
        page.mouse.move(0, 0)
        for title in page.locator(OPEN_TABS).all_inner_texts():  # those within another tab, before that is left
            if title not in self.first:
                row = page.locator("[role=tablist]:visible", has=page.get_by_role("tab", name=title, exact=True))
                if not set(titles := row.get_by_role("tab").all_inner_texts()) & set(self.first):
                    row.get_by_role("tab", name=titles[0], exact=True).click()
        for title in self.first:
            page.get_by_role("tab", name=title, exact=True).click()

    def drop(self) -> None:
        self.page = None
        self.desk.close()


OPEN_TABS = "[role=tab][aria-selected=true]:visible"


@pytest.fixture(scope="module")
def kept(browser: Browser) -> Iterator[Kept]:
    desk = Desk(browser)
    with closing(desk):
        yield Kept(desk)


@pytest.fixture
def own_page(kept: Kept) -> Iterator[None]:
    """For a test whose page must be a new one, or which leaves something in it that the next one would meet."""
    kept.drop()
    yield
    kept.drop()


@pytest.fixture
def session(served: tuple[Dashboard, Runner], kept: Kept, request: pytest.FixtureRequest) -> Iterator[Session]:
    """A page of a loop that has just begun; it rests between such tests. The page may be that of the test before,
    with the first tabs open: see `own_page`."""
    dashboard, runner = served
    before = runner.snapshot.run
    for command in (Load(shipped()["ur5-hybrid"]), SetSpeed(1.0), Reset(), Play()):
        runner.post(command)
    opened = Session(kept.opened(dashboard.url), runner)
    opened.wait(lambda now: now.run > before and now.scenario.name == "ur5-hybrid" and now.phase == "running")
    yield opened
    runner.post(Pause())
    if request.node.stash.get(PASSED, False) and opened.page.url.rstrip("/") == dashboard.url:
        kept.tidy()
    else:
        kept.drop()
    kept.desk.judge()
