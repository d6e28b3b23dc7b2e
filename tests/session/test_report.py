"""Report of a session's process to the gateway, which keeps what the session would begin with anew."""

from __future__ import annotations

import threading
from typing import Any, cast

import pytest

from app.scenario.data import edited, from_toml, shipped
from app.session.commands import Edit, Pause, Seek
from app.session.runner import Runner
from app.workers.session import _report
from drivers.waiting import until

pytestmark = pytest.mark.slow  # waits for the report


class Gateway:
    """Gateway that hangs up after the first message."""

    def __init__(self) -> None:
        self.told: list[Any] = []

    def send(self, message: object) -> None:
        self.told.append(message)
        raise OSError


def test_the_newest_scenario_is_reported_while_somebody_looks_back() -> None:
    scenario, gateway = shipped()["planar3r-hybrid"], Gateway()
    runner = Runner(scenario)
    runner.start()
    try:
        until(lambda: runner.snapshot.t > 0.1)
        runner.post(Edit("controller.epsilon", 4.0))
        runner.post(Pause())
        until(lambda: runner.snapshot.latest.scenario.controller.epsilon == 4.0)
        runner.post(Seek(0.02))
        until(lambda: runner.snapshot.scenario.controller.epsilon != 4.0)
        reporting = threading.Thread(target=_report, args=(cast(Any, gateway), runner, scenario), daemon=True)
        reporting.start()
        reporting.join(60.0)
        assert [from_toml(message.scenario) for message in gateway.told] == [
            edited(scenario, "controller.epsilon", 4.0)
        ]
    finally:
        runner.close()
