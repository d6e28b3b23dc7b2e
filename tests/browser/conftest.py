"""A browser, the dashboard that it shows, and pages of both."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import pytest
from playwright.sync_api import Browser, BrowserContext, ConsoleMessage, Page, expect, sync_playwright

from app.dashboard.page import Dashboard
from app.session.commands import Pause, Play
from app.session.runner import Runner
from drivers.browser import LAUNCH_ARGS, find_or_install
from drivers.pages import NO_HINTS, PATIENCE, SENT, UNDRAWN, VIEWPORT, PageSession, wait_without_notice
from drivers.waiting import until
from tests.browser.shared_page import SCENARIO, SharedPage, rest_at_start
from tests.support.drawn import serving

# What viser's own client says, which does no harm: at every drag in the scene (SceneTree.tsx); and on a busy machine of
# a row that has been removed, since of all messages that have come it applies updates last (MessageHandler.tsx).
VISERS_OWN = ("Unable to preventDefault inside passive event listener", "Tried to update non-existent component")
# With every page Chromium begins a process for what drops down from its address bar, which is not there: a second of a
# core. There is one such list: the other names are those of Playwright, which it replaces.
UNSEEN = (
    "WebUIOmniboxPopup", "WebUIOmniboxAimPopup", "WebUIOmniboxFullPopup",
    "AimEnabled", "AvoidCorsURLLoaderRestartOnRedirect", "AvoidUnnecessaryBeforeUnloadCheckSync",
    "DestroyProfileOnBrowserClose", "HttpsFirstBalancedModeAutoEnable", "HttpsUpgrades", "LensOverlay", "MediaRouter",
    "NetworkTimeServiceQuerying", "OptimizationHints", "PaintHolding", "PreconnectToSearch",
    "ThirdPartyStoragePartitioning",
)  # fmt: skip
PASSED = pytest.StashKey[bool]()


def pytest_itemcollected(item: pytest.Item) -> None:
    """Tests with a browser run apart from the others, which would take their cores."""
    if "browser" in getattr(item, "fixturenames", ()):
        item.add_marker(pytest.mark.browser)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Iterator[None]:
    """Notes whether the test itself has passed, for what is done with its page."""
    report = yield
    if report.when == "call":
        item.stash[PASSED] = report.passed
    return report


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    executable = find_or_install()
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(
            executable_path=executable,
            timeout=PATIENCE * 1e3,
            args=[*LAUNCH_ARGS, f"--disable-features={','.join(UNSEEN)}"],
        )
        expect.set_options(timeout=PATIENCE * 1e3)
        yield chromium
        chromium.close()


@dataclass
class Pages:
    """Pages, each in a context of its own, and what their consoles said that should not be there."""

    browser: Browser
    contexts: list[BrowserContext] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)

    def open(
        self, url: str, *, console_errors_allowed: bool = False, first_visit: bool = False, **context_options
    ) -> Page:
        self.contexts.append(context := self.browser.new_context(**context_options))
        context.add_init_script(UNDRAWN)
        context.add_init_script(SENT)
        if not first_visit:
            context.add_init_script(NO_HINTS)
        page = context.new_page()
        page.set_default_timeout(PATIENCE * 1e3)
        if not console_errors_allowed:
            page.on("pageerror", lambda error: self.errors.append(error.stack or str(error)))
            page.on("console", self._note)
        page.goto(url)
        return page

    def _note(self, message: ConsoleMessage) -> None:
        if message.type == "error" and not any(own in message.text for own in VISERS_OWN):
            self.errors.append(message.text)

    def close(self) -> None:
        while self.contexts:
            self.contexts.pop().close()

    def require_no_errors(self) -> None:
        """Fail if a console has shown an error since the last call."""
        errors, self.errors = self.errors, []
        assert not errors, "the browser's console shows errors"


@pytest.fixture
def open_page(browser: Browser) -> Iterator[Callable[..., Page]]:
    """`open_page(url, **context_options)`: each page in a context of its own, its console free of errors.

    A test that expects errors there says so with `console_errors_allowed=True`, and one that wants the first steps,
    which lie over the scene, with `first_visit=True`.
    """
    pages = Pages(browser)
    yield pages.open
    pages.close()
    pages.require_no_errors()


def opened(pages: Pages, dashboard: Dashboard) -> Page:
    """A page of this dashboard that shows the running loop."""
    page = pages.open(dashboard.url, viewport=VIEWPORT)
    page.get_by_text("real time").wait_for()
    wait_without_notice(page)
    return page


@pytest.fixture(scope="session")
def served() -> Iterator[tuple[Dashboard, Runner]]:
    """The dashboard of most tests, with the loop that it shows."""
    with serving(SCENARIO) as both:
        yield both


@pytest.fixture(scope="session")
def shared(browser: Browser, served: tuple[Dashboard, Runner]) -> Iterator[tuple[SharedPage, Pages]]:
    """The page of the tests that ask for `session`, and its console."""
    dashboard, runner = served
    pages = Pages(browser)
    yield SharedPage(runner, lambda: opened(pages, dashboard), pages.close), pages
    pages.close()


@pytest.fixture
def own_session(browser: Browser) -> Iterator[PageSession]:
    """A page of a dashboard that no other test has used: what is chosen on it, as for a map, stays the dashboard's."""
    pages = Pages(browser)
    with serving(SCENARIO) as (dashboard, runner):
        yield PageSession(opened(pages, dashboard), runner)
        pages.close()
    pages.require_no_errors()


@pytest.fixture
def from_the_start(served: tuple[Dashboard, Runner]) -> None:
    """For a test that opens its own page: the loop runs the shipped scenario from its start, whatever was before."""
    _, runner = served
    rest_at_start(runner)
    runner.post(Play())
    until(
        lambda: (
            runner.snapshot.executed >= runner.posted
            and runner.snapshot.scenario == SCENARIO
            and runner.snapshot.phase == "running"
        )
    )


@pytest.fixture
def messages_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    """For a test of messages, and of what else goes by itself after some seconds, which a busy machine may need."""
    monkeypatch.setattr("app.dashboard.widgets.page.complaint.SHOWN", PATIENCE)
    monkeypatch.setattr("app.dashboard.widgets.run.whatif_panel._SHOWN", PATIENCE)


@pytest.fixture
def new_page(shared: tuple[SharedPage, Pages]) -> None:
    """For a test whose page must be a new one, or which opens the only page itself."""
    page, _ = shared
    page.discard()


@pytest.fixture
def spent_page(shared: tuple[SharedPage, Pages]) -> Iterator[None]:
    """For a test that leaves something in its page that nothing else takes away."""
    page, _ = shared
    yield
    page.discard()


@pytest.fixture
def session(
    shared: tuple[SharedPage, Pages], served: tuple[Dashboard, Runner], request: pytest.FixtureRequest
) -> Iterator[PageSession]:
    """A page of a loop that has just begun, its console free of errors; it rests between such tests. The page may be
    that of the test before, put back in order: see `new_page` and `spent_page`."""
    page, pages = shared
    _, runner = served
    yield page.begin_anew()
    runner.post(Pause())
    if not request.node.stash.get(PASSED, False):
        page.discard()
    pages.require_no_errors()
