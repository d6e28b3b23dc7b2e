"""Lock on edits: while the goal of a lesson is open, only its fields change the run."""

from __future__ import annotations

import re

import pytest

from app.dashboard.widgets.fields.edit_lock import EditLock
from app.scenario.data import shipped
from app.session.commands import (
    BeginScenario,
    Blend,
    Command,
    DragTool,
    Edit,
    EditModel,
    Load,
    Pause,
    Play,
    PushNow,
    Reset,
    Seek,
    TakeWayOut,
)
from environments.push import Grip
from tests.support.desks import Posted

HYBRID = shipped()["ur5-hybrid"]
ALLOWED = Edit("target_model.B_m", [100.0] * 6)


@pytest.fixture
def lock() -> tuple[EditLock, list[Command], list[str]]:
    posted = Posted()
    complaints: list[str] = []
    return EditLock(posted.post, complaints.append), posted, complaints


@pytest.mark.parametrize(
    "command",
    [
        Edit("mode", "motion"),
        Edit("target_model", {}),
        EditModel({"B_m": {1: 100.0}, "K_m": {1: 900.0}}),
        Blend({}, 1.0),
        Load(HYBRID),
        BeginScenario(HYBRID),
        PushNow(),
        DragTool(Grip((0.5, 0.0, 0.3))),
        TakeWayOut(),
    ],
)
def test_other_changes_are_refused_with_the_way_out(
    command: Command, lock: tuple[EditLock, list[Command], list[str]]
) -> None:
    gate, posted, complaints = lock
    gate.fields = frozenset({"target_model.B_m"})
    assert gate.post(command) is None
    assert posted == []
    assert type(command).__name__ not in complaints[0]
    assert complaints[0].endswith("locked by the goal of a lesson; allowed: B_m, or leave the lesson")
    assert not re.search(r"[a-z_]+\.[a-zA-Z_]+", complaints[0])
    gate.fields = None
    assert gate.post(command) == len(posted)
    assert posted == [command]


def test_the_controls_and_the_time_stay_free(lock: tuple[EditLock, list[Command], list[str]]) -> None:
    gate, posted, complaints = lock
    gate.fields = frozenset({"target_model.B_m"})
    free = [ALLOWED, EditModel({"B_m": {1: 100.0}}), Play(), Pause(), Reset(), Seek(0.1), DragTool(None)]
    for command in free:
        gate.post(command)
    assert posted == free
    assert not complaints
