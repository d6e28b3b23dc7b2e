"""The question of a sweep: which runs it has, and what is refused."""

from __future__ import annotations

import runpy
from pathlib import Path

import msgspec
import numpy as np
import pytest

from app.scenario.data import edited, kind_of, shipped, with_value
from app.scenario.declared_bounds import outside
from app.scenario.departures import Departure
from app.scenario.errors import ScenarioError
from app.scenario.schema import Declared
from app.scenario.units import CARTESIAN
from app.sweep import plan
from app.sweep.axes import Axis, axis_of, fitted
from app.sweep.fingerprint import fingerprint
from app.sweep.plan import Sweep, SweepPlan
from app.sweep.run_metrics import SweepRunner
from app.sweep.run_store import RunStore
from app.tune.plan import Tuning
from controllers.laws.table import LAWS

BASE = shipped()["planar3r-hybrid"]
BARE = msgspec.structs.replace(BASE, declared=Declared(payload_offset=0.1))  # without a payload, no arm differs
ROOT = Path(__file__).parents[2]
BENT = ROOT / "tests" / "support" / "robots" / "bent3r.urdf"


def sweep_of(*vary: str, **fields: object) -> Sweep:
    return msgspec.structs.replace(Sweep(BASE, tuple(map(axis_of, vary))), **fields)


def test_a_grid_has_every_value_with_every_other_one_and_every_arm() -> None:
    asked = SweepPlan(sweep_of("contact.K_e=1e3:1e5:3:log", "controller.law=vsmrc,computed-torque", draw=2))
    rows = [asked.row(number) for number in range(asked.count)]
    assert asked.count == 12
    assert [(row.point, row.arm) for row in rows] == [(k // 2, k % 2) for k in range(12)]
    assert [tuple(row.values.values()) for row in rows[::2]] == [
        (K_e, law) for K_e in (1e3, 1e4, 1e5) for law in ("vsmrc", "computed-torque")
    ]
    scenario = asked.scenario(rows[7])
    assert (scenario.contact.K_e, scenario.controller.law, scenario.name) == (1e4, "computed-torque", BASE.name + "-7")


def test_the_same_arms_at_every_point_within_what_is_declared_and_at_its_corners_on_demand() -> None:
    inside = SweepPlan(sweep_of("controller.layer=0.002:0.03:3", draw=40, seed=7))
    corners = SweepPlan(sweep_of("controller.layer=0.002:0.03:3", draw=40, seed=7, corners=True))
    first = [inside.scenario(inside.row(arm)).truth for arm in range(40)]
    assert [inside.scenario(inside.row(80 + arm)).truth for arm in range(40)] == first
    assert len(set(first)) == 40
    assert (
        SweepPlan(sweep_of("controller.layer=0.002:0.03:3", draw=40, seed=8)).scenario(inside.row(0)).truth not in first
    )
    for asked in (inside, corners):
        assert all(outside(asked.scenario(asked.row(number)), CARTESIAN) == () for number in range(asked.count))
    declared = BASE.declared
    for number in range(40):
        truth = corners.scenario(corners.row(number)).truth
        assert np.abs(np.array(truth.link_scaling) - 1.0) == pytest.approx(np.full(3, declared.link_scaling))
        assert truth.payload_mass == pytest.approx(declared.payload_mass)
    scaling = np.array([truth.link_scaling for truth in first])
    assert (np.abs(scaling - 1.0) < 0.9 * declared.link_scaling).any()


def test_half_of_the_quantities_that_are_drawn_lie_at_their_edge() -> None:
    """An edge is where promises break first."""
    drawn = [Departure.inside(np.random.default_rng(seed), 6) for seed in range(400)]
    lengths = np.linalg.norm([each.centres for each in drawn], axis=2)
    for shares in (
        np.abs([each.links for each in drawn]), np.abs([each.rotors for each in drawn]), lengths,
        *(np.array([getattr(each, name) for each in drawn])
          for name in ("payload", "offset", "coulomb", "viscous", "disturbance")),
    ):  # fmt: skip
        assert np.isclose(shares, 1.0).mean() == pytest.approx(0.5, abs=0.1)
        assert shares.max() <= 1.0 + 1e-12


def test_what_is_not_drawn_of_the_truth_stays() -> None:
    pushed = msgspec.structs.replace(BASE, truth=msgspec.structs.replace(BASE.truth, push=(3.0, 0.0, 0.0)))
    asked = SweepPlan(msgspec.structs.replace(sweep_of("controller.K_s=20:80:2", draw=1), scenario=pushed))
    assert asked.scenario(asked.row(0)).truth.push == (3.0, 0.0, 0.0)


@pytest.mark.parametrize("design", ["latin", "sobol"])
def test_a_design_fills_its_ranges_evenly(design: str) -> None:
    asked = SweepPlan(
        sweep_of("contact.K_e=1e3:1e5:log", "controller.K_s=20:80", "controller.law=vsmrc,pd-gravity",
                 design=design, points=64, seed=3)
    )  # fmt: skip
    values = [asked.values_at(point) for point in range(64)]
    K_e, K_s = (np.array([float(each[path]) for each in values]) for path in ("contact.K_e", "controller.K_s"))
    for fractions in ((np.log10(K_e) - 3.0) / 2.0, (K_s - 20.0) / 60.0):
        assert (fractions >= 0.0).all()
        assert (fractions <= 1.0).all()
        assert np.histogram(fractions, 8, (0.0, 1.0))[0].tolist() == [8] * 8
    assert [each["controller.law"] for each in values].count("vsmrc") == 32
    assert asked.values_at(5) == SweepPlan(asked.sweep).values_at(5)


def test_entries_of_a_list_are_varied(tmp_path: Path) -> None:
    impedance = shipped()["ur5-impedance"]
    asked = SweepPlan(
        msgspec.structs.replace(sweep_of(), scenario=impedance, vary=(axis_of("target_model.K_m.2=1:3:3"),))
    )
    before, after = impedance.target_model.K_m, asked.scenario(asked.row(1)).target_model.K_m
    assert isinstance(before, tuple)
    assert after == (before[0], 2.0, *before[2:])
    matrix = edited(impedance, "target_model.K_m", (100.0 * np.eye(6)).tolist())
    assert np.array(with_value(matrix, "target_model.K_m.2.3", 7.0).target_model.K_m)[1, 2] == 7.0
    (tmp_path / plan.FILE).write_text(plan.to_toml(asked.sweep))
    assert plan.read(tmp_path / plan.FILE) == asked.sweep


def test_a_section_that_is_of_a_varied_kind_already_keeps_its_fields() -> None:
    base = edited(shipped()["ur5-motion"], "motion.radius", 0.123)
    asked = SweepPlan(msgspec.structs.replace(sweep_of("motion=circle,line"), scenario=base))
    assert asked.scenario(asked.row(0)).motion == base.motion
    assert kind_of(asked.scenario(asked.row(1)).motion) == "line"


def test_a_stated_bound_is_as_good_as_another_one_for_the_scenario_s_own_arm() -> None:
    stated = edited(BASE, "declared.delta_C", "speed")
    asked = SweepPlan(msgspec.structs.replace(sweep_of("contact.K_e=1e3:2e3:3"), scenario=stated))
    assert asked.scenario(asked.row(0)).declared == stated.declared
    with pytest.raises(ScenarioError) as refused:  # which are drawn always: those that its search does not see
        SweepPlan(Tuning(stated, (Axis("controller.layer", (), 0.002, 0.05),), points=4, aims=("force_error",)))
    assert str(refused.value).startswith("tuning: declared.delta_C is stated, and only its run shows")
    assert str(refused.value).endswith("such as declared.link_scaling")


def test_a_number_of_a_row_that_there_is_not_is_refused() -> None:
    asked = SweepPlan(sweep_of("contact.K_e=1e3:1e5:3:log"))
    with pytest.raises(ScenarioError, match="row 3; allowed: 0 to 2"):
        asked.row(3)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("contact.K_e", "allowed: PATH=LOW:HIGH:COUNT"),
        ("contact.K_e=", "allowed: PATH=LOW:HIGH:COUNT"),
        ("contact.K_e=1:2:3:4", "allowed: PATH=LOW:HIGH:COUNT"),
        ("contact.K_e=1:two:3", "allowed: PATH=LOW:HIGH:COUNT"),
        ("contact.K_e=1:2:2.5", "allowed: PATH=LOW:HIGH:COUNT"),
        ("contact.K_e=nan:2:3", "contact.K_e: nan; allowed: finite numbers"),
        ("contact.K_e=1:inf:3", "contact.K_e: inf; allowed: finite numbers"),
        ("contact.K_e=2:1:3", "2 to 1; allowed: low before high"),
        ("contact.K_e=0:1:3:log", "logarithmic from 0; allowed: from above 0"),
        ("contact.K_e=1:2:inf", "allowed: PATH=LOW:HIGH:COUNT"),
        ("contact.K_e=1:2:1", "1 value; allowed: 2 to 100000"),
        ("contact.K_e=1:2:1000000000", "1000000000 values; allowed: 2 to 100000"),
        ("contact.K_e=[1, 2", "allowed"),
    ],
)
def test_an_axis_that_makes_no_sense_is_refused(text: str, sentence: str) -> None:
    if text.endswith("[1, 2"):  # words, which the field refuses in its row
        assert axis_of(text) == Axis("contact.K_e", ("[1", 2))
        return
    with pytest.raises(ScenarioError) as refused:
        axis_of(text)
    assert sentence in str(refused.value)


@pytest.mark.parametrize(
    ("sweep", "sentence"),
    [
        (sweep_of("contact.K_f=1:2:3"), "contact.K_f: no such field"),
        (sweep_of("target_model.K_m.9=1:2:3"), "target_model.K_m.9: no such entry"),
        (sweep_of("contact.K_e=1:2:3", "contact.K_e=3:4:2"), "contact.K_e twice; allowed: each field once"),
        (sweep_of("truth.link_scaling=1:2:3", draw=2), "is drawn for each true arm; allowed: without --draw"),
        (sweep_of("contact.K_e=1:2:3", corners=True), "allowed: with --draw"),
        (
            sweep_of("controller.d=5:50:3"),
            "controller.d has no effect while controller.gain is theorem; allowed: with controller.gain constant, such "
            "as with --set controller.gain=constant",
        ),
        (
            msgspec.structs.replace(sweep_of("contact.M_e=1:2:3"), scenario=shipped()["ur5-hybrid"]),
            "contact.M_e has no effect while contact.kind is elastic; allowed: with contact.kind mass-damper-spring",
        ),
        (
            msgspec.structs.replace(sweep_of("contact.K_e=1:2:3"), scenario=shipped()["ur5-constrained"]),
            "contact.K_e has no effect while contact.kind is rigid; allowed: with contact.kind elastic or "
            "mass-damper-spring, such as with --set contact.kind=elastic",
        ),
        (sweep_of("contact.K_e=1:2"), "contact.K_e is a range; allowed: LOW:HIGH:COUNT"),
        (sweep_of("contact.K_e=1:2:3", points=4), "points: 4 in a grid"),
        (sweep_of("contact.K_e=1:2", design="sobol"), "design: 'sobol' with 0 points, 1 varied field; allowed"),
        (sweep_of(design="latin", points=4), "design: 'latin' with 4 points, 0 varied fields"),
        (sweep_of("contact.K_e=soft,2e4"), "contact.K_e: 'soft'; allowed: a number"),
        (sweep_of("contact.K_e=1e4,soft,2e4"), "contact.K_e: 'soft'; allowed: a number"),
        (sweep_of("contact.K_e=1e4,1e4"), "contact.K_e: 10000.0 twice; allowed: different values"),
        (sweep_of("simulation.seed=9007199254740993,1"), "simulation.seed: 9007199254740993; allowed: at most 9007"),
        (sweep_of("mode=1:2:3"), "mode: 1.0; allowed: text"),
        (sweep_of("contact.K_e=1:2:100000", "controller.K_s=1:2:1000"), "1e+08 runs; allowed: at most 1e+07"),
        (sweep_of("contact.K_e=1:2:3", draw=10**400), "1e+300 runs; allowed: at most 1e+07"),
        (
            msgspec.structs.replace(sweep_of("contact.K_e=1:2:3", draw=2), scenario=BARE),
            "draw: 2 true arms that are all alike, since no quantity that is drawn is declared; allowed: a bound",
        ),
        (
            msgspec.structs.replace(
                sweep_of("contact.K_e=1:2:3", draw=1), scenario=edited(BASE, "declared.delta_C", "speed")
            ),
            "draw: declared.delta_C is stated, and only its run shows whether a true arm is within it; "
            "allowed: in its place bounds of links, payload and friction, such as declared.link_scaling, or the "
            "scenario's own arm, without --draw",
        ),
        (sweep_of("declared.delta_M=0.1:0.2:3", draw=2), "draw: declared.delta_M is stated, and only"),
        (sweep_of("name=a,b"), "vary: name; allowed: fields on which a run depends"),
        (
            sweep_of("motion=circel,line"),
            "motion.kind: 'circel'; allowed: hold, point-to-point, circle, line, own; did",
        ),
        (sweep_of("contact.kind=elastic,elastc"), "contact.kind: 'elastc'; allowed: elastic, free, mass-damper-spring"),
        (
            sweep_of("mode=hybrd"),
            "mode: 'hybrd'; allowed: constrained, hybrid, hybrid-impedance, impedance, motion; did",
        ),
        (
            sweep_of("controller.law=vsmrc,pd-gravty"),
            "controller.law: 'pd-gravty'; allowed: vsmrc, computed-torque, pd",
        ),
        (sweep_of("robot.name=planar3r,ur55"), "robot.name: 'ur55'; allowed: ur5, ur3, ur10, panda, xarm7, z1, planar"),
        (
            sweep_of("task_space.kind=cartesian,joint"),
            "vary: task_space.kind: joint beside cartesian would put m and rad, N and N·m into one column; allowed: "
            "one sweep for each kind, such as with --set task_space.kind=joint",
        ),
        (sweep_of("task_space=joint"), "one sweep for each kind, such as with --set task_space.kind=joint"),
        (sweep_of("contact.K_e=1:2:3", until=99.0), "until: 99 s; allowed: at most 10 s, the duration of the runs"),
        (
            sweep_of("contact.K_e=1:2:3", until=1e-4),
            "until: 0.0001 s; allowed: at least 0.001 s, a control period",
        ),
        (
            sweep_of("motion.period=2:6:3", "motion=circle,line"),
            "vary: motion.period beside motion, of which it is a part; allowed: one of both",
        ),
        (
            sweep_of("truth.link_scaling.2=0.9:1.1:3", "truth.link_scaling=0.8,1.2"),
            "vary: truth.link_scaling.2 beside truth.link_scaling, of which",
        ),
        (
            msgspec.structs.replace(sweep_of(), scenario=edited(BASE, "controller.law", "of_my_own")),
            "controller.law: 'of_my_own'; allowed: vsmrc",
        ),
        (sweep_of("contact.K_e=1:2:3", until=float("nan")), "until: nan s; allowed: at most"),
        (
            sweep_of("simulation.duration=3,2", until=2.5),
            "until: 2.5 s; allowed: at most 2 s, the duration of the runs",
        ),
        (
            sweep_of("simulation.duration=2:3", until=2.5, design="latin", points=3),
            "until: 2.5 s; allowed: at most 2 s, the duration of the runs",
        ),
    ],
)
def test_a_sweep_that_makes_no_sense_is_refused(sweep: Sweep, sentence: str) -> None:
    with pytest.raises(ScenarioError) as refused:
        SweepPlan(sweep)
    assert sentence in str(refused.value)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"vary = 3", "sweep.toml: vary: 3; allowed: a list (`vsmrc sweep` writes this file)"),
        (b"scenario = {", "not a TOML file"),
        (b"a." * 400 + b"b = 1", "line 1 has 400 dots; allowed: at most 300"),
        (b"name = '\xff'", "sweep.toml: not a TOML file: it is no UTF-8 text; allowed: a text in UTF-8"),
        (
            b"[scenario]\nmode = 'levitation'",
            "scenario.mode: 'levitation'; allowed: constrained, hybrid, hybrid-impedance",
        ),
    ],
)
def test_a_file_that_is_no_sweep_is_refused(content: bytes, sentence: str, tmp_path: Path) -> None:
    (tmp_path / "sweep.toml").write_bytes(content)
    with pytest.raises(ScenarioError) as refused:
        plan.read(tmp_path / "sweep.toml")
    assert sentence in str(refused.value)


def test_a_field_of_whole_numbers_takes_whole_steps_and_ranges_and_no_others() -> None:
    steps = fitted(axis_of("simulation.substeps=1:4:4"), BASE)
    assert steps.values == (1, 2, 3, 4)
    assert all(type(value) is int for value in steps.values)
    with pytest.raises(ScenarioError, match=r"simulation\.substeps: 1\.5; allowed: whole numbers"):
        fitted(axis_of("simulation.substeps=1:4:7"), BASE)
    within = fitted(axis_of("simulation.substeps=1:4"), BASE)
    asked = SweepPlan(Sweep(BASE, (within,), "sobol", points=16))
    found = [asked.scenario(asked.row(number)).simulation.substeps for number in range(16)]
    assert [found.count(each) for each in (1, 2, 3, 4)] == [4, 4, 4, 4]  # the ends as often as what is between
    assert fitted(axis_of("simulation.substeps=1,2.0,3"), BASE).values == (1, 2, 3)
    with pytest.raises(ScenarioError, match=r"simulation\.substeps: 0\.5; allowed: whole numbers"):
        fitted(axis_of("simulation.substeps=0.5:2.5"), BASE)
    for text in ("contact.K_e=1:4:4", "controller.law=vsmrc", "mode=1:2:3", "contact.K=1:2:2"):
        assert fitted(axis_of(text), BASE) == axis_of(text)


def test_an_entry_of_a_matrix_that_is_drawn_is_not_varied() -> None:
    centres = with_value(BASE, "truth.link_centre", [[0.0] * 3] * 3)
    varied = Sweep(centres, (axis_of("truth.link_centre.1.1=0.0,0.1"),), draw=2)
    with pytest.raises(ScenarioError, match="is drawn for each true arm"):
        SweepPlan(varied)


def test_the_constant_gain_is_varied_where_it_is_chosen() -> None:
    constant = edited(BASE, "controller.gain", "constant")
    assert SweepPlan(sweep_of("controller.d=5:50:3", scenario=constant)).count == 3
    assert SweepPlan(sweep_of("controller.d=5:50:3", "controller.gain=theorem,constant")).count == 6


def test_a_law_that_was_added_to_the_program_is_swept_over_its_own_parameters(monkeypatch: pytest.MonkeyPatch) -> None:
    """docs/extending.md: the law in plain numpy with Pinocchio, and not with the compiled engine."""
    law = runpy.run_path(str(ROOT / "docs" / "examples" / "pid_gravity.py"))["LAW"]
    monkeypatch.setitem(LAWS, law.kind, law)
    scenario = edited(edited(shipped()["ur5-impedance"], "controller.law", law.kind), "simulation.duration", 0.05)
    asked = sweep_of(f"controller.own.{law.kind}.k_i=200:5000:2", scenario=scenario, engine="pinocchio")
    few, many = (SweepRunner(asked).metrics(number) for number in range(2))
    assert few["stopped"] is many["stopped"] is None
    assert few["residual"] != many["residual"]
    refused = SweepRunner(msgspec.structs.replace(asked, engine="compiled")).metrics(0)
    assert str(refused["stopped"]).endswith("is in plain numpy; allowed: --engine pinocchio")


@pytest.mark.parametrize("path", ["truth.payload_mass", "truth.link_scaling.2", "truth"])
def test_a_field_that_is_drawn_is_not_set(path: str) -> None:
    given = {path: {"payload_mass": 1.0} if path == "truth" else 1.0}
    with pytest.raises(
        ScenarioError, match=r"^--set truth\.\S+: it is drawn for each true arm; allowed: without --draw$"
    ):
        plan.require_not_drawn(sweep_of("controller.K_s=20:80:2", draw=2), given)
    plan.require_not_drawn(sweep_of("controller.K_s=20:80:2"), given)
    plan.require_not_drawn(sweep_of(draw=2), {"truth.push": [1.0, 0.0, 0.0], "truth": {"push_start": 1.0}})


def whole_time(sweep: Sweep) -> float:
    """Simulated time of all runs of a sweep, s."""
    plan = SweepPlan(sweep)
    return plan.seconds_of(np.arange(plan.count))


def test_the_simulated_time_is_that_of_the_durations_that_are_varied() -> None:
    steps = sweep_of("controller.K_s=20:80:5", "simulation.duration=1,2,6", draw=2)
    assert whole_time(steps) == pytest.approx(5 * 2 * (1.0 + 2.0 + 6.0))
    assert whole_time(msgspec.structs.replace(steps, until=0.5)) == pytest.approx(30 * 0.5)
    asked = SweepPlan(sweep_of("simulation.duration=1:9:log", design="sobol", points=16))
    lengths = [asked.scenario(asked.row(number)).simulation.duration for number in range(16)]
    assert asked.seconds_of(np.arange(16)) == pytest.approx(sum(lengths))
    assert whole_time(sweep_of("controller.K_s=20:80:2")) == pytest.approx(2 * BASE.simulation.duration)


def test_the_names_of_runs_can_be_read_again() -> None:
    named = msgspec.structs.replace(BASE, name="n" * 199)
    asked = SweepPlan(msgspec.structs.replace(sweep_of("controller.K_s=20:80:2"), scenario=named))
    assert len(asked.scenario(asked.row(1)).name) <= 200


def test_a_question_too_long_to_be_read_again_is_not_written() -> None:
    long = Axis("contact.K_e", tuple(1e3 + k / 7 for k in range(100_000)))
    several = Sweep(BASE, (long, msgspec.structs.replace(long, path="controller.K_s")), "sobol", points=4)
    with pytest.raises(ScenarioError, match="MB of values; allowed: 4 MB"):
        plan.to_toml(several)


def test_arms_may_be_drawn_within_a_bound_that_is_varied_and_one_arm_without_any() -> None:
    for sweep in (sweep_of("declared.link_scaling=0.0,0.1", draw=2), sweep_of("controller.K_s=20:80:2", draw=1)):
        assert SweepPlan(msgspec.structs.replace(sweep, scenario=BARE)).count in (4, 2)


def test_another_file_of_the_arm_is_another_program(tmp_path: Path) -> None:
    own, varied, out = tmp_path / "own.urdf", tmp_path / "varied.urdf", tmp_path / "out"
    own.write_bytes(BENT.read_bytes())
    given = with_value(BASE, "robot.urdf", str(own))
    asked = msgspec.structs.replace(sweep_of(), scenario=given, vary=(Axis("robot.urdf", (str(varied), str(own))),))
    before = msgspec.structs.replace(asked, program=fingerprint(asked))
    with RunStore(out, before):
        pass
    seen = {fingerprint(), before.program}
    varied.write_bytes(BENT.read_bytes())  # there was none
    seen.add(fingerprint(asked))
    own.write_bytes(BENT.read_bytes() + b"\n")
    seen.add(fingerprint(asked))
    assert len(seen) == 4
    with pytest.raises(ScenarioError, match=r"another version of the program or with another file as robot\.urdf"):
        RunStore(out, msgspec.structs.replace(asked, program=fingerprint(asked)))
