"""What the scene draws, as far as it can be told without a browser."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest
import viser
from scipy.spatial.transform import Rotation

from app.dashboard.scene.arrows import LONGEST, UNIT, ForceScale, task_directions
from app.dashboard.scene.spring_damper import BESIDE, HALF_WIDTH, segments
from app.dashboard.scene.tool_drag import LEVER, RADIUS, HeldHandle, ToolDrag
from app.dashboard.scene.trails import error_colors
from app.dashboard.scene.view import SceneView
from app.dashboard.theme.colors import ERROR_COLORS
from app.dashboard.view_options import SceneOptions, Viewing, rounded_up
from app.scenario.data import edited, load
from app.session.commands import DragTool, Edit
from app.session.snapshot import snapshot_of
from app.simulation.closed_loop import ClosedLoop
from environments.surfaces.form import SurfaceMotion
from environments.surfaces.table import Surface
from tests.support.surfaces import cylinder, plane


def test_scales_are_round_numbers_not_below_the_value() -> None:
    assert [rounded_up(v, 1.0) for v in (0.0, 1.0, 1.2, 2.0, 3.0, 7.0, 11.0, 30.0, 70.0, 400.0)] == [
        1, 1, 2, 2, 5, 10, 20, 50, 100, 500
    ]  # fmt: skip


def test_errors_have_the_colours_of_the_legend() -> None:
    colors = error_colors(np.array([0.0, 0.5, 1.0, 7.0]), 1.0)
    np.testing.assert_allclose(colors, [*ERROR_COLORS, ERROR_COLORS[-1]])


def test_the_force_scale_holds_still_until_arrows_leave_the_page() -> None:
    scale = ForceScale()
    assert scale.fit([np.array([20.0, 0.0, 0.0])], None) == 10.0
    assert scale.fit([np.array([0.0, 8.0, 0.0])], None) == 10.0
    grown = scale.fit([np.array([0.0, 60.0, 0.0])], None)
    assert UNIT * 60.0 / grown <= LONGEST
    assert scale.fit([np.array([0.0, np.inf, 0.0]), np.zeros(3)], None) == grown
    assert scale.fit([np.zeros(3)], 5.0) == 5.0


@pytest.mark.parametrize("t", [0.0, 0.3])
def test_task_directions_change_one_coordinate_each(t: float) -> None:
    motion = SurfaceMotion(amplitude=0.02, frequency=0.5)
    tilted = plane(np.zeros(3), np.array([0.3, 0.1, -1.0]), motion)
    round_ = cylinder(np.zeros(3), np.array([0.0, 1.0, 0.2]), np.array([0.0, 0.0, 1.0]), 0.3, "outside", motion)
    p, h = np.array([0.1, 0.05, 0.33]), 1e-6
    for surface in (tilted, round_, Surface.cartesian(np.eye(3)[[0, 2, 1]])):
        directions = task_directions(surface, p, t)
        np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0)
        for i in (1, 2):
            change = (surface.chart(p + h * directions[i], t).g - surface.chart(p, t).g) / h
            assert change[i] > 0.1
            np.testing.assert_allclose(np.delete(change, i), 0.0, atol=1e-4)
        gradient = surface.chart(p, t).G[0]
        np.testing.assert_allclose(directions[0], gradient / np.linalg.norm(gradient))


@pytest.mark.parametrize(("seen_at", "starts"), [((0.2, 1.2), 0.0), ((0.2, 12.0), 2.0), ((3.0,), 0.0)])
def test_paths_are_those_of_the_whole_run_also_where_nobody_looked(
    seen_at: tuple[float, ...], starts: float, viser_server: viser.ViserServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No chord from where somebody looked last; after a long while the last seconds, and of another run its own."""
    loop, view = ClosedLoop.from_scenario(load("ur5-hybrid")), SceneView(viser_server)
    monkeypatch.setattr(view, "_arm", lambda *_: MagicMock())
    drawn: dict[str, list[np.ndarray]] = {"_tool_path": [], "_desired_path": []}
    for name, points in drawn.items():
        extend = lambda p, *_, points=points: points.append(p)  # noqa: E731
        monkeypatch.setattr(view, name, MagicMock(extend=extend, clear=points.clear, scale=1.0))

    def require_whole(since: float) -> None:
        run, system = loop.recording.stretch(since, loop.t), loop.system
        desired = [system.tool_at(r_d, t) for r_d, t in zip(run["r_d"], run["t"], strict=True)]
        for points, taken in zip(drawn.values(), (run["tool"], desired), strict=True):
            apart = np.array([np.linalg.norm(np.array(points) - p, axis=1).min() for p in taken[::50]])
            assert apart.max() < 0.005
            assert np.abs(np.diff(points, axis=0)).max() < 0.02
            assert np.linalg.norm(np.array(points[0]) - taken[0]) < 0.01

    for until in seen_at:
        while loop.t < until - 1e-9:
            loop.step()
            if abs(loop.t - 0.7) < 1e-6:
                loop.edit(edited(loop.system.scenario, "controller.K_s", 50.0))  # r_d means what it meant
        view.show(replace(snapshot_of(loop), run=1), SceneOptions())
    require_whole(starts)
    loop.reset()
    for _ in range(600):
        loop.step()
    view.show(replace(snapshot_of(loop), run=2), SceneOptions())
    require_whole(0.0)


def test_a_ball_that_is_turned_follows_the_hand_on_its_outside() -> None:
    """Grasped in front and drawn to the right it turns to the right, about the upright axis, on top of its own
    orientation."""
    front, right = np.array([0.0, -1.0, 0.0]), np.array([1.0, 0.0, 0.0])
    R = Rotation.from_rotvec([0.2, 0.1, 0.0])
    held = HeldHandle(1, 0, False, 0, "turn", RADIUS * front, np.zeros(3), R.as_matrix(), front)
    turned = Rotation.from_rotvec(held.turned(RADIUS * front + 0.05 * right)) * R.inv()
    np.testing.assert_allclose(turned.as_rotvec(), [0.0, 0.0, 0.05 / LEVER], atol=1e-12)
    np.testing.assert_allclose(
        np.cross(turned.as_rotvec(), front) / np.linalg.norm(turned.as_rotvec()), right, atol=1e-12
    )
    np.testing.assert_allclose(held.turned(RADIUS * front), [0.2, 0.1, 0.0], atol=1e-12)


@pytest.mark.parametrize("second", ["push", "target"])
def test_a_tool_that_a_page_pulls_is_held_by_no_other_one_until_it_is_let_go_or_the_page_has_gone(second: str) -> None:
    snapshot, connected = snapshot_of(ClosedLoop.from_scenario(load("ur5-impedance"), history=1)), {1, 2}
    desk, posted = MagicMock(), []
    desk.snapshot, desk.viewing = lambda: snapshot, Viewing()
    desk.post = lambda command: posted.append(command) or True
    desk.lock.refuses = lambda _: ""
    hand = ToolDrag(MagicMock(), desk, connected.__contains__)

    def drag(client: int, phase: str, kind: str, by: float = 0.0) -> None:
        at = tuple(snapshot.tool)
        event = SimpleNamespace(
            client_id=client, phase=phase, start_position=at, end_position=(at[0] + by, at[1] + by, at[2] + by)
        )
        hand._drag(event, kind)  # pyright: ignore[reportArgumentType]

    drag(1, "start", "push")
    drag(1, "update", "push", 0.1)
    drag(2, "start", second)
    drag(2, "update", second, 0.2)
    drag(1, "end", "push", 0.1)
    drag(2, "end", second, 0.2)
    assert [command.grip is None for command in posted if isinstance(command, DragTool)] == [False, False, True]
    assert len(posted) == 3

    drag(1, "start", "push", 0.1)
    connected.remove(1)  # and its drag has not been ended
    drag(2, "start", second)
    drag(2, "update", second, 0.2)
    drag(2, "end", second, 0.2)
    again = posted[3:]
    assert [command for command in again if isinstance(command, DragTool)][1] == DragTool(None)
    assert again[-1] == DragTool(None) if second == "push" else isinstance(again[-1], Edit)


@pytest.mark.parametrize("ended_by", [{"phase": "paused"}, {"run": 1}, {"phase": "stopped"}])
@pytest.mark.parametrize("kind", ["push", "target"])
def test_a_hand_that_was_let_go_takes_hold_again_only_by_another_drag(kind: str, ended_by: dict[str, object]) -> None:
    start = replace(snapshot_of(ClosedLoop.from_scenario(load("ur5-impedance"), history=1)), phase="running")
    desk, posted, now = MagicMock(), [], [start]
    desk.snapshot, desk.viewing = lambda: now[0], Viewing()
    desk.post = lambda command: posted.append(command) or True
    desk.lock.refuses = lambda _: ""
    hand = ToolDrag(MagicMock(), desk, {1}.__contains__)

    def drag(phase: str, by: float = 0.0) -> None:
        at = tuple(start.tool)
        event = SimpleNamespace(
            client_id=1, phase=phase, start_position=at, end_position=(at[0] + by, at[1] + by, at[2] + by)
        )
        hand._drag(event, kind)  # pyright: ignore[reportArgumentType]

    now[0] = replace(start, phase="paused")  # it is taken hold of before the run goes on
    drag("start")
    now[0] = start
    drag("update", 0.1)
    before = list(posted)
    now[0] = replace(start, **ended_by)
    drag("update", 0.15)
    now[0] = replace(now[0], phase="running")
    drag("update", 0.2)
    drag("end", 0.2)
    assert posted == [*before, *([DragTool(None)] if kind == "push" else [])]
    drag("start")
    drag("update", 0.1)
    drag("end", 0.1)
    assert len(posted) > len(before) + (kind == "push")


@pytest.mark.parametrize("away", [(0.0, 0.0, 0.02), (0.01, -0.02, 0.0), (0.03, 0.0, -0.01), (0.02, 0.01, 0.0)])
def test_the_spring_is_as_long_as_the_deflection_and_leads_to_the_tool(away: tuple[float, ...]) -> None:
    tool, e = np.array([0.4, 0.2, 0.3]), np.array(away)
    for times in (1.0, 10.0):
        drawn = segments(tool, tool + e, times)
        along = (drawn - tool) @ e / np.linalg.norm(e)
        # from the tool to the desired point, in the direction of the one from the other, and nothing beyond
        np.testing.assert_allclose([along.min(), along.max()], [0.0, times * np.linalg.norm(e)], atol=1e-12)
        np.testing.assert_array_equal(drawn[-1, 0], tool)
        across = np.linalg.norm(drawn - tool - along[..., None] * e / np.linalg.norm(e), axis=-1)
        assert across[:-1].min() > 0.5 * BESIDE
        assert across.max() < BESIDE + 2.0 * HALF_WIDTH
