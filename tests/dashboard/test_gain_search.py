"""Fields that are swept from a slider, what a candidate of a search sets, and how it is taken back."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import numpy as np
import pytest
import viser

from app.dashboard.widgets.families.candidate_chart import candidates_html
from app.dashboard.widgets.families.gain_search import AGAIN, NOT_OFFERED, GainSearch
from app.dashboard.widgets.families.swept_fields import FIELDS, FieldChoice, field_of_row, prepared
from app.dashboard.widgets.fields.controls import Desk
from app.dashboard.widgets.fields.field_binding import FieldBinding, NumberRow, SliderScale, log_scale
from app.dashboard.widgets.fields.model_fields import DiagonalBinding, OscillatorBinding
from app.dashboard.widgets.run.whatif import WhatIf, changed
from app.scenario import own_code
from app.scenario.data import edited, shipped, with_values
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.session.commands import EditAll
from app.session.preview_client import Previewer
from app.session.runner import Runner
from app.session.snapshot import snapshot_of
from app.simulation.closed_loop import ClosedLoop
from app.sweep.axes import Value
from app.sweep.background import Background
from app.sweep.run_metrics import RunMetrics
from app.tune.background import BackgroundTuning
from app.tune.candidates import Candidate, candidate_of, front
from app.tune.plan import Tuning, moved
from app.tune.running import TuningResult
from drivers.waiting import until
from tests.support.desks import BareDesk
from tests.support.pages import ROOT

BASE = shipped()["planar3r-hybrid"]


def seen(**more: Any) -> Any:
    matrices = {"K_m": np.diag([0.0, 4000.0, 4000.0])}
    return SimpleNamespace(scenario=BASE, matrices=matrices, **more)


def test_a_slider_is_swept_around_its_value_and_over_its_length_where_it_is_linear() -> None:
    value = BASE.controller.layer
    swept = field_of_row(NumberRow(FieldBinding("controller.layer"), "layer [m/s]", log_scale(1e-4, 1.0)), seen())
    assert (swept.name, swept.path) == ("boundary layer", "controller.layer")
    assert (swept.low, swept.high, swept.logarithmic) == pytest.approx((value / 10, value * 10, True))
    swept = field_of_row(NumberRow(FieldBinding("truth.coulomb"), "Coulomb [N·m]", SliderScale(0, 10)), seen())
    assert (swept.low, swept.high, swept.logarithmic) == (0, 10, False)
    swept = field_of_row(NumberRow(FieldBinding("declared.viscous"), "viscous [N·m·s]", SliderScale(0, 10)), seen())
    assert swept.name == "largest viscous friction per joint (declared)"
    near_the_end = field_of_row(
        NumberRow(FieldBinding("controller.layer"), "layer", log_scale(0.9 * value, 2 * value)), seen()
    )
    assert (near_the_end.low, near_the_end.high) == pytest.approx((0.9 * value, 2 * value))
    with pytest.raises(ScenarioError, match="K_m: it has no slider now"):
        field_of_row(NumberRow(FieldBinding("target_model.K_m"), "K_m", None), seen())


def test_an_entry_of_a_matrix_is_swept_also_where_the_mode_gives_the_matrix() -> None:
    swept = field_of_row(NumberRow(DiagonalBinding("target_model.K_m", 1), "K_m ψ", log_scale(1, 1e5)), seen())
    assert swept.path == "target_model.K_m.2"
    base = prepared(seen(), [swept])
    assert list(with_values(base, {swept.path: 900.0}).target_model.K_m or ()) == [0.0, 900.0, 4000.0]
    place = SimpleNamespace(read=lambda _: 3.0, entry=OscillatorBinding("target_model", "omega", 1).entry)
    with pytest.raises(ScenarioError, match="ω ψ: it follows from several matrices; allowed: an entry of M_m"):
        field_of_row(NumberRow(cast(FieldBinding, place), "ω ψ", log_scale(1, 100)), seen())


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("nan, 1", "boundary layer: 'nan'; allowed: a number"),
        ("0.01, 1e400", "boundary layer: '1e400'; allowed: a number"),
        ("0.01", "boundary layer: '0.01'; allowed: two numbers with a comma between"),
        ("2, 1", "boundary layer: 2 to 1; allowed: low before high"),
        ("0.01, 0.010000001", "boundary layer: '0.01, 0.010000001'; allowed: ends further apart"),
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
    search = SimpleNamespace(tuning=tuning, candidates=candidates, front=front(candidates[1:]), **state)
    drawn = candidates_html(cast(BackgroundTuning, search), {"controller.layer": "boundary layer"}, 1)
    marks = dict(re.findall(r'data-point="(\d)".*?<(?:path|circle) class="(vs-[a-z]+)"', drawn))
    assert marks == {"0": "vs-own", "1": "vs-best", "2": "vs-best", "3": "vs-badged"}
    labels = dict(re.findall(r'data-point="(\d)"[^>]* aria-label="(.*?)"', drawn))
    assert labels["3"].endswith("worst of 4 arms. Not offered: over its limit: &lt;b&gt;layer&lt;/b&gt;")
    first = "candidate 1, boundary layer 0.01 m/s: residual 1 N, torque variation 3 N·m/s, worst of 4 arms"
    assert labels["1"] == first  # by the number that the sentences at the end have
    assert labels["0"].startswith("own gains: residual 2 N")
    assert drawn.count("vs-chosen-ring") == 1
    assert "<b>" not in drawn
    assert "logarithmic" not in drawn
    assert re.findall(r'data-point="(\d)"[^>]* tabindex="0"', drawn) == ["0"]
    candidates[0] = replace(candidates[0], aims=(2.0, math.inf))  # the own gains have no place in the picture
    alone = candidates_html(cast(BackgroundTuning, search), {"controller.layer": "boundary layer"}, 1)
    assert re.findall(r'data-point="(\d)"[^>]* tabindex="0"', alone) == ["1"]


def test_aims_more_than_a_decade_apart_have_logarithmic_axes() -> None:
    def x_of(largest: float) -> list[float]:
        aims = ("residual", "torque_variation")
        tuning = Tuning(BASE, (moved("controller.layer=0.001:0.1:log"),), points=4, aims=aims)
        candidates = [
            Candidate(number, {}, (value, 2.0), "", False, 1.0) for number, value in enumerate((1.0, 2.0, largest))
        ]
        state = {"problem": "", "waiting": False, "complete": True, "going": False, "runs": 3, "most": 3}
        search = SimpleNamespace(tuning=tuning, candidates=candidates, front=front(candidates[1:]), **state)
        drawn = candidates_html(cast(BackgroundTuning, search), {}, None)
        assert ("residual [N], logarithmic" in drawn or "residual, logarithmic" in drawn) == (largest > 10.0)
        at = dict(re.findall(r'data-point="(\d)" data-at="([\d.]+),', drawn))
        return [float(at[str(number)]) for number in range(3)]

    first, second, last = x_of(415.0)
    assert second - first > 0.1 * (last - first)  # 0.2 % of it on a linear axis
    first, second, last = x_of(9.0)
    assert second - first == pytest.approx((last - first) / 8.0, abs=0.2)


def test_candidates_of_one_aim_are_drawn_at_their_numbers_also_those_that_are_never_offered() -> None:
    tuning = Tuning(BASE, (moved("controller.layer=0.001:0.1:log"),), points=9, aims=("residual",))
    candidates = [
        Candidate(number, {}, (1.0 + number,), "over its limit" if number > 2 else "", False, 1.0)
        for number in range(9)
    ]
    state = {"problem": "", "waiting": False, "complete": True, "going": False, "runs": 9, "most": 9}
    search = SimpleNamespace(tuning=tuning, candidates=candidates, front=front(candidates[1:]), **state)
    drawn = candidates_html(cast(BackgroundTuning, search), {}, None)
    at = [(float(x), float(y)) for x, y in re.findall(r'data-at="([\d.]+),([\d.]+)"', drawn)]
    across = sorted(x for x, _ in at)
    assert np.diff(across) == pytest.approx([(across[-1] - across[0]) / 8] * 8, abs=0.11)
    assert len({y for _, y in at}) == 3  # what is never offered lies at the upper edge


@pytest.fixture
def ended(monkeypatch: pytest.MonkeyPatch) -> BackgroundTuning:
    """A search that has ended: of its front, candidate 1 is over a limit on test arms, 2 changes nothing
    there, and 4 is offered; candidate 3 would be in the front without candidate 1."""
    monkeypatch.setattr(Background, "_run", lambda _: None)
    layer = (moved("controller.layer=0.001:0.1:log"),)
    tuning = Tuning(BASE, layer, points=5, draw=4, unseen=2, aims=("residual", "torque_variation"))

    def run(residual: float, variation: float, failed: str | None = None) -> RunMetrics:
        verdict = "nothing promised" if failed else "holds"
        return {"residual": residual, "torque_variation": variation, "failed": failed, "verdict": verdict}

    seen = {0: run(5.0, 5.0), 1: run(1.0, 4.0), 2: run(2.0, 3.0), 3: run(1.5, 4.5), 4: run(4.0, 1.0)}
    unseen = {0: run(5.0, 5.0), 1: run(1.0, 4.0, "gain"), 2: run(5.0, 5.0), 4: run(4.0, 1.0)}
    values: dict[int, dict[str, Value]] = {
        number: {"controller.layer": 0.01 * number} if number else {} for number in seen
    }
    candidates = [candidate_of(tuning, number, values[number], [each] * 4) for number, each in seen.items()]
    tried = {number: candidate_of(tuning, number, values[number], [each] * 2) for number, each in unseen.items()}
    search = BackgroundTuning(tuning, workers=1)
    for each in candidates:
        search.take(each)
    assert [each.number for each in search.front] == [1, 2, 4]
    search.take(TuningResult(candidates, tried, {number: [each] * 2 for number, each in unseen.items()}))
    return search


OVER = "on the test arms, over its limit: d covers (17) (2 of 2 arms)"
IN_VAIN = "it changes nothing on any test arm"


def test_a_candidate_that_fails_on_arms_that_were_not_seen_becomes_a_cross_and_no_other_takes_its_place(
    ended: BackgroundTuning,
) -> None:
    drawn = candidates_html(ended, {"controller.layer": "boundary layer"}, None)
    marks = dict(re.findall(r'data-point="(\d)".*?<(?:path|circle) class="(vs-[a-z]+)"', drawn))
    assert marks == {"0": "vs-own", "1": "vs-badged", "2": "vs-badged", "3": "vs-tried", "4": "vs-best"}
    labels = dict(re.findall(r'data-point="(\d)"[^>]* aria-label="(.*?)"', drawn))
    assert labels["1"].endswith(f". Not offered: {OVER}")
    assert labels["2"].endswith(f". Not offered: {IN_VAIN}")
    assert "Not offered" not in labels["3"] + labels["4"]
    (line,) = re.findall(r'class="vs-front" d="(.*?)"', drawn)
    assert line.count("V") == 0  # through candidate 4 alone


def test_what_the_sentences_at_the_end_do_not_offer_cannot_be_applied(
    ended: BackgroundTuning, viser_server: viser.ViserServer
) -> None:
    page = BareDesk(viser_server, BASE)
    search = GainSearch(page.desk)
    layer = next(each for each in FIELDS if each.path == "controller.layer")
    search._fields, search._names = [layer], {layer.path: layer.name}
    search._work = ended
    search.show(page.snapshot())
    told = search._conclusions.content
    assert f"candidate 1 is not offered: {OVER}." in told
    assert f"candidate 2 is not offered: {IN_VAIN}." in told
    assert "residual and torque variation: candidate 4 better than the own gains" in told
    assert ".toml" not in told  # a page has no such file
    for number, reason in (("1", OVER), ("2", IN_VAIN)):
        search._choose(ended, number, 1)
        held = page.whatif.held
        assert held is not None
        assert (held.label, held.then) == (f"candidate {number}", NOT_OFFERED)
        assert held.value == f"boundary layer 0.0{number} m/s"
        search._choose(ended, number, 1)
        assert page.complaints.pop() == f"candidate {number}: not offered, {reason}"
    assert not page.posted
    search._choose(ended, "4", 1)
    assert page.whatif.held is not None
    assert page.whatif.held.then == AGAIN
    search._choose(ended, "4", 2)  # another page's first click
    assert not page.posted
    search._choose(ended, "4", 2)
    assert page.posted == [EditAll({"controller.layer": 0.04})]
    assert not page.complaints
    page._snapshot = snapshot_of(ClosedLoop.from_scenario(edited(BASE, "task_space.characteristic_length", 0.3)))
    search._choose(ended, "4", 1)
    assert page.complaints == [
        "candidate 4: of an earlier scenario, whose gains mean something else; allowed: a search for the present one"
    ]
    assert len(page.posted) == 1


def test_a_search_under_a_law_of_ones_own_has_the_engine_that_takes_it(viser_server: viser.ViserServer) -> None:
    engines = []
    own_code.use([ROOT / "docs" / "examples" / "pid_gravity.py"])
    for law in ("vsmrc", "pid-gravity"):
        page = BareDesk(viser_server, edited(BASE, "controller.law", law))
        search = GainSearch(page.desk)
        engines.append(search._request(page.snapshot())[1].engine)
    assert engines == ["compiled", "pinocchio"]


def test_files_of_searches_for_different_things_have_different_names(
    ended: BackgroundTuning, viser_server: viser.ViserServer
) -> None:
    page, names = BareDesk(viser_server, BASE), list[str]()
    cast(Any, page.desk).export_jobs = None
    search = GainSearch(page.desk)
    search._delivery = cast(Any, SimpleNamespace(give=lambda _, __, name, ___: names.append(name)))
    for changes in ({}, {"seed": 1}, {"aims": ("residual",)}, {"vary": (moved("controller.K_s=20:80"),)}):
        asked = msgspec.structs.replace(ended.tuning, until=1.5, **changes)
        search._work = cast(BackgroundTuning, SimpleNamespace(tuning=asked, rows=[], found=ended.found))
        search._on_file(cast(Any, None))
    assert names[0] == "vsmrc-planar3r-hybrid-search-residual-torque_variation-controller-layer-seed-0-1.50s.zip"
    assert len(set(names)) == 4


MOTION, UNDECLARED = shipped()["ur5-motion"], edited(BASE, "declared", {})
STATED = edited(BASE, "declared.delta_C", "speed")
ALIKE = (
    "they are all alike, since no quantity that is drawn is declared; allowed: a bound above 0 on the tab Robot, such "
    "as that of the links"
)


@pytest.mark.parametrize(
    ("scenario", "choices", "sentence"),
    [
        (
            MOTION,
            {},
            "What counts: force error, which no run of this scenario in motion mode has; allowed: path error, angle "
            "error, torque variation, settling time, residual of (8)",
        ),
        (MOTION, {"first": "path error", "second": "force error"}, "What else counts: force error, which no run of"),
        (BASE, {"second": "force error"}, "What else counts: force error, as what counts; allowed: something else, or"),
        (UNDECLARED, {}, f"Judged by: 4 of the declared set: {ALIKE}, or the scenario's own with 1 under Test arms"),
        (UNDECLARED, {"arms": "the scenario's own"}, f"Test arms: 8: {ALIKE}, or 1"),
        (STATED, {}, "Judged by: 4 of the declared set: bound of ‖ΔC‖ (declared) is stated, and only its run shows"),
    ],
)  # fmt: skip
def test_a_search_that_makes_no_sense_is_refused_in_the_words_of_its_controls(
    scenario: Scenario, choices: dict[str, str], sentence: str, viser_server: viser.ViserServer
) -> None:
    page = BareDesk(viser_server, scenario)
    search = GainSearch(page.desk)
    for name, value in choices.items():
        getattr(search, f"_{name}").value = value
    with pytest.raises(ScenarioError) as refused:
        search._request(page.snapshot())
    assert str(refused.value).startswith(sentence)
    assert not re.search(r"--|\w\.\w", str(refused.value))  # neither an option of the command line nor a path


def test_a_search_has_a_gain_to_move_and_nothing_else(viser_server: viser.ViserServer) -> None:
    page = BareDesk(viser_server, BASE)
    search = GainSearch(page.desk)
    stiffness = NumberRow(FieldBinding("contact.K_e"), "K_e [N/m]", log_scale(100, 100_000))
    with pytest.raises(ScenarioError) as refused:
        search.let_move(stiffness)
    assert str(refused.value) == "stiffness of the surface: no gain; allowed: fields of the tabs Controller and Model"
    assert [each.field and each.field.path for each in search._moves] == [
        "controller.layer",
        "controller.K_s",
        None,
        None,
    ]
    search._request(page.snapshot())
    search._moves[0]._range.value = "-1, 0.05"
    with pytest.raises(ScenarioError, match=r"^boundary layer: -1\.?0?; allowed: a number > 0"):
        search._request(page.snapshot())
    for each in search._moves:
        each.leave()
    with pytest.raises(ScenarioError) as refused:
        search._request(page.snapshot())
    assert str(refused.value) == "the gains that may move: none; allowed: one or more"
