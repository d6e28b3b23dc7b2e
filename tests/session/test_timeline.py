"""Looking back, forking and editing: what is shown again is what has been, to the last bit."""

import numpy as np
import pytest

from app.analysis.metrics import metrics_of
from app.scenario.data import differences, edited, shipped
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.session.changes import in_mode
from app.session.timeline import Timeline
from app.simulation.closed_loop import ClosedLoop
from app.simulation.recording import BLOCK
from environments.push import Grip
from tests.support.timelines import line_of, run

pytestmark = pytest.mark.slow  # long or many simulations


def q_of(line: Timeline) -> np.ndarray:
    return line.loop.view().q


@pytest.mark.parametrize("t", [0.0, 0.001, 0.25, 0.333, 0.699, 0.7, 0.701, 1.1])
def test_the_past_is_shown_as_it_was(noisy: Timeline, t: float) -> None:
    line = noisy
    line.seek(t)
    assert line.loop.t == pytest.approx(t, abs=1e-9)
    recorded = line.recording.at(t + 1e-6)
    np.testing.assert_array_equal(q_of(line), recorded["q"])
    assert line.loop.system.scenario.force.value == (35.0 if t >= 0.7 else 20.0)
    assert line.end == pytest.approx(1.2)


def test_what_is_shown_again_is_the_recording_and_then_the_run_goes_on(noisy: Timeline) -> None:
    line, rows = noisy, noisy.recording.rows()
    line.seek(0.5)
    for k in range(500, 1200):
        np.testing.assert_array_equal(q_of(line), rows[k, line.recording.columns["q"]])
        line.step()
    assert line.loop.t == line.end
    run(line, 100)
    assert line.end == pytest.approx(1.3)
    np.testing.assert_array_equal(line.recording.rows()[:1200], rows)


@pytest.mark.parametrize("t", [0.03, 0.07, 0.29, 0.47])
def test_a_contact_that_is_lost_and_met_again_is_so_when_looked_back_at(t: float) -> None:
    """A tool on a rigid surface that only pushes is pulled off it for a tenth of a second: forked before, within and
    after, the run is the same to the last bit."""
    scenario = edited(edited(shipped()["ur5-constrained"], "simulation.leaving_domain", "flag"), "motion", "hold")
    for path, value in {"push": [0.0, 0.0, 60.0], "push_start": 0.05, "push_duration": 0.1}.items():
        scenario = edited(scenario, f"truth.{path}", value)
    line = run(line_of(scenario), 600)
    rows, pressed = line.recording.rows(), line.recording.signals(("multiplier",))["multiplier"].ravel()
    lost = np.flatnonzero(pressed == 0.0)
    assert 50 <= lost[0] < lost[-1] < 500
    assert pressed[-1] > 0.0
    line.seek(t)
    line.fork()
    np.testing.assert_array_equal(run(line, 600 - round(1e3 * t)).recording.rows(), rows)


def test_a_fork_without_a_change_becomes_the_same_run_again() -> None:
    line = run(line_of(shipped()["planar3r-hybrid"]), 1000)
    rows = line.recording.rows()
    line.seek(0.4)
    line.fork()
    assert line.end == pytest.approx(0.4)
    assert len(line.recording) == 400
    np.testing.assert_array_equal(run(line, 600).recording.rows(), rows)
    np.testing.assert_array_equal(line.pinned[0].recording.rows(), rows)


def test_an_edit_of_the_past_forks_and_pins_what_was(noisy: Timeline) -> None:
    line, rows = noisy, noisy.recording.rows()
    line.seek(0.3)
    assert line.edit(edited(line.loop.system.scenario, "force.value", 10.0))
    run(line, 300)
    assert line.end == pytest.approx(0.6)
    assert line.recording.at(0.59)["F_cd"][0] == 10.0
    np.testing.assert_array_equal(line.recording.rows(t_to=0.2995), rows[:300])
    np.testing.assert_array_equal(line.pinned[0].recording.rows(), rows)
    assert line.pinned[0].scenario.force.value == 35.0
    assert [(epoch.t, epoch.scenario.force.value) for epoch in line.recording.epochs] == [(0.0, 20.0), (0.3, 10.0)]
    line.seek(0.1)
    assert line.loop.system.scenario.force.value == 20.0


@pytest.mark.parametrize("t", [0.0, 0.7])
@pytest.mark.parametrize("how", ["fork", "edit", "plan"])
def test_a_fork_at_a_change_is_in_the_epoch_that_begins_there(noisy: Timeline, t: float, how: str) -> None:
    line, then = noisy, noisy.recording.epochs[1 if t else 0]
    line.seek(t)
    before = line.loop.system.scenario
    match how:
        case "fork":
            line.fork()
        case "edit":
            assert line.edit(edited(before, "force.value", 10.0))
        case "plan":  # a blend to come is no epoch yet, but the epoch knows it
            assert line.edit(edited(before, "blend", {"to": {"B_m": [900.0] * 6}, "at": t + 0.5, "over": 1.0}))
            assert line.recording.epochs[-1].model_at(t + 2.0).B_m[0, 0] == 900.0
            assert line.pinned[-1].recording.epochs[1 if t else 0].blend is None
    assert line.first == 0.0
    assert line.end == pytest.approx(t)
    run(line, 100)
    last = line.recording.epochs[-1]
    assert last.t == then.t
    assert last.scenario == (then.scenario if how == "fork" else line.loop.system.scenario)
    assert last.certificate == line.loop.certificate
    line.seek(line.first)
    line.to_end()


@pytest.mark.parametrize("delay", [0.0, 0.006])
def test_a_look_back_computes_few_periods_and_the_states_take_little_room(
    delay: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However short the periods are, and however many readings are on their way in a state: 600 with this delay."""
    scenario = edited(edited(shipped()["planar2r-semicircle"], "controller.period", 1e-5), "sensor.delay", delay)
    line, computed, advance = run(line_of(scenario), 4000), [0], ClosedLoop.advance

    def counted(loop: ClosedLoop) -> None:
        computed[0] += 1
        advance(loop)

    monkeypatch.setattr(ClosedLoop, "advance", counted)
    for back in (1, 240, 1999):
        computed[0] = 0
        line.seek(line.end - back * 1e-5)
        assert computed[0] <= (600 if delay else 250)
        np.testing.assert_array_equal(q_of(line), line.recording.at(line.loop.t + 1e-8)["q"])
    assert sum(len(key.state.reader.memory) for key in line._keyframes) <= 4000 + 600
    assert 4000 / len(line._keyframes) > 200


def test_changes_of_one_instant_take_no_more_room_than_one(noisy: Timeline) -> None:
    keys = len(noisy._keyframes)
    for value in range(50):
        noisy.edit(edited(noisy.loop.system.scenario, "force.value", 20.0 + value))
        noisy.drag_tool(Grip((0.5, 0.0, 1e-3 * value)))
    assert len(noisy._keyframes) <= keys + 1


def test_an_edit_of_a_run_that_has_stopped_begins_anew_and_pins_it() -> None:
    line = run(line_of(edited(shipped()["ur5-constrained"], "force.value", -5.0)), 50)
    stopped, rows = line.loop.stopped, line.recording.rows()
    assert "contact lost" in (stopped or "")
    assert line.edit(edited(line.loop.system.scenario, "force.value", 20.0))
    assert line.end == 0.0
    assert line.loop.stopped is None
    np.testing.assert_array_equal(line.pinned[0].recording.rows(), rows)


def test_a_refused_edit_of_the_past_changes_nothing(noisy: Timeline) -> None:
    line, rows = noisy, noisy.recording.rows()
    line.seek(0.3)
    with pytest.raises(ScenarioError, match="M_m"):
        line.edit(edited(line.loop.system.scenario, "target_model.M_m", (0.0,) * 6))
    assert line.loop.t == pytest.approx(0.3)
    assert line.pinned == ()
    np.testing.assert_array_equal(run(line, 1000).recording.rows()[:1200], rows)


def test_an_edit_that_begins_anew_leaves_the_past(noisy: Timeline) -> None:
    noisy.seek(0.3)
    assert noisy.edit(shipped()["planar2r-semicircle"])
    assert (noisy.first, noisy.end, len(noisy.pinned)) == (0.0, 0.0, 1)


def test_the_end_is_returned_to(noisy: Timeline) -> None:
    q = q_of(noisy)
    noisy.seek(0.2)
    noisy.to_end()
    np.testing.assert_array_equal(q_of(noisy), q)
    noisy.seek(noisy.end)
    np.testing.assert_array_equal(q_of(noisy), q)


@pytest.mark.parametrize("t", [-0.1, 1.3, float("nan"), float("inf")])
def test_what_is_not_known_is_refused(noisy: Timeline, t: float) -> None:
    with pytest.raises(ScenarioError, match=r"time: .* allowed: 0 to 1.2 s"):
        noisy.seek(t)


def test_the_way_to_a_stop_is_shown_again() -> None:
    scenario = edited(shipped()["ur5-hybrid"], "truth.disturbance", 200.0)
    line = run(line_of(edited(scenario, "simulation.bound_violation", "stop")), 3000)
    reason = line.loop.stopped
    assert reason is not None
    assert "the arm diverges" in reason
    line.seek(max(line.end - 0.05, 0.0))
    assert line.loop.stopped is None
    run(line, 200)
    assert (line.loop.stopped, line.loop.t) == (reason, line.end)


def test_a_branch_shares_full_blocks_and_goes_on_by_itself() -> None:
    line = run(line_of(shipped()["planar2r-semicircle"]), BLOCK + 100)
    whole = line.recording.rows()
    twin = line.recording.branch(0.0, whole[BLOCK + 49, 0])
    np.testing.assert_array_equal(twin.rows(), whole[: BLOCK + 50])
    twin.new_row().view(float)[:] = 7.0
    twin.commit()
    np.testing.assert_array_equal(line.recording.rows(), whole)
    assert np.shares_memory(twin._blocks[0].rows, line.recording._blocks[0].rows)


def test_differences_of_scenarios() -> None:
    one = shipped()["ur5-hybrid"]
    other = edited(edited(one, "controller.K_s", 30.0), "motion", {"kind": "hold"})
    found = differences(one, other)
    assert found["controller.K_s"] == (one.controller.K_s, 30.0)
    assert found["motion.kind"] == ("circle", "hold")
    assert found["motion.radius"][1] is None
    assert differences(one, one) == {}


def test_a_run_that_is_begun_anew_is_the_one_that_begins_so(shifted: Scenario) -> None:
    """A moved target has moved from t = 0 on, a blend is still to come, and bounds are those of what runs."""
    model = {"K_m": [0.0, 6000.0, 5000.0, 5000.0, 5000.0, 5000.0]}
    line = run(line_of(shipped()["ur5-hybrid"]), 300)
    line.edit(shifted)
    pressing = edited(edited(shifted, "force.value", 35.0), "controller.K_e_hat", 2000.0)
    line.edit(pressing)
    line.edit(edited(pressing, "blend", {"to": model, "at": 0.4, "over": 0.4}))
    run(line, 300)
    assert line.loop.blending
    scenario = line.loop.system.scenario
    line.reset()
    again, fresh = run(line, 900), run(line_of(scenario), 900)
    assert again.loop.stopped is None
    np.testing.assert_array_equal(again.recording.rows(), fresh.recording.rows())
    assert again.loop.system.scenario == fresh.loop.system.scenario != scenario  # the blend is over


@pytest.fixture
def shifted() -> Scenario:
    return edited(shipped()["ur5-hybrid"], "shift.by", [0.03, 0.0])


@pytest.mark.parametrize("path_and_value", [("mode", "motion"), ("force.value", 30.0)])
def test_what_is_changed_while_looking_back_is_recorded_as_long_as_any_run(path_and_value: tuple[str, object]) -> None:
    path, value = path_and_value
    line = run(line_of(shipped()["planar2r-semicircle" if path == "force.value" else "ur5-hybrid"]), 300)
    history = line.recording.history
    line.seek(0.1)
    scenario = line.loop.system.scenario
    line.edit(in_mode(scenario, "motion") if path == "mode" else edited(scenario, path, value))
    assert line.recording.history == history
    line.reset()
    assert line.recording.history == history


def test_estimates_along_the_reference_are_a_block_at_a_time_and_the_same_again(noisy: Timeline) -> None:
    scenario = edited(noisy.loop.system.scenario, "controller.estimates", "along-reference")
    line = run(line_of(scenario), 700)
    calls = []
    posture = line.loop.system.posture_at
    assert line.loop.controlled_arm.along is not None
    assert len(line.loop.controlled_arm.along._block) == 20
    line.loop.controlled_arm.along._posture = lambda q, t: calls.append(t) or posture(q, t)
    run(line, 100)
    assert len(calls) <= 120  # one for each period, not from the beginning
    before = line.recording.rows()
    line.seek(0.33)
    run(line, 200)
    back = line.loop.recording.rows()
    known = before[np.searchsorted(before[:, 0], back[0, 0] - 1e-9) :][: len(back)]
    assert np.array_equal(back, known)
    line.to_end()
    edit = edited(line.loop.system.scenario, "force.value", 25.0)
    line.edit(edit)
    assert line.loop.controlled_arm.along.start.k == 800  # and an edit goes on from there
    run(line, 50)
    twin = ClosedLoop.from_state(line.loop.state.copy(), previous=line.loop.system)
    for _ in range(50):
        line.step()
        twin.step()
    assert np.array_equal(line.recording.rows(0.8505), twin.recording.rows(0.8505))


def test_a_contact_that_is_changed_pushes_as_it_is_now(noisy: Timeline) -> None:
    force = noisy.loop.view().force
    noisy.edit(edited(noisy.loop.system.scenario, "contact.K_e", 5000.0))
    np.testing.assert_allclose(noisy.loop.view().force, 0.5 * force, rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "path", "value"),
    [("ur5-corner-coupled", "coupling.K_e", (-1500.0, 0.0, 0.0)), ("panda-align", "face.K_t", 30.0)],
)
def test_a_contact_whose_surroundings_are_changed_pushes_as_it_is_now(name: str, path: str, value: object) -> None:
    line = run(line_of(shipped()[name]), 60)
    line.edit(edited(line.loop.system.scenario, path, value))
    arm = line.loop.state.arm.copy()
    before = arm.views.load.wrench.copy()
    line.loop.system.plant.find_load(arm, line.loop.t)
    np.testing.assert_array_equal(arm.views.load.wrench, before)


def test_live_numbers_are_those_of_the_estimates_in_use() -> None:
    line = run(line_of(edited(shipped()["ur5-hybrid"], "controller.estimates", "along-reference")), 100)
    live = line.loop.view().live
    line.step()
    last = line.recording.at(line.end)
    assert live["d_required"] == last["d_required"][0]
    assert live["s_norm"] == last["s_norm"][0]


def test_a_blend_takes_nothing_from_what_was_flagged_or_reached() -> None:
    limited = edited(edited(shipped()["ur5-hybrid"], "truth.torque_limit", 0.1), "controller.on_change", "watch")
    to = {"to": {"B_m": [900.0] + [400.0] * 5}, "at": 0.2, "over": 0.1}
    plain, blended = (run(line_of(scenario), 500).loop for scenario in (limited, edited(limited, "blend", to)))
    assert "saturates" in (plain.warning or "")
    assert blended.warning == plain.warning
    assert len(blended.recording.epochs) > len(plain.recording.epochs) == 1
    figures = metrics_of(plain), metrics_of(blended)
    assert figures[0].reaching_time == figures[1].reaching_time
    assert figures[0].reaching_time_bound == figures[1].reaching_time_bound > 0.0
