"""The scene of a run that stands still: it follows the page, and is drawn only where something has changed."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from dataclasses import replace
from unittest.mock import MagicMock

import numpy as np
import pytest

from app.dashboard.page import Dashboard
from app.dashboard.page_content import PageContent
from app.dashboard.scene.tool_drag import HeldHandle
from app.scenario.data import load
from app.session.ghost import NoGhost
from app.session.runner import Runner
from app.storage.link_meshes import Meshes

Frame = Callable[[], int]


@pytest.fixture(scope="module")
def page() -> Iterator[tuple[PageContent, Frame]]:
    """Content of a page of a run that stands still, and a function that draws a frame and returns how often the scene
    was drawn in it."""
    dashboard, runner = Dashboard(port=0), Runner(load("ur5-hybrid"))
    try:
        dashboard.attach(runner)
        content = dashboard._content
        assert content is not None
        scene, instants = content._scene, itertools.count(1.0)
        drawing = MagicMock(wraps=scene.show)
        scene.show = drawing

        def frame() -> int:
            drawing.reset_mock()
            content.draw(next(instants))
            return drawing.call_count

        assert [frame() for _ in range(3)] == [1, 0, 0]
        yield content, frame
    finally:
        dashboard.close()
        runner.close()


def test_a_switch_is_followed_at_once_and_drawn_once(page: tuple[PageContent, Frame]) -> None:
    content, frame = page
    content._viewing.scene_options = replace(content._viewing.scene_options, grid=False, newtons=50.0)
    assert [frame() for _ in range(3)] == [1, 0, 0]
    assert not content._scene._grid.visible
    assert content._viewing.legend.newtons == 50.0


def test_the_target_follows_the_drag(page: tuple[PageContent, Frame]) -> None:
    content, frame = page
    hand, still = content._hand, np.zeros(3)
    hand._held = HeldHandle(0, 0, False, 0, "target", still, np.array([0.0, 0.05, 0.0]), np.eye(3), still)
    assert [frame() for _ in range(2)] == [1, 0]
    assert hand._target.visible
    place = hand._target.position.copy()
    hand._held = replace(hand._held, moved=np.array([0.0, 0.09, 0.0]))
    frame()
    assert np.linalg.norm(hand._target.position - place) == pytest.approx(0.04, abs=1e-6)
    hand._held = None
    frame()
    assert not hand._target.visible


def test_meshes_take_the_place_of_bones_when_they_come(page: tuple[PageContent, Frame]) -> None:
    content, frame = page
    arm = content._scene._robot_view
    assert arm is not None
    meshes: Meshes = Future()
    for mesh in arm._shapes:
        mesh.remove()
    arm._shapes = bones = arm._shaped(meshes)
    assert [frame() for _ in range(2)] == [0, 0]
    meshes.set_result(())
    assert [frame() for _ in range(2)] == [1, 0]
    assert arm._shapes is not bones


def test_the_ghost_of_a_run_that_has_not_begun_is_not_out_of_reach(page: tuple[PageContent, Frame]) -> None:
    content, frame = page
    content._viewing.scene_options = replace(content._viewing.scene_options, ghost=True)
    frame()
    assert content._viewing.legend.ghost == NoGhost.NO_ROWS
    assert f"ghost, {NoGhost.NO_ROWS}" in content._scene_legend._html.content
