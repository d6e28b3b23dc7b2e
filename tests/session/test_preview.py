"""What-if previews: the same numbers as the loop, and final values against closed forms."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from app.analysis.metrics import BAND, settling_time
from app.analysis.steady_force import steady_force_error
from app.scenario.data import edited, from_plain, shipped, to_plain
from app.scenario.schema import Scenario
from app.session.preview import LASTS, PreviewRun
from app.session.preview_messages import Preview, PreviewRefusal, PreviewRequest
from app.simulation.closed_loop import ClosedLoop
from app.storage.constants_store import kept_memory
from app.workers.preview import _GrowingBand, _Known
from environments.push import Grip
from tests.support.previews import preview_metrics, running

pytestmark = pytest.mark.slow  # long runs

EDITS: dict[str, object] = {
    "force.value": 33.0,
    "target_model.K_m": None,
    "controller.layer": 0.02,
    "contact.K_e": 3e4,
    "truth.payload_mass": 1.0,
    "sensor.cutoff": 200.0,
    "declared.payload_mass": 1.0,
    "controller.period": 5e-4,
    "surface.motion.amplitude": 0.01,
}


def disturbed() -> Scenario:
    """Everything that has a memory: a noisy, slow, late sensor; reaching; estimates along the reference."""
    data = to_plain(shipped()["ur5-hybrid-reaching"])
    data["sensor"] = {"noise": 0.1, "delay": 0.004, "cutoff": 80.0, "bias": [0.1, 0.0, 0.2]}
    data["controller"]["estimates"] = "along-reference"
    data["truth"] |= {"coulomb": 0.5, "disturbance": 1.0}
    data["declared"] |= {"coulomb": 0.6, "disturbance": 1.2, "force_error": 1.0}
    return from_plain(data)


def foreseen(loop: ClosedLoop, scenario: Scenario, horizon: float) -> np.ndarray:
    preview_run = PreviewRun(PreviewRequest(1, loop.state.copy(), scenario, horizon))
    while preview_run.progress < 1.0:
        preview_run.advance(37)
    return preview_run._loop.recording.rows()


@pytest.mark.parametrize("name", [*shipped(), "disturbed"])
def test_an_unchanged_scenario_goes_on_bit_for_bit(name: str) -> None:
    loop = running(disturbed() if name == "disturbed" else shipped()[name])
    ahead = foreseen(loop, loop.system.scenario, 0.2)
    t = loop.t
    for _ in range(len(ahead)):
        loop.step()
    assert len(ahead) == round(0.2 / loop.system.scenario.controller.period)
    np.testing.assert_array_equal(ahead, loop.recording.rows(t))


@pytest.mark.parametrize("path", EDITS)
@pytest.mark.parametrize("scenario", [shipped()["ur5-hybrid"], disturbed()], ids=["plain", "disturbed"])
def test_an_edit_does_what_it_would_do_in_the_loop(scenario: Scenario, path: str) -> None:
    loop = running(scenario)
    value = [0.0, 3000.0, 3000.0, 3000.0, 3000.0, 3000.0] if EDITS[path] is None else EDITS[path]
    changed = edited(loop.system.scenario, path, value)
    ahead = foreseen(loop, changed, 0.1)
    loop.edit(changed)
    t = loop.t
    for _ in range(len(ahead)):
        loop.step()
    np.testing.assert_array_equal(ahead, loop.recording.rows(t))


def test_a_state_is_not_changed_by_what_goes_on_from_it() -> None:
    loop = running(disturbed())
    state = loop.state.copy()
    first, second = (ClosedLoop.from_state(state, previous=loop.system) for _ in range(2))
    for going in (loop, first, second):
        for _ in range(50):
            going.step()
    np.testing.assert_array_equal(first.recording.rows(), second.recording.rows())
    np.testing.assert_array_equal(first.recording.rows(), loop.recording.rows(state.t))


def test_settling_time_of_an_exponential() -> None:
    t = np.arange(0.0, 10.0, 1e-3)
    tau = 0.4
    signal_ = 3.0 - 2.0 * np.exp(-t / tau)
    assert settling_time(t, signal_, resolution=1e-6) == pytest.approx(-tau * np.log(BAND), abs=1e-3)
    assert settling_time(t, signal_, resolution=2.0) == 0.0
    assert settling_time(t, np.sin(t), resolution=1e-6) == np.inf
    assert settling_time(t[:500], signal_[:500], resolution=1e-6) == np.inf


@pytest.mark.parametrize(("K_m1", "K_e"), [(0.0, 2e4), (1500.0, 2e4), (1500.0, 5e3), (0.0, 1e4)])
def test_final_force_error_is_that_of_37(K_m1: float, K_e: float) -> None:
    loop = running(shipped()["ur5-hybrid"])
    stiffness = [K_m1, 4000.0, 4000.0, 4000.0, 4000.0, 4000.0]
    scenario = edited(edited(loop.system.scenario, "target_model.K_m", stiffness), "contact.K_e", K_e)
    preview_run = PreviewRun(PreviewRequest(1, loop.state.copy(), scenario, 2.0))
    preview_run.advance(10_000)
    preview = preview_run.preview()
    assert isinstance(preview, Preview)
    metrics = preview.metrics
    expected = (1.0 - K_e / (K_m1 + K_e)) * (K_e - 1e4) / 1e4 * 20.0
    assert metrics.force_error_predicted == pytest.approx(expected, abs=1e-9)
    assert metrics.force_error == pytest.approx(expected, abs=0.02)
    assert metrics.left is None
    assert steady_force_error(running(shipped()["ur5-motion"], 1).system, *np.zeros((3, 6))) is None


def test_settling_of_the_force_is_that_of_the_target_model() -> None:
    # the desired force jumps: e obeys M e.. + B e. + K_e e = 0 from rest, critically damped at 31.6 rad/s;
    # (1 + x) exp(-x) = 0.02 at x = 5.834
    known = edited(edited(shipped()["ur5-hybrid"], "truth.link_scaling", 1.0), "motion", "hold")
    loop = running(known, 1500)
    preview_run = PreviewRun(
        PreviewRequest(1, loop.state.copy(), edited(loop.system.scenario, "force.value", 30.0), 2.0)
    )
    preview_run.advance(10_000)
    preview = preview_run.preview()
    assert isinstance(preview, Preview)
    assert preview.metrics.force_settling == pytest.approx(5.834 / np.sqrt(1e4 / 10.0), rel=0.02)
    assert preview.metrics.motion_settling == 0.0
    np.testing.assert_allclose(preview.ahead[[0, -1]], [1e-3, 1.999], rtol=1e-9)


def test_under_impedance_the_path_error_is_that_of_the_plots() -> None:
    loop = running(shipped()["ur5-impedance"], 3000)
    preview_run = PreviewRun(PreviewRequest(0, loop.state.copy(), loop.system.scenario, 1.0))
    preview_run.advance(1000)
    preview = preview_run.preview()
    assert isinstance(preview, Preview)
    drawn = np.linalg.norm(preview.signals["e_r"][:, :3], axis=1)
    assert drawn[-1] > 5e-3  # the wall holds it off its path
    assert preview.metrics.motion_error == pytest.approx(drawn[preview.ahead > 0.8].max(), rel=1e-3)


def test_a_tool_that_is_twisted_shows_its_angle_error() -> None:
    """At the end of a long twist the springs K_m of the angles hold it: M / (l^2 K_m)."""
    scenario = edited(edited(shipped()["ur5-impedance-6d"], "motion", "hold"), "truth.push", [0.0, 0.0, 0.0])
    scenario = edited(edited(scenario, "truth.push_start", 0.0), "truth.push_moment", [0.0, 0.0, 0.5])
    loop = running(edited(scenario, "truth.push_duration", 20.0))
    metrics = preview_metrics(PreviewRequest(1, loop.state.copy(), loop.system.scenario, 3.0))
    expected = 0.5 / (loop.system.layout.l**2 * 1500.0)
    assert (metrics.angle_largest, metrics.angle_error) == (pytest.approx(expected, rel=1e-3),) * 2


@pytest.mark.parametrize(
    ("scenario", "path", "angle"),
    [("ur5-hybrid", True, False), ("panda-elbow", True, True), ("planar3r-corner", False, True)],
)
def test_only_errors_of_what_is_free_are_told(scenario: str, path: bool, angle: bool) -> None:
    state = running(shipped()[scenario], 5).state.copy()
    metrics = preview_metrics(PreviewRequest(1, state, state.scenario, 0.05, push=30.0))
    assert all((error is not None) == path for error in (metrics.motion_largest, metrics.motion_error))
    assert all((error is not None) == angle for error in (metrics.angle_largest, metrics.angle_error))


@pytest.mark.parametrize("push", [0.0, 20.0])
def test_metrics_of_the_running_scenario_count_until_the_run_goes_another_way(push: float) -> None:
    free = edited(edited(shipped()["ur5-impedance"], "contact.kind", "free"), "truth.push", [0.0, 0.0, 0.0])
    known_arm = edited(free, "truth.link_scaling", 1.0)  # stands still from the beginning
    scenario = edited(known_arm, "motion", "hold") if push else free
    loop = ClosedLoop.from_scenario(scenario)
    preview_run = PreviewRun(PreviewRequest(1, loop.state.copy(), scenario, 1.0, push=push))
    while preview_run.progress < 1.0:
        preview_run.advance(100)
    assert preview_run._push == push
    preview, memory = preview_run.preview(), kept_memory()
    assert isinstance(preview, Preview)
    known = _Known(memory, _GrowingBand(memory), running=preview_run)

    def count() -> bool:
        """Whether metrics are known; they are those of the seconds from now on."""
        request = PreviewRequest(2, loop.state.copy(), loop.system.scenario, 1.0, push=push)
        if (metrics := known.metrics_for(request)) is None:
            return False
        anew = msgspec.structs.asdict(preview_metrics(request))
        for figure, value in msgspec.structs.asdict(metrics).items():
            expected = anew[figure]
            assert value == (pytest.approx(expected, rel=1e-6) if isinstance(expected, float) else expected), figure
        return True

    def go_on(seconds: float) -> None:
        for _ in range(round(seconds / loop.period)):
            loop.step()

    def back_at_an_edit() -> None:
        loop.edit(edited(scenario, "controller.layer", 0.02))
        loop.edit(scenario)

    assert count()
    go_on(0.4)
    assert count()
    loop.reset()
    go_on(0.2)
    assert count()  # the same run once more
    x, y, z = loop.view().tool
    loop.drag_tool(Grip((x, y + 0.1, z), stiffness=3000.0, limit=200.0))
    assert not count()
    go_on(0.2)
    loop.drag_tool(None)
    assert not count()
    loop.reset()
    go_on(0.4)
    assert count()
    back_at_an_edit()
    assert not count()
    loop.reset()
    go_on(1.5)
    assert not count()  # beyond what was foreseen


def test_an_edit_that_restarts_is_compared_with_a_restart_of_the_running_scenario() -> None:
    """The transient of the start must not be read as the slider's effect."""
    loop = running(shipped()["ur5-hybrid"], 1500)
    state, scenario = loop.state.copy(), loop.system.scenario
    preview_run = PreviewRun(PreviewRequest(1, state, edited(scenario, "task_space.characteristic_length", 0.2), 0.3))
    while preview_run.progress < 1.0:
        preview_run.advance(100)
    running_now = PreviewRun(preview_run.unchanged, preview_run.base)
    today, preview = running_now.metrics_from(state), preview_run.preview()  # as the process asks first
    begun = ClosedLoop.from_scenario(scenario).state
    assert today == preview_metrics(PreviewRequest(1, begun, scenario, 0.3))
    assert isinstance(preview, Preview)
    assert today is not None
    assert preview.metrics.motion_largest == pytest.approx(today.motion_largest, rel=0.1)
    assert today.motion_largest > 10.0 * preview_metrics(PreviewRequest(1, state, scenario, 0.3)).motion_largest
    # what is known of the restart answers the next question of its kind, also from a later state
    known = _Known(memory := kept_memory(), _GrowingBand(memory), running=running_now)
    assert known.metrics_for(preview_run.unchanged) == today
    loop.step()
    later = replace(preview_run.request, state=loop.state.copy())
    assert known.metrics_for(PreviewRun(later, preview_run.base).unchanged) == today
    assert known.metrics_for(replace(later, scenario=scenario)) is None  # 1.5 s ahead nothing is foreseen


@pytest.mark.parametrize("periods", [1, 2, 3, 1000])
def test_a_horizon_of_any_length_is_answered(periods: int) -> None:
    loop = running(shipped()["planar2r-semicircle"], 5)
    period = loop.system.scenario.controller.period
    preview_run = PreviewRun(PreviewRequest(1, loop.state.copy(), loop.system.scenario, periods * period))
    preview_run.advance(periods)
    preview = preview_run.preview()
    assert isinstance(preview, Preview)
    assert preview.whole
    assert preview.metrics.span == pytest.approx(periods * period)
    assert preview.ahead[-1] == pytest.approx((periods - 1) * period)


def test_a_preview_of_a_run_that_stops_in_its_first_period_says_why() -> None:
    loop = running(shipped()["ur5-hybrid"])
    preview_run = PreviewRun(PreviewRequest(1, loop.state.copy(), loop.system.scenario, 1.0))
    preview_run.advance(1)
    preview_run._loop.fail("the arm", ArithmeticError("torn"))
    refused = preview_run.preview()
    assert isinstance(refused, PreviewRefusal)
    assert refused.sentence.startswith("nothing lies ahead: ")
    assert "torn" in refused.sentence


def test_leaving_the_domain_is_said() -> None:
    loop = running(shipped()["ur5-hybrid"])
    weak = edited(edited(loop.system.scenario, "controller.gain", "constant"), "controller.d", 1.0)
    preview_run = PreviewRun(PreviewRequest(1, loop.state.copy(), edited(weak, "truth.payload_mass", 20.0), 1.0))
    preview_run.advance(10_000)
    preview = preview_run.preview()
    assert isinstance(preview, Preview)
    assert preview.metrics.gain_margin < 0.0
    assert preview.metrics.left is not None
    assert preview.metrics.left.startswith("t = ")


def test_the_compiled_engine_foresees_the_same() -> None:
    for name in ("ur5-hybrid", "ur5-impedance", "ur5-constrained"):
        state = running(shipped()[name]).state.copy()
        request = PreviewRequest(1, state, edited(state.scenario, "controller.layer", 0.02), 0.3)
        foreseen = [PreviewRun(request, engine="pinocchio"), PreviewRun(request, engine="compiled")]
        while foreseen[0].progress < 1.0:
            for preview_run in foreseen:
                preview_run.advance(70)
        step, compiled = (preview_run._loop.recording.signals(("e_r", "s", "tau", "F")) for preview_run in foreseen)
        for name_of, values in step.items():
            assert len(values) == 300
            np.testing.assert_allclose(compiled[name_of], values, rtol=0.0, atol=1e-9 * np.abs(values).max())


@pytest.mark.parametrize(
    ("name", "moving"),
    [
        ("ur5-hybrid", "surface.motion.amplitude"),
        ("ur5-hybrid", "surface.tilt.amplitude"),
        ("ur5-corner", "second.surface.motion.amplitude"),
    ],
)
def test_an_arm_on_a_moving_surface_is_not_pushed(name: str, moving: str) -> None:
    still = edited(edited(shipped()[name], "motion", "hold"), "rotation", "hold")
    for scenario, pushed in ((still, 20.0), (edited(still, moving, 0.01), 0.0)):
        loop = ClosedLoop.from_scenario(scenario)
        assert PreviewRun(PreviewRequest(1, loop.state.copy(), scenario, 1.0, push=20.0))._push == pushed


def test_an_arm_at_rest_is_pushed_and_gives_way_as_its_stiffness_says() -> None:
    """m e'' + b e' + k e = F for a second, from rest: the closed form at its end, and the swing back."""
    free = edited(edited(shipped()["ur5-impedance"], "motion", "hold"), "contact.kind", "free")
    free = edited(free, "truth.push", [0.0, 0.0, 0.0])
    m, b, k = 10.0, 60.0, 2000.0
    loop = running(edited(free, "target_model.B_m", 6 * [b]))
    state, scenario = loop.state.copy(), loop.system.scenario
    metrics = preview_metrics(PreviewRequest(1, state, scenario, 4.0, push=30.0))
    assert metrics.push == 30.0
    omega, zeta = np.sqrt(k / m), b / (2.0 * np.sqrt(k * m))
    beyond = np.exp(-np.pi * zeta / np.sqrt(1.0 - zeta**2))
    assert metrics.motion_largest == pytest.approx(30.0 / k * (1.0 + beyond), rel=0.02)
    wave = np.exp(-zeta * omega * LASTS)  # left of the first swing when the push ends
    assert metrics.motion_overshoot == pytest.approx(30.0 / k * beyond, rel=0.1 + 2.0 * wave)
    assert metrics.motion_error < 2e-4
    assert not metrics.motion_grows
    first_swing, at_rest = (preview_metrics(PreviewRequest(1, state, scenario, s, push=30.0)) for s in (0.2, 1.0))
    assert first_swing.motion_grows
    assert not at_rest.motion_grows
    assert metrics.contact_largest is None
    assert preview_metrics(PreviewRequest(1, state, scenario, 4.0)).motion_largest < 2e-4
    # a sinusoidal push of no size, or a moment that is over, leaves nothing of itself to this one
    for path, value in (("truth.push_frequency", 3.0), ("truth.push_moment", [0.0, 0.0, 0.1])):
        left = edited(edited(edited(scenario, path, value), "truth.push_start", 0.0), "truth.push_every", 0.0)
        left = running(edited(left, "truth.push_duration", 0.001)).state.copy()
        again = preview_metrics(PreviewRequest(1, left, left.scenario, 4.0, push=30.0))
        assert (again.push, again.motion_largest) == (30.0, pytest.approx(metrics.motion_largest, rel=1e-3))
    # what moves by itself is not pushed: by an edit, on its path, by a push of its own
    shifted = edited(scenario, "shift.by", [0.02])
    assert preview_metrics(PreviewRequest(1, state, shifted, 1.0, push=30.0)).push == 0.0
    for moving in ("ur5-hybrid", "ur5-heavy"):
        state = running(shipped()[moving]).state.copy()
        assert preview_metrics(PreviewRequest(1, state, state.scenario, 5.0, push=30.0)).push == 0.0


def test_overshoot_of_a_force_is_what_goes_beyond_its_final_value() -> None:
    hybrid = edited(shipped()["ur5-hybrid"], "target_model.B_m", [200.0, *5 * [400.0]])
    state = running(hybrid, 1500).state.copy()
    metrics = preview_metrics(PreviewRequest(1, state, edited(hybrid, "force.value", 30.0), 2.0))
    zeta = 200.0 / (2.0 * np.sqrt(10.0 * 1e4))  # M_m, K_f K_e
    beyond = 10.0 * np.exp(-np.pi * zeta / np.sqrt(1.0 - zeta**2))
    assert metrics.force_overshoot == pytest.approx(beyond, rel=0.3)  # the desired force changes within some time
    assert metrics.torque_largest > 10.0


def test_overshoot_of_a_force_that_ends_where_it_began_is_the_way_to_either_side() -> None:
    """A payload is taken up: the force rises, and comes back."""
    state = running(shipped()["ur5-hybrid"], 2500).state.copy()
    asked = PreviewRequest(1, state, edited(state.scenario, "truth.payload_mass", 0.5), 2.0)
    preview_run = PreviewRun(asked)
    preview_run.advance(100_000)
    force = preview_run._loop.recording.signals(("multiplier",))["multiplier"]
    assert preview_metrics(asked).force_overshoot == pytest.approx(np.abs(force - force[-1]).max(), rel=0.02)
    assert np.abs(force - force[-1]).max() > 0.5 > 0.1 > abs(force[0] - force[-1])


def test_a_stiffer_surface_is_told_with_the_largest_force_on_it() -> None:
    loop = running(shipped()["ur5-hybrid"], 1500)
    stiffer = edited(loop.system.scenario, "contact.K_e", 1.6e5)
    metrics = preview_metrics(PreviewRequest(1, loop.state.copy(), stiffer, 0.5))
    loop.edit(stiffer)
    for _ in range(round(0.5 / stiffer.controller.period)):
        loop.step()
    after = loop.recording.signals(("multiplier",), t_from=loop.t - 0.5)["multiplier"]
    assert metrics.contact_largest == pytest.approx(np.abs(after).max())
    assert metrics.contact_largest > 200.0  # ten times what is asked for, while the overshoot is seen from there
    assert metrics.contact_final is None
