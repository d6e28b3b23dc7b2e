"""Band of a preview: the numbers of each arm are those of a loop with that arm, in any order, and none is hidden."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NoReturn

import msgspec
import numpy as np
import pytest

from app.scenario.data import edited, shipped
from app.scenario.departures import Departure
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario, TruthSection
from app.session.arm_band import SEED, SIGNALS, ArmBand, ArmsAhead, BandStretch, TrueArms
from app.session.changes import blending_to
from app.session.preview import PreviewRun
from app.session.preview_client import Previewer
from app.session.preview_messages import Preview, PreviewRequest
from app.simulation import assembly
from app.simulation.assembly import assemble
from app.simulation.closed_loop import ClosedLoop
from app.simulation.compiled_run import CompiledRun
from app.simulation.recording import Recording
from app.workers.preview import _GrowingBand
from drivers import kernels
from drivers.waiting import PATIENCE, until

pytestmark = pytest.mark.slow  # processes of its own
COUNT, HORIZON = 3, 0.2


def running(scenario: Scenario) -> ClosedLoop:
    loop = ClosedLoop.from_scenario(scenario)
    CompiledRun(loop).advance(300)
    return loop


def preview_run_of(loop: ClosedLoop, scenario: Scenario) -> PreviewRun:
    return PreviewRun(PreviewRequest(1, loop.state.copy(), scenario, HORIZON, arms=COUNT), engine="compiled")


def truth_of(scenario: Scenario, number: int, n: int) -> TruthSection:
    return Departure.inside(np.random.default_rng([SEED, number, n]), n).truth(scenario.declared, of=scenario.truth)


def true_arms() -> TrueArms:
    """With the memory of constants over Omega that this test run has (tests/conftest.py)."""
    return TrueArms(assembly.Memory())


def band_of(stretch: BandStretch) -> ArmBand:
    return whole(true_arms().run(stretch, COUNT))


def whole(ahead: ArmsAhead) -> ArmBand:
    until(lambda: not ahead.going)
    band = ahead.band()
    assert band is not None
    assert band.whole
    return band


@pytest.mark.parametrize("name", ["ur5-hybrid", "ur5-impedance", "ur5-constrained", "ur5-corner"])
def test_each_arm_goes_on_as_a_loop_with_that_arm(name: str) -> None:
    loop = running(shipped()[name])
    scenario = edited(loop.system.scenario, "controller.K_s", 80.0)
    stretch = preview_run_of(loop, scenario).stretch
    band = band_of(stretch)
    assert band.arms == COUNT
    assert band.stopped == 0
    for number in range(COUNT):
        own = ClosedLoop.from_state(loop.state.copy())
        own.edit(scenario)
        arm = assemble(msgspec.structs.replace(scenario, truth=truth_of(scenario, number, own.recording.n)))
        # not all of it: a rigid surface moves the start, and so reference and layout, with the masses
        own._become(own._changed(replace(own.system, scenario=arm.scenario, plant=arm.plant)))
        CompiledRun(own).advance(stretch.rows)
        ours = slice(number * len(band.ahead), (number + 1) * len(band.ahead))
        near = 1e-5 if name == "ur5-constrained" else 0.0  # a rigid surface's solver begins elsewhere
        for signal in SIGNALS:
            its = own.recording.signals((signal,))[signal][stretch.points]
            np.testing.assert_allclose(band.signals[signal][ours], its, rtol=near, atol=1e-3 * near, err_msg=signal)
    np.testing.assert_allclose(band.signals["t"][: len(band.ahead)] - stretch.since, band.ahead, atol=1e-9)


def test_arms_are_others_than_the_true_one_and_the_same_at_every_value() -> None:
    loop = running(shipped()["ur5-hybrid"])
    arms, firsts = true_arms(), []
    for K_s in (60.0, 90.0, 60.0):
        stretch = preview_run_of(loop, edited(loop.system.scenario, "controller.K_s", K_s)).stretch
        firsts.append(whole(arms.run(stretch, COUNT)))
    np.testing.assert_array_equal(firsts[0].signals["e_r"], firsts[2].signals["e_r"])
    apart = firsts[0].signals["e_r"].reshape(COUNT, -1)
    assert np.abs(apart[0] - apart[1]).max() > 1e-9
    assert np.abs(firsts[0].signals["e_r"] - firsts[1].signals["e_r"]).max() > 1e-9


def test_arms_in_two_threads_share_no_model_of_the_arm(monkeypatch: pytest.MonkeyPatch) -> None:
    """Estimates along the reference are taken from Pinocchio's memory while the other thread runs its arm. They take
    long, so the arms run a little beyond the preview only, in as many slices as usual."""
    monkeypatch.setattr("app.session.arm_band.LATER", 0.1)
    monkeypatch.setattr("app.session.arm_band.SLICE", 100)
    loop = running(edited(shipped()["ur5-hybrid"], "controller.estimates", "along-reference"))
    arms, stretch = true_arms(), preview_run_of(loop, loop.system.scenario).stretch
    whole(arms.run(stretch, COUNT))
    systems = [arms._begun.system, *arms._systems.values()]
    assert len({id(system.nominal.data) for system in systems}) == COUNT + 1
    assert all(system.observer.model is system.nominal for system in systems)
    band = whole(arms.run(stretch, COUNT))
    for number in range(COUNT):
        own = ClosedLoop.from_state(loop.state.copy())
        alone = own.with_truth(
            truth_of(own.system.scenario, number, own.recording.n), Recording(own.recording.n, stretch.rows), None
        )
        CompiledRun(alone).advance(stretch.rows)
        its = alone.recording.signals(("e_r",))["e_r"][stretch.points]
        np.testing.assert_array_equal(band.signals["e_r"].reshape(COUNT, *its.shape)[number], its)


def test_an_arm_that_stops_is_counted_and_has_no_values_beyond_its_end() -> None:
    """A force loop too fast for a rigid surface: most arms lose it at once."""
    loop = running(shipped()["ur5-constrained"])
    scenario = edited(loop.system.scenario, "target_model.K_f", [0.2, *5 * [0.0]])
    ahead = PreviewRun(PreviewRequest(1, loop.state.copy(), scenario, 3.0, arms=COUNT), engine="compiled").stretch
    band = band_of(ahead)
    known = np.isfinite(band.signals["s_norm"].reshape(COUNT, -1))
    ends = known.sum(axis=1)
    assert band.stopped == (ends < len(band.ahead)).sum() > 0
    assert "contact lost" in band.because
    assert (known == (np.arange(len(band.ahead)) < ends[:, None])).all()


def test_a_band_grows_with_all_its_arms_and_its_beginning_stays() -> None:
    loop = running(shipped()["ur5-hybrid"])
    stretch = PreviewRun(
        PreviewRequest(1, loop.state.copy(), loop.system.scenario, 5.0, arms=COUNT), engine="compiled"
    ).stretch
    ahead, seen = true_arms().run(stretch, COUNT), list[ArmBand]()
    while ahead.going:
        if (band := ahead.band()) is not None:
            seen.append(band)
    last = whole(ahead)
    assert not seen[0].whole
    assert len({len(band.ahead) for band in seen}) > 2
    for band in seen:
        assert band.arms == COUNT
        for signal in SIGNALS:
            one, other = (each.signals[signal].reshape(COUNT, len(each.ahead), -1) for each in (band, last))
            np.testing.assert_array_equal(one, other[:, : len(band.ahead)])


def test_arms_that_are_left_run_no_farther() -> None:
    loop = running(shipped()["ur5-hybrid"])
    scenario = loop.system.scenario
    stretch = PreviewRun(PreviewRequest(1, loop.state.copy(), scenario, 1000.0, arms=COUNT), engine="compiled").stretch
    ahead = true_arms().run(stretch, COUNT)
    until(lambda: ahead.reached > 0)
    ahead.leave()
    assert not ahead.going
    assert ahead.reached < ahead.rows


def test_a_band_that_cannot_be_says_why() -> None:
    loop = running(shipped()["ur5-hybrid"])
    none = msgspec.structs.replace(loop.system.scenario, declared=type(loop.system.scenario.declared)(force_error=1.0))
    assert preview_run_of(loop, none).bandless == "nothing is declared to be uncertain"
    stated = edited(loop.system.scenario, "declared.delta_G", "2 + away")
    assert preview_run_of(loop, stated).bandless.startswith(
        "declared.delta_G is stated, and only its run shows whether"
    )
    assert preview_run_of(loop, loop.system.scenario).bandless == ""
    by_steps = PreviewRun(PreviewRequest(1, loop.state.copy(), loop.system.scenario, HORIZON, arms=COUNT))
    assert "compiled" in by_steps.bandless


def test_what_an_arm_cannot_be_built_for_is_raised_and_the_others_are_left(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = running(shipped()["ur5-hybrid"])
    stretch = PreviewRun(
        PreviewRequest(1, loop.state.copy(), loop.system.scenario, 1000.0, arms=COUNT), engine="compiled"
    ).stretch
    build, built = ClosedLoop.with_truth, list[ClosedLoop]()

    def last_fails(*arguments: Any) -> ClosedLoop:
        if len(built) == COUNT - 1:
            raise ScenarioError("truth.payload_mass: too heavy")
        built.append(build(*arguments))
        return built[-1]

    monkeypatch.setattr(ClosedLoop, "with_truth", last_fails)
    ahead = true_arms().run(stretch, COUNT)
    until(lambda: not ahead.going)
    assert ahead.reached == 0
    with pytest.raises(ScenarioError, match="too heavy"):
        ahead.band()


def test_why_there_is_no_band_is_something_to_draw(monkeypatch: pytest.MonkeyPatch) -> None:
    """The reason comes from a thread, after the first answer."""
    loop = running(shipped()["ur5-hybrid"])
    preview_run = preview_run_of(loop, loop.system.scenario)
    while preview_run.progress < 1.0:
        preview_run.advance(preview_run.batch)

    def fails(*_: Any) -> NoReturn:
        raise ScenarioError("truth.payload_mass: too heavy")

    monkeypatch.setattr(ClosedLoop, "with_truth", fails)
    band = _GrowingBand(assembly.Memory())
    band.follow(preview_run)
    assert band.grow(time.perf_counter() + PATIENCE)
    answer = band.behind(preview_run.preview())
    assert (answer.band, answer.bandless) == (None, "truth.payload_mass: too heavy")
    assert not band.going


@pytest.mark.parametrize(("violation", "judged"), [("flag", False), ("stop", True)])
def test_the_premises_of_an_arm_are_judged_only_where_a_broken_promise_stops_it(violation: str, judged: bool) -> None:
    """Also after a blend, whose end begins another epoch."""
    base = edited(shipped()["ur5-hybrid"], "simulation.bound_violation", violation)
    softer = edited(base, "target_model", {"B_m": [300.0, *[600.0] * 5], "K_m": [0.0, *[6000.0] * 5]})
    loop = ClosedLoop.from_scenario(blending_to(base, softer, 0.03, 0.05))
    n = loop.recording.n
    arm = loop.with_truth(truth_of(base, 0, n), Recording(n), None)
    CompiledRun(arm).advance(150)
    assert arm.system.blend is None
    assert arm.controlled_arm.judged == judged
    assert np.isfinite(arm.recording.stretch()["s_bound"][-1]) == judged


@pytest.fixture
def previewer() -> Iterator[Previewer]:
    kernels.main()  # where some are not compiled yet, the process answers by Pinocchio, without a band
    previewer = Previewer()
    yield previewer
    previewer.close()


def test_the_process_answers_first_and_then_with_the_whole_band_of_the_newest_question(previewer: Previewer) -> None:
    loop = running(shipped()["ur5-hybrid"])
    asked = [edited(loop.system.scenario, "controller.K_s", K_s) for K_s in (60.0, 70.0, 90.0)]
    expected = band_of(preview_run_of(loop, asked[-1]).stretch)  # compiles what the process finds in the cache
    for scenario in asked:
        previewer.ask(loop.state.copy(), scenario, HORIZON, arms=COUNT)

    def banded() -> Preview | None:
        newest = previewer.newest
        return newest if isinstance(newest, Preview) and newest.band is not None and newest.number == 3 else None

    answer = until(lambda: banded() if banded() and banded().band.whole else None)  # pyright: ignore[reportOptionalMemberAccess]
    assert answer.whole
    assert answer.band is not None
    assert answer.band.arms == COUNT
    for signal in SIGNALS:
        np.testing.assert_array_equal(answer.band.signals[signal], expected.signals[signal])
    previewer.ask(loop.state.copy(), loop.system.scenario, HORIZON)
    plain = until(lambda: n if isinstance(n := previewer.newest, Preview) and n.number == 4 and n.whole else None)
    assert plain.band is None
