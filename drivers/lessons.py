"""Driver that takes every shipped lesson to its end in a real browser, by keyboard or by mouse:
`python -m drivers.lessons`.

It gives the lesson's reference answers, and prints long waits, refusals by the page, and faults of its looks. On
request it leaves pictures of each step in a folder.
"""

from __future__ import annotations

import contextlib
import re
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro
from playwright.sync_api import Error, Locator, Page, Playwright, expect, sync_playwright
from playwright.sync_api import TimeoutError as PageTimeout

from app.access.classroom import POINTS
from app.dashboard.page import Dashboard
from app.lessons.blocks import ChoiceQuestion, CurveQuestion, Explain, Goal, LessonRun, NumberQuestion, StartScenario
from app.lessons.lesson import Lesson, LessonStep, shipped_lessons
from app.lessons.playing import play, runs
from app.lessons.words import LessonWords, words_of
from app.scenario.data import load
from app.session.commands import SetSpeed
from app.session.runner import Runner
from app.simulation.omega.search_memory import Memory
from drivers.browser import LAUNCH_ARGS, find_or_install
from drivers.pages import (
    NO_HINTS,
    PATIENCE,
    UNDRAWN,
    choose_from,
    let_send,
    open_tab,
    press_by_key,
    resting_box,
    type_over,
    wait_without_notice,
)

Means = Literal["keyboard", "mouse", "phone"]
SIZES = {"keyboard": (1280, 720), "mouse": (1280, 720), "phone": (390, 844)}
# Script that returns the parts of the lesson's text that stick out of the panel or are cut.
LOOKS = """() => {
  const faults = [];
  if (document.documentElement.scrollWidth > innerWidth) faults.push("the page is wider than its window");
  for (const part of document.querySelectorAll(".vs-prose, .vs-prose math, .vs-prose table, .vs-lines, .vs-bars")) {
    const box = part.getBoundingClientRect();
    if (part.checkVisibility() && box.width && (box.left < -1 || box.right > innerWidth + 1))
      faults.push(`sticks out: ${part.textContent.trim().slice(0, 40)}`);
  }
  for (const label of document.querySelectorAll(".mantine-Button-label"))
    if (label.checkVisibility() && label.scrollWidth > label.clientWidth + 1) faults.push(`cut: ${label.textContent}`);
  return faults;
}"""


@dataclass
class Taker:
    """Taker of a lesson: a page, the means by which it is used, and the words of the program in the lesson."""

    page: Page
    means: Means
    words: LessonWords

    @property
    def ready(self) -> Locator:
        """Button to the next step, as it is named where nothing is left to be done in this one."""
        return self.page.get_by_role("button", name=re.compile(f"^({self.words.next}|{self.words.finish})$"))

    def press(self, name: str) -> None:
        """Press the button with this name, or whose name begins with it and a space."""
        begins = re.compile(rf"^{re.escape(name)}(\s|$)")
        button = self.page.get_by_role("button", name=begins).filter(visible=True).last
        if self.means == "keyboard":
            press_by_key(button)
        elif self.means == "mouse":
            button.click()
        else:
            button.tap()

    def next(self) -> None:
        """Go to the next step."""
        self.page.locator(".vs-lesson[data-step]").wait_for()
        expect(self.ready).to_be_enabled(timeout=PATIENCE * 1e3)
        if self.means == "keyboard":
            self.page.keyboard.press("j")
        else:
            self.press(self.ready.inner_text())

    def fill(self, label: str, text: str) -> None:
        """Write into the field with this label, and press Enter."""
        row = self.page.locator("form:visible", has=self.page.get_by_text(label, exact=True))
        field = row.locator("input[type=text]:visible, .mantine-TextInput-input:visible").last
        if self.means != "keyboard":
            field.click()
        type_over(field, text)

    def draw(self, course: list[tuple[float, float]]) -> None:
        """Draw a curve of `POINTS` points. course: its points, shares of the axes from the left and from below."""
        pad = self.page.locator(".vs-pad svg")
        pad.scroll_into_view_if_needed()
        if self.means == "keyboard":
            pad.focus()
            now = 0.5  # an arrow key moves by 2 %, with Shift by 10 %; to the right the value stays
            for number, (_, y) in enumerate(course):
                for size, held in ((0.1, "Shift+"), (0.02, "")):
                    presses = round((y - now) / size)
                    for _ in range(abs(presses)):
                        self.page.keyboard.press(f"{held}Arrow{'Up' if presses > 0 else 'Down'}")
                    now += presses * size
                if number < len(course) - 1:
                    self.page.keyboard.press("ArrowRight")
            return
        box = resting_box(pad)
        ends = {name: float(pad.get_attribute(f"data-{name}") or 0) for name in ("left", "right", "top", "bottom")}
        scale = box["width"] / 336
        for number, (x, y) in enumerate(course):
            at = ends["left"] + x * (ends["right"] - ends["left"]), ends["bottom"] - y * (ends["bottom"] - ends["top"])
            self.page.mouse.move(box["x"] + scale * at[0], box["y"] + scale * at[1])
            if number == 0:
                self.page.mouse.down()
        self.page.mouse.up()


def take(taker: Taker, lesson: Lesson, memory: Memory, look: Callable[[LessonStep], None]) -> list[str]:
    """Take a lesson to its end. Returns the faults, a sentence each. look: called with each step."""
    page, words, faults = taker.page, taker.words, list[str]()
    outcomes = {step.number: play(step, memory) for step in runs(lesson)}
    measurements = {name: value for outcome in outcomes.values() for name, value in outcome.measurements.items()}
    for step in lesson.steps:
        page.locator(f".vs-lesson[data-step='{step.number}']").wait_for()
        match step.block:
            case ChoiceQuestion() as question:
                for _ in range(3):  # the widgets of the step may still be moving under the mouse
                    taker.press(f"{'ABCDE'[question.right - 1]})")
                    with contextlib.suppress(PageTimeout):
                        taker.ready.wait_for(timeout=20e3)
                        break
            case NumberQuestion() as question:
                unit, value = measurements[question.measure].unit, measurements[question.measure].value
                taker.fill(f"{words.your_answer} [{unit}]" if unit else words.your_answer, f"{value:.5g}")
                taker.ready.wait_for()
            case CurveQuestion() as question:
                run = next(each for each in runs(lesson) if each.number > step.number)
                trace = next(each for each in outcomes[run.number].traces if each.line.shows(question.line))
                taker.draw(_course(question, trace.t, trace.values))
                let_send(page)
                taker.press(words.lock_line)
                page.locator(".vs-pad[data-locked='1']").wait_for()
            case LessonRun() as block:
                taker.press(words.of_run(block.title, block.seconds, again=False))
                again = words.of_run(block.title, block.seconds, again=True)
                page.get_by_role("button", name=again, exact=True).wait_for()
                page.locator(".vs-lines").first.wait_for()
            case Goal() as goal:
                for control in goal.controls:
                    taker.fill(control.label, f"{control.reference:g}")
                taker.press(words.anew)
                page.get_by_text(words.reached, exact=True).wait_for()
            case Explain() if page.locator(".vs-prose .vs-scored .vs-warn").count():
                faults.append(
                    f"step {step.number}: the reference is not right here: "
                    + " | ".join(page.locator(".vs-prose .vs-scored").all_inner_texts())
                )
            case StartScenario() | Explain():
                pass
        page.wait_for_timeout(300)
        faults += [f"step {step.number}: {fault}" for fault in page.evaluate(LOOKS)]
        look(step)
        if step.number < len(lesson.steps):
            taker.next()
    taker.press(words.leave)
    page.get_by_text(words.done, exact=True).wait_for()
    return faults


def _course(question: CurveQuestion, t: object, values: object) -> list[tuple[float, float]]:
    import numpy as np

    times = np.linspace(question.start, question.end, POINTS)
    course = np.interp(times, np.asarray(t), np.asarray(values))
    fractions = np.clip((course - question.low) / (question.high - question.low), 0.0, 1.0)
    return [(float(x), float(y)) for x, y in zip(np.linspace(0.0, 1.0, POINTS), fractions, strict=True)]


def opened(playwright: Playwright, means: Means, *, drawn: bool) -> Page:
    """Page of a new browser, as large as these means want it. drawn: whether the scene is."""
    browser = playwright.chromium.launch(executable_path=find_or_install(), args=list(LAUNCH_ARGS))
    width, height = SIZES[means]
    context = browser.new_context(
        viewport={"width": width, "height": height}, has_touch=means == "phone", is_mobile=means == "phone"
    )
    context.add_init_script(NO_HINTS)
    if not drawn:
        context.add_init_script(UNDRAWN)
    page = context.new_page()
    page.set_default_timeout(PATIENCE * 1e3)
    return page


def taken(page: Page, means: Means, name: str, lesson: Lesson, memory: Memory, pictures: Path | None) -> bool:
    """Take a lesson, and print how it went; returns whether it went without faults. pictures: folder for a picture of
    each step, None for none."""
    number, title = name.partition("-")[0].lstrip("0"), lesson.head.title
    menu = page.get_by_label("Lesson", exact=True).filter(visible=True).last
    choose_from(menu, f"{number}. {title}", exact=False)
    taker, began = Taker(page, means, words_of(lesson.head.language)), time.monotonic()
    page.get_by_role("button", name=taker.words.begin, exact=True).wait_for()
    taker.press(taker.words.begin)

    def look(step: LessonStep) -> None:
        if pictures is not None:
            pictures.mkdir(parents=True, exist_ok=True)
            page.screenshot(path=pictures / f"{name}-{step.number:02d}-{means}.png")

    try:
        faults = take(taker, lesson, memory, look)
    except (Error, AssertionError, TimeoutError) as error:
        stuck = f"stuck at {page.locator('.vs-lesson[data-step]').all_inner_texts()}: {error}"[:600]
        picture = Path(tempfile.mkdtemp()) / f"{name}.png"
        page.screenshot(path=picture)
        print(f"{name} by {means}: {stuck}; see {picture}")
        page.get_by_role("button", name=taker.words.leave).click()
        return False
    print(f"{name} by {means}: done in {time.monotonic() - began:.0f} s", *faults, sep="\n  ", flush=True)
    return not faults


def main(
    lessons: tyro.conf.Positional[tuple[str, ...]] = (),
    /,
    means: Means = "keyboard",
    speed: float = 4.0,
    pictures: Path | None = None,
) -> int:
    """Take lessons in Chromium.

    Args:
        lessons: by name; all shipped ones without
        means: keyboard, mouse, or phone (390 x 844, by touch)
        speed: of the runs, times real time
        pictures: folder for a picture of each step
    """
    dashboard, runner = Dashboard(port=0, fps=6.0), Runner(load("ur5-heavy"))
    dashboard.attach(runner)
    runner.start()
    threading.Thread(target=dashboard.run_forever, daemon=True).start()
    memory, bad = Memory(), 0
    with sync_playwright() as playwright:
        page = opened(playwright, means, drawn=pictures is not None)
        page.goto(dashboard.url)
        page.get_by_text("real time").wait_for()
        wait_without_notice(page)
        open_tab(page, "Lessons")
        runner.post(SetSpeed(speed))
        for name, lesson in shipped_lessons().items():
            if not lessons or name in lessons:
                bad += not taken(page, means, name, lesson, memory, pictures)
    dashboard.close()
    runner.close()
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(tyro.cli(main))
