"""Candidates of a tuning: one with a badge is never offered, whatever its metrics are."""

from __future__ import annotations

import math
from pathlib import Path

import msgspec
import pyarrow.parquet as pq
import pytest

from app.scenario.data import edited
from app.scenario.schema import Scenario
from app.sweep.run_metrics import RunMetrics
from app.tune.candidates import Candidate, candidate_of, front
from app.tune.outcome import FIGURE, TABLE, conclusions, summary_rows, write
from app.tune.running import TuningResult
from environments.trajectories.point_to_point import Hold
from tests.tune.test_plan import TUNING

BOTH = msgspec.structs.replace(TUNING, aims=("force_error", "torque_variation"))
SOUND: RunMetrics = {"force_error": 1.0, "torque_variation": 5.0, "verdict": "holds", "failed": None, "stopped": None}


def candidate(number: int, *aims: float, badge: str = "") -> Candidate:
    return Candidate(number, {}, aims, badge, float(bool(badge)), 1.0)


def test_a_candidate_is_as_good_as_its_worst_arm() -> None:
    found = candidate_of(BOTH, 3, {}, [SOUND, SOUND | {"force_error": 2.0}, SOUND | {"torque_variation": 7.0}])
    assert (found.aims, found.badge, found.broken, found.promised) == ((2.0, 7.0), "", 0.0, 1.0)


@pytest.mark.parametrize(
    ("run", "badge"),
    [
        ({"failed": "held, gain", "verdict": "nothing promised"}, "over its limit: d covers (17)"),
        ({"failed": "layer"}, "over its limit: robust terms, sampled"),
        ({"failed": "force_loop"}, "over its limit: force loop, sampled"),
        ({"failed": "sampled_loop"}, "over its limit: closed loop, sampled"),
        ({"verdict": "broken"}, "the promise was broken"),
        ({"stopped": "t = 0.036 s: contact lost"}, "contact lost"),
        ({"force_error": None}, "no force error"),
    ],
)
def test_one_arm_that_breaks_a_limit_or_stops_gives_a_badge(run: RunMetrics, badge: str) -> None:
    found = candidate_of(BOTH, 3, {}, [SOUND, SOUND | run])
    assert found.badge == f"{badge} (1 of 2 arms)"
    assert found.broken == 0.5
    assert front([found]) == []


def test_the_reason_why_candidates_are_not_offered_is_told_whole() -> None:
    over = candidate_of(BOTH, 1, {}, [SOUND | {"failed": "gain"}])
    own = candidate_of(BOTH, 0, {}, [SOUND])
    found = TuningResult([own, over], {0: own}, {0: [SOUND]})
    assert any("for this reason: over its limit: d covers (17)" in each for each in conclusions(BOTH, found))


def test_a_candidate_that_fails_on_new_arms_is_a_cross_in_the_files_too(tmp_path: Path) -> None:
    own, good, better = (candidate_of(BOTH, n, {}, [SOUND | {"force_error": 1.0 / (n + 1.0)}]) for n in range(3))
    over = candidate_of(BOTH, 2, {}, [SOUND | {"failed": "gain"}])
    runs = {0: [SOUND], 1: [SOUND | {"force_error": 0.5}], 2: [SOUND | {"failed": "gain"}]}
    write(BOTH, TuningResult([own, good, better], {0: own, 1: good, 2: over}, runs), tmp_path)
    rows = pq.read_table(tmp_path / TABLE).to_pylist()
    assert [(row["badge"], row["file"]) for row in rows[:2]] == [("", None), ("", "front/1.toml")]
    assert rows[2]["badge"].startswith("on the test arms, over its limit: d covers (17)")
    assert rows[2]["file"] is None
    assert "A cross: never" in (tmp_path / FIGURE).read_text()


def test_equal_reasons_are_counted_together_and_no_others() -> None:
    """The instant at which a run stops is no part of the reason."""
    late, early = (SOUND | {"stopped": f"t = {t} s: contact lost"} for t in ("0.036", "1.204"))
    over = SOUND | {"failed": "layer"}
    three = candidate_of(BOTH, 1, {}, [over, SOUND, early, over, over])
    assert three.badge == "over its limit: robust terms, sampled (3 of 5 arms, 4 for any reason)"
    assert three.broken == 0.8
    lost = [
        candidate_of(BOTH, number, {}, [SOUND, over, *stops])
        for number, stops in ((2, (early, late)), (3, (late,) * 2))
    ]
    assert [each.badge for each in lost] == ["contact lost (2 of 4 arms, 3 for any reason)"] * 2
    own = candidate_of(BOTH, 0, {}, [SOUND])
    sentences = conclusions(BOTH, TuningResult([own, three, *lost], {0: own}, {0: [SOUND]}))
    assert "3 of 3 candidates are not offered, 2 of them for this reason: contact lost" in sentences


def test_a_premise_that_is_no_limit_gives_no_badge() -> None:
    found = candidate_of(BOTH, 3, {}, [SOUND, SOUND | {"failed": "held", "verdict": "nothing promised"}])
    assert (found.badge, found.promised) == ("", 0.5)


def test_a_front_has_what_nothing_dominates_and_no_badge() -> None:
    good, other, dominated = candidate(1, 1.0, 9.0), candidate(2, 2.0, 3.0), candidate(3, 2.0, 4.0)
    again, broken = candidate(4, 1.0, 9.0), candidate(5, 0.1, 0.1, badge="contact lost")
    assert front([dominated, other, broken, good, again]) == [good, other]
    assert front([candidate(1, 3.0), candidate(2, 2.0), candidate(3, 1.0, badge="no")]) == [candidate(2, 2.0)]
    assert front([candidate(1, math.inf, badge="refused")]) == []


def test_own_gains_are_beaten_where_the_worst_arm_and_most_arms_are_better() -> None:
    def last_sentence(*errors: float) -> str:
        tuning = msgspec.structs.replace(TUNING, unseen=3)
        runs = {0: [SOUND, SOUND, SOUND | {"force_error": 4.0}], 1: [SOUND | {"force_error": each} for each in errors]}
        tried = {number: candidate_of(tuning, number, {}, each) for number, each in runs.items()}
        return conclusions(tuning, TuningResult([tried[0], candidate(1, 0.5)], tried, runs))[-1]

    assert "best.toml better than the own gains" in last_sentence(0.5, 0.5, 3.0)
    assert "the own gains are NOT beaten" in last_sentence(1.0, 1.0, 3.0)  # one arm is no more than chance
    assert "the own gains are NOT beaten" in last_sentence(0.5, 0.5, 5.0)


def test_runs_that_are_too_short_for_metrics_of_their_end_are_said() -> None:
    """The transient is judged then: what is best there may be worse in the long run."""

    def sentences(aims: tuple[str, ...], *times: float | None, of: Scenario = TUNING.scenario) -> list[str]:
        tuning = msgspec.structs.replace(TUNING, aims=aims, scenario=of)
        length = tuning.scenario.simulation.duration
        own = [SOUND | {"settling_time": None if each is None else each * length} for each in times]
        runs = {0: own, 1: [SOUND for _ in times]}
        tried = {number: candidate_of(tuning, number, {}, each) for number, each in runs.items()}
        return [
            each
            for each in conclusions(tuning, TuningResult([tried[0], tried[1]], tried, runs))
            if "last fifth" in each
        ]

    assert sentences(("force_error",), 0.1, 0.3) == []
    (slow,) = sentences(("force_error", "torque_variation"), 0.1, 0.6)
    assert "needs up to" in slow
    assert slow.endswith(
        "own gains. Only the last fifth of a run is judged (force error). Gains that look better there may be worse "
        "later; use longer runs (--duration, on the page *Each run*)"
    )
    assert "does not settle" in sentences(("force_error",), 0.1, None)[0]
    assert sentences(("torque_variation",), 0.6, 0.9) == []
    assert sentences(("motion_error",), 0.1, None) == []  # along a circle the error never comes to rest
    still = msgspec.structs.replace(TUNING.scenario, motion=Hold())
    assert "does not settle" in sentences(("motion_error",), 0.1, None, of=still)[0]
    pushed = msgspec.structs.replace(still, truth=msgspec.structs.replace(still.truth, push_every=2.0))
    assert sentences(("motion_error",), 0.1, None, of=pushed) == []


def test_a_row_of_the_front_that_another_one_beats_on_the_arms_not_seen_is_marked() -> None:
    tuning = msgspec.structs.replace(BOTH, vary=())
    aims = {0: (1.0, 5.0), 1: (0.5, 6.0), 2: (0.6, 5.5), 3: (0.6, 5.7)}  # worst of the test arms
    runs = {n: [SOUND | {"force_error": a, "torque_variation": b}] for n, (a, b) in aims.items()}
    tried = {number: candidate_of(tuning, number, {}, each) for number, each in runs.items()}
    head, *rows = summary_rows(tuning, TuningResult(list(tried.values()), tried, runs))
    assert head[0] == "worst of\n32 test arms"
    assert [row[0] for row in rows] == [
        "own gains", "front/1.toml", "front/2.toml", "front/3.toml\nbeaten by front/2.toml"
    ]  # fmt: skip


def test_own_gains_that_never_come_to_a_metric_are_beaten_by_gains_that_do() -> None:
    timed = msgspec.structs.replace(TUNING, aims=("settling_time",), unseen=2)
    runs = {0: [SOUND | {"settling_time": each} for each in (None, 0.3)], 1: [SOUND | {"settling_time": 0.2}] * 2}
    tried = {number: candidate_of(timed, number, {}, each) for number, each in runs.items()}
    found = TuningResult(list(tried.values()), tried, runs)
    assert conclusions(timed, found)[-1].startswith("settling time: best.toml better than the own gains")
    neither = TuningResult(list(tried.values()), {0: tried[0], 1: tried[0]}, {0: runs[0], 1: runs[0]})
    assert "NOT beaten" in conclusions(timed, neither)[-1]


def test_17_is_no_limit_of_a_law_without_the_gain_d() -> None:
    run = SOUND | {"failed": "law, gain", "verdict": "nothing promised"}
    assert candidate_of(BOTH, 1, {}, [run]).badge == ""
    assert candidate_of(BOTH, 1, {}, [run | {"failed": "law, gain, sampled_loop"}]).badge.startswith(
        "over its limit: closed"
    )


def test_a_test_on_the_arm_of_the_search_is_called_none() -> None:
    """Nothing is declared, so that the drawn arm is the believed one, as the scenario's own may be."""
    same = "the test arm is that of the search, since no quantity that is drawn is declared"
    nothing = f"{same}: nothing was tested"
    own, undeclared = candidate_of(TUNING, 0, {}, [SOUND]), edited(TUNING.scenario, "declared", {})
    believed = edited(undeclared, "truth", {})
    for scenario, told in (
        (believed, True),
        (undeclared, False),  # its own arm is heavier
        (edited(believed, "sensor.noise", 0.1), False),
    ):
        tuning = msgspec.structs.replace(TUNING, scenario=scenario, draw=0, unseen=1)
        assert (nothing in conclusions(tuning, TuningResult([own], {0: own}, {0: [SOUND]}))) == told
