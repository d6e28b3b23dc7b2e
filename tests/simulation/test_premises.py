"""What is promised of a run, on which premises, and what is said when one fails."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

from app.cli.commands import execute
from app.cli.status import BROKEN, DONE, UNPROMISED
from app.dashboard.widgets.theorem.premise_table import premises_html
from app.scenario.caption import promised
from app.scenario.data import edited, shipped
from app.scenario.errors import ScenarioError
from app.scenario.units import CARTESIAN
from app.session.headless_run import simulate
from app.session.snapshot import snapshot_of
from app.simulation.closed_loop import ClosedLoop
from app.simulation.compiled_run import CompiledRun
from app.simulation.promise.verdict import sentence
from controllers.control_law import ControlLaw
from controllers.laws.table import LAWS
from controllers.posture_check import periods_between_checks
from controllers.premise_statements import STATEMENTS
from controllers.premises import Premise, PremiseTable, judge
from tests.support.arms import random_spd
from tests.support.cases import short

pytestmark = pytest.mark.slow  # long or many simulations


@pytest.mark.parametrize(
    ("premise", "name", "fields"),
    [
        ("law", "ur5-hybrid", {"controller__law": "computed-torque"}),
        ("declared", "ur5-hybrid", {"truth__link_scaling": 1.16}),
        (
            "domain",
            "ur5-motion",
            {"simulation__domain_radius": 0.0005, "truth__push": [0, 0, 300], "truth__push_start": 0},
        ),
        ("drives", "ur5-motion", {"truth__torque_limit": 0.1}),
        (
            "joints",
            "panda-hybrid",
            {
                "robot__posture": [0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 2.89],
                "rotation": {"kind": "line", "displacement": [0.0, 0.0, 0.2], "period": 0.6, "ramp": 0.0},
            },
        ),
        ("gain", "ur5-hybrid", {"controller__gain": "constant", "controller__d": 11.0}),
        ("held", "ur5-hybrid", {"sensor__delay": 0.004, "controller__epsilon": 0.2}),
        ("layer", "ur5-motion", {"controller__layer": 0.001}),
        ("sampled_loop", "ur5-motion", {"controller__layer": 0.001}),
        ("force_loop", "ur5-constrained", {"target_model__M_m": [1.5, 10, 10, 10, 10, 10]}),
    ],
)
def test_each_premise_that_fails_ends_the_promise(premise: str, name: str, fields: dict[str, object]) -> None:
    loop, metrics = simulate(short(name, **fields))
    finding = next(finding for finding in metrics.premises if finding.premise == premise)
    assert finding.failed is not None
    assert finding.margin is not None
    assert finding.margin < 0.0
    assert metrics.promise.verdict == "nothing promised"
    assert metrics.promise.share < 1.0
    row = loop.recording.at(finding.failed + 1e-6)
    assert math.isnan(row["s_bound"][0])
    assert math.isnan(row["s_band"][0])
    shown = premises_html(snapshot_of(loop))
    assert STATEMENTS[Premise[premise.upper()]].title in shown
    assert f"k_r′ = {loop.system.constants.k_r_low:.3g} kg" in shown
    assert "with a margin of 2 %" in shown


@pytest.mark.parametrize("name", ["ur5-hybrid", "ur5-motion", "planar3r-hybrid", "panda-hybrid", "ur5-hybrid-reaching"])
def test_shipped_runs_hold_with_all_premises(name: str) -> None:
    loop, metrics = simulate(short(name))
    assert metrics.promise.verdict == "holds"
    assert metrics.promise.share == 1.0
    assert all(finding.holds and finding.failed is None for finding in metrics.premises)
    assert metrics.envelope_violation == 0.0
    rows = loop.recording.signals(("s_norm", "s_bound", "s_band", "V_band"))
    assert np.isfinite(rows["s_band"]).all()


def test_what_must_be_below_its_limit_fails_at_it() -> None:
    """At a factor of 1 a loop does not come to rest; a gain that is just what (17) requires is enough."""
    table, most = PremiseTable.fresh(), np.full(len(Premise), 2.0)
    table = table._replace(value=most.copy(), limit=most.copy())
    assert not judge.py_func(table, 0.5)
    failing = {premise for premise in Premise if table.failing[premise]}
    assert failing == {premise for premise, statement in STATEMENTS.items() if statement.sign == "<"}


def test_the_sampled_loop_that_is_unstable_is_said_with_ways_that_the_law_has() -> None:
    mine = ControlLaw("mine", "mine", "mine", torque=lambda _given, _out: None, told=("force",))
    ways = {
        law: sentence(Premise.SAMPLED_LOOP, 1.5, 1.0, CARTESIAN, law).partition("choose a shorter control period")[2]
        for law in (*LAWS.values(), mine)
    }
    assert ways == {
        LAWS["vsmrc"]: ", a smaller delay of the sensor, a softer target model, or smaller K_s and F_1",
        LAWS["computed-torque"]: ", a smaller delay of the sensor, or a softer target model",
        LAWS["pd-gravity"]: ", or a softer target model",
        mine: ", a smaller delay of the sensor, or smaller gains",
    }


def test_a_verdict_before_the_first_period_has_the_numbers_of_the_law_in_force() -> None:
    weak = edited(edited(short("ur5-motion"), "controller.gain", "constant"), "controller.d", 0.5)
    begun, changed = ClosedLoop.from_scenario(weak), ClosedLoop.from_scenario(short("ur5-motion"))
    for _ in range(10):
        changed.advance()
    changed.edit(weak)
    for loop in (begun, changed):
        found = re.search(r"the gain d = (\S+) N is below the (\S+) N that \(17\) requires", loop.standing.now.because)
        assert found is not None
        assert float(found[1]) == 0.5 < float(found[2])


def test_the_promise_begins_anew_when_the_premise_holds_again() -> None:
    """A drive that is too weak for a moment; then V_0 is that of the instant when it is strong enough again."""
    loop = ClosedLoop.from_scenario(short("ur5-hybrid"))
    weak = edited(loop.system.scenario, "truth.link_scaling", 1.3)
    for _ in range(50):
        loop.step()
    loop.edit(weak)
    for _ in range(50):
        loop.step()
    assert loop.standing.now.verdict == "nothing promised"
    assert "outside the declared set" in loop.standing.now.because
    loop.edit(short("ur5-hybrid"))
    for _ in range(50):
        loop.step()
    assert loop.standing.now.verdict == "holds"
    assert loop.standing.now.since == pytest.approx(0.1, abs=0.002)
    assert loop.standing.run.verdict == "nothing promised"
    assert 0.6 < loop.standing.run.share < 0.7


def test_the_band_falls_no_faster_than_the_theorem_while_a_push_makes_it_be_found_anew_in_every_period() -> None:
    """The gain of a discontinuous law, and with it the band, follows a push that swings by 0.75 N in a period."""
    push = {"truth__push": [40.0, 0.0, 0.0], "truth__push_frequency": 3.0, "truth__push_start": 0.0}
    loop, _ = simulate(short("ur5-impedance", controller__switching="discontinuous", **push))
    V_band = loop.recording.signals(("V_band",))["V_band"]
    changes = np.diff(V_band)
    found_anew = (changes[1:] != 0.0) & (changes[:-1] != 0.0)  # then the period before was looked at, too
    falls = (V_band[2:] / V_band[1:-1])[found_anew & (changes[1:] < 0.0)]
    c_1 = loop.state.evaluation.views.promise_record.reaching.c_1
    assert len(falls) > 20
    assert falls.min() >= math.exp(-c_1 * loop.period) * (1.0 - 1e-12)


def test_the_band_does_not_grow_with_the_gain_that_it_bounds() -> None:
    """While s is reached d is a quarter above what it is at rest; the band keeps to H and the layer."""
    loop, _ = simulate(short("ur5-hybrid-reaching"))
    rows = loop.recording.signals(("d", "s_band"))
    assert rows["d"].max() > 1.25 * rows["d"].min()
    assert rows["s_band"].max() < 1.05 * rows["s_band"].min()
    check = loop.state.evaluation.part("posture_check")
    assert rows["s_band"][-1] == pytest.approx(0.01 * math.sqrt(check.H_max / check.H_min), rel=0.05)


def test_chattering_raises_d_but_not_the_band() -> None:
    """Under the discontinuous law the band is T d, with the d of the sliding surface."""
    scenario = short("ur5-motion-discontinuous", controller__bounds="paper", controller__period=0.0005)
    loop, metrics = simulate(scenario)
    rows = loop.recording.signals(("d", "s_band"), t_from=0.1)
    assert np.ptp(rows["d"]) > 0.05 * rows["d"].mean()
    assert np.isfinite(rows["s_band"]).all()
    assert np.abs(np.diff(rows["s_band"])).max() < 0.02 * rows["s_band"].mean()
    assert metrics.promise.verdict == "holds"


def test_a_promise_from_far_begins_where_s_is() -> None:
    """s is away from zero, under a premise that fails at first: what is promised later begins from the s of then."""
    loop = ClosedLoop.from_scenario(short("ur5-hybrid-reaching", truth__link_scaling=1.3))
    for _ in range(20):
        loop.step()
    assert math.isnan(loop.promise_record.bound)
    loop.edit(short("ur5-hybrid-reaching", controller__on_change="watch"))
    for _ in range(2):
        loop.step()
    s = float(loop.recording.at(loop.t)["s_norm"][0])
    assert s > 3.0 * loop.promise_record.band
    assert loop.promise_record.bound > s
    assert loop.standing.now.verdict == "holds"


def test_a_promise_that_a_weak_drive_has_ended_begins_anew_where_s_is() -> None:
    """Without an edit: a drive is too weak on the way from far, until s is nearly in its band."""
    loop = ClosedLoop.from_scenario(short("ur5-hybrid-reaching", truth__torque_limit=[36.0] * 6))
    CompiledRun(loop).advance(400)
    rows = loop.recording.stretch()
    promised = np.isfinite(rows["s_bound"])
    (anew,) = np.flatnonzero(promised[1:] & ~promised[:-1]) + 1
    assert promised[0]
    assert rows["s_bound"][anew] > rows["s_norm"][anew] > rows["s_band"][anew]
    assert loop.standing.now.verdict == "holds"


def test_a_run_that_diverges_promises_nothing() -> None:
    """The runaway of (7) at 4 ms is refused before it starts; at a constant gain the same arm may run, unpromised."""
    fields = {"declared__link_scaling": 0.3, "truth__link_scaling": 1.3, "controller__period": 0.004}
    with pytest.raises(
        ScenarioError, match=r"controller\.bounds: with 'paper' .* runs away .* controller\.period <= 0\.0"
    ):
        ClosedLoop.from_scenario(short("ur5-motion", controller__bounds="paper", **fields))
    thin = {"controller__gain": "constant", "controller__d": 2000.0}
    loop, metrics = simulate(short("ur5-motion", **thin, **fields))
    assert metrics.promise.verdict == "nothing promised"
    assert loop.standing.now.verdict == "nothing promised"


def test_a_caption_says_what_was_promised() -> None:
    names = ("s_norm", "s_bound", "s_band")
    loop = ClosedLoop.from_scenario(short("ur5-hybrid"))
    for _ in range(50):
        loop.step()
    assert promised(loop.recording.signals(names)).endswith("holds throughout.")
    loop.edit(short("ur5-hybrid", truth__link_scaling=1.3))
    for _ in range(150):
        loop.step()
    assert "holds in 25 % of the time" in promised(loop.recording.signals(names))
    assert promised(loop.recording.signals(names, t_from=0.06)) == "Theorem 1 promises nothing here."
    one = np.ones(3)
    assert "is broken" in promised({"s_norm": 3 * one, "s_bound": one, "s_band": one})


def test_strict_tells_by_its_status(tmp_path: Path) -> None:
    run = ["run", "planar3r-hybrid", "--duration", "0.1", "--out", str(tmp_path), "--strict"]
    assert execute(run) == DONE
    promise = json.loads((tmp_path / "metrics.json").read_text())["promise"]
    assert promise["verdict"] == "holds"
    assert execute([*run, "--set", "truth.link_scaling=1.3"]) == UNPROMISED
    figures = json.loads((tmp_path / "metrics.json").read_text())
    assert figures["promise"]["verdict"] == "nothing promised"
    assert [finding["premise"] for finding in figures["premises"] if finding["failed"] is not None] == ["declared"]
    assert BROKEN == 4
    assert UNPROMISED == 5


def test_the_band_is_what_one_period_of_the_worst_perturbation_leaves() -> None:
    """(b) to (d) of docs/theory.md on s -> s - T H^-1 (K_s s + d sigma(s) - p), with p always where it does most."""
    random, T, systems = np.random.default_rng(0), 1e-3, 40
    H = np.array([random_spd(random, 4, 1.0, 20.0) for _ in range(systems)])
    K_s, d = random.uniform(20.0, 150.0, systems), random.uniform(5.0, 40.0, systems)
    layer = 10 ** random.uniform(-3.0, -1.5, systems)
    low, high = np.linalg.eigvalsh(H)[:, [0, -1]].T
    chatter = T * d / (low - 0.5 * T * K_s)
    heaviest = np.where(chatter > 0.5 * layer, np.maximum(high, 4.0 * low), high)
    band, Y = np.sqrt(heaviest / low) * np.maximum(layer, chatter), np.linalg.inv(H)
    s, worst = np.zeros((systems, 4)), np.zeros(systems)
    for _ in range(3000):
        Hs = np.einsum("nij,nj->ni", H, s)
        directions = np.concatenate([random.standard_normal((systems, 8, 4)), np.stack([Hs, s, -s], axis=1)], axis=1)
        directions += 1e-12
        p = 0.9 * d[:, None, None] * directions / np.linalg.norm(directions, axis=2, keepdims=True)
        held = (K_s + d / np.maximum(np.linalg.norm(s, axis=1), layer))[:, None] * s
        candidates = s[:, None] - T * (held[:, None] - p) @ Y
        levels = np.einsum("nki,nij,nkj->nk", candidates, H, candidates) + 1e-3 * np.square(candidates).sum(axis=2)
        s = candidates[np.arange(systems), levels.argmax(axis=1)]
        worst = np.maximum(worst, np.linalg.norm(s, axis=1))
    assert (worst <= band).all()


def test_the_band_counts_with_d_on_the_sliding_surface_not_with_the_present_one() -> None:
    """The same arm at the same place, with the rates that make s zero, asks for nearly twice the gain of now."""
    loop = ClosedLoop.from_scenario(short("ur5-hybrid-reaching", controller__switching="discontinuous"))
    now = loop.controlled_arm.evaluated()
    loop.state.arm.views.q_dot[:] -= now.part("seen").task.J_q_inv @ now.part("output").s
    on_surface = loop.controlled_arm.evaluated().part("output")
    assert np.linalg.norm(on_surface.s) < 1e-12
    assert on_surface.d > 1.8 * now.part("output").d
    assert loop.state.evaluation.part("posture_check").d == pytest.approx(
        on_surface.d, rel=0.05
    )  # chattering adds, Coriolis takes


def test_a_period_counts_once_however_often_the_loop_through_the_multiplier_asks_for_the_law() -> None:
    loop, metrics = simulate(short("ur5-constrained", sensor__ideal=True))
    assert loop.promise_record.periods == len(loop.recording.signals(("t",))["t"])
    assert metrics.promise.verdict == "holds"
    assert loop.recording.epochs[-1].layer_reached == loop.promise_record.layer_reached
    held = loop.recording.signals(("held_error",), t_from=0.002)["held_error"]
    assert held.min() > 1e-4  # from period to period, not from one iteration to the next
    assert held.max() < 0.1


def test_a_law_that_was_swapped_while_the_run_stood_is_judged_with_the_next_period() -> None:
    loop = ClosedLoop.from_scenario(edited(short("ur5-motion"), "controller.law", "computed-torque"))
    for _ in range(5):
        loop.step()
    assert "law" in loop.standing.now.because
    loop.edit(edited(loop.system.scenario, "controller.law", "vsmrc"))
    waiting = loop.standing
    assert (waiting.now.verdict, waiting.reason) == ("nothing promised", "judged in the next control period")
    assert "law is not" not in waiting.now.because
    loop.step()
    assert loop.standing.now.verdict == "holds"


def test_a_run_that_goes_on_beyond_its_duration_says_why_it_leaves_omega() -> None:
    """Omega surrounds the path of the run's duration, as of a run of a map that the page opens."""
    loop = ClosedLoop.from_scenario(edited(shipped()["ur5-hybrid"], "simulation.duration", 1.0))
    CompiledRun(loop).advance(1000)
    assert loop.warning is None
    CompiledRun(loop).advance(2000)
    longer = "for the first 1 s of the path; a path that goes on to other places needs a scenario with a longer"
    assert longer in str(loop.warning)
    whole = ClosedLoop.from_scenario(shipped()["ur5-hybrid"])
    CompiledRun(whole).advance(3000)
    assert whole.warning is None


def test_before_the_first_period_nothing_is_promised() -> None:
    sound = ClosedLoop.from_scenario(short("ur5-hybrid")).standing
    found = (sound.now.verdict, sound.now.because)
    assert found == ("nothing promised", "the run is judged in the next control period")
    assert (sound.run.verdict, sound.run.because) == ("nothing promised", "no control period has been computed")
    assert all(finding.holds for finding in sound.findings)
    for fields, reason in (
        ({"controller__law": "computed-torque"}, "the law is not the robust one"),
        ({"truth__link_scaling": 1.3}, "the true arm is outside the declared set"),
    ):
        standing = ClosedLoop.from_scenario(short("ur5-hybrid", **fields)).standing
        assert reason in standing.now.because
        assert [finding.holds for finding in standing.findings].count(False) == 1


def test_a_layer_that_is_too_thin_leaves_no_promised_instant_and_one_that_is_mended_has_one() -> None:
    loop = ClosedLoop.from_scenario(short("ur5-motion", controller__layer=0.001))
    assert loop.state.epoch.band_reached_by is None
    loop.advance()
    loop.edit(edited(loop.system.scenario, "controller.layer", 0.01))
    assert loop.state.epoch.band_reached_by is not None
    loop.edit(edited(loop.system.scenario, "controller.layer", 0.001))
    assert loop.state.epoch.band_reached_by is None


def test_without_a_layer_the_robust_terms_have_a_limit_too() -> None:
    """From λ_min(K_s) T = ½ λ_min(H) on a period takes less from V than (19) counts on, docs/theory.md, section 2."""
    given = {"controller__switching": "discontinuous", "controller__gain": "constant", "controller__d": 50.0}
    check = ClosedLoop.from_scenario(short("ur5-motion", **given)).state.evaluation.part("posture_check")
    limit = 0.5 * check.H_min / 1e-3
    for factor, holds in ((0.98, True), (1.02, False)):
        loop = ClosedLoop.from_scenario(short("ur5-motion", **given, controller__K_s=[factor * limit] * 6))
        table, check = loop.state.evaluation.part("table"), loop.state.evaluation.part("posture_check")
        assert bool(table.failing[Premise.LAYER]) is not holds
        assert np.isfinite(check.radius) == holds


def test_a_stated_bound_without_a_value_is_kept_by_no_arm_that_errs() -> None:
    """The formula is tried up to simulation.duration; later it is the root of a negative number."""
    loop = ClosedLoop.from_scenario(short("ur5-motion", declared__delta_f="1 + sqrt(0.31 - t)", truth__disturbance=0.5))
    CompiledRun(loop).advance(300)
    assert loop.standing.run.verdict == "holds"
    CompiledRun(loop).advance(100)
    table = loop.state.evaluation.part("table")
    assert table.failed[Premise.DECLARED] == pytest.approx(0.311, abs=0.0015)
    assert "‖f̃‖ = 0.5 N·m > declared 0 N·m" in loop.standing.now.because


def test_a_long_control_period_does_not_space_out_the_looks() -> None:
    assert [periods_between_checks.py_func(T) for T in (2e-4, 1e-3, 4e-3, 0.05)] == [40, 40, 10, 1]


def test_an_edit_promises_nothing_on_surfaces_that_were_not_searched() -> None:
    """A wave that does not come back, for which the constants are known until the run's duration."""
    loop = ClosedLoop.from_scenario(edited(shipped()["ur5-wave"], "simulation.duration", 0.1))
    CompiledRun(loop).advance(150)
    assert loop.standing.now.verdict == "nothing promised"
    loop.edit(edited(loop.system.scenario, "controller.K_s", 90.0))
    assert (loop.state.epoch.band_reached_by, loop.state.epoch.layer_reached_by) == (None, None)
    for _ in range(3):
        loop.step()
    assert np.isnan(loop.recording.signals(("s_bound",))["s_bound"][-3:]).all()
    assert "not known for the surfaces as they are now" in loop.standing.now.because


@pytest.mark.parametrize("compiled", [False, True])
def test_instants_of_a_promise_that_was_lost_before_them_are_promised_no_more(compiled: bool) -> None:
    epochs = []
    for bound in ("2", "0.02 + 2*exp(-100*t)"):  # N·m, soon below the torque that disturbs the joints
        scenario = short("ur5-hybrid-reaching", declared__delta_f=bound, truth__disturbance=1.0)
        loop = ClosedLoop.from_scenario(scenario)
        assert loop.state.epoch.band_reached_by is not None
        assert loop.state.epoch.band_reached_by > 0.02
        if compiled:
            CompiledRun(loop).advance(20)
        else:
            for _ in range(20):
                loop.step()
        epochs.append(loop.state.epoch)
    assert epochs[0].band_reached_by is not None
    assert (epochs[1].band_reached_by, epochs[1].layer_reached_by) == (None, None)
