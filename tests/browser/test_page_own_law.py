"""A law, a path and a surface of a user's own on the page: chosen from menus like ours, with their parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from app.scenario import own_code
from app.scenario.data import kind_of, load, to_plain
from app.session.preview_client import Previewer
from drivers.pages import PATIENCE, VIEWPORT, PageSession
from tests.support.drawn import serving

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
OWN = ("pid_gravity.py", "figure_eight.py", "cone.py")


@pytest.fixture
def own(open_page: Callable[..., Page], monkeypatch: pytest.MonkeyPatch) -> Iterator[PageSession]:
    """A page of a server that was started with the examples. Without the process for previews, which would compile them
    once more."""
    monkeypatch.setattr(Previewer, "warm_up", lambda *_: None)
    own_code.use([EXAMPLES / name for name in OWN])
    with serving(load("ur5-impedance")) as (dashboard, runner):
        page = open_page(dashboard.url, viewport=VIEWPORT)
        page.set_default_timeout(PATIENCE * 1e3)
        page.get_by_text("real time").wait_for()
        yield PageSession(page, runner)


def test_a_law_of_one_s_own_stands_in_the_menu_with_its_parameter(own: PageSession) -> None:
    own.tab("Controller")
    expect(own.row("k_i [N/(m·s)]")).to_have_count(0)
    own.choose("Law", "PID + gravity")
    own.wait(lambda now: now.scenario.controller.law == "pid-gravity" and now.live["d"] == 0.0)
    own.page.get_by_text("with the integral of the error so that no weight leaves one behind").wait_for()
    own.row("K_s [N·s/m]").wait_for(state="detached")

    own.enter("k_i [N/(m·s)]", "800")
    own.wait(lambda now: now.scenario.controller.own == {"pid-gravity": {"k_i": 800.0}})
    own.enter("k_i [N/(m·s)]", "-1")
    own.page.locator(
        ".vs-status", has_text="controller.own.pid-gravity.k_i: -1 N/(m·s); allowed: 0 to 50000"
    ).wait_for()
    assert own.now.scenario.controller.own == {"pid-gravity": {"k_i": 800.0}}

    own.choose("Law", "robust (25)")
    own.wait(lambda now: now.scenario.controller.law == "vsmrc")
    own.row("k_i [N/(m·s)]").wait_for(state="detached")
    assert own.now.phase == "running"

    own.tab("Task")
    own.choose("Path", "Figure of eight")
    own.enter("height [m]", "0.01")
    own.wait(lambda now: to_plain(now.scenario)["motion"]["parameters"] == {"height": 0.01})
    own.row("radius [m]").wait_for(state="detached")
    own.tab("World")
    own.choose("Shape", "Cone")
    own.wait(lambda now: kind_of(now.scenario.surface) == "own:cone")
    own.enter("angle [rad]", "0.1")
    own.page.locator(".vs-status", has_text="surface.parameters.angle: 0.1 rad; allowed: 0.3 to 1.5 rad").wait_for()
    assert own.now.phase == "running"
    own.choose("Shape", "plane")
    own.row("angle [rad]").wait_for(state="detached")
