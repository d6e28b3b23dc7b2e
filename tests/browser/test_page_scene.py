"""The scene in a real browser: the tool pushed and its target dragged with the mouse, the camera, the switches."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest
from playwright.sync_api import Locator, expect
from viser import ClientHandle
from viser import transforms as tf

from app.dashboard.page import Dashboard
from app.dashboard.panels.view import SWITCHES
from app.dashboard.scene.arrows import ForceArrow
from app.dashboard.scene.camera import viewpoint
from app.dashboard.view_options import SceneOptions, Viewing
from app.scenario.data import shipped, with_values
from app.session.commands import Load, Reset
from app.session.runner import Runner
from app.session.snapshot import Snapshot
from drivers.pages import PageSession, resting_box
from tests.browser.test_page_stage import OVER


@pytest.fixture
def scene(session: PageSession, served: tuple[Dashboard, Runner]) -> Iterator[Scene]:
    """A page whose arm yields to a hand alone, looked at from the side."""
    yielding = {"contact.kind": "free", "motion": "hold", "truth.push": (0.0, 0.0, 0.0)}
    session.runner.post(Load(with_values(shipped()["ur5-impedance"], yielding)))
    session.wait(lambda now: now.scenario.mode == "impedance" and now.t > 0.1)
    session.tab("View")
    session.wait(lambda _: len(served[0].clients) == 1)  # those of other tests have gone
    (client,) = served[0].clients.values()
    view = served[0]._content  # pyright: ignore[reportPrivateUsage]
    assert view is not None
    yield Scene(session, client, view._viewing)  # pyright: ignore[reportPrivateUsage]
    session.runner.post(Reset())


class Scene:
    """A page with its camera and its view options."""

    def __init__(self, session: PageSession, client: ClientHandle, viewing: Viewing) -> None:
        self.session, self.page, self.client, self.viewing = session, session.page, client, viewing

    def switch(self, field: str) -> Locator:
        return self.page.get_by_role("checkbox", name=SWITCHES[field][0], exact=True)

    def turn(self, field: str, *, on: bool) -> None:
        """Turn a switch on or off; returns when the page's process knows, since of several inputs at once viser's
        client sends the last one only."""
        self.switch(field).set_checked(on)
        self.session.wait(lambda _: getattr(self.viewing.scene_options, field) is on)

    def view(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Press a camera button; returns position and point looked at when the flight is over."""
        self.page.get_by_role("button", name=name, exact=True).click()
        camera = self.client.camera

        def there(now: Snapshot) -> bool:
            goal = viewpoint(name, now)
            away = np.linalg.norm(camera.position - goal.position), np.linalg.norm(camera.look_at - goal.look_at)
            return max(away) < 2e-3

        self.session.wait(there)
        return camera.position.copy(), camera.look_at.copy()

    def pixel(self, point: np.ndarray) -> tuple[float, float]:
        """Where a point (3,) m of the scene is on the page."""
        camera, box = self.client.camera, self.page.locator("canvas[data-engine]").bounding_box()
        assert box is not None
        x, y, z = tf.SO3(camera.wxyz).as_matrix().T @ (point - camera.position)
        focal = 0.5 * box["height"] / np.tan(0.5 * camera.fov)
        return box["x"] + 0.5 * box["width"] + focal * x / z, box["y"] + 0.5 * box["height"] + focal * y / z

    def drag_tool(self, right: float, down: float) -> None:
        """Take hold of the tool's handle and move on by so many pixels; the button stays down."""
        x, y = 0.0, 0.0
        canvas = self.page.locator("canvas[data-engine]")

        def over_it(now: Snapshot) -> bool:
            nonlocal x, y
            x, y = self.pixel(now.tool)
            self.page.mouse.move(x + 1.0, y)  # it is a movement that the page asks what it is over
            self.page.mouse.move(x, y)
            return canvas.evaluate("(canvas) => canvas.style.cursor") == "pointer"

        self.session.wait(over_it)
        self.page.mouse.down()
        self.page.mouse.move(x + right, y + down, steps=12)

    def pushed(self) -> np.ndarray:
        """Newest recorded push (3,) N."""
        return self.session.now.recording.signals(("F_push",))["F_push"][-1]


def test_dragging_the_tool_pushes_it_and_letting_go_ends_that(scene: Scene):
    session = scene.session
    scene.view("side")
    home = session.now.tool.copy()
    scene.drag_tool(0, -60)
    session.wait(lambda now: bool(np.linalg.norm(now.push) > 5.0))
    session.wait(lambda now: bool(now.tool[2] - home[2] > 2e-3))
    assert scene.pushed()[2] > 0.0  # upwards on the page is upwards in the world
    assert np.linalg.norm(scene.pushed()) <= 60.0 + 1e-6
    scene.page.mouse.up()
    session.wait(lambda now: now.state.grip is None and not now.push.any() and not scene.pushed().any())
    assert session.now.scenario.shift.by == (0.0,)
    session.wait(lambda now: bool(np.linalg.norm(now.tool - home) < 5e-4))


def test_the_drag_turns_the_tool_where_that_is_chosen(scene: Scene):
    session = scene.session
    scene.view("side")
    session.choose("Dragging", "turns it (Shift: pushes)")
    expect(scene.page.get_by_label("Dragging", exact=True)).to_have_value("turns it (Shift: pushes)")
    scene.drag_tool(60, 0)
    session.wait(lambda now: bool(np.linalg.norm(now.recording.signals(("moment_push",))["moment_push"][-1]) > 0.5))
    record = session.now.recording.signals(("F_push", "moment_push"))
    assert not record["F_push"][-1].any()
    assert 0.5 < np.linalg.norm(record["moment_push"][-1]) <= 5.0 + 1e-9
    scene.page.locator(".vs-note", has_text="turned: 100 mm = 2.5 N·m").wait_for()
    scene.page.mouse.up()
    session.wait(lambda now: now.state.grip is None and not now.push_moment.any())
    session.choose("Dragging", "pushes it (Shift: moves the target)")


def test_a_page_that_closes_while_it_pushes_lets_go(scene: Scene):
    scene.view("side")
    scene.drag_tool(30, -40)
    scene.session.wait(lambda now: now.state.grip is not None)
    scene.page.goto("about:blank")
    until = scene.session.now.t + 60.0
    while scene.session.now.state.grip is not None:
        assert scene.session.now.t < until
        scene.page.wait_for_timeout(50)


def test_with_shift_the_drag_moves_the_target(scene: Scene):
    session = scene.session
    scene.view("side")
    home, run = session.now.tool.copy(), session.now.run
    scene.page.keyboard.down("Shift")
    scene.drag_tool(0, -40)
    scene.page.wait_for_timeout(500)
    assert session.now.state.grip is None
    scene.page.mouse.up()
    scene.page.keyboard.up("Shift")
    session.wait(lambda now: now.scenario.shift.by[-1] > 0.01)
    by = np.array(session.now.scenario.shift.by)
    session.wait(lambda now: bool(np.linalg.norm(now.tool - home - by) < 1e-3))
    assert session.now.run == run


def test_camera_and_switches_are_the_pages_and_not_the_runs(scene: Scene):
    session, before = scene.session, scene.session.now
    views = [scene.view(name) for name in ("front", "side", "contact", "whole arm")]
    assert all(np.linalg.norm(a[0] - b[0]) > 0.2 for a, b in pairwise(views))
    assert np.linalg.norm(views[2][0] - session.now.tool) < 0.6
    legend = scene.page.locator(".vs-note", has_text="100 mm =")
    legend.wait_for()
    assert "ghost" not in legend.inner_text()
    scene.turn("ghost", on=True)
    scene.page.locator(".vs-note", has_text="mm away").wait_for()
    resting_box(scene.switch(tuple(SWITCHES)[-1]))
    places = [scene.switch(field).bounding_box() for field in SWITCHES]
    for field in SWITCHES:
        scene.turn(field, on=False)
    legend.wait_for(state="hidden")
    # under the mouse, whatever the legend
    session.wait(lambda _: [scene.switch(field).bounding_box() for field in SWITCHES] == places)
    for field in SWITCHES:
        scene.turn(field, on=getattr(SceneOptions(), field))
    session.choose("Force arrows", "100 mm = 5 N")
    scene.page.locator(".vs-note", has_text="100 mm = 5 N").wait_for()
    session.choose("Force arrows", "automatic")
    session.choose("Meshes", "light")
    scene.page.wait_for_timeout(1000)
    session.choose("Meshes", "fine")
    assert session.now.revision == before.revision
    assert session.now.scenario == before.scenario
    assert session.now.phase == "running"


def test_legend_and_labels_lie_over_nothing_whatever_the_window(session: PageSession):
    page = session.page
    page.locator(".vs-legend-button").click()
    page.locator(".vs-legend").wait_for()
    parts = [".vs-legend", ".vs-legend-button", ".vs-acts button", ".vs-timeline", ".vs-labels [data-shown]"]
    for width, height in ((1024, 768), (1280, 720), (1920, 1080)):
        page.set_viewport_size({"width": width, "height": height})
        page.evaluate("window.apart = 0")
        # five times in a row: right after a change of the window's size the old places may be apart by chance
        page.wait_for_function(
            f"""(parts) => {{
              const box = document.querySelector(".vs-legend").getBoundingClientRect();
              const scene = document.querySelector("canvas[data-engine]").getBoundingClientRect();
              const labels = [...document.querySelectorAll(".vs-labels [data-shown]")];
              const whole = labels.length > 1 && labels.map((e) => e.getBoundingClientRect())
                .every(({{ left, right }}) => left >= scene.left && right <= scene.right);
              const apart = !({OVER})(parts) && box.width > 100 && box.bottom < innerHeight && whole;
              window.apart = apart ? window.apart + 1 : 0;
              return window.apart === 5;
            }}""",
            arg=parts,
            polling=300,
        )
    page.locator(".vs-legend-button").click()
    page.locator(".vs-legend").wait_for(state="hidden")


# Colour of the scene at a place of the page, 0 to 255: the last picture is kept.
COLOR = """([x, y]) => {
  const canvas = document.querySelector("canvas[data-engine]"), box = canvas.getBoundingClientRect();
  const copy = new OffscreenCanvas(1, 1).getContext("2d"), scale = canvas.width / box.width;
  copy.drawImage(canvas, (x - box.left) * scale, (y - box.top) * scale, 1, 1, 0, 0, 1, 1);
  return [...copy.getImageData(0, 0, 1, 1).data].slice(0, 3);
}"""
# Of the arm in its own colours: ghost and pinned runs of it are translucent.
TRIANGLES = """() => Object.entries(__viserMutable.nodeRefFromName).filter(([name]) => name.startsWith("/robot_"))
  .flatMap(([, node]) => node?.children.filter((part) => part.isMesh && !part.material.transparent) ?? [])
  .reduce((sum, { geometry }) => sum + geometry.index.count / 3, 0)"""


def test_arrows_stand_before_the_arm_which_is_coarse_without_a_graphics_card(
    scene: Scene, served: tuple[Dashboard, Runner]
):
    page = scene.page
    scene.view("front")
    inside = ForceArrow(served[0]._server.scene, "/force/inside", "inside", (255, 0, 255), side="top-left")  # pyright: ignore[reportPrivateUsage]
    inside.show(np.array([0.0, 0.0, 0.01]), np.array([0.0, 0.0, 8.0]), 10.0)  # in the base of the arm
    page.evaluate("window.undrawn = false")

    def pink(_: Snapshot) -> bool:
        red, green, blue = page.evaluate(COLOR, scene.pixel(np.array([0.0, 0.0, 0.03])))
        return red > 1.5 * green and blue > 1.5 * green

    scene.session.wait(pink)
    # pressed first: an arm that has come just now is whole until the page has made it coarse
    triangles = []
    for coarse in ("false", "true"):
        page.locator(".vs-coarse-button").click()
        page.locator(f".vs-coarse-button[aria-pressed='{coarse}']").wait_for()
        triangles.append(page.evaluate(TRIANGLES))
    assert 2_000 < triangles[1] < triangles[0] / 3
    page.evaluate("window.undrawn = true")
    inside.show(np.zeros(3), np.zeros(3), 10.0)
