"""Charts of a sweep: what is counted at each point, and where (17) and the declaration end."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import msgspec
import numpy as np
import pytest

from app.scenario.errors import ScenarioError
from app.sweep.axes import Axis, axis_of
from app.sweep.charts import _borders, _fractions, _map, _parallel, _scatter, _slices, chart
from app.sweep.plan import Sweep, SweepPlan
from app.sweep.points import SweepView, interval, points_of, require_metric
from app.sweep.run_metrics import METRIC_COLUMNS
from tests.support.svg import texts_of
from tests.sweep.test_plan import BASE, sweep_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

SWEEP = sweep_of("contact.K_e=1e3:1e5:3:log", "controller.K_s=20:80:2", draw=4)


def columns(sweep: Sweep = SWEEP) -> dict[str, np.ndarray]:
    """Table of a sweep whose force error is 0.1 N times point plus arm; the run 9 stopped, (17) fails for an arm of
    point 4, and the arms of point 5 are outside what is declared. The promise holds but for arm 3,
    for want of (17), at point 1 also of the declaration. The rows are out of order."""
    asked = SweepPlan(sweep)
    rows = [asked.key_columns(asked.row(number)) for number in range(asked.count)]
    for row in rows:
        row |= {
            "force_error": 0.1 * row["point"] + row["arm"],
            "stopped": "contact lost" if row["row"] == 9 else None,
            "gain_margin": -0.3 if (row["point"], row["arm"]) == (4, 2) else 0.5,
            "declared": 0.0 if row["point"] == 5 else 1.0,
            "verdict": "nothing promised" if row["arm"] == 3 else "holds",
            "failed": ("gain, declared" if row["point"] == 1 else "gain") if row["arm"] == 3 else None,
        }
    return {name: np.array([row[name] for row in reversed(rows)]) for name in rows[0]}


def test_a_share_counts_the_arms_within_the_limit_and_not_those_that_stopped() -> None:
    points = points_of(SWEEP, columns(), SweepView("force_error", within=1.25))
    assert points.arms.tolist() == [4] * 6
    assert points.good.tolist() == [2, 2, 1, 1, 1, 1]  # point 2 would have two, but its arm 1 is row 9
    assert points.number.tolist() == [0.5, 0.5, 0.25, 0.25, 0.25, 0.25]
    assert np.flatnonzero(points.stopped).tolist() == [2]
    assert points.theorem.tolist() == [1, 1, 1, 1, 0, 1]
    assert points.declared.tolist() == [1, 1, 1, 1, 1, 0]
    assert points.values["contact.K_e"].tolist() == [1e3, 1e3, 1e4, 1e4, 1e5, 1e5]


def test_the_worst_and_the_median_arm() -> None:
    worst, median = (
        points_of(SWEEP, columns(), SweepView("force_error", statistic=each)) for each in ("worst", "median")
    )
    # the arm that stopped is the worst of its point, whatever its metric
    assert worst.number == pytest.approx([3.0, 3.1, np.nan, 3.3, 3.4, 3.5], nan_ok=True)
    assert np.flatnonzero(worst.never).tolist() == [2]
    assert median.number == pytest.approx([1.5, 1.6, (2.2 + 3.2) / 2, 1.8, 1.9, 2.0])
    assert worst.holding.tolist() == [3] * 6
    margins = points_of(SWEEP, columns(), SweepView("gain_margin", statistic="worst"))
    assert margins.number == pytest.approx(
        [0.5, 0.5, np.nan, 0.5, -0.3, 0.5], nan_ok=True
    )  # of a margin the least is the worst


def test_arms_that_never_settle_are_worse_than_any_that_do() -> None:
    arm = columns()["arm"]
    some = columns() | {"settling_time": np.where(arm == 0, np.inf, np.where(arm == 1, np.nan, 0.5))}
    worst = points_of(SWEEP, some, SweepView("settling_time"))
    assert worst.never.all()
    assert np.isnan(worst.number).all()
    few = columns() | {"settling_time": np.where(arm == 3, np.nan, 0.1 * arm)}
    median = points_of(SWEEP, few, SweepView("settling_time", statistic="median"))
    assert median.number == pytest.approx([0.15, 0.15, np.nan, 0.15, 0.15, 0.15], nan_ok=True)  # of 0, 0.1, 0.2, never
    assert np.flatnonzero(median.never).tolist() == [2]  # of 0, stopped, 0.2, never
    none = points_of(SWEEP, columns() | {"settling_time": np.full(24, np.nan)}, SweepView("settling_time"))
    assert np.isnan(none.number).all()
    assert not none.never.any()


def test_a_refused_run_is_the_worst_also_of_a_metric_that_a_stopped_run_has() -> None:
    table = columns()
    refused = (table["point"] == 0) & (table["arm"] > 1)
    table |= {
        "stopped": np.where(refused, "refused", table["stopped"]),
        "promised_share": np.where(refused, np.nan, 0.1 * (1 + table["arm"])),
    }
    worst, median = (
        points_of(SWEEP, table, SweepView("promised_share", statistic=each)) for each in ("worst", "median")
    )
    # what the run 9 had when it stopped counts
    assert worst.number == pytest.approx([np.nan, 0.1, 0.1, 0.1, 0.1, 0.1], nan_ok=True)
    assert np.flatnonzero(worst.never).tolist() == np.flatnonzero(median.never).tolist() == [0]


def test_a_run_that_stopped_keeps_a_limit_of_a_metric_that_it_has() -> None:
    table = columns() | {"promised_share": np.where(columns()["point"] == 3, np.nan, 1.0)}
    table["stopped"] = np.where(table["point"] == 3, "refused", table["stopped"])
    # all arms of point 2, of which one stopped, and none of point 3, which were refused
    assert points_of(SWEEP, table, SweepView("promised_share", within=0.9)).good.tolist() == [4, 4, 4, 0, 4, 4]


def test_a_run_without_the_metric_neither_keeps_a_limit_nor_misses_it() -> None:
    table, view = columns(), SweepView("force_error", within=1.25)
    table["force_error"] = np.where(np.isin(table["point"], (0, 2)), np.nan, table["force_error"])  # in 2, one stopped
    points = points_of(SWEEP, table, view)
    assert points.number == pytest.approx([np.nan, 0.5, np.nan, 0.25, 0.25, 0.25], nan_ok=True)
    drawn = texts_of(chart(SWEEP, table, view, "svg"))
    assert sum(text.endswith("/4") for text in drawn) == 4
    assert "White: no run has this metric (1 point)" in " ".join(drawn)
    stopped = np.where(table["point"] > 0, "contact lost", None)
    without = table | {"force_error": np.where(table["point"] > 0, 1.0, np.nan), "stopped": stopped}
    assert np.isnan(points_of(SWEEP, without, view).number).all()
    settling = table | {"settling_time": np.full(24, np.nan)}  # who never settles misses the limit
    assert points_of(SWEEP, settling, SweepView("settling_time", within=1.0)).number.tolist() == [0.0] * 6


def test_a_share_is_of_the_arms_that_have_the_metric() -> None:
    """As the violation of a bound that is promised to some arms only."""
    table = columns() | {"envelope_violation": np.where(columns()["arm"] < 2, np.nan, 0.0)}
    points = points_of(SWEEP, table, SweepView("envelope_violation", within=1e-3))
    assert points.counted.tolist() == [2, 2, 3, 2, 2, 2]  # with the one that stopped
    assert points.good.tolist() == [2] * 6
    assert points.number == pytest.approx([1, 1, 2 / 3, 1, 1, 1])
    drawn = texts_of(chart(SWEEP, table, SweepView("envelope_violation", within=1e-3), "svg"))
    assert drawn.count("2/2") == 5
    assert "In 6 points only some arms have this metric, and they alone count" in " ".join(drawn)


def test_one_run_that_is_not_drawn_is_no_sample() -> None:
    alone, view = sweep_of("contact.K_e=1e3:1e5:3:log"), SweepView("force_error", within=0.15)
    drawn = " ".join(texts_of(chart(alone, columns(alone), view, "svg")))
    assert "force error ≤ 0.15 N" in drawn
    assert "Wilson" not in drawn
    assert "share" not in drawn
    assert "1: the run keeps the limit, 0: it does not" in drawn
    for sweep, bands in ((alone, 0), (sweep_of("contact.K_e=1e3:1e5:3:log", draw=1), 1)):
        canvas = _slices(sweep, list(sweep.vary), points_of(sweep, columns(sweep), view), view)
        assert len(canvas.axes[0].collections) == bands


def test_a_limit_of_a_margin_is_its_least() -> None:
    table = columns() | {"promised_share": np.where(columns()["arm"] == 0, 0.2, 1.0)}
    assert points_of(SWEEP, table, SweepView("promised_share", within=0.9)).good.tolist() == [3] * 6
    drawn = texts_of(chart(SWEEP, table, SweepView("promised_share", within=0.9), "svg"))
    assert "share of arms with promised share ≥ 0.9" in drawn


def test_of_refused_runs_nothing_is_known() -> None:
    refused = columns()["point"] == 0
    table = columns() | {name: np.where(refused, np.nan, columns()[name]) for name in ("declared", "gain_margin")}
    points = points_of(SWEEP, table, SweepView("force_error"))
    assert np.isnan(points.declared[0])
    assert np.isnan(points.theorem[0])
    assert points.declared[1:].tolist() == [1, 1, 1, 1, 0]


def test_values_in_any_order_stay_within_parallel_coordinates() -> None:
    assert _fractions(axis_of("contact.K_e=3e4,1e4,5e4"), np.array([1e4, 3e4, 5e4])).tolist() == [0.0, 0.5, 1.0]


def test_wilsons_interval_of_few_arms() -> None:
    """(p + z²/2n ± z sqrt(p (1 − p)/n + z²/4n²)) / (1 + z²/n), z = 1.96."""
    n, p, z = 8, 0.75, 1.959963984540054
    half = z * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    expected = [(p + z**2 / (2 * n) + sign * half) / (1 + z**2 / n) for sign in (-1.0, 1.0)]
    assert interval(6, 8) == pytest.approx(expected)


def test_borders_run_between_tiles_that_hold_and_tiles_that_do_not() -> None:
    held = np.array([[1.0, 1.0, 0.0], [1.0, 0.0, 0.0]])  # rows from below
    assert _borders(held, np.array([0.0, 1.0, 2.0, 3.0]), np.array([0.0, 10.0, 20.0])) == [
        ([2.0, 2.0], [0.0, 10.0]),
        ([1.0, 1.0], [10.0, 20.0]),
        ([1.0, 2.0], [10.0, 10.0]),
    ]


def test_a_map_writes_counts_names_and_borders() -> None:
    drawn = chart(SWEEP, columns(), SweepView("force_error", within=1.25), "svg")
    assert chart(SWEEP, columns(), SweepView("force_error", within=1.25), "svg") == drawn
    texts = texts_of(drawn)
    counts = sorted(text for text in texts if text.endswith("/4"))
    assert counts == ["1/4"] * 4 + ["2/4"] * 2  # beside the cross, too
    for text in (
        "(17) ends",
        "declared ends",
        "stiffness of the surface [N/m]",
        "share of arms with force error ≤ 1.25 N",
    ):
        assert text in texts
    assert any("4 true arms each, inside the declared set" in text for text in texts)
    assert any("4 of 4 is a share of at least 0.51" in text for text in texts)


def test_other_charts_for_other_sweeps() -> None:
    slices = texts_of(chart(SWEEP, columns(), SweepView("force_error", kind="slices"), "svg"))
    assert "reaching gain K_s 20 N·s/m" in slices
    assert "force error, worst arm [N]" in slices
    scattered = msgspec.structs.replace(
        sweep_of("contact.K_e=1e3:1e5:log", "controller.K_s=20:80", design="sobol", points=8), draw=4
    )
    assert "reaching gain K_s [N·s/m]" in texts_of(
        chart(scattered, columns(scattered), SweepView("force_error"), "svg")
    )
    three = msgspec.structs.replace(SWEEP, vary=(*SWEEP.vary, axis_of("controller.law=vsmrc,pd-gravity")))
    assert {"robust (25)", "PD + gravity", "control law", "stiffness of the surface [N/m]"} <= set(
        texts_of(chart(three, columns(three), SweepView("force_error"), "svg"))
    )


def test_slices_reach_over_all_values_that_are_swept() -> None:
    """Points at the ends that have no value do not end the axis."""
    stiffness = sweep_of("contact.K_e=1e3:1e5:9:log")
    table = columns(stiffness)
    ends = np.isin(table["point"], (0, 1, 7, 8))
    table["settling_time"] = np.where(ends, np.nan, 0.5)
    view = SweepView("settling_time", kind="slices")
    low, high = _slices(stiffness, list(stiffness.vary), points_of(stiffness, table, view), view).axes[0].get_xlim()
    assert 0.5e3 < low < 1e3
    assert 1e5 < high < 2e5


@pytest.mark.parametrize(
    ("view", "order"),
    [
        (SweepView("force_error", statistic="median"), [0, 1, 3, 4, 5, 2]),
        (SweepView("force_error", within=1.25), [0, 1, 2, 3, 4, 5]),
        (SweepView("gain_margin"), [0, 1, 3, 5, 4, 2]),  # of point 2 an arm has stopped
    ],
)
def test_the_worst_lines_are_drawn_over_the_others(view: SweepView, order: list[int]) -> None:
    points = points_of(SWEEP, columns(), view)
    lines = _parallel(SWEEP, list(SWEEP.vary), points, view).axes[0].lines[:6]
    places = np.transpose([_fractions(axis, points.values[axis.path]) for axis in SWEEP.vary]).tolist()
    drawn = [places.index(np.asarray(line.get_ydata()).tolist()) for line in lines]
    assert drawn == order


def test_a_design_over_one_of_its_fields_is_refused() -> None:
    design = sweep_of("contact.K_e=1e3:1e5:log", "controller.K_s=20:80", design="sobol", points=8)
    for view in (
        SweepView("force_error", over=("contact.K_e",)),
        SweepView("force_error", over=("contact.K_e",), kind="slices"),
    ):
        with pytest.raises(ScenarioError, match="design"):
            chart(design, columns(design), view, "svg")


def test_slices_say_which_lines_they_leave_out() -> None:
    many = sweep_of("contact.K_e=1e3:1e5:3:log", "controller.K_s=20:100:9")
    drawn = texts_of(chart(many, columns(many), SweepView("force_error", kind="slices"), "svg"))
    assert "8 of 9 lines" in drawn
    assert {"reaching gain K_s 20 N·s/m", "reaching gain K_s 100 N·s/m"} <= set(drawn)
    assert sum(text.startswith("reaching gain K_s ") and text[18].isdigit() for text in drawn) == 8
    all_of_them = texts_of(chart(SWEEP, columns(), SweepView("force_error", kind="slices"), "svg"))
    assert not any("lines" in text for text in all_of_them)


def test_each_of_the_slices_has_a_name_of_its_own() -> None:
    three = sweep_of("contact.K_e=1e3:1e5:3:log", "controller.K_s=20:80:2", "controller.layer=0.01,0.02")
    view = SweepView("force_error", kind="slices", over=("contact.K_e", "controller.K_s"))
    axes = [axis for axis in three.vary if axis.path in view.over]
    labels = _slices(three, axes, points_of(three, columns(three), view), view).axes[0].get_legend_handles_labels()[1]
    assert len(set(labels)) == len(labels) == 4
    assert all("reaching gain" in label and "boundary layer" in label for label in labels)


def test_a_metric_that_no_run_has_is_refused() -> None:
    table = columns() | {name: np.full(24, np.nan) for name in METRIC_COLUMNS if name != "force_error"}
    require_metric(table, "force_error")
    with pytest.raises(
        ScenarioError, match="--of moment_error: no run of this sweep has it; allowed: force_error; did"
    ):
        require_metric(table, "moment_error")


def test_values_that_the_page_has_rounded_are_even_steps_of_the_logarithm_still() -> None:
    assert axis_of("contact.K_e=5000.0,8891.4,15811.4,28117.1,50000.0").on_log_scale
    assert axis_of("contact.K_e=50000.0,5000.0,15811.4,28117.1,8891.4").on_log_scale  # in whatever order
    assert not axis_of("contact.K_e=5000.0,8900.0,15800.0,28100.0,50000.0").on_log_scale
    assert not axis_of("controller.law=vsmrc,pd-gravity,computed-torque").on_log_scale


LOGARITHMIC = ("contact.K_e=1e3:1e5:3:log", "controller.layer=0.001:0.1:3:log")
RANGES = ("contact.K_e=1e3:1e5:log", "controller.layer=0.001:0.1:log")


@pytest.mark.parametrize(
    ("sweep", "draw"),
    [
        (sweep_of(*LOGARITHMIC), _map),
        (sweep_of(*LOGARITHMIC), _scatter),
        (sweep_of(LOGARITHMIC[0]), _slices),
        (sweep_of(*RANGES, design="sobol", points=8), _scatter),
        (sweep_of(RANGES[0], design="sobol", points=8), _slices),
    ],
)
def test_a_logarithmic_field_has_a_logarithmic_axis_in_every_chart(sweep: Sweep, draw: Callable[..., Canvas]) -> None:
    view = SweepView("force_error")
    plot = draw(sweep, list(sweep.vary), points_of(sweep, columns(sweep), view), view).axes[0]
    assert plot.get_xscale() == "log"
    assert (plot.get_yscale() == "log") == (len(sweep.vary) == 2)
    assert _fractions(sweep.vary[0], np.array([1e4])) == pytest.approx([0.5])


def test_a_metric_that_is_the_same_everywhere_stands_at_the_foot_of_its_scale() -> None:
    table = columns() | {
        "saturated_share": np.zeros(24),
        "settling_time": np.where(columns()["point"] == 0, np.nan, 0.5),
    }
    drawn = chart(SWEEP, table, SweepView("saturated_share"), "svg")
    assert not any(text.startswith("−") for text in texts_of(drawn))  # no negative share
    missing = texts_of(chart(SWEEP, table, SweepView("settling_time"), "svg"))
    assert any("White: no run has this metric (1 point)" in text for text in missing)


@pytest.mark.parametrize(
    ("vary", "view", "sentence"),
    [
        (SWEEP.vary, SweepView("beauty"), "--of 'beauty'; allowed:"),
        (SWEEP.vary, SweepView("force_error", statistic="share"), "allowed: share with --within"),
        (SWEEP.vary, SweepView("force_error", within=1.0, statistic="worst"), "allowed: share with --within"),
        (SWEEP.vary, SweepView("force_error", over=("motion.kind",)), "--over 'motion.kind'; allowed:"),
        (SWEEP.vary, SweepView("force_error", over=("contact.K_e",) * 2), "--over contact.K_e twice; allowed: each"),
        (SWEEP.vary[:1], SweepView("force_error", kind="map"), "a grid of two fields"),
        (SWEEP.vary[:1], SweepView("force_error", kind="scatter"), "two fields of numbers"),
        (
            (*SWEEP.vary, axis_of("controller.layer=0.01,0.02")),
            SweepView("force_error", kind="scatter"),
            "points of other controller.layer would lie below one another",
        ),
        (
            SWEEP.vary[:1],
            SweepView("force_error", kind="parallel"),
            "over contact.K_e alone; allowed: two or more fields",
        ),
        (
            (Axis("controller.law", ("vsmrc", "pd-gravity")),),
            SweepView("force_error", kind="slices"),
            "a field of numbers",
        ),
    ],
)
def test_a_view_that_makes_no_sense_is_refused(vary: tuple[Axis, ...], view: SweepView, sentence: str) -> None:
    sweep = msgspec.structs.replace(SWEEP, vary=vary, scenario=BASE)
    with pytest.raises(ScenarioError) as refused:
        chart(sweep, columns(sweep), view, "svg")
    assert sentence in str(refused.value)


def test_what_stopped_is_marked_in_every_chart_and_runs_that_are_missing_are_told() -> None:
    table = {name: column[columns()["point"] != 3] for name, column in columns().items()}
    for view in (SweepView("force_error", within=1.25), SweepView("force_error", kind="slices")):
        drawn = " ".join(texts_of(chart(SWEEP, table, view, "svg")))
        assert "Only 20 of 24 runs so far." in drawn
        assert "A cross: runs that stopped or were refused (1 point)" in drawn
    parallel = " ".join(texts_of(chart(SWEEP, columns(), SweepView("force_error", kind="parallel"), "svg")))
    assert "Grey: runs that stopped or were refused (1 point)" in parallel
    assert "A cross" not in parallel


def test_a_field_of_words_has_a_chart_without_being_asked_for_one() -> None:
    words = msgspec.structs.replace(SWEEP, vary=(Axis("controller.law", ("vsmrc", "computed-torque")),))
    rows = [SweepPlan(words).key_columns(SweepPlan(words).row(number)) for number in range(8)]
    table = {name: np.resize(column, 8) for name, column in columns().items()}
    table |= {name: np.array([row[name] for row in rows]) for name in rows[0]}
    assert b"<svg" in chart(words, table, SweepView("force_error"), "svg")


def test_two_views_of_a_sweep_have_two_names() -> None:
    views = [
        SweepView("force_error"),
        SweepView("force_error", within=0.5),
        SweepView("force_error", within=1.25),
        SweepView("force_error", statistic="median"),
        SweepView("force_error", kind="parallel"),
        SweepView("force_error", over=("contact.K_e",)),
    ]
    assert views[0].name == "force_error"
    assert views[1].name == "force_error-within-0.5"
    assert len({view.name for view in views}) == len(views)
