"""The page that tests use one after another: opening one costs more than most of them."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from typing import Any

from playwright.sync_api import Page

from app.scenario.data import shipped
from app.session.commands import Load, Pause, Play, Reset, SetSpeed, ToEnd, Unpin
from app.session.runner import Runner
from drivers.pages import VIEWPORT, PageSession, resting_box

SCENARIO = shipped()["ur5-hybrid"]
SETTLED = 20.0  # s until a page that was put back in order shows it; then another one is opened

# What can be left behind on a page: values, open tabs and folders, what lies over it or is scrolled, widths, theme.
# That a busy machine slows the loop is said by itself.
_APPEARANCE = """() => {
  const shown = (selector) => [...document.querySelectorAll(selector)]
    .filter((e) => e.checkVisibility({ visibilityProperty: true }));
  const texts = (selector) => shown(selector).map((e) => e.textContent);
  return {
    status: texts(".vs-status .vs-title, .vs-status .vs-mode, .vs-status .vs-mode + .vs-chip"),
    values: shown("input, textarea").map((e) => (e.type === "checkbox" ? e.checked : e.value)),
    tabs: shown("[role=tab]").map((e) => `${e.textContent} ${e.ariaSelected}`),
    over: shown("[data-floating-window], .vs-help, .vs-message:not(.vs-warn), [role=dialog], [role=listbox], "
      + "[role=alert], [data-large], form[data-held], .vs-values").map((e) => e.className),
    docks: [...document.querySelectorAll("[data-dock-region], canvas[data-engine]")]
      .map((e) => Math.round(e.getBoundingClientRect().width)),
    scrolled: [...document.querySelectorAll("*")].filter((e) => e.scrollTop || e.scrollLeft).map((e) => e.className),
    page: [innerWidth, innerHeight, document.documentElement.dataset.mantineColorScheme, window.undrawn],
  };
}"""
_PUT_BACK = """() => {
  document.activeElement?.blur();
  for (const e of document.querySelectorAll("*")) if (e.scrollTop || e.scrollLeft) e.scrollTo(0, 0);
  for (const button of document.querySelectorAll("[role=alert] .mantine-Notification-closeButton")) button.click();
  window.undrawn = true;
}"""
# Where to press next so that the first tabs are open, as in the beginning; null where all of them are.
_OTHER_TAB = """() => {
  const others = [...document.querySelectorAll("[role=tablist]")]
    .filter((row) => row.checkVisibility())
    .map((row) => row.querySelector("[role=tab]"))
    .filter((tab) => tab && tab.ariaSelected !== "true");
  const box = others.at(-1)?.getBoundingClientRect();
  return box ? [box.x + box.width / 2, box.y + box.height / 2] : null;
}"""
# Whether the status line shows these texts; t may be left out.
_SHOWS = """([title, phase, t]) => {
  const text = (part) => document.querySelector(`.vs-status ${part}`)?.textContent;
  return text(".vs-title") === title && text(".vs-mode + .vs-chip") === phase && (!t || text(".vs-number") === t);
}"""


class SharedPage:
    """Page that tests use one after another.

    open_page: opens a page of the runner's loop.
    close: closes what it has opened."""

    def __init__(self, runner: Runner, open_page: Callable[[], Page], close: Callable[[], None]) -> None:
        self._runner, self._open_page, self._close = runner, open_page, close
        self._page: Page | None = None
        self._address = ""
        self._first: dict[str, list[Any]] = {}

    def begin_anew(self) -> PageSession:
        """A loop that has just begun, and its page as it was when it was opened, or else another one."""
        try:
            return self._begun()
        except BaseException:
            self.discard()
            raise

    def discard(self) -> None:
        """Close the page; the next test gets another one."""
        self._page, self._first = None, {}
        self._close()

    def _begun(self) -> PageSession:
        if self._page is not None and not self._page.is_closed():
            _let_go(self._page)
        rest_at_start(self._runner)
        if self._page is not None and not self._put_back(self._page):
            self.discard()
        self._runner.post(Play())
        if self._page is not None and not self._looks_as_first(self._page):
            self.discard()
        if self._page is None:
            self._page = self._open_page()
            self._address = self._page.url
        session = PageSession(self._page, self._runner)
        while not self._runs_as_shipped(session):  # an input of the test before came late, on a busy machine
            rest_at_start(self._runner)
            self._runner.post(Play())
        self._page.wait_for_function(_SHOWS, arg=[SCENARIO.title, "running"])
        if not self._first:
            for side in ("left", "right"):  # docks.js gives them another width than the server
                resting_box(self._page.locator(f"[data-dock-region={side}]"))
            self._first = self._page.evaluate(_APPEARANCE)
        return session

    def _runs_as_shipped(self, session: PageSession) -> bool:
        """Whether the loop runs the scenario as it is shipped, without pinned runs, once it has heard all commands and
        goes on."""
        session.wait(lambda now: now.executed >= self._runner.posted and now.phase == "running")
        return session.now.scenario == SCENARIO and not session.now.pinned

    def _put_back(self, page: Page) -> bool:
        """Put the page back in order: nothing held or pressed, the first tabs open. Returns whether it then shows the
        loop at its beginning."""
        if page.is_closed() or page.url != self._address:
            return False
        page.mouse.move(0, 0)
        page.set_viewport_size(VIEWPORT)
        page.evaluate(_PUT_BACK)
        if not _until(lambda: _on_first_tabs(page), page):
            return False
        return _until(lambda: page.evaluate(_SHOWS, [SCENARIO.title, "paused", "0.00"]), page)

    def _looks_as_first(self, page: Page) -> bool:
        if _until(lambda: page.evaluate(_APPEARANCE) == self._first, page):
            return True
        now = page.evaluate(_APPEARANCE)
        other = {part: (self._first[part], now[part]) for part in now if now[part] != self._first[part]}
        warnings.warn(f"a test leaves its page changed, and another one is opened: {other}", stacklevel=1)
        return False


def rest_at_start(runner: Runner) -> None:
    """Let the loop rest at the start of the shipped scenario, whatever was before."""
    pins = [Unpin(pinned.number) for pinned in runner.snapshot.pinned]
    # an edit while the test before still looks back would fork its run, and pin what lay ahead
    for command in (ToEnd(), *pins, Load(SCENARIO), SetSpeed(1.0), Pause(), Reset()):
        runner.post(command)


def _let_go(page: Page) -> None:
    """Let go of what a test holds, and take it back: a slider would be applied after the scenario has been loaded."""
    if page.locator("form[data-held]").count():
        page.keyboard.press("Escape")
    page.mouse.up()
    page.keyboard.up("Shift")


def _on_first_tabs(page: Page) -> bool:
    """Whether the first tabs are open; presses one of them where not. viser hears the mouse, not a DOM click()."""
    other = page.evaluate(_OTHER_TAB)
    if other:
        page.mouse.click(*other)
    return not other


def _until(condition: Callable[[], bool], page: Page) -> bool:
    until = time.monotonic() + SETTLED
    while not condition():
        if time.monotonic() > until:
            return False
        page.wait_for_timeout(50)
    return True
