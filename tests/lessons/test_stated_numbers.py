"""Numbers that the text of a lesson states beside the measured ones: they are those of its runs."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from app.analysis.metrics import metrics_of, path_error
from app.lessons.blocks import LessonRun
from app.lessons.lesson import load
from app.lessons.playing import runs
from app.scenario.data import edited
from app.simulation.closed_loop import ClosedLoop
from app.storage.constants_store import kept_memory

EVERY = 20  # control periods from one reading of the page's numbers to the next


def loop_of(name: str, title: str) -> ClosedLoop:
    """Loop at the beginning of a run of a lesson."""
    (step,) = (step for step in runs(load(name)) if isinstance(step.block, LessonRun) and step.block.title == title)
    assert step.scenario is not None
    return ClosedLoop.from_scenario(step.scenario, memory=kept_memory())


def run_to(loop: ClosedLoop, end: float) -> None:
    while loop.stopped is None and loop.t < end - 0.5 * loop.period:
        loop.advance()


def text_of(name: str) -> str:
    return " ".join(" ".join(step.text.split()) for step in load(name).steps)


@pytest.mark.slow
def test_the_error_within_a_layer_is_that_of_the_change_of_s() -> None:
    text = text_of("06-chattering")
    for title, stated in (("layer of 10 mm/s", True), ("layer of 100 mm/s", False)):
        loop = loop_of("06-chattering", title)
        run_to(loop, 3.0)
        record, model = loop.recording.stretch(2.0 - 0.5 * loop.period), loop.system.controller.model
        s = record["s"]
        changes = np.linalg.norm(np.gradient(s, record["t"], axis=0), axis=1).max()
        filtered = changes * float(model.M_m[0, 0] / model.K_m[0, 0])
        error = path_error(loop.system, record)
        assert error is not None
        assert 0.75 * filtered < error.max() < filtered
        assert np.linalg.norm(s, axis=1).max() > 100.0 * error.max()  # s itself is no measure of it
        if stated:
            assert f"at most {1e3 * np.linalg.norm(s, axis=1).max():.2g} mm/s" in text
            assert f"at most {1e3 * changes:.2g} mm/s²" in text
            assert f"1/{model.K_m[0, 0] / model.M_m[0, 0]:g} s²: {1e3 * filtered:.2g} mm" in text


@pytest.mark.slow
def test_the_weight_on_the_second_joint_is_that_of_the_whole_time_that_is_measured() -> None:
    loop = loop_of("05-heavy-arm", "computed torque")
    run_to(loop, 4.0)
    model = loop.system.robot.model
    data = model.createData()
    rows = loop.recording.stretch(2.0)["q"][::EVERY]
    weights = [abs(pin.computeGeneralizedGravity(model, data, q)[1]) for q in rows]
    low, high = min(weights), max(weights)
    assert f"{low:.0f} to {high:.0f} N·m" in text_of("05-heavy-arm")
    assert f"{low:.0f} bis {high:.0f} N·m" in text_of("05-heavy-arm.de")


@pytest.mark.slow
@pytest.mark.parametrize(("layer", "number"), [("5 mm/s", "0.51"), ("2 mm/s", "1.24"), ("1 mm/s", "2.45")])
def test_the_number_of_a_layer_is_that_of_the_page_but_for_a_quarter_of_the_least_gain(layer: str, number: str) -> None:
    loop, shown = loop_of("07-sampling", layer), list[float]()
    for k in range(1, 3001):
        loop.advance()
        if k % EVERY == 0:
            shown.append(loop.view().live["layer_loop_factor"])
    text, controller = text_of("07-sampling"), loop.system.controller
    assert f"{min(shown):.2f} to {max(shown):.2f}" in text
    # (λ_max(K_s) + ¼ λ_min(K_s) + d/s_b) T/h: without the second part it is what the lesson calls (K_s + d/s_b) T/H
    stiffness = loop.view().live["d"] / loop.system.scenario.controller.layer
    gain = float(np.diag(controller.gains.K_s)[0])
    alone = shown[-1] * (gain + stiffness) / (1.25 * gain + stiffness)
    assert f"{alone:.2f}" == number
    assert number in text
    assert f"{shown[-1] - alone:.3f} here" in text


@pytest.mark.slow
def test_the_beginning_of_reaching_and_its_promise_are_those_of_the_run() -> None:
    text, loop = text_of("08-reaching"), loop_of("08-reaching", "as promised")
    run_to(loop, 0.2)
    first, found = loop.recording.stretch(), metrics_of(loop, 1.0, "pinocchio")
    assert f"{-1e3 * first['phi'][0]:.1f} mm away from the surface" in text
    assert f"{-1e3 * first['e_r'][0, 0]:.1f} mm from its desired depth" in text
    assert f"= {1e3 * first['s_norm'][0]:.0f}$ mm/s" in text
    assert found.reaching_time is not None
    assert found.reaching_time_bound is not None
    assert found.layer_time_bound is not None
    assert f"promised after {found.reaching_time_bound:.2f} s at the latest" in text
    assert "A factor of more than eight" in text
    assert 8.0 < found.layer_time_bound / found.reaching_time < 9.0


@pytest.mark.slow
def test_the_force_error_on_a_moving_plane_with_an_arm_that_is_known_is_as_stated() -> None:
    (step,) = (each for each in runs(load("09-moving-surface")) if getattr(each.block, "title", "") == "2 Hz")
    assert step.scenario is not None
    loop = ClosedLoop.from_scenario(edited(step.scenario, "truth.link_scaling", 1.0), memory=kept_memory())
    run_to(loop, 4.0)
    rows = loop.recording.stretch(2.0)
    error = np.abs(rows["F_c"][:, 0] - rows["F_cd"][:, 0]).max()
    assert f"the error would be some {error:.2f} N" in text_of("09-moving-surface")


@pytest.mark.slow
def test_the_factors_of_the_rigid_contact_are_those_of_its_runs() -> None:
    text, soft, usual = text_of("10-rigid-contact"), *(loop_of("10-rigid-contact", f"K_f = {k}") for k in ("0.2", "1"))
    high = loop_of("10-rigid-contact", "K_f = 5.5").system.scenario
    high = ClosedLoop.from_scenario(edited(high, "target_model.K_f", [4.5, *[0.0] * 5]), memory=kept_memory())
    run_to(soft, 0.1)
    run_to(usual, 1.5)
    run_to(high, 1.5)
    assert soft.stopped is not None
    assert "contact lost" in soft.stopped
    assert f"some {10 * round(100 * soft.t)} ms after the beginning" in text
    assert "with more than 80 N" in text
    assert 80.0 < soft.recording.stretch()["F_c"][:, 0].max() < 90.0
    small, one, large = (float(each.view().live["force_loop_factor"]) for each in (soft, usual, high))
    weight = f"{1.0 - one:.2f}"
    assert f"$1 - {weight}\\,K_f$ here: {small:.1f} with 0.2, {one:.1f} with 1." in text
    stated = 1.0 - 4.5 * float(weight)
    assert f"with about ${stated:.2f}$, still comes to rest" in text
    assert large == pytest.approx(stated, abs=0.01)
    rows = high.recording.stretch(1.0)
    assert np.abs(rows["F_c"][:, 0] - rows["F_cd"][:, 0]).max() < 1e-3


@pytest.mark.slow
def test_the_balance_of_forces_outside_the_declared_set_is_that_of_the_runs() -> None:
    text, edge, heavy = text_of("11-outside"), *(loop_of("11-outside", f"{k} % heavier") for k in (15, 50))
    baseline = ClosedLoop.from_scenario(
        edited(heavy.system.scenario, "controller.law", "computed-torque"), memory=kept_memory()
    )
    for loop in (edge, heavy, baseline):
        run_to(loop, 3.0)
    law, last = edge.system.scenario.controller, edge.recording.stretch(1.0)
    gain, s = float(last["d"].max()), float(last["s_norm"].max())
    stiffness = float(np.diag(edge.system.controller.gains.K_s)[0])
    perturbation = s * (gain / law.layer + stiffness)
    larger = perturbation * 50.0 / 15.0
    assert (
        f"balances {gain + stiffness * law.layer:.0f} N: {gain:.0f} N by $d$, and {stiffness * law.layer:.0f} N" in text
    )
    assert f"some {perturbation:.0f} N with 15 %, and 50 % heavier links cause about {larger:.0f} N" in text
    rest = larger - gain
    assert f"the remaining {rest:.0f} N" in text
    assert heavy.recording.stretch(1.0)["s_norm"].max() == pytest.approx(rest / stiffness, rel=0.05)
    error = path_error(baseline.system, baseline.recording.stretch(1.0))
    assert error is not None
    assert f"computed torque would be {1e3 * error.max():.1f} mm off" in text
