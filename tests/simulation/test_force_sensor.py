"""The force sensor against closed forms, and delays that it cannot have."""

from __future__ import annotations

import numpy as np
import pytest

from app.scenario.data import edited, shipped
from app.scenario.errors import ScenarioError
from app.simulation.assembly import assemble
from environments.sensors import ForceReader, ForceSensor, Sensor


def test_sensor_is_a_first_order_lag_and_a_delay() -> None:
    """A step of the force: 1 - exp(-2 pi cutoff t), some periods late, with its bias."""
    sensor = ForceSensor(Sensor(bias=(0.5, 0.0, 0.0), delay=0.004, cutoff=20.0), period=0.001)
    reader, step = ForceReader(sensor, seed=0), np.array([0.0, 3.0, 0.0, 0.0, 0.0, 0.0])
    for _ in range(10):
        np.testing.assert_allclose(reader.read(np.zeros(6)), [0.5, 0.0, 0.0, 0.0, 0.0, 0.0], atol=1e-15)
    readings = np.array([reader.read(step) for _ in range(50)])
    np.testing.assert_allclose(readings[:4, 1], 0.0, atol=1e-15)
    late = 0.001 * np.arange(1, 47)
    np.testing.assert_allclose(readings[4:, 1], 3.0 * (1.0 - np.exp(-2 * np.pi * 20.0 * late)), atol=1e-12)


@pytest.mark.parametrize("name", ["delay", "moment_delay"])
def test_a_delay_that_would_be_none_is_refused(name: str) -> None:
    """A delay takes the nearest whole number of control periods."""
    base, path = shipped()["ur5-hybrid"], f"sensor.{name}"
    periods = {delay: assemble(edited(base, path, delay)).sensor.late for delay in (0.0, 6e-4, 1.4e-3, 1.6e-3)}
    assert list(periods.values()) == [0, 1, 1, 2]
    for delay in (1e-5, 5e-4):
        with pytest.raises(ScenarioError, match=f"{path}: {delay:g} s, less than .* allowed: 0, more than 0.0005 s"):
            assemble(edited(base, path, delay))
