"""What building and drawing the page costs, counted in work that is done, not in time."""

from collections import Counter

import msgspec

from app.dashboard import Dashboard
from app.runner import Runner
from app.scenario_data import shipped


def test_no_part_of_the_schema_is_translated_twice(monkeypatch):
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
