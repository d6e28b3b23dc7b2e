"""Page in a real browser and the loop behind it, for tests that act like a person."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from playwright.sync_api import Locator, Page

from app.session.runner import Runner
from app.session.snapshot import Snapshot

VIEWPORT = {"width": 1280, "height": 720}
# Script that marks the first steps as seen, as in a browser that has opened the page before. A page without an address
# has no storage.
NO_HINTS = "try { localStorage.setItem('vsmrc.hints', 'dismissed'); } catch { }"
# Script that stops the drawing of the scene, which in software takes a whole core, and has at most twelve frames a
# second, since each of them visits the whole scene; the few tests that look at the picture set `undrawn` to false.
# A canvas that is neither drawn nor cleared is not put on the screen again.
UNDRAWN = """
  window.undrawn = true;
  const frame = window.requestAnimationFrame.bind(window);
  let waiting = new Map(), due = new Map(), asked = 0, soon = false;
  const begin = (now) => {
    [due, waiting, soon] = [waiting, new Map(), false];
    for (const then of due.values()) try { then(now); } catch (error) { reportError(error); }
  };
  window.requestAnimationFrame = (then) => {
    waiting.set(++asked, then);
    if (!soon) window.undrawn ? setTimeout(() => frame(begin), 80) : frame(begin);
    soon = true;
    return asked;
  };
  window.cancelAnimationFrame = (number) => { waiting.delete(number); due.delete(number); };
  for (const name of ["drawElements", "drawArrays", "drawElementsInstanced", "drawArraysInstanced", "clear"]) {
    const draw = WebGL2RenderingContext.prototype[name];
    WebGL2RenderingContext.prototype[name] = function (...what) { if (!window.undrawn) draw.apply(this, what); };
  }
"""
# All plots of a page, and those on its screen: the plots of a tab that was opened before stay in the page, hidden.
CHARTS = "Object.values(__viserTestpoints.uplots).map((p) => p.chart)"
SHOWN = f"{CHARTS}.filter((c) => c.root.checkVisibility())"
# Script that notes the page's last messages and the user's last inputs, for the report of a wait that fails.
SENT = """
  window.vsmrcSent = [];
  const post = Worker.prototype.postMessage, note = (...what) => {
    window.vsmrcSent.push([Math.round(performance.now()), ...what].join(" "));
    window.vsmrcSent = window.vsmrcSent.slice(-30);
  };
  Worker.prototype.postMessage = function (data, ...rest) {
    const { type, uuid, updates } = data?.message ?? {};
    if (type && type !== "ViewerCameraMessage") note(type, uuid, JSON.stringify(updates ?? ""));
    return post.call(this, data, ...rest);
  };
  for (const kind of ["mousedown", "mouseup", "click", "keydown"])
    window.addEventListener(kind, (e) => note(kind, e.target.tagName, e.target.innerText?.slice(0, 30) ?? ""), true);
"""
ROWS = """
  () => [...document.querySelectorAll("form")].filter((form) => form.checkVisibility()).map((form) => [
    form.innerText, form.querySelector("input.mantine-TextInput-input")?.value,
    form.querySelector("[role=slider]")?.ariaValueNow, "held" in form.dataset ? "held" : "",
  ].join(" | ")).concat(window.vsmrcSent ?? [])
"""
# Script that notes whether the next click is one on an option of a menu.
_NOTE_CHOICE = """() => {
  window.optionClicked = false;
  addEventListener("click", (e) => { window.optionClicked = Boolean(e.target.closest?.("[role=option]")); },
    { capture: true, once: true });
}"""
PATIENCE = 240.0  # s: a busy machine may take long to start the process for previews


def each_tab(page: Page) -> Iterator[str]:
    """Open every tab of every panel, also tabs within tabs, and yield its title; at the end the first tabs are open
    again."""
    return _each(page, [page.locator("[role=tab]:visible")])


def each_view(page: Page) -> Iterator[str]:
    """Open every tab as `each_tab` does, but a tab of both docks at a time, and yield their titles: half as many views
    for checks of the whole page."""
    return _each(page, [page.locator(f"[data-dock-region={side}] [role=tab]:visible") for side in ("left", "right")])


def _each(page: Page, rows: Sequence[Locator]) -> Iterator[str]:
    """Open the tabs of all rows of tabs, one of each row at a time, and yield their titles."""
    first = page.locator("[role=tab][aria-selected=true]:visible").all_inner_texts()
    seen: set[str] = set()
    # the last one first, since the tabs within the tab that was just opened come behind the others
    while titles := [unseen[-1] for tabs in rows if (unseen := [t for t in tabs.all_inner_texts() if t not in seen])]:
        for title in titles:
            page.get_by_role("tab", name=title, exact=True).click()
        page.wait_for_timeout(400)
        yield " + ".join(titles)
        seen.update(titles)
    for title in first:
        page.get_by_role("tab", name=title, exact=True).click()


def wait_without_notice(page: Page) -> None:
    """Wait until the page has closed viser's notice of slow graphics, for which it has a button of its own."""
    page.locator(".vs-coarse-button[aria-pressed=true]").wait_for(state="attached")
    page.locator("#webgl-software-rendering").wait_for(state="detached")


def type_over(field: Locator, text: str) -> None:
    """Type a text in place of that of a field, and press Enter."""
    field.fill(text)
    while field.input_value() != text:  # a late answer came between the field's selection and its text, which is added
        field.page.wait_for_timeout(200)
        field.fill(text)
    field.press("Enter")


@dataclass(frozen=True)
class PageSession:
    """Session of a test: a page, and the runner behind it."""

    page: Page
    runner: Runner

    @property
    def now(self) -> Snapshot:
        return self.runner.snapshot

    def choose(self, label: str, option: str) -> None:
        menu = self.page.get_by_label(label, exact=True).locator("visible=true")
        chosen = self.page.get_by_role("option", name=option, exact=True)
        for _ in range(10):
            for _ in range(5):  # a row that moves out of sight closes its menu, as in a folder that is being opened
                menu.click()
                self.page.wait_for_timeout(100)
                if chosen.is_visible():
                    break
            self.page.evaluate(_NOTE_CHOICE)
            chosen.click()
            # an answer that comes between press and release draws the options anew, and then nothing has been clicked
            if self.page.evaluate("window.optionClicked"):
                return
        raise AssertionError(f"{option} cannot be chosen for {label}")

    def tab(self, name: str) -> None:
        self.page.get_by_role("tab", name=name, exact=True).click()

    def row(self, label: str) -> Locator:
        return self.page.locator("form:visible", has=self.page.get_by_text(label, exact=True))

    def number(self, label: str) -> Locator:
        return self.row(label).locator(".mantine-TextInput-input")

    def enter(self, label: str, text: str) -> None:
        """Type a text in place of a row's number, and press Enter."""
        type_over(self.number(label), text)

    def grip(self, label: str, at: float = 0.33) -> tuple[Callable[[float], None], Locator]:
        """Press the mouse on a row's slider. Returns a function that moves the slider (0 to 1), and the row's text
        field."""
        slider = self.row(label).locator(".mantine-Slider-root")
        held = self.page.locator("form[data-held]", has=self.page.get_by_text(label, exact=True))
        for _ in range(5):  # rows move while the page is being built, and a press may land beside one
            box = slider.bounding_box()
            assert box is not None
            x, y, width = box["x"], box["y"] + box["height"] / 2, box["width"]
            self.page.mouse.move(x + at * width, y)
            self.page.mouse.down()
            if held.count():
                break
            self.page.mouse.up()
            self.page.wait_for_timeout(500)
        else:
            raise AssertionError(f"the slider of {label} cannot be held")

        def move(share: float) -> None:
            self.page.mouse.move(x + share * width, y, steps=10)

        return move, self.number(label)

    def ahead(self) -> float:
        """Time from now to the right end of the lines of the first plot on the screen, s."""
        return self.page.evaluate(f"{SHOWN}[0].data[0].at(-1)")

    def wait(self, condition: Callable[[Snapshot], bool], seconds: float = PATIENCE) -> None:
        """Wait until the loop fulfils the condition. A failure shows the loop's state, the numbers on the page and the
        page's last inputs."""
        until = time.monotonic() + seconds
        while not condition(self.now):
            assert time.monotonic() < until, (
                self.now.phase,
                self.now.reason,
                self.now.refusal,
                self.now.revision,
                self.page.evaluate(ROWS),
                self.now.scenario,
            )
            self.page.wait_for_timeout(50)
