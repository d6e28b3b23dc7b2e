"""Every mode, tab and theme as a picture: `python -m docs.make_screenshots [FOLDER] [--only NAME ...]`, by default all
of them in docs/screenshots.

A name is that of a picture, or its beginning (`tab-`): then only these are made anew, and the others stay. The titles
of the tabs are read from the page. An index, README.md, is written beside the pictures; look at every one.
"""

from __future__ import annotations

import re
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro
from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright

from app.dashboard.page import Dashboard
from app.dashboard.widgets.lesson.guided_minute import steps
from app.scenario.data import shipped
from app.session.commands import DropWayOut, Edit, Load, Pause, Pin, Play, Reset, Unpin
from app.session.runner import Runner
from drivers.browser import LAUNCH_ARGS, find_or_install
from drivers.pages import NO_HINTS, PATIENCE, PageSession, each_tab

SHOWN = Path(__file__).parent / "screenshots"
MODES = {
    "motion": "ur5-motion",
    "impedance": "ur5-impedance",
    "hybrid": "ur5-hybrid",
    "hybrid-impedance": "ur5-hybrid-impedance",
    "constrained": "ur5-constrained",
    "hybrid-moving": "ur5-hybrid-moving",
    "wave": "ur5-wave",
    "chattering": "ur5-motion-discontinuous",
    "panda": "panda-hybrid",
    "planar2r": "planar2r-semicircle",
    "planar3r": "planar3r-hybrid",
}
SIZES = ((1280, 720), (1920, 1080))
PHONE = {"viewport": {"width": 390, "height": 844}, "is_mobile": True, "has_touch": True, "device_scale_factor": 2}
SETTLED = 6.0  # s of simulated time
MINUTE = 5.7  # s of a step of the guided minute: some are pushed at 5 s
FREQUENT, RARE = 150, 100  # colours of a picture, together at most 256: a third of its size


@dataclass(frozen=True)
class Album:
    """A folder of pictures, and what is said of each.
    only: names, or beginnings of names, of the pictures that are made; all of them where there is none."""

    folder: Path
    only: tuple[str, ...] = ()
    captions: dict[str, str] = field(default_factory=dict)

    def wants(self, *names: str) -> bool:
        """Whether one of these pictures is made; of a name that ends in a hyphen, one that begins so."""
        return not self.only or any(
            name.startswith(only) or (name.endswith("-") and only.startswith(name))
            for name in names
            for only in self.only
        )

    def add(self, page: Page, name: str, caption: str) -> None:
        if not self.wants(name):
            return
        path = self.folder / f"{name}.png"
        page.get_by_text("The loop cannot keep up").wait_for(state="hidden")  # a busy machine
        page.screenshot(path=path)
        with Image.open(path) as picture:
            fewer_colors(picture.convert("RGB")).save(path, optimize=True)
        self.captions[path.name] = caption
        print(path)

    def close(self) -> None:
        """Write the index; pictures of another time go, unless only some were made."""
        if self.only:
            self._describe()
            return
        for path in self.folder.glob("*.png"):
            if path.name not in self.captions:
                path.unlink()
        self._write([(name, caption) for name, caption in self.captions.items()])

    def _describe(self) -> None:
        """The index with what is said of the pictures that were made, new ones behind the others."""
        known = re.findall(r"!\[(.*)\]\((.*)\)", (self.folder / "README.md").read_text(encoding="utf-8"))
        captions = {name: caption for caption, name in known} | self.captions
        self._write([(name, caption) for name, caption in captions.items() if (self.folder / name).exists()])

    def _write(self, captions: list[tuple[str, str]]) -> None:
        parts = ["# Screenshots\n\nMade by `make screenshots`.\n"]
        parts += [f"## {caption}\n\n![{caption}]({name})\n" for name, caption in captions]
        (self.folder / "README.md").write_text("\n".join(parts), encoding="utf-8")


def main(folder: Annotated[Path, tyro.conf.Positional] = SHOWN, /, *, only: tuple[str, ...] = ()) -> None:
    """Take pictures of the page.

    Args:
        folder: where they are written
        only: these, or what begins so, and no others
    """
    folder.mkdir(parents=True, exist_ok=True)
    dashboard = Dashboard(port=0)
    runner = Runner(shipped()["ur5-hybrid"])
    dashboard.attach(runner)
    runner.start()
    threading.Thread(target=dashboard.run_forever, daemon=True).start()
    album = Album(folder, only)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=find_or_install(), args=LAUNCH_ARGS)
        page = opened(browser, dashboard.url, viewport={"width": 1600, "height": 900})
        shoot_desktop(page, runner, album)
        page.close()
        shoot_other_screens(browser, dashboard.url, album)
        browser.close()
    album.close()
    dashboard.close()
    runner.close()


def shoot_desktop(page: Page, runner: Runner, album: Album) -> None:
    """Pictures of the modes, the tabs and what is done on a page."""
    for name, scenario in MODES.items():
        if album.wants(name):
            load(runner, scenario, page)
            shoot(page, album, name, shipped()[scenario].title)
    load(runner, "ur5-hybrid", page)
    if album.wants("tab-"):
        for title in each_tab(page):
            shoot(page, album, f"tab-{slug(title)}", f"Tab {title}")
    if album.wants("refused", "what-if"):
        refuse_and_hold(page, runner, album)
    if album.wants("cursors", "presentation"):
        present(page, runner, album)
    if album.wants("compared", "past"):
        compare(page, runner, album)
    if album.wants("robustness-map"):
        robustness_map(page, album)
    if album.wants("minute-"):
        guided_minute(page, runner, album)
    if album.wants("lessons", "lesson-"):
        lesson(page, album)
    if album.wants("help", "light", "light-"):
        load(runner, "ur5-hybrid", page)
        show_help(page, album)
        page.keyboard.press("t")
        shoot(page, album, "light", "Light")
        for title in each_tab(page) if album.wants("light-") else ():
            shoot(page, album, f"light-{slug(title)}", f"Tab {title}, light")
        page.keyboard.press("t")
    load(runner, "ur5-hybrid", page)


def shoot_other_screens(browser: Browser, url: str, album: Album) -> None:
    """Pictures of pages of other sizes, on a phone, and of the first visit."""
    for width, height in SIZES:
        if album.wants(name := f"hybrid-{width}x{height}"):
            page = opened(browser, url, viewport={"width": width, "height": height})
            shoot(page, album, name, f"{width} x {height}")
            page.close()
    if album.wants("phone"):
        page = opened(browser, url, **PHONE)
        shoot(page, album, "phone", "A phone")
        page.close()
    if album.wants("first-steps"):
        page = opened(browser, url, first_visit=True, viewport={"width": 1280, "height": 720})
        shoot(page, album, "first-steps", "The first visit")


def opened(browser: Browser, url: str, *, first_visit: bool = False, **options) -> Page:
    page = browser.new_page(**options)
    if not first_visit:
        page.add_init_script(NO_HINTS)
    page.set_default_timeout(PATIENCE * 1e3)
    page.goto(url)
    page.get_by_text("real time").wait_for(timeout=60_000)
    page.wait_for_timeout(4000)
    page.evaluate("document.querySelector('.vs-coarse-button:not([hidden])')?.click()")  # whole arms
    return page


def load(runner: Runner, name: str, page: Page) -> None:
    """Load a scenario and let it settle; a run that stops is shown as it stopped."""
    runner.post(Load(shipped()[name]))
    settle(runner, page)


def settle(runner: Runner, page: Page) -> None:
    """Begin anew, and wait until the run shows what it is about."""
    before = runner.snapshot.run
    runner.post(Reset())
    runner.post(Play())  # a lesson's run has paused at its end
    until = time.monotonic() + 240.0  # its kernels may have to be compiled
    while time.monotonic() < until:
        now = runner.snapshot
        if now.run != before and (now.t >= SETTLED or now.phase == "stopped"):
            return
        page.wait_for_timeout(100)


def refuse_and_hold(page: Page, runner: Runner, album: Album) -> None:
    """A value that is refused, and a slider that is held until its preview is whole."""
    runner.post(Edit("target_model.M_m", [0.0] * 6))
    shoot(page, album, "refused", "Refused, with the reason")
    runner.post(DropWayOut())
    page.locator(".vs-strip .vs-message", has_text="Refused").wait_for(state="hidden")
    move, _ = PageSession(page, runner).grip("F_d [N]")
    move(0.75)
    # the process that previews may still be starting; the band comes last, or why there is none: no kernels yet
    page.get_by_text("within the next 5.0 s").wait_for(timeout=240e3)
    page.locator(".vs-held", has_text="true arms").wait_for(timeout=240e3)
    page.wait_for_timeout(1500)
    album.add(page, "what-if", "A slider held: what would come")
    page.keyboard.press("Escape")
    page.mouse.up()


def guided_minute(page: Page, runner: Runner, album: Album) -> None:
    """The guided minute as a film of pictures: each step when something happens in it."""
    page.keyboard.press("g")
    for number, step in enumerate(steps(), start=1):
        page.locator(".vs-minute").get_by_text(f"{number} of {len(steps())}").wait_for()
        until = time.monotonic() + 240.0
        while runner.snapshot.scenario.mode != step.scenario.mode or runner.snapshot.t < MINUTE:
            assert time.monotonic() < until, step.title
            page.wait_for_timeout(100)
        shoot(page, album, f"minute-{number}", f"The guided minute, {number}: {step.title}")
        page.get_by_role("button", name="Next" if number < len(steps()) else "Done", exact=False).click()


def lesson(page: Page, album: Album) -> None:
    """The first lesson: a course is drawn, and its run is seen and explained."""
    page.get_by_role("tab", name="Lessons", exact=True).click()
    shoot(page, album, "lessons", "The lessons")
    page.get_by_role("button", name="Begin").click()
    for number in (1, 2):
        page.locator(f".vs-lesson[data-step='{number}']").wait_for()
        page.keyboard.press("j")
    pad = page.locator(".vs-pad svg")
    pad.wait_for()
    box = pad.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 0.13 * box["width"], box["y"] + 0.66 * box["height"])
    page.mouse.down()
    for across, down in ((0.25, 0.66), (0.4, 0.45), (0.6, 0.42), (0.97, 0.42)):
        page.mouse.move(box["x"] + across * box["width"], box["y"] + down * box["height"], steps=6)
    page.mouse.up()
    page.get_by_role("button", name="Lock my line").click()
    shoot(page, album, "lesson-predict", "A lesson: the course of the deviation is predicted")
    page.keyboard.press("j")
    page.get_by_role("button", name="Run: ").click()
    page.locator(".vs-lines").first.wait_for()
    page.keyboard.press("j")
    page.locator(".vs-prose .vs-scored").first.wait_for()
    shoot(page, album, "lesson-explain", "A lesson: the run over the prediction, explained")
    page.get_by_role("button", name="Leave the lesson").click()
    page.get_by_role("tab", name="Task", exact=True).click()


def present(page: Page, runner: Runner, album: Album) -> None:
    """A step of the force between two cursors, and the presentation."""
    t = runner.snapshot.t
    runner.post(Edit("force", {"kind": "step", "start": 20.0, "value": 30.0, "time": t + 0.5, "rise": 0.1}))
    while runner.snapshot.t < t + 4.5:
        page.wait_for_timeout(100)
    runner.post(Pause())
    page.locator(".uplot-container").nth(1).hover()
    page.locator(".vs-measure").nth(1).click()
    shoot(page, album, "cursors", "A plot on the whole screen, measured with two cursors")
    page.keyboard.press("Escape")
    runner.post(Play())
    load(runner, "ur5-hybrid", page)
    page.get_by_role("tab", name="Task", exact=True).click()
    page.keyboard.press("v")
    page.mouse.move(800, 300)
    page.wait_for_timeout(3000)
    album.add(page, "presentation", "The presentation: one plot, the sliders used last, large type")
    page.keyboard.press("v")
    page.wait_for_timeout(1500)


def compare(page: Page, runner: Runner, album: Album) -> None:
    """Two pinned runs beside the one that runs, and the run looked back at."""
    for stiffness in (250.0, 1000.0, 4000.0):
        runner.post(Edit("target_model.K_m", [0.0, *[stiffness] * 5]))
        settle(runner, page)
        if stiffness < 4000.0:
            runner.post(Pin())
    runner.post(Pause())  # the pinned runs have ended and would leave the plots' window
    page.get_by_role("tab", name="Runs", exact=True).click()
    shoot(page, album, "compared", "Pinned runs: their arms, curves and metrics beside those of the run")
    page.get_by_role("button", name="back").click()
    shoot(page, album, "past", "Looking back")
    page.get_by_role("button", name="to the end").click()
    for pinned in runner.snapshot.pinned:
        runner.post(Unpin(pinned.number))
    runner.post(Play())
    load(runner, "ur5-hybrid", page)


def robustness_map(page: Page, album: Album) -> None:
    """A map over stiffness and true masses, computed beside the loop."""
    page.get_by_role("tab", name="Robustness", exact=True).click()
    page.get_by_role("button", name="Compute the map").click()
    page.get_by_text("81 of 81 runs").wait_for(timeout=240e3)
    page.get_by_role("button", name="Compute the map").wait_for()  # the page has brought the map into view
    shoot(page, album, "robustness-map", "The robustness map: a metric for many settings, a tile opens its run")
    page.get_by_role("tab", name="Task", exact=True).click()


def show_help(page: Page, album: Album) -> None:
    page.keyboard.press("?")
    page.locator(".vs-help").wait_for()
    shoot(page, album, "help", "Help")
    page.keyboard.press("Escape")
    page.locator(".vs-help").wait_for(state="detached")


def shoot(page: Page, album: Album, name: str, caption: str) -> None:
    page.mouse.move(5, 5)  # no tooltip in the picture
    page.wait_for_timeout(1500)
    album.add(page, name, caption)


def fewer_colors(picture: Image.Image) -> Image.Image:
    """With a palette: the most frequent colours as they are, which are those of flat areas, and for the rest a choice
    that covers all of them, so that thin lines keep theirs."""
    counted = sorted(picture.getcolors(picture.width * picture.height) or (), key=lambda entry: entry[0], reverse=True)
    frequent = [channel for _, color in counted[:FREQUENT] for channel in color]
    rare = picture.quantize(RARE, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).getpalette() or []
    palette = Image.new("P", (1, 1))
    palette.putpalette(frequent + rare[: 3 * RARE])
    return picture.quantize(palette=palette, dither=Image.Dither.NONE)


def slug(title: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-")


if __name__ == "__main__":
    tyro.cli(main)
