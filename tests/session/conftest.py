"""Timelines that several tests look back on."""

import pytest

from app.scenario.data import edited, shipped
from app.session.timeline import Timeline
from tests.support.timelines import line_of, run


@pytest.fixture
def noisy() -> Timeline:
    """1.2 s with a noisy, late sensor; at 0.7 s the desired force changes."""
    scenario = edited(edited(shipped()["ur5-hybrid"], "sensor.noise", 0.2), "sensor.delay", 0.004)
    line = run(line_of(edited(scenario, "declared.force_error", 2.0)), 700)
    line.edit(edited(line.loop.system.scenario, "force.value", 35.0))
    return run(line, 500)
