"""What holds for every arm in every mode against everything it may meet."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from app.scenario.admitted_contacts import admitted_contacts
from app.scenario.data import edited, from_plain, from_toml, shipped, to_toml
from app.session.commands import Edit, Pause, SetSpeed
from app.session.runner import Runner
from app.simulation.closed_loop import ClosedLoop
from app.simulation.compiled_run import CompiledRun
from controllers.modes import MODES
from drivers.waiting import until
from environments.catalogue import CATALOGUE
from tests.support.cases import scenario_of, surfaces_for
from tests.support.same_rows import PRECISION, require_same_rows

pytestmark = pytest.mark.slow  # long or many simulations

STEPS = 60
# of the compiled run, where a signal does not come from rest and is no small difference of large numbers
PRECISE = {"q": 1e-12, "tool": 1e-12, "d": 1e-12, "d_required": 1e-12, "tau": 1e-11, "tau_applied": 1e-11}
# by the force loop through a surface with a mass, of which light arms feel the most
AMPLIFIED, LESS_PRECISE = 1e-9, {signal: 10.0 * precision for signal, precision in PRECISE.items()}


def cases() -> list[tuple[str, str, str, str]]:
    return [
        (robot, mode.name, contact, surface)
        for robot in CATALOGUE
        for mode in MODES.values()
        for contact in admitted_contacts(mode)
        for surface in (["plane"] if contact == "free" else surfaces_for(robot))
    ]


def table(loop: ClosedLoop) -> np.ndarray:
    for _ in range(STEPS):
        loop.step()
        assert loop.stopped is None
    return loop.recording.rows()


@pytest.mark.usefixtures("rough_constants")  # both runs have the same
@pytest.mark.parametrize("case", cases(), ids=" / ".join)
def test_run_is_finite_repeats_bit_for_bit_and_is_the_same_compiled(case: tuple[str, str, str, str]) -> None:
    scenario = scenario_of(*case)
    before = to_toml(scenario)
    loop = ClosedLoop.from_scenario(scenario)
    first, second = table(loop), table(ClosedLoop.from_scenario(scenario, previous=loop.system))
    massive = loop.system.plant.nature.massive
    if massive:
        # the tool begins where phi = 0: rounding would decide whether a one-sided surface's mass joins it at once
        loop = ClosedLoop.from_scenario(edited(scenario, "contact.unilateral", False), previous=loop.system)
        table(loop)
    compiled = ClosedLoop.from_scenario(loop.system.scenario, previous=loop.system)
    CompiledRun(compiled).advance(STEPS)
    closer, precision = (LESS_PRECISE, AMPLIFIED) if massive else (PRECISE, PRECISION)
    require_same_rows(loop, compiled, closer, precision)
    assert len(first) == STEPS
    promised = ("s_bound", "s_band", "V_band")  # no numbers where nothing is promised
    others = np.ones(first.shape[1], dtype=bool)
    for name in promised:
        others[loop.recording.columns[name]] = False
    assert np.isfinite(first[:, others]).all()
    np.testing.assert_array_equal(first, second)
    assert to_toml(scenario) == before
    assert from_toml(before) == scenario


@pytest.mark.parametrize("name", ["ur5-hybrid-moving", "planar2r-semicircle", "panda-hybrid"])
def test_dashboard_has_the_numbers_of_a_headless_run(name: str) -> None:
    runner = Runner(shipped()[name])
    runner.start()
    try:
        until(lambda: runner.snapshot.t >= 0.4)
        runner.post(Pause())
        until(lambda: runner.snapshot.phase == "paused")
        live = runner.snapshot.recording.rows(t_to=0.3)
    finally:
        runner.close()
    loop = ClosedLoop.from_scenario(shipped()[name])
    for _ in range(len(live)):
        loop.step()
    assert len(live) > 250
    np.testing.assert_array_equal(live, loop.recording.rows())


def test_edits_while_running_equal_edits_headless() -> None:
    """Edits are carried out between two steps, so a run with edits can be repeated exactly."""
    base = shipped()["ur5-hybrid"]
    changed = edited(base, "force.value", 25.0)
    tables = []
    for _ in range(2):
        loop = ClosedLoop.from_scenario(base)
        for step in range(200):
            if step == 100:
                loop.edit(changed)
            loop.step()
        tables.append(loop.recording.rows())
    assert np.array_equal(*tables)
    assert np.isclose(tables[0][-1, loop.recording.columns["F_cd"]][0], 25.0)


def test_refused_edit_keeps_the_loop() -> None:
    runner = Runner(shipped()["ur5-hybrid"])
    runner.start()
    try:
        before = runner.snapshot.scenario
        runner.post(Edit("controller.K_s", -1.0))
        runner.post(Edit("target_model.M_m", [0.0] * 6))
        runner.post(Edit("contact.kind", "rigid"))
        runner.post(Edit("nothing.like.this", 1))
        runner.post(SetSpeed(float("nan")))
        until(lambda: runner.snapshot.refusal_number >= 5)
        after = runner.snapshot
        assert after.scenario == before
        assert after.phase == "running"
        until(lambda: runner.snapshot.t > after.t)
        assert "speed" in (after.refusal or "")
    finally:
        runner.close()


def test_snapshot_is_serialisable_as_a_scenario() -> None:
    for scenario in shipped().values():
        assert from_plain(msgspec.to_builtins(scenario)) == scenario
