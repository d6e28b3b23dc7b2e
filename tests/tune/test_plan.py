"""The question of a tuning: what is moved, and what is refused."""

from __future__ import annotations

import msgspec
import pytest

from app.scenario.data import edited, shipped
from app.scenario.errors import ScenarioError
from app.sweep.axes import Axis
from app.sweep.plan import SweepPlan, SweepRow
from app.tune.plan import Tuning, moved, require_sound
from app.tune.search import Search

TUNING = Tuning(
    shipped()["planar3r-hybrid"], (moved("controller.layer=0.002:0.05:log"),), points=9, draw=2, aims=("force_error",)
)

UNDECLARED = edited(shipped()["planar3r-hybrid"], "declared", {})


def test_one_arm_that_the_search_does_not_see_needs_no_bounds() -> None:
    require_sound(msgspec.structs.replace(TUNING, scenario=UNDECLARED, draw=0, unseen=1))
    with pytest.raises(ScenarioError, match="--unseen 2: true arms that are all alike"):
        require_sound(msgspec.structs.replace(TUNING, scenario=UNDECLARED, draw=0, unseen=2))


def test_a_gain_that_moves_is_a_range() -> None:
    assert moved("controller.layer = 0.002:0.05:log") == Axis("controller.layer", (), 0.002, 0.05, True)
    assert moved("target_model.K_m.2=-1:1e3") == Axis("target_model.K_m.2", (), -1.0, 1e3)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("controller.layer", "--move 'controller.layer'; allowed: PATH=LOW:HIGH"),
        ("=1:2", "allowed: PATH=LOW:HIGH"),
        ("controller.layer=0.01", "allowed: PATH=LOW:HIGH"),
        ("controller.layer=1:2:lin", "allowed: PATH=LOW:HIGH"),
        ("controller.layer=1:2:log:3", "allowed: PATH=LOW:HIGH"),
        ("controller.layer=1:2:3", "--move 'controller.layer=1:2:3'; allowed: PATH=LOW:HIGH, with"),
        ("controller.layer=1,2", "--move 'controller.layer=1,2'; allowed: PATH=LOW:HIGH, with"),
        ("controller.layer=nan:2", "--move controller.layer: nan; allowed: finite numbers"),
        ("controller.layer=2:1", "--move controller.layer: 2 to 1; allowed: low before high"),
        ("controller.layer=0:1:log", "--move controller.layer: logarithmic from 0; allowed: from above 0"),
    ],
)
def test_a_gain_that_makes_no_sense_is_refused(text: str, sentence: str) -> None:
    with pytest.raises(ScenarioError) as refused:
        moved(text)
    assert sentence in str(refused.value)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (
            {"scenario": edited(TUNING.scenario, "robot.urdf", "/nonsense.urdf")},
            "/nonsense.urdf",
        ),
        ({"aims": ()}, "--for nothing; allowed: one metric or two"),
        ({"aims": ("force_eror",)}, "--for 'force_eror'; allowed: motion_error, angle_error, force_error"),
        ({"aims": ("force_eror",)}, "did you mean force_error?"),
        ({"aims": ("residual", "residual")}, "allowed: one metric or two different ones"),
        ({"aims": ("residual", "force_error", "motion_error")}, "allowed: one metric or two"),
        (
            {"scenario": shipped()["ur5-motion"]},
            "--for force_error: a run of this scenario in motion mode has none; allowed: motion_error, angle_error",
        ),
        (
            {"scenario": shipped()["planar3r-corner"], "aims": ("motion_error",)},
            "--for motion_error: a run of this scenario in hybrid mode has none; allowed: angle_error, force_error",
        ),
        (
            {"scenario": shipped()["planar2r-semicircle"], "aims": ("angle_error",)},
            "--for angle_error: a run of this scenario in constrained mode has none; allowed: motion_error",
        ),
        (
            {"aims": ("constraint_violation",)},
            "--for constraint_violation: a run of this scenario in hybrid mode has none",
        ),
        ({"vary": ()}, "--move: no gain may move"),
        ({"vary": (moved("controller.layr=1:2"),)}, "controller.layr: no such field"),
        ({"vary": (moved("controller.layer=1:2"),) * 2}, "controller.layer twice"),
        ({"vary": (moved("truth.link_scaling=1:2"),)}, "truth.link_scaling: no gain; allowed: fields of controller"),
        ({"vary": (moved("simulation.duration=1:2"),)}, "simulation.duration: no gain"),
        ({"vary": (moved("controller.d=5:50"),)}, "controller.d has no effect while controller.gain is theorem"),
        (
            {"scenario": UNDECLARED, "draw": 0, "unseen": 32},
            "--unseen 32: true arms that are all alike, since no quantity that is drawn is declared; allowed: a bound "
            "above 0, such as declared.link_scaling, or --unseen 1 without --draw",
        ),
        (
            {"scenario": UNDECLARED, "draw": 1, "unseen": 1},
            "allowed: a bound above 0, such as declared.link_scaling, or",
        ),
        ({"until": 11.0}, "until: 11 s; allowed: at most 10 s, the duration of the runs"),
    ],
)
def test_a_tuning_that_makes_no_sense_is_refused(changes: dict[str, object], sentence: str) -> None:
    with pytest.raises(ScenarioError) as refused:
        require_sound(msgspec.structs.replace(TUNING, **changes))
    assert sentence in str(refused.value)


@pytest.mark.parametrize("draw", [0, 2])
def test_the_arms_that_the_search_does_not_see_are_others_inside_the_declared_set(draw: int) -> None:
    tuning = msgspec.structs.replace(TUNING, draw=draw, unseen=3)
    plan = SweepPlan(tuning)
    truths = [plan.scenario(SweepRow(arm, 0, arm, {})).truth for arm in range(tuning.arms)]
    assert len(set(truths)) == tuning.arms == max(draw, 1) + 3
    assert (truths[0] == tuning.scenario.truth) == (draw == 0)
    other = SweepRow(tuning.arms, 1, 1, {"controller.layer": 0.02})
    assert plan.scenario(other).truth == truths[1]  # the same for every candidate


def test_a_rounded_candidate_stays_within_its_range() -> None:
    low, high = 0.0123456, 0.0123461  # 0.01235, to four digits
    narrow = msgspec.structs.replace(TUNING, vary=(moved(f"controller.layer={low}:{high}"),))
    asked = Search(narrow).ask(range(1, 4))
    assert all(low <= values["controller.layer"] <= high for values in asked.values())


def test_arms_that_the_search_does_not_see_have_noise_of_their_own() -> None:
    tuning = msgspec.structs.replace(TUNING, scenario=edited(TUNING.scenario, "simulation.seed", 7), unseen=3)
    plan = SweepPlan(tuning)
    for point in (0, 3):
        seeds = [
            plan.scenario(SweepRow(point * tuning.arms + arm, point, arm, {})).simulation.seed
            for arm in range(tuning.arms)
        ]
        assert seeds == [7, 7, 8, 9, 10]


def test_a_narrow_range_is_searched_within() -> None:
    narrow = msgspec.structs.replace(TUNING, vary=(moved("controller.K_s=100.01:100.09"),), points=17)
    found = [values["controller.K_s"] for values in Search(narrow).ask(range(1, 9)).values()]
    assert all(100.01 <= float(value) <= 100.09 for value in found)
    assert len(set(found)) == 8
