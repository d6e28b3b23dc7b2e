"""Dashboards that draw in a thread of their own, as `vsmrc serve` has them draw."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from app.dashboard.page import Dashboard
from app.scenario.schema import Scenario
from app.session.runner import Runner
from drivers.waiting import PATIENCE


@contextmanager
def drawn(dashboard: Dashboard) -> Iterator[Dashboard]:
    """Context in which the dashboard draws in a thread of its own. At its end the dashboard is closed and the thread
    has ended; the runner is the caller's to close."""
    drawing = threading.Thread(target=dashboard.run_forever, daemon=True)
    drawing.start()
    try:
        yield dashboard
    finally:
        dashboard.close()
        drawing.join(PATIENCE)  # for the frame that is just being drawn
    assert not drawing.is_alive()


@contextmanager
def serving(scenario: Scenario) -> Iterator[tuple[Dashboard, Runner]]:
    """A dashboard on a free port, with the loop that it shows."""
    dashboard = Dashboard(port=0, fps=4.0)  # software draws these pages, on the cores that the tests need
    dashboard.show_progress("compiling the control law…")
    runner = Runner(scenario)
    dashboard.attach(runner)
    runner.start()
    with drawn(dashboard):
        yield dashboard, runner
    runner.close()
