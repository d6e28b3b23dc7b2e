"""The picture of the robustness map: its numbers, the ends of what is declared, and the present setting."""

from __future__ import annotations

import re
from itertools import pairwise
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import numpy as np
import pytest
import viser

from app.dashboard.widgets.families.map_tiles import Naming, Present, map_html
from app.dashboard.widgets.families.robustness_map import RobustnessMap, badness
from app.dashboard.widgets.families.swept_fields import FIELDS
from app.scenario.data import edited, load
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.session.changes import in_mode
from app.sweep.background import BackgroundSweep, coarse_first
from app.sweep.plan import Sweep, SweepPlan
from app.sweep.points import SweepView, points_of
from app.sweep.run_metrics import RunMetrics
from tests.support.desks import BareDesk
from tests.sweep.test_charts import columns
from tests.sweep.test_plan import sweep_of

SWEEP = sweep_of("contact.K_e=1e3:1e5:3:log", "controller.K_s=20:80:2", draw=4)
ALONE = sweep_of("contact.K_e=1e3:1e5:3:log", draw=4)
NAMES = {"contact.K_e": ("stiffness <b>", "N/m"), "controller.K_s": ("gain", "N·s/m")}

PREMISES = "true arm inside the declared set, d covers (17)"
NOWHERE: dict[str, float | None] = {}


def picture(
    view: SweepView,
    present: Present = NOWHERE,
    sweep: Sweep = SWEEP,
    table: dict[str, np.ndarray] | None = None,
    **state: Any,
) -> str:
    shown = {"rows": [None] * 24, "going": False, "waiting": False, "problem": ""} | state
    naming = Naming("force error", "mN", 1e3, "" if view.within is None else "<7> mN", NAMES)
    points = points_of(sweep, columns(sweep) if table is None else table, view)
    return map_html(cast(BackgroundSweep, SimpleNamespace(plan=SweepPlan(sweep), **shown)), points, naming, present)


def labels_in(drawn: str) -> list[str]:
    return re.findall(r'data-point="\d+"[^>]* aria-label="(.*?)"', drawn)


def test_tiles_say_their_numbers_in_units_and_the_arms_behind_them() -> None:
    worst = picture(SweepView("force_error"))
    labels = labels_in(worst)
    assert len(labels) == 6
    number = "stiffness &lt;b&gt; 1000 N/m, gain 80 N·s/m: force error 3100 mN, worst of 4 arms"
    assert labels[1] == f"{number}; the promise holds for 3 of 4 arms; not met: {PREMISES}"
    assert labels[2].endswith("a run stopped or was refused")
    assert re.findall(r'data-point="(\d+)"', worst) == ["0", "1", "2", "3", "4", "5"]
    assert "<b>" not in worst
    share = labels_in(picture(SweepView("force_error", within=1.25)))
    kept = "2 of 4 arms keep the limit of &lt;7&gt; mN (95 %: 0.15 to 0.85 of arms drawn like these)"
    assert share[0].endswith(f"{kept}; the promise holds for 3 of 4 arms; not met: d covers (17)")
    wide = columns() | {"force_error": 10.0 ** -columns()["point"]}
    middle = re.findall(r'y="244" text-anchor="middle">(.*?)<', picture(SweepView("force_error"), table=wide))
    assert middle == ["3.16 mN"]  # of 1000 and 0.01: the colours follow the logarithm
    assert 'y="244" text-anchor="middle"' not in worst


def test_tiles_can_be_pressed_without_a_gap() -> None:
    drawn = picture(SweepView("force_error"))
    areas = re.findall(
        r'<rect x="([\d.]+)" y="[\d.]+" width="([\d.]+)" height="[\d.]+" fill="transparent"/></g>', drawn
    )
    assert len(areas) == 6
    columns_of_tiles = sorted({(float(x), float(x) + float(wide)) for x, wide in areas})
    assert all(right == pytest.approx(left, abs=0.02) for (_, right), (left, _) in pairwise(columns_of_tiles))


def test_the_declared_set_ends_between_tiles_and_the_ring_is_at_the_present_setting() -> None:
    drawn = picture(SweepView("force_error"), {"contact.K_e": 1e4, "controller.K_s": 80.0})
    ends = re.search(r'class="vs-ends"[^>]* d="([^"]*)"', drawn)
    assert ends is not None
    assert ends[1].count("M") == 2  # of point 5, at the upper right corner: its left and its lower edge
    ring = re.search(r'class="vs-present" cx="([\d.]+)" cy="([\d.]+)"', drawn)
    assert ring is not None
    assert [float(each) for each in ring.groups()] == [187.0, 55.0]  # middle column, upper row
    between = picture(SweepView("force_error"), {"contact.K_e": 10**3.5, "controller.K_s": 50.0})
    ring = re.search(r'class="vs-present" cx="([\d.]+)" cy="([\d.]+)"', between)
    assert ring is not None
    assert [float(each) for each in ring.groups()] == [139.3, 102.0]  # steps of the logarithm across, even ones up
    for beyond in ({"contact.K_e": 5e5, "controller.K_s": 80.0}, {"contact.K_e": 1e4}):
        assert "vs-present" not in picture(SweepView("force_error"), beyond)
    theorem = re.search(r'class="vs-theorem"[^>]* d="([^"]*)"', drawn)
    assert theorem is not None
    assert theorem[1].count("M") == 2  # of point 4, at the lower right corner: its left and its upper edge


def test_refused_runs_draw_no_boundary_and_missing_metrics_are_reported() -> None:
    refused = columns()["point"] == 0
    unknown = {name: np.where(refused, np.nan, 1.0) for name in ("declared", "gain_margin")}
    drawn = picture(SweepView("settling_time"), table=columns() | unknown | {"settling_time": np.full(24, np.inf)})
    assert 'class="vs-ends"' not in drawn
    assert 'class="vs-theorem"' not in drawn
    assert "force error: no value on some arm" in labels_in(drawn)[0]


CROSS = re.compile(r'<path d="[^"]*" stroke="currentColor"/>')


@pytest.mark.parametrize("view", [SweepView("force_error"), SweepView("force_error", within=1.25)])
@pytest.mark.parametrize("sweep", [SWEEP, ALONE])
def test_of_a_figure_that_no_run_has_there_is_a_sentence_and_no_scale(sweep: Sweep, view: SweepView) -> None:
    table = columns(sweep)
    drawn = picture(view, sweep=sweep, table=table | {"force_error": np.full(len(table["point"]), np.nan)})
    assert ". No run of this scenario has this figure.<" in drawn
    assert not re.search(r"rgb\(|vs-dot-of|vs-interval", drawn)  # a colour, a dot
    beside = re.findall(r'<text x="40" [^>]*>(.*?)<', drawn)
    assert beside == ([] if sweep is ALONE else ["20", "80", "80"])  # only values of a field
    assert 'y="244"' not in drawn
    assert len(CROSS.findall(drawn)) == 1  # of the run that stopped
    ends = [label.rpartition(": ")[2] for label in labels_in(drawn)]
    assert sorted(set(ends)) == ["a run stopped or was refused", "no figure"]
    shown = picture(view, sweep=sweep, table=table)
    assert "No run of this scenario" not in shown
    assert re.search(r"rgb\(|vs-dot-of", shown)
    assert len(CROSS.findall(shown)) == 1


@pytest.mark.parametrize("sweep", [SWEEP, ALONE])
def test_a_cross_is_a_run_that_stopped_and_not_one_that_never_settled(sweep: Sweep) -> None:
    table = columns(sweep)
    table |= {"settling_time": np.where(table["arm"] == 0, np.inf, 1.0)}
    drawn = picture(SweepView("settling_time"), sweep=sweep, table=table)
    assert ". At every setting some arm has no value.<" in drawn
    assert len(CROSS.findall(drawn)) == 1
    assert not re.search(r"rgb\(|vs-dot-of", drawn)
    share = picture(SweepView("settling_time", within=2.0), sweep=sweep, table=table)
    assert "some arm has no value" not in share  # one that never settles does not keep the limit
    assert "3 of 4 arms keep the limit" in labels_in(share)[0]
    never = table | {"settling_time": np.full(len(table["arm"]), np.nan)}
    none = picture(SweepView("settling_time", within=2.0), sweep=sweep, table=never)
    assert "no run of this scenario" not in none
    assert "0 of 4 arms keep the limit" in labels_in(none)[0]


def test_a_tile_opens_the_run_of_its_worst_arm() -> None:
    rows: list[RunMetrics] = [
        {"arm": arm, "promised_share": share, "settling_time": time, "stopped": None}
        for arm, (share, time) in enumerate([(1.0, 0.5), (0.2, None), (0.9, 0.7)])
    ]
    for metric, worst in (("promised_share", 1), ("settling_time", 1)):
        assert max(rows, key=lambda row, metric=metric: badness(row, metric))["arm"] == worst
    rows[0]["stopped"] = "contact lost"
    assert max(rows, key=lambda row: badness(row, "promised_share"))["arm"] == 1  # which a stopped run has, too
    assert max(rows, key=lambda row: badness(row, "settling_time"))["arm"] == 0
    rows[0]["promised_share"] = None  # refused
    assert max(rows, key=lambda row: badness(row, "promised_share"))["arm"] == 0


def test_a_tile_with_a_stopped_run_says_its_number_where_it_has_one() -> None:
    table = columns()
    shares = table | {"promised_share": np.where(table["arm"] == 1, 0.2, 1.0)}
    drawn = labels_in(picture(SweepView("promised_share"), table=shares))
    assert "200 mN, worst of 4 arms; a run stopped or was refused; the promise" in drawn[2]
    assert "stopped" not in drawn[0]
    kept = labels_in(picture(SweepView("force_error", within=1.25)))[2]
    assert "1 of 4 arms keep" in kept
    assert "of arms drawn like these); a run stopped or was refused; the promise" in kept


def test_one_run_that_is_not_drawn_keeps_a_limit_or_does_not() -> None:
    for fields, ends in ((SWEEP.vary, ["limit not kept", "limit kept"]), (ALONE.vary, ["no", "yes", "↑ limit kept"])):
        sweep = msgspec.structs.replace(SWEEP, vary=fields, draw=0)
        drawn = picture(SweepView("force_error", within=0.15), sweep=sweep, rows=[None] * SweepPlan(sweep).count)
        labels = labels_in(drawn)
        kept = sum(": keeps the limit" in label for label in labels)
        assert f"Force error: {kept} of {len(labels)} runs keep the limit of &lt;7&gt; mN. " in drawn
        assert ": keeps the limit of &lt;7&gt; mN" in labels[0]
        assert ": does not keep the limit of &lt;7&gt; mN" in labels[2]
        assert not re.search(r"95 %|vs-interval|share", drawn)
        assert [text for text in re.findall(r"<text [^>]*>(.*?)<", drawn) if re.search("no|yes|kept", text)] == ends


def test_files_of_maps_that_show_different_things_have_different_names(viser_server: viser.ViserServer) -> None:
    page = BareDesk(viser_server, SWEEP.scenario)
    cast(Any, page.desk).export_jobs = None
    robustness, names = RobustnessMap(page.desk), list[str]()
    robustness._delivery = cast(Any, SimpleNamespace(give=lambda _, __, name, ___: names.append(name)))

    def save(sweep: Sweep, chosen: str = "SVG") -> str:
        robustness._work = cast(BackgroundSweep, SimpleNamespace(plan=SweepPlan(sweep), rows=[{"row": 0}]))
        robustness._on_file(cast(Any, SimpleNamespace(target=SimpleNamespace(value=chosen))))
        return names[-1]

    short = msgspec.structs.replace(SWEEP, until=1.5)
    named = "vsmrc-planar3r-hybrid-map-force_error-contact-K_e-controller-K_s-4-arms-1.50s"
    assert save(short) == f"{named}.svg"  # the length of its runs, not the instant of the loop
    assert save(short, "sweep folder") == f"{named}.zip"
    save(msgspec.structs.replace(short, draw=0))
    save(msgspec.structs.replace(short, vary=ALONE.vary))
    robustness._within.value = "0.5"
    save(short)
    robustness._metric.value = "settling time"
    save(short)
    assert len(set(names)) == len(names) == 6


def test_over_one_field_there_is_a_course_with_an_interval_at_each_share() -> None:
    worst = picture(SweepView("force_error"), {"contact.K_e": 1e4}, ALONE)
    assert len(labels_in(worst)) == 3
    assert worst.count("vs-interval") == 0
    assert re.search(r'class="vs-present" d="M 187.0 ', worst)  # in the middle
    share = picture(SweepView("force_error", within=1.25), sweep=ALONE)
    assert (
        "2 of 4 arms keep the limit of &lt;7&gt; mN (95 %: 0.15 to 0.85 of arms drawn like these)"
        in labels_in(share)[0]
    )
    assert share.count("vs-interval") == 3


def test_a_course_ends_at_a_value_of_which_there_is_no_figure_and_begins_anew_behind_it() -> None:
    sweep = sweep_of("contact.K_e=1e3:1e5:5:log", draw=2)
    table = columns(sweep)
    table |= {"stopped": np.full(len(table["point"]), None)}
    broken = table | {"force_error": np.where(table["point"] == 2, np.nan, table["force_error"])}
    counts = [
        [len(line.split(", ")) for line in re.findall(r'class="vs-course" points="(.*?)"', drawn)]
        for drawn in (picture(SweepView("force_error"), sweep=sweep, table=each) for each in (table, broken))
    ]
    assert counts == [[5], [2, 2]]


def test_a_map_that_failed_says_so() -> None:
    assert "its process has ended" in picture(SweepView("force_error"), problem="its process has ended")
    assert "24 of 24 runs" in picture(SweepView("force_error"), going=True)
    waiting = picture(SweepView("force_error"), waiting=True)
    assert "It waits until the maps and searches of other visitors are done" in waiting


@pytest.mark.parametrize(("across", "up"), [(9, 9), (13, 5), (5, 5)])
def test_every_fourth_tile_comes_first_and_each_comes_once(across: int, up: int) -> None:
    vary = (f"contact.K_e=1e3:1e5:{across}:log", f"controller.K_s=20:80:{up}")
    asked = SweepPlan(msgspec.structs.replace(sweep_of(*vary, draw=2)))
    order = coarse_first(asked)
    assert sorted(order) == list(range(asked.count))
    first = order[: 2 * len(range(0, across, 4)) * len(range(0, up, 4))]
    places = np.array([divmod(number // 2, up) for number in first])
    assert (places % 4 == 0).all()


def test_a_field_without_an_effect_is_not_offered_first_and_refused(viser_server: viser.ViserServer) -> None:
    page = BareDesk(viser_server, load("planar2r-semicircle"))
    robustness = RobustnessMap(page.desk)
    robustness.show(page.snapshot())
    chosen = [side.field.path for side in (robustness._across, robustness._up) if side.field]
    assert chosen == ["truth.payload_mass", "truth.link_scaling"]
    robustness._request(page.snapshot())
    robustness._across.choose(next(each for each in FIELDS if each.path == "contact.K_e"))
    with pytest.raises(
        ScenarioError, match="stiffness of the surface: it has no effect while contact is rigid; allowed"
    ):
        robustness._request(page.snapshot())


@pytest.mark.parametrize(
    ("declared", "sentence"),
    [
        (
            {},
            "True arms: 4 of the declared set: they are all alike, since no quantity that is drawn is declared; "
            "allowed: a bound above 0 on the tab Robot, such as that of the links, or the scenario's own",
        ),
        (
            {"delta_C": "speed"},
            "True arms: 4 of the declared set: bound of ‖ΔC‖ (declared) is stated, and only its run shows whether a "
            "true arm is within it; allowed: in its place bounds of links, payload and friction on the tab Robot, or "
            "the scenario's own",
        ),
    ],
)
def test_a_map_that_makes_no_sense_is_refused_in_the_words_of_its_controls(
    declared: dict[str, object], sentence: str, viser_server: viser.ViserServer
) -> None:
    page = BareDesk(viser_server, edited(SWEEP.scenario, "declared", declared))
    robustness = RobustnessMap(page.desk)
    robustness._up.leave()  # the mass of the true links is drawn
    robustness._request(page.snapshot())
    robustness._arms.value = "4 of the declared set"
    with pytest.raises(ScenarioError) as refused:
        robustness._request(page.snapshot())
    assert str(refused.value) == sentence


def test_a_map_beyond_what_its_field_allows_is_refused_and_a_limit_that_is_none_is_said(
    viser_server: viser.ViserServer,
) -> None:
    page = BareDesk(viser_server, SWEEP.scenario)
    robustness = RobustnessMap(page.desk)
    robustness._up.leave()
    robustness._across._range.value = "-5, 100"
    with pytest.raises(ScenarioError, match=r"^stiffness of the surface: -5(\.0)?; allowed: a number >"):
        robustness._request(page.snapshot())
    robustness._within.value = "abc"
    assert robustness._limit == "Limit: 'abc'; allowed: a number"
    assert robustness._view.within is None


@pytest.mark.parametrize(
    ("scenario", "earlier"),
    [
        (edited(SWEEP.scenario, "contact.K_e", 2e4), False),
        (in_mode(SWEEP.scenario, "impedance"), True),
        (edited(SWEEP.scenario, "task_space.characteristic_length", 0.3), True),
    ],
    ids=["a softer surface", "another mode", "other task coordinates"],
)
def test_a_map_of_an_earlier_scenario_says_so(
    viser_server: viser.ViserServer, scenario: Scenario, earlier: bool
) -> None:
    page = BareDesk(viser_server, scenario)
    robustness = RobustnessMap(page.desk)
    robustness._fields = {each.path: each for each in FIELDS}
    work = SimpleNamespace(plan=SweepPlan(SWEEP), rows=[], going=True, waiting=False, problem="")
    drawn = robustness._drawn(cast(BackgroundSweep, work), page.snapshot())
    told = "The map is of an earlier scenario: mode, arm, tool, task coordinates or surfaces were others."
    assert (told in drawn) == earlier
