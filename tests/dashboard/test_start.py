"""What building and drawing the page costs, counted in work that is done, not in time."""

import threading
from collections import Counter

import msgspec
import pytest

from app.dashboard import page
from app.dashboard.page import Dashboard
from app.dashboard.transport.stalled_clients import StalledClients
from app.scenario.data import shipped
from app.session.runner import Runner
from drivers.waiting import PATIENCE, until


def test_no_part_of_the_schema_is_translated_twice(monkeypatch: pytest.MonkeyPatch):
    translated: Counter[object] = Counter()
    translate = msgspec.inspect.multi_type_info

    def counted(types):
        types = list(types)
        translated.update(types)
        return translate(types)

    monkeypatch.setattr(msgspec.inspect, "multi_type_info", counted)
    dashboard, runner = Dashboard(port=0), Runner(shipped()["ur5-hybrid"])
    try:
        dashboard.attach(runner)
    finally:
        dashboard.close()
        runner.close()
    assert [kind for kind, times in translated.items() if times > 1] == []


def test_a_dashboard_is_closed_between_two_frames(monkeypatch: pytest.MonkeyPatch):
    drawing, go_on, order = threading.Event(), threading.Event(), []

    def drop(_: StalledClients) -> None:  # a part of every frame
        drawing.set()
        go_on.wait(PATIENCE)
        order.append("drawn")

    monkeypatch.setattr(StalledClients, "drop", drop)
    monkeypatch.setattr(page, "FRAME_ENDING", PATIENCE)
    dashboard = Dashboard(port=0)
    stop = dashboard._server.stop
    monkeypatch.setattr(dashboard._server, "stop", lambda: (order.append("stopped"), stop()))
    frames = threading.Thread(target=dashboard.run_forever, daemon=True)
    frames.start()
    drawing.wait(PATIENCE)
    closing = threading.Thread(target=dashboard.close, daemon=True)
    closing.start()
    until(dashboard._closed.is_set)
    go_on.set()
    closing.join(PATIENCE)
    frames.join(PATIENCE)
    assert order == ["drawn", "stopped"]
