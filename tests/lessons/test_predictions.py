"""Measured numbers and predictions of them: units, intervals, and where a prediction is drawn."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from app.lessons.answers import Answer
from app.lessons.blocks import LessonRun, Measure, NumberQuestion, PictureLine
from app.lessons.lesson import LessonStep
from app.lessons.measures import taken
from app.lessons.predictions import predicted
from app.scenario.errors import ScenarioError
from app.scenario.units import Units

NUMBER = NumberQuestion(ask="?", measure="way", tolerance=1.0, wrong=(0.0,))
LINE = PictureLine(signal="e_r.2", unit="mm", title="way")


def test_a_time_is_measured_and_predicted_in_its_own_unit_and_no_length_is_a_time() -> None:
    t = np.linspace(0.0, 2.0, 2001)
    scenario = SimpleNamespace(controller=SimpleNamespace(period=1e-3))
    robot = SimpleNamespace(slides=6 * (False,))
    system: Any = SimpleNamespace(scenario=scenario, robot=robot, units=Units("cartesian", "revolute"))
    recording: Any = SimpleNamespace(stretch=lambda *_: {"t": t, "phi": np.where(t < 0.8, 1.0, 0.0)})

    def number(statistic: Any, unit: str) -> str:
        return str(taken(system, recording, 2.0, Measure(unit, signal="phi", statistic=statistic, level=0.5)))

    assert [number("below", unit) for unit in ("s", "ms")] == ["0.8 s", "800 ms"]
    assert [number("settles", unit) for unit in ("s", "ms")] == ["0.8 s", "800 ms"]
    assert number("peak", "mm") == "1000 mm"
    for statistic in ("below", "settles"):
        with pytest.raises(ScenarioError, match=f"unit: 'mm' of the statistic {statistic}; allowed: s, ms"):
            number(statistic, "mm")

    recording.stretch = lambda *_: {"t": t, "phi": np.where(t < 0.8, np.nan, 0.0)}
    with pytest.raises(ScenarioError, match="measure of phi: it has no value at t = 0 s; allowed: a start and end"):
        number("largest", "mm")

    run = LessonRun("run", 2.0, (LINE,), {"way": Measure("ms", signal=LINE.signal, statistic="settles", start=0.5)})
    step = LessonStep(1, 1, "predict", "", NUMBER, None)
    assert predicted(run, LINE, [(step, Answer(250.0))]).instants == (0.75,)
    late = Measure("ms", signal=LINE.signal, statistic="settles", last=0.5)
    assert predicted(replace(run, measures={"way": late}), LINE, [(step, Answer(250.0))]).instants == (1.75,)
    levels = {
        statistic: predicted(
            replace(run, measures={"way": Measure("mm", signal=LINE.signal, statistic=statistic)}),
            LINE,
            [(step, Answer(5.0))],
        ).levels
        for statistic in ("largest", "span", "variation")
    }
    assert levels == {"largest": (5.0,), "span": (), "variation": ()}
