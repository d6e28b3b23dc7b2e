"""Fields that are swept from a slider, what a candidate of a search sets, and how it is taken back."""

from __future__ import annotations

import re
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from app.dashboard.widgets.candidate_chart import candidates_html
from app.dashboard.widgets.controls import Desk
from app.dashboard.widgets.field_place import FieldPlace, NumberRow, SliderScale, log_scale
from app.dashboard.widgets.model_fields import DiagonalPlace, OscillatorPlace
from app.dashboard.widgets.swept_fields import FIELDS, FieldChoice, field_of_row, prepared
from app.dashboard.widgets.whatif import WhatIf, changed
from app.scenario.data import shipped, with_values
from app.scenario.errors import ScenarioError
from app.session.commands import EditAll
from app.session.preview_client import Previewer
from app.session.runner import Runner
from app.tune.background import BackgroundTuning
from app.tune.candidates import Candidate
from app.tune.plan import Tuning, moved
from drivers.waiting import until

BASE = shipped()["planar3r-hybrid"]


def seen(**more: Any) -> Any:
    matrices = {"K_m": np.diag([0.0, 4000.0, 4000.0])}
    return SimpleNamespace(scenario=BASE, matrices=matrices, **more)


def test_a_slider_is_swept_around_its_value_and_over_its_length_where_it_is_linear() -> None:
    value = BASE.controller.layer
    swept = field_of_row(NumberRow(FieldPlace("controller.layer"), "layer [m/s]", log_scale(1e-4, 1.0)), seen())
    assert (swept.name, swept.path) == ("boundary layer", "controller.layer")
    assert (swept.low, swept.high, swept.logarithmic) == pytest.approx((value / 10, value * 10, True))
    swept = field_of_row(NumberRow(FieldPlace("truth.coulomb"), "Coulomb [N·m]", SliderScale(0, 10)), seen())
    assert (swept.low, swept.high, swept.logarithmic) == (0, 10, False)
    swept = field_of_row(NumberRow(FieldPlace("declared.viscous"), "viscous [N·m·s]", SliderScale(0, 10)), seen())
    assert swept.name == "largest viscous friction per joint (declared)"
    near_the_end = field_of_row(
        NumberRow(FieldPlace("controller.layer"), "layer", log_scale(0.9 * value, 2 * value)), seen()
    )
    assert (near_the_end.low, near_the_end.high) == pytest.approx((0.9 * value, 2 * value))
    with pytest.raises(ScenarioError, match="K_m: it has no slider now"):
        field_of_row(NumberRow(FieldPlace("target_model.K_m"), "K_m", None), seen())


def test_an_entry_of_a_matrix_is_swept_also_where_the_mode_gives_the_matrix() -> None:
    swept = field_of_row(NumberRow(DiagonalPlace("target_model.K_m", 1), "K_m ψ", log_scale(1, 1e5)), seen())
    assert swept.path == "target_model.K_m.2"
    base = prepared(seen(), [swept])
    assert list(with_values(base, {swept.path: 900.0}).target_model.K_m or ()) == [0.0, 900.0, 4000.0]
    place = SimpleNamespace(read=lambda _: 3.0, entry=OscillatorPlace("target_model", "omega", 1).entry)
    with pytest.raises(ScenarioError, match="ω ψ: it follows from several matrices; allowed: an entry of M_m"):
        field_of_row(NumberRow(cast(FieldPlace, place), "ω ψ", log_scale(1, 100)), seen())


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("nan, 1", "boundary layer: 'nan'; allowed: a number"),
        ("0.01, 1e400", "boundary layer: '1e400'; allowed: a number"),
        ("0.01", "boundary layer: '0.01'; allowed: two numbers with a comma between"),
        ("2, 1", "boundary layer: 2 to 1; allowed: low before high"),
    ],
)
def test_a_range_that_makes_no_sense_is_one_sentence(text: str, sentence: str) -> None:
    def handle(*_: object, **__: object) -> SimpleNamespace:
        return SimpleNamespace(value="boundary layer", label="", visible=True, on_update=lambda _: None)

    desk = cast(Desk, SimpleNamespace(gui=SimpleNamespace(add_dropdown=handle, add_text=handle)))
    choice = FieldChoice(desk, "Across", FIELDS, "boundary layer", optional=False)
    choice._range.value = text
    with pytest.raises(ScenarioError) as refused:
        choice.axis(BASE, 5)
    assert str(refused.value) == sentence


def test_what_a_candidate_sets_is_taken_back_together() -> None:
    runner, whatif = Runner(BASE), WhatIf(Previewer())
    runner.start()
    try:
        before, edit = runner.snapshot, EditAll({"controller.layer": 0.02, "controller.K_s": 54.0})
        whatif.remember(before, edit)
        runner.post(edit)
        after = until(lambda: now if (now := runner.snapshot).revision > before.revision else None)
        assert (after.scenario.controller.layer, after.scenario.controller.K_s) == (0.02, 54.0)
        assert after.run == before.run
        undo = whatif.undo(after)
        assert undo is not None
        assert changed(after.scenario, undo) == BASE
    finally:
        runner.close()


def test_a_candidate_over_a_limit_is_a_cross_with_its_badge_and_not_of_the_front() -> None:
    aims = ("residual", "torque_variation")
    tuning = Tuning(BASE, (moved("controller.layer=0.001:0.1:log"),), points=4, draw=4, aims=aims)
    candidates = [
        Candidate(number, {"controller.layer": 0.01 * number} if number else {}, aims, badge, bool(badge), 1.0)
        for number, aims, badge in (
            (0, (2.0, 2.0), ""),
            (1, (1.0, 3.0), ""),
            (2, (3.0, 1.0), ""),
            (3, (0.5, 0.5), "over its limit: <b>layer</b>"),
        )
    ]
    state = {"problem": "", "waiting": False, "complete": True, "going": False, "runs": 16, "most": 99}
    search = SimpleNamespace(tuning=tuning, candidates=candidates, **state)
    drawn = candidates_html(cast(BackgroundTuning, search), {"controller.layer": "boundary layer"}, 1)
    marks = dict(re.findall(r'data-point="(\d)".*?<(?:path|circle) class="(vs-[a-z]+)"', drawn))
    assert marks == {"0": "vs-own", "1": "vs-best", "2": "vs-best", "3": "vs-badged"}
    labels = dict(re.findall(r'data-point="(\d)"[^>]* aria-label="(.*?)"', drawn))
    assert labels["3"].endswith("worst of 4 arms. Not offered: over its limit: &lt;b&gt;layer&lt;/b&gt;")
    assert labels["1"].startswith("boundary layer 0.01 m/s: residual 1 N, torque variation 3 N·m/s, worst of 4 arms")
    assert labels["0"].startswith("own gains: residual 2 N")
    assert drawn.count("vs-chosen-ring") == 1
    assert "<b>" not in drawn
    assert "logarithmic" not in drawn


def test_aims_more_than_a_decade_apart_have_logarithmic_axes() -> None:
    def x_of(largest: float) -> list[float]:
        aims = ("residual", "torque_variation")
        tuning = Tuning(BASE, (moved("controller.layer=0.001:0.1:log"),), points=4, aims=aims)
        candidates = [
            Candidate(number, {}, (value, 2.0), "", False, 1.0) for number, value in enumerate((1.0, 2.0, largest))
        ]
        state = {"problem": "", "waiting": False, "complete": True, "going": False, "runs": 3, "most": 3}
        search = SimpleNamespace(tuning=tuning, candidates=candidates, **state)
        drawn = candidates_html(cast(BackgroundTuning, search), {}, None)
        assert ("residual [N], logarithmic" in drawn or "residual, logarithmic" in drawn) == (largest > 10.0)
        at = dict(re.findall(r'data-point="(\d)" data-at="([\d.]+),', drawn))
        return [float(at[str(number)]) for number in range(3)]

    first, second, last = x_of(415.0)
    assert second - first > 0.1 * (last - first)  # 0.2 % of it on a linear axis
    first, second, last = x_of(9.0)
    assert second - first == pytest.approx((last - first) / 8.0, abs=0.2)
