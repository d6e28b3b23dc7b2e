"""Faults of the loop, one at a time: the reason is said, what is recorded stays, Reset works."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from app.scenario.data import edited, load
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario
from app.session.commands import Blend, Edit, Load, Play, Reset, Seek
from app.session.headless_run import simulate
from app.session.runner import Runner
from app.session.snapshot import Snapshot
from app.simulation.period.controlled_arm import ControlledArm
from drivers.waiting import until
from tests.support.faults import begun, boom, ended, running


@pytest.fixture(scope="module")
def runner() -> Iterator[Runner]:
    with running() as runner:
        yield runner


def assert_kept_and_reset_works(runner: Runner, stopped: Snapshot) -> None:
    rows = stopped.recording.rows()
    assert len(rows) > 100
    assert rows[-1, 0] == pytest.approx(stopped.end, abs=2e-3)
    assert np.isfinite(stopped.q).all()  # the page has a picture to show
    assert np.isfinite(stopped.tool).all()
    runner.post(Seek(0.05))
    until(lambda: runner.snapshot.looking_back)
    before = runner.snapshot.run
    for command in (Reset(), Play()):
        runner.post(command)
    until(lambda: runner.snapshot.run > before and runner.snapshot.phase == "running")
    until(lambda: runner.snapshot.t > 0.05)


@pytest.mark.parametrize(
    ("of", "part", "stage"),
    [
        ("arm", "measure", "the measurement"),
        ("arm", "apply_law", "the control law"),
        ("arm", "complete", "the record"),
        ("loop", "view", "the view of the loop"),
    ],
)
@pytest.mark.faults
def test_an_exception_in_any_stage_ends_the_run_and_not_its_thread(
    runner: Runner, of: str, part: str, stage: str
) -> None:
    begun(runner, load("ur5-hybrid"))
    loop = runner._commanded.timeline.loop
    broken = loop if of == "loop" else loop.controlled_arm
    setattr(broken, part, boom)
    stopped = ended(runner)
    assert stopped.reason == f"t = {stopped.end:.3f} s: {stage} failed (KeyError: 'boom')"
    delattr(broken, part)
    assert_kept_and_reset_works(runner, stopped)


@pytest.mark.faults
def test_a_plant_that_fails_ends_the_run(runner: Runner, monkeypatch: pytest.MonkeyPatch) -> None:
    begun(runner, load("ur5-hybrid"))
    with monkeypatch.context() as patched:
        patched.setattr(type(runner._commanded.timeline.loop.system.plant), "advance", boom)
        stopped = ended(runner)
    assert "the plant failed (KeyError: 'boom')" in stopped.reason
    assert_kept_and_reset_works(runner, stopped)


@pytest.mark.faults
def test_the_loop_itself_failing_ends_the_run_and_not_its_thread(
    runner: Runner, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun(runner, load("ur5-hybrid"))
    with monkeypatch.context() as patched:
        patched.setattr(runner, "_advance", boom)
        stopped = ended(runner)
    assert "the loop failed (KeyError: 'boom')" in stopped.reason
    assert_kept_and_reset_works(runner, stopped)


def test_a_law_that_gives_no_number_ends_the_run(runner: Runner) -> None:
    begun(runner, load("ur5-hybrid"))
    loop = runner._commanded.timeline.loop
    law = loop.controlled_arm._control_period

    def failing(*arguments: object) -> None:
        law(*arguments)
        loop.state.evaluation.views.output.tau[:] = loop.state.evaluation.views.applied[:] = np.nan

    loop.controlled_arm._control_period = failing
    stopped = ended(runner)
    assert "the control law asks for a torque that is no finite number: [nan, nan" in stopped.reason
    assert_kept_and_reset_works(runner, stopped)


BILATERAL = edited(load("ur5-constrained"), "contact.unilateral", False)
YIELDING = edited(edited(load("ur5-impedance"), "target_model.K_m", [1.0] * 6), "simulation.leaving_domain", "stop")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("base", "path", "value", "message"),
    [
        (BILATERAL, "target_model.M_m", [1.0] + [12.0] * 5, "the arm diverges"),
        (load("ur5-constrained"), "force.value", -5.0, "contact lost, the surface would have to pull"),
        (edited(YIELDING, "truth.push_duration", 60.0), "truth.push", [0.0, 0.0, 100.0], "J_q is nearly singular"),
    ],
)
def test_what_nature_ends_ends_in_a_sentence(
    runner: Runner, base: Scenario, path: str, value: object, message: str
) -> None:
    begun(runner, base)
    runner.post(Edit(path, value))
    stopped = ended(runner)
    assert message in stopped.reason
    assert len(stopped.recording) > 100
    runner.post(Load(base))
    until(lambda: runner.snapshot.scenario == base and runner.snapshot.phase == "running")


def test_a_headless_run_that_ends_in_its_first_period_is_refused_with_the_reason(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It has no row, so no metrics; a sweep writes the refusal into the run's row and goes on."""

    def unreachable(_: object) -> None:
        raise ValueError("the tool cannot be brought onto the surface")

    monkeypatch.setattr(ControlledArm, "move", unreachable)
    with pytest.raises(ScenarioError, match=r"first control period: t = 0\.000 s: the plant failed \(the tool cannot"):
        simulate(load("ur5-constrained"), engine="pinocchio")


@pytest.mark.faults
def test_a_command_that_fails_unexpectedly_is_refused_and_the_run_goes_on(runner: Runner) -> None:
    before = begun(runner, load("ur5-hybrid"))
    runner.post(Blend(5, 1.0))  # pyright: ignore[reportArgumentType]
    refused = until(lambda: runner.snapshot.refusal_number > before.refusal_number and runner.snapshot)
    assert refused.refusal == "Blend failed (TypeError: 'int' object is not iterable)"
    until(lambda: runner.snapshot.t > refused.t + 0.1)
