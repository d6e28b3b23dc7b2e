"""A run of one second that is exported, and its snapshot."""

from __future__ import annotations

import pytest

from app.scenario.data import edited, load
from app.session import headless_run
from app.session.snapshot import Snapshot, snapshot_of
from app.simulation.closed_loop import ClosedLoop


@pytest.fixture(scope="session")
def loop() -> ClosedLoop:
    return headless_run.simulate(edited(load("ur5-hybrid-moving"), "simulation.duration", 1.0))[0]


@pytest.fixture(scope="session")
def snapshot(loop: ClosedLoop) -> Snapshot:
    return snapshot_of(loop)
