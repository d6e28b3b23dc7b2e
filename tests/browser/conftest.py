"""A browser, the dashboard that it shows, and pages of both."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest
from playwright.sync_api import Browser, ConsoleMessage, Page, expect, sync_playwright

from app.dashboard.page import Dashboard
from app.scenario.data import shipped
from app.session.commands import Load, Pause, Play, SetSpeed
from app.session.runner import Runner
from drivers.browser import LAUNCH_ARGS, find_or_install
from drivers.pages import NO_HINTS, PATIENCE, UNDRAWN, VIEWPORT, Session
from tests.support.drawn import drawn

# viser's own client says so at every drag in the scene (SceneTree.tsx); it does no harm
VISERS_OWN = "Unable to preventDefault inside passive event listener"
# With every page Chromium begins a process for what drops down from its address bar, which is not there: a second of a
# core. There is one such list: the other names are those of Playwright, which it replaces.
UNSEEN = (
    "WebUIOmniboxPopup", "WebUIOmniboxAimPopup", "WebUIOmniboxFullPopup",
    "AimEnabled", "AvoidCorsURLLoaderRestartOnRedirect", "AvoidUnnecessaryBeforeUnloadCheckSync",
    "DestroyProfileOnBrowserClose", "HttpsFirstBalancedModeAutoEnable", "HttpsUpgrades", "LensOverlay", "MediaRouter",
    "NetworkTimeServiceQuerying", "OptimizationHints", "PaintHolding", "PreconnectToSearch",
    "ThirdPartyStoragePartitioning",
)  # fmt: skip


def pytest_itemcollected(item: pytest.Item) -> None:
    """Tests with a browser run apart from the others, which would take their cores."""
    if "browser" in getattr(item, "fixturenames", ()):
        item.add_marker(pytest.mark.browser)


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    executable = find_or_install()
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(
            executable_path=executable, args=[*LAUNCH_ARGS, f"--disable-features={','.join(UNSEEN)}"]
        )
        expect.set_options(timeout=PATIENCE * 1e3)
        yield chromium
        chromium.close()


@pytest.fixture
def open_page(browser: Browser) -> Iterator[Callable[..., Page]]:
    """`open_page(url, **context_options)`: each page in a context of its own, its console free of errors.

    A test that expects errors there says so with `console_errors_allowed=True`, and one that wants the first steps,
    which lie over the scene, with `first_visit=True`.
    """
    contexts, errors = [], []

    def note(message: ConsoleMessage) -> None:
        if message.type == "error" and VISERS_OWN not in message.text:
            errors.append(message.text)

    def open_page(
        url: str, *, console_errors_allowed: bool = False, first_visit: bool = False, **context_options
    ) -> Page:
        contexts.append(context := browser.new_context(**context_options))
        context.add_init_script(UNDRAWN)
        if not first_visit:
            context.add_init_script(NO_HINTS)
        page = context.new_page()
        page.set_default_timeout(PATIENCE * 1e3)
        if not console_errors_allowed:
            page.on("pageerror", lambda error: errors.append(error.stack or str(error)))
            page.on("console", note)
        page.goto(url)
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert not errors, "the browser's console shows errors"


@pytest.fixture(scope="session")
def served() -> Iterator[tuple[Dashboard, Runner]]:
    """A dashboard on a free port, with the loop that it shows."""
    dashboard = Dashboard(port=0, fps=4.0)  # software draws these pages, on the cores that the tests need
    dashboard.show_progress("compiling the control law…")
    runner = Runner(shipped()["ur5-hybrid"])
    dashboard.attach(runner)
    runner.start()
    with drawn(dashboard):
        yield dashboard, runner
    runner.close()


@pytest.fixture
def session(served: tuple[Dashboard, Runner], open_page: Callable[..., Page]) -> Iterator[Session]:
    """A page of a loop that has just begun; it rests between such tests."""
    dashboard, runner = served
    for command in (Load(shipped()["ur5-hybrid"]), SetSpeed(1.0), Play()):
        runner.post(command)
    page = open_page(dashboard.url, viewport=VIEWPORT)
    page.get_by_text("real time").wait_for()
    warning = page.locator("#webgl-software-rendering")  # viser's own, and it lies over the scene
    warning.locator("button").click()
    warning.wait_for(state="detached")
    opened = Session(page, runner)
    opened.wait(lambda now: now.scenario.name == "ur5-hybrid" and now.phase == "running")
    yield opened
    runner.post(Pause())
