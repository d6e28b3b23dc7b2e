"""Runs that a preview goes on from, and its metrics."""

from __future__ import annotations

from app.scenario.schema import Scenario
from app.session.preview import PreviewRun
from app.session.preview_messages import Preview, PreviewMetrics, PreviewRequest
from app.simulation.closed_loop import ClosedLoop


def running(scenario: Scenario, periods: int = 400) -> ClosedLoop:
    """Closed loop after so many periods."""
    loop = ClosedLoop.from_scenario(scenario)
    for _ in range(periods):
        loop.step()
    return loop


def preview_metrics(request: PreviewRequest) -> PreviewMetrics:
    """Metrics of a preview, computed at once in this process."""
    preview_run = PreviewRun(request)
    preview_run.advance(100_000)
    preview = preview_run.preview()
    assert isinstance(preview, Preview)
    return preview.metrics
