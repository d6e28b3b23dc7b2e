"""What a lecture does to the page: hurried changes, whole-range drags, two pages at once."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import pytest
from playwright.sync_api import Page

from app.dashboard.page import Dashboard
from app.dashboard.widgets.fields.matrix_text import written
from app.scenario.data import from_toml, to_toml
from app.session.commands import Reset
from app.session.runner import Runner
from controllers.modes import MODES
from drivers.pages import PATIENCE, VIEWPORT, PageSession, fill_in, wait_without_notice
from environments.catalogue import CATALOGUE

ARMS = ("planar3r", "panda", "ur5")


def test_a_slider_is_dragged_over_its_whole_range_while_the_loop_runs(session: PageSession):
    before = session.now
    move, text = session.grip("F_d [N]")
    positions = [i / 5 for i in range(6)]
    for position in (*positions, *reversed(positions), 0.5):
        move(position)
    session.moved()
    session.wait(lambda now: now.t > before.t + 0.5)
    held = session.now
    assert (held.scenario, held.revision) == (before.scenario, before.revision)
    session.page.mouse.up()
    session.wait(lambda now: now.revision == before.revision + 1)
    assert session.now.scenario.force.value == pytest.approx(30.0, abs=0.3)
    session.wait(lambda now: text.input_value() == written(now.scenario.force.value))
    assert session.now.revision == before.revision + 1
    # every instant of the drag was simulated: no control step is missing, and time went on
    t = held.recording.signals(("t",))["t"]
    assert held.run == before.run
    assert max(b - a for a, b in itertools.pairwise(t)) == pytest.approx(held.scenario.controller.period)


def test_thirty_hurried_changes_of_mode_and_arm_leave_a_loop_that_runs_and_a_page_that_agrees(session: PageSession):
    for arm in ARMS:
        session.tab("Robot")
        session.choose("Arm", CATALOGUE[arm].title)
        session.page.locator("canvas[data-engine]").click(position={"x": 20, "y": 200})  # keys act outside fields
        for number in (3, 1, 5, 4, 1, 3, 5, 4, 3):
            session.page.keyboard.press(str(number))
    # only the last key asks for this mode: where it runs, nothing is left to be done
    session.page.keyboard.press("2")
    last = "impedance"
    session.wait(lambda now: (now.robot.name, now.scenario.mode, now.phase) == (ARMS[-1], last, "running"))
    settled = session.now
    session.wait(lambda now: now.t > settled.t + 0.5)
    assert from_toml(to_toml(session.now.scenario)) == settled.scenario
    session.page.locator(".vs-status").get_by_text(MODES[last].label).wait_for()
    arm = session.page.get_by_label("Arm", exact=True)
    session.wait(lambda _: arm.input_value() == CATALOGUE[ARMS[-1]].title)
    assert (session.now.revision, session.now.refusal_number) == (settled.revision, settled.refusal_number)


def test_two_pages_of_one_loop(session: PageSession, served: tuple[Dashboard, Runner], open_page: Callable[..., Page]):
    """What one of them does, both show; neither answers for the other, and one that closes lets go."""
    page = open_page(served[0].url, viewport=VIEWPORT)
    page.set_default_timeout(PATIENCE * 1e3)
    wait_without_notice(page)
    other = PageSession(page, session.runner)
    before = session.now
    fill_in(session.number("F_d [N]"), "26")
    move, _ = other.grip("F_d [N]")  # held there, typed here
    move(0.9)
    session.number("F_d [N]").press("Enter")
    session.wait(lambda now: now.scenario.force.value == 26.0)
    page.close()
    session.wait(lambda _: session.number("F_d [N]").input_value() == "26")
    session.runner.post(Reset())
    again = PageSession(open_page(served[0].url, viewport=VIEWPORT), session.runner)
    session.wait(lambda _: again.number("F_d [N]").input_value() == "26")
    again.choose("Mode", MODES["motion"].label)
    session.page.locator(".vs-mode", has_text=MODES["motion"].label).wait_for()
    session.page.wait_for_timeout(1000)  # for an echo, if there were one
    assert session.now.revision == before.revision + 2
    assert session.now.refusal_number == before.refusal_number
