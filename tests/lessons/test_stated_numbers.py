"""Numbers that the text of a lesson states beside the measured ones: they are those of its runs."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from app.analysis.metrics import path_error
from app.lessons.blocks import LessonRun
from app.lessons.lesson import load
from app.lessons.playing import runs
from app.simulation.closed_loop import ClosedLoop
from app.storage.constants_store import kept_memory

EVERY = 20  # control periods from one reading of the page's numbers to the next


def loop_of(name: str, title: str) -> ClosedLoop:
    """Loop at the beginning of a run of a lesson."""
    (step,) = (step for step in runs(load(name)) if isinstance(step.block, LessonRun) and step.block.title == title)
    assert step.scenario is not None
    return ClosedLoop.from_scenario(step.scenario, memory=kept_memory())


def run_to(loop: ClosedLoop, end: float) -> None:
    while loop.t < end - 0.5 * loop.period:
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
