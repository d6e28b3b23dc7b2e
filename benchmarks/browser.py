"""Page of the dashboard in headless Chromium."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from playwright.sync_api import Browser, Page, ViewportSize, sync_playwright

from drivers.browser import LAUNCH_ARGS, find_or_install

VIEWPORT: ViewportSize = {"width": 1280, "height": 720}
RUNNING = '.vs-status[data-phase="running"]'


@contextlib.contextmanager
def chromium() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=find_or_install(), args=LAUNCH_ARGS)
        yield browser
        browser.close()


def opened(browser: Browser, url: str, frames: list[bytes | str] | None = None) -> Page:
    """Page once it shows the running loop; `frames` receives the data of its web socket."""
    page = browser.new_page(viewport=VIEWPORT)
    if frames is not None:
        # not `frames.append` itself: playwright sets attributes on the function
        page.on("websocket", lambda socket: socket.on("framereceived", lambda frame: frames.append(frame)))
    page.goto(url)
    page.locator(RUNNING).wait_for(state="attached", timeout=60_000)
    return page
