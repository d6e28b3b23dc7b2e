"""Every mode and every tab as a picture: `python docs/make_screenshots.py [FOLDER]`, by default docs/screenshots.

The modes are at 1600 x 900, the first also at 1280 x 720 and 1920 x 1080. Look at every one of them.
"""

from __future__ import annotations

import sys
import threading
import time
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

from app.dashboard import Dashboard
from app.runner import Edit, Load, Runner
from app.scenario import shipped
from tests.browser import LAUNCH_ARGS, find_or_install

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
TABS = ("Task", "Model", "Controller", "World", "Robot", "Torque")
SIZES = ((1280, 720), (1920, 1080))
SETTLED = 6.0  # s of simulated time


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    dashboard = Dashboard(port=0)
    runner = Runner(shipped()["ur5-hybrid"])
    dashboard.attach(runner)
    runner.start()
    threading.Thread(target=dashboard.run_forever, daemon=True).start()
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=find_or_install(), args=LAUNCH_ARGS)
        page = opened(browser.new_page(viewport={"width": 1600, "height": 900}), dashboard.url)
        for name, scenario in MODES.items():
            load(runner, scenario, page)
            shoot(page, folder / f"{name}.png")
        load(runner, "ur5-hybrid", page)
        for tab in TABS:
            page.get_by_role("tab", name=tab, exact=True).click()
            shoot(page, folder / f"tab-{tab.lower()}.png")
        runner.post(Edit("target_model.M_m", [0.0] * 6))
        shoot(page, folder / "refused.png")
        page.get_by_role("tab", name="Task", exact=True).click()
        page.get_by_role("tab", name="Live", exact=True).click()
        hold(page, "F_d [N]", 0.33, 0.75)
        page.screenshot(path=folder / "what-if.png")
        page.keyboard.press("Escape")
        page.mouse.up()
        page.close()
        for width, height in SIZES:
            page = opened(browser.new_page(viewport={"width": width, "height": height}), dashboard.url)
            shoot(page, folder / f"hybrid-{width}x{height}.png")
            page.close()
        browser.close()
    dashboard.close()
    runner.close()


def opened(page: Page, url: str) -> Page:
    page.goto(url)
    page.get_by_text("real time").wait_for(timeout=60_000)
    page.wait_for_timeout(4000)
    toast = page.locator(".mantine-Notification-root button")
    if toast.count():
        toast.first.click()
    return page


def load(runner: Runner, name: str, page: Page) -> None:
    """Load a scenario and let it settle; a run that stops is shown as it stopped."""
    runner.post(Load(shipped()[name]))
    until = time.monotonic() + 30.0
    while time.monotonic() < until:
        snapshot = runner.snapshot
        if snapshot.scenario.name == name and (snapshot.t >= SETTLED or snapshot.phase == "stopped"):
            return
        page.wait_for_timeout(100)


def hold(page: Page, label: str, at: float, to: float) -> None:
    """Drag a row's slider from one share of its length to another and hold it until its preview is whole."""
    row = page.locator("form", has=page.get_by_text(label, exact=True))
    box = row.locator(".mantine-Slider-root").bounding_box()
    assert box is not None
    y = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + at * box["width"], y)
    page.mouse.down()
    page.mouse.move(box["x"] + to * box["width"], y, steps=20)
    page.get_by_text("within the next 5.0 s").wait_for()
    page.wait_for_timeout(1500)


def shoot(page: Page, path: Path) -> None:
    page.mouse.move(5, 5)  # no tooltip in the picture
    page.wait_for_timeout(1500)
    page.screenshot(path=path)
    print(path)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "screenshots")
