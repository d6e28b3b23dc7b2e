"""Runs that a preview goes on from, and its metrics."""

from __future__ import annotations

from app.scenario.schema import Scenario
from app.session.preview import Foresight
from app.session.preview_messages import Outlook, PreviewMetrics, PreviewRequest
from app.simulation.closed_loop import ClosedLoop


def running(scenario: Scenario, periods: int = 400) -> ClosedLoop:
    """Closed loop after so many periods."""
    loop = ClosedLoop.from_scenario(scenario)
    for _ in range(periods):
        loop.step()
    return loop


def preview_metrics(request: PreviewRequest) -> PreviewMetrics:
    """Metrics of a preview, computed at once in this process."""
    foresight = Foresight(request)
    foresight.advance(100_000)
    outlook = foresight.outlook()
    assert isinstance(outlook, Outlook)
    return outlook.metrics
