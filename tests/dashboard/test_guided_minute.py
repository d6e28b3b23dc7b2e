"""Guided minute: what its texts say is what the runs do."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
import viser

from app.dashboard.widgets.fields.controls import Desk
from app.dashboard.widgets.fields.edit_lock import EditLock
from app.dashboard.widgets.lesson.guided_minute import GuidedMinute, GuidedStep, steps
from app.scenario.data import edited, load
from app.scenario.schema import Scenario
from app.session.changes import pushed
from app.session.commands import Load, Play
from app.session.snapshot import Snapshot
from app.simulation.builders.environment_builder import robot_of
from app.simulation.closed_loop import ClosedLoop
from controllers.modes import MODES
from tests.support.desks import Posted


def test_a_lesson_with_an_open_goal_does_not_begin_it(viser_server: viser.ViserServer) -> None:
    """What is refused neither opens the folder nor lets a paused attempt at the goal run on."""
    posted, complaints = Posted(), list[str]()
    lock = EditLock(posted.post, complaints.append)
    minute = GuidedMinute(cast(Desk, SimpleNamespace(gui=viser_server.gui, post=lock.post)))
    lock.fields = frozenset({"controller.layer"})
    asyncio.run(minute._toggle(None))
    assert (posted, minute._folder.visible, len(complaints)) == ([], False, 1)
    lock.fields = None
    asyncio.run(minute._toggle(None))
    assert posted == [Load(steps()[0].scenario), Play()]
    assert minute._folder.visible
    asyncio.run(minute._toggle(None))
    assert not minute._folder.visible


def test_it_closes_when_its_scenario_or_mode_is_left_and_not_before_its_scenario_runs(viser_server: viser.ViserServer):
    posted = Posted()
    minute = GuidedMinute(cast(Desk, SimpleNamespace(gui=viser_server.gui, post=posted.post)))
    asked = steps()[0].scenario

    def after(executed: int, scenario: Scenario) -> bool:
        """Whether it is open after the runner has carried out so many commands and has this scenario."""
        minute.show(cast(Snapshot, SimpleNamespace(executed=executed, scenario=scenario)))
        return minute._folder.visible

    asyncio.run(minute._toggle(None))
    assert after(0, load("panda-hybrid"))  # that of before, while the step's scenario is prepared
    assert after(2, asked)
    assert after(3, edited(asked, "controller.law", "computed-torque"))
    assert not after(4, edited(asked, "mode", "impedance"))
    asyncio.run(minute._toggle(None))
    assert after(len(posted), asked)
    assert not after(len(posted) + 1, load("panda-hybrid"))


def ran(scenario: Scenario, to: float) -> dict[str, np.ndarray]:
    loop = ClosedLoop.from_scenario(scenario)
    while loop.t < to:
        loop.advance()
        assert loop.stopped is None
    assert loop.warning is None
    return loop.recording.signals(("t", "e_r", "F_c", "F_cd", "F_push", "multiplier"))


def step(mode: str) -> GuidedStep:
    return next(each for each in steps() if each.scenario.mode == mode)


def settled(rows: dict[str, np.ndarray], signal: str) -> np.ndarray:
    return rows[signal][rows["t"] > 3.0]


def test_every_mode_has_a_step_and_its_arm_is_heavier_than_believed() -> None:
    assert [each.scenario.mode for each in steps()] == list(MODES)
    assert all(each.scenario.truth.link_scaling == pytest.approx(1.15) for each in steps())
    assert all(each.scenario.controller.law == "vsmrc" for each in steps())


def test_motion_is_not_moved_by_a_push() -> None:
    scenario = step("motion").scenario
    rows = ran(pushed(scenario, robot_of(scenario), 4.0), 5.0)
    assert np.linalg.norm(rows["F_push"], axis=1).max() > 20.0
    assert np.abs(settled(rows, "e_r")).max() < 0.02e-3


def test_a_push_moves_an_impedance_as_its_spring_says() -> None:
    rows = ran(step("impedance").scenario, 6.0)
    assert np.linalg.norm(rows["F_push"][-1]) == pytest.approx(30.0)
    assert rows["e_r"][-1, 1] == pytest.approx(30.0 / 2000.0, rel=0.02)
    before = rows["e_r"][np.searchsorted(rows["t"], 4.9)]
    assert 2000.0 * before[2] == pytest.approx(rows["multiplier"][np.searchsorted(rows["t"], 4.9)], rel=1e-3)


def test_the_robust_law_holds_the_force_and_computed_torque_does_not() -> None:
    scenario = step("hybrid").scenario
    held, other = (
        np.abs(settled(rows, "F_c")[:, 0] - 20.0).max()
        for rows in (ran(scenario, 8.0), ran(edited(scenario, "controller.law", "computed-torque"), 8.0))
    )
    assert held < 0.01
    assert other == pytest.approx(9.0, abs=0.5)


def test_along_the_surface_a_push_is_yielded_to_while_the_force_stays() -> None:
    rows = ran(step("hybrid-impedance").scenario, 6.0)
    assert np.abs(rows["e_r"][-1, 1:3]).max() == pytest.approx(7.35e-3, abs=0.4e-3)
    assert np.abs(settled(rows, "multiplier") - 20.0).max() < 0.1


def test_a_rigid_plane_is_pressed_with_what_is_asked() -> None:
    rows = ran(step("constrained").scenario, 4.0)
    assert np.abs(settled(rows, "multiplier") - 20.0).max() < 0.05
