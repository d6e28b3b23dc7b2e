"""Page in a real browser and the loop behind it, for tests that act like a person."""

import re
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from playwright.sync_api import FloatRect, Locator, Page, TimeoutError, expect

from app.dashboard.theme.style import MARKS
from app.session.commands import Pause
from app.session.runner import Runner
from app.session.snapshot import Snapshot

VIEWPORT = {"width": 1280, "height": 720}
PHONE = {"viewport": {"width": 390, "height": 844}, "is_mobile": True, "has_touch": True}
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
# Script that notes the user's next clicks, and one that says whether the last of them was on such an element.
_NOTE_CLICKS = """() => {
  window.lastClick = null;
  window.notesClicks ??= (addEventListener("click", (e) => { if (e.isTrusted) lastClick = e.target; }, true), true);
}"""
_CLICKED = "(selector) => Boolean(window.lastClick?.closest(selector))"
# Scripts that return when viser's client has sent what waits (one message in 50 ms, of those that wait the last only),
# when the place of the mouse has come to a slider before that, and when the page has reported a tab that was opened.
_SENT = "new Promise((done) => setTimeout(() => setTimeout(done, 60), 60))"
_MOVED = f"new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))).then(() => {_SENT})"
_REPORTED = f"new Promise((done) => setTimeout(done, 220)).then(() => {_SENT})"
# Script that returns the place of an element that has stayed there for longer than any script of the page rests between
# two looks at the layout, null where the element has gone.
_RESTING = """async (element) => {
  const place = () => (({ x, y, width, height }) => ({ x, y, width, height }))(element.getBoundingClientRect());
  let box = place();
  for (let same = 0; same < 7; same++) {
    await new Promise((done) => setTimeout(done, 100));
    const now = place();
    if (!element.isConnected) return null;
    if (JSON.stringify(now) !== JSON.stringify(box)) [box, same] = [now, -1];
  }
  return box;
}"""
# Script that returns text and place of the slider of each of these rows, as they are at one moment.
_ROWS = """(labels) => labels.map((label) => {
  const named = (form) => [...form.querySelectorAll("label")].some((each) => each.textContent.trim() === label);
  const row = [...document.querySelectorAll("form")].find((form) => form.checkVisibility() && named(form));
  const text = row?.querySelector("input.mantine-TextInput-input")?.value ?? "";
  const place = row?.querySelector("[role=slider]")?.ariaValueNow ?? NaN;
  return [text.replace(/[MARKS]/g, ""), Number(place)];
})""".replace("MARKS", "".join(MARKS))
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
            open_tab(page, title)
        yield " + ".join(titles)
        seen.update(titles)
    for title in first:
        open_tab(page, title)


def wait_without_notice(page: Page) -> None:
    """Wait until the page has closed viser's notice of slow graphics, for which it has a button of its own."""
    page.locator(".vs-coarse-button[aria-pressed=true]").wait_for(state="attached")
    page.locator("#webgl-software-rendering").wait_for(state="detached")


def open_tab(page: Page, title: str) -> None:
    """Open a tab. Returns when the page has told the server, which shows the present values there from then on."""
    tab = page.get_by_role("tab", name=title, exact=True)
    tab.click()
    expect(tab).to_have_attribute("aria-selected", "true", timeout=PATIENCE * 1e3)
    page.evaluate(_REPORTED)


def let_send(page: Page) -> None:
    """Wait until the page has sent what the user has done: of several inputs at once viser's client sends the last one
    only."""
    page.evaluate(_SENT)


def named(label: str) -> re.Pattern[str]:
    """Accessible name of a control with this label: two of a tab have that of their folder behind it."""
    return re.compile(rf"^{re.escape(label)}(, .*)?$")


def fill_in(field: Locator, text: str) -> None:
    """Type a text in place of that of a field. Returns when the page has sent it."""
    for _ in range(20):
        field.fill(text)
        let_send(field.page)
        if field.input_value() == text:
            return
        # a late answer came between the field's selection and its text, which is added then, or behind it
    raise AssertionError(f"{text} cannot be typed: {field.input_value()}")


def type_over(field: Locator, text: str) -> None:
    """Type a text in place of that of a field, and press Enter. Returns when the page has sent it."""
    fill_in(field, text)
    field.press("Enter")
    let_send(field.page)


def choose_from(menu: Locator, option: str, *, exact: bool = True) -> None:
    """Choose an option of a menu, again where a late answer has closed the menu, or drawn its options anew between
    press and release, which is no click then, or where the row has moved out of sight, which hides its options.
    Returns when the page has sent it."""
    page, until = menu.page, time.monotonic() + PATIENCE
    while time.monotonic() < until:
        menu.scroll_into_view_if_needed()
        if menu.get_attribute("aria-expanded") != "true":
            menu.click()
        page.evaluate(_NOTE_CLICKS)
        try:
            listed = menu.and_(page.locator("[aria-expanded=true]")).get_attribute("aria-controls", timeout=5e3)
            options = page.locator(f"[id='{listed}']").get_by_role("option", name=option, exact=exact)
            options.first.click(timeout=5e3)
        except TimeoutError:  # as where the row moved out of sight, in a folder that was being opened
            continue
        let_send(page)
        if page.evaluate(_CLICKED, "[role=option]"):
            return
    raise AssertionError(f"{option} cannot be chosen")


def press_by_key(button: Locator) -> None:
    """Press a button by keyboard alone, again where it was drawn anew between focus and key. Returns when the page has
    sent it."""
    page, until = button.page, time.monotonic() + PATIENCE
    while time.monotonic() < until:
        page.evaluate(_NOTE_CLICKS)
        button.press("Enter")
        let_send(page)
        if page.evaluate(_CLICKED, "button"):
            return
    raise AssertionError(f"{button} cannot be pressed by a key")


def resting_box(element: Locator) -> FloatRect:
    """Place of an element once it rests there: rows and docks move while a page is being laid out."""
    for _ in range(20):
        if box := element.evaluate(_RESTING):
            return box
    raise AssertionError(f"{element} is drawn anew again and again")


@dataclass(frozen=True)
class PageSession:
    """Session of a test: a page, and the runner behind it."""

    page: Page
    runner: Runner

    @property
    def now(self) -> Snapshot:
        return self.runner.snapshot

    def choose(self, label: str, option: str, *, exact: bool = True) -> None:
        choose_from(self.page.get_by_label(named(label)).locator("visible=true"), option, exact=exact)

    def tab(self, name: str) -> None:
        open_tab(self.page, name)

    def check(self, label: str, *, on: bool = True) -> None:
        """Check a box, or take its mark away."""
        self.page.get_by_label(label).locator("visible=true").first.set_checked(on)
        self.sent()

    def sent(self) -> None:
        """Wait until the page has sent what the user has done."""
        let_send(self.page)

    def moved(self) -> None:
        """Wait until a held slider is where the mouse is, and the page has sent it."""
        self.page.evaluate(_MOVED)

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
            box = resting_box(slider)
            x, y, width = box["x"], box["y"] + box["height"] / 2, box["width"]
            self.page.mouse.move(x + at * width, y)
            self.page.mouse.down()
            if held.count():
                break
            if self.page.locator("form[data-held]").count():  # that of another row
                self.page.keyboard.press("Escape")
            self.page.mouse.up()
        else:
            raise AssertionError(f"the slider of {label} cannot be held")

        def move(fraction: float) -> None:
            self.page.mouse.move(x + fraction * width, y, steps=10)

        return move, self.number(label)

    def rows(self, *labels: str) -> list[tuple[str, float]]:
        """Text and place of the slider, 0 to 1, of each of these rows, all as they are at one moment."""
        return [(text, place) for text, place in self.page.evaluate(_ROWS, labels)]

    def ahead(self) -> float:
        """Time from now to the right end of the lines of the first plot on the screen, s; nan while none is drawn."""
        return self.page.evaluate(f"{SHOWN}[0]?.data?.[0]?.at(-1) ?? NaN")

    def pause_after(self, t: float) -> None:
        """Pause the run once it has come to t (s)."""
        self.wait(lambda now: now.t > t)
        self.runner.post(Pause())
        self.wait(lambda now: now.phase == "paused")

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
