"""The sections of the evidence on two simulators, baselines and practice, on few of their cases: what they find."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from app.evidence import baselines, practice, simulator_runs, simulators
from app.evidence.section import EvidenceSection

pytestmark = pytest.mark.slow  # long or many simulations


def found(section: EvidenceSection, thin: int) -> list[Any]:
    return [job.function(*job.arguments) for job in section.jobs(thin)]


def test_both_simulators_agree_and_what_differs_is_what_mujoco_leaves_out() -> None:
    pytest.importorskip("mujoco")
    results = found(simulators.SECTION, 20)
    kinds = {simulator_runs.Free, simulator_runs.Steady, simulator_runs.ContactCourse, simulator_runs.Constraint}
    assert {type(result) for result in results} == kinds
    for result in results:
        match result:
            case simulator_runs.Free():
                assert result.moved > 0.05
                assert max(result.euler, result.rk4) < 1e-12
                largest = np.array([rung.max() for rung in result.rungs])
                np.testing.assert_allclose(largest[:-1] / largest[1:], 2.0, rtol=0.05)
            case simulator_runs.Steady():
                assert result.mujoco == pytest.approx(result.predicted, rel=1e-6)
                assert result.ours == pytest.approx(result.mujoco, rel=1e-6)
            case simulator_runs.ContactCourse():
                assert result.ours.max() > 15.0
                assert result.without < 1e-9 < result.with_drift
                assert result.apart < 2.0 * result.drift
            case simulator_runs.Constraint():
                assert result.q_ddot < 1e-11 * result.largest[0]
                assert result.multiplier < 1e-11 * result.largest[1]
                assert len(result.by_slider) == (3 if len(result.kinds) == 1 else 0)
                for (coarse, _), (fine, _) in [result.by_slider[:2]] if result.by_slider else []:
                    assert coarse / fine == pytest.approx(100.0, rel=0.1)
            case _:
                raise AssertionError(result)


@pytest.mark.usefixtures("compiled")
def test_baselines_lose_on_uncertain_arms_and_win_where_it_is_said() -> None:
    seeds = (0, 1)
    ours, _, computed, fast, pd, _ = baselines.CONTESTANTS
    quiet = {who: baselines.on_uncertain(who, seeds, 0.0) for who in (ours, computed, pd)}
    for robust, inverse, simple in zip(*quiet.values(), strict=True):
        assert robust.stopped is None
        assert robust.promised == 1.0
        assert robust.over_bound is not None
        assert robust.over_bound <= 1e-9
        for worse in (inverse, simple):
            assert worse.account.path_rms > 5.0 * robust.account.path_rms
            assert (worse.account.force_rms or 0.0) > 20.0 * (robust.account.force_rms or np.inf)
    assert (baselines.on_exact(ours).account.force_rms or 0.0) < 1e-3  # on an exact arm nobody errs by much
    assert baselines.on_exact(fast).account.path_rms < 1e-6
    loud = {who: baselines.on_uncertain(who, seeds[:1], 1.0)[0].account for who in (ours, computed, pd)}
    assert loud[pd].variation == pytest.approx(quiet[pd][0].account.variation, rel=1e-9)
    assert loud[computed].variation < 0.7 * loud[ours].variation


@pytest.mark.usefixtures("compiled")
def test_the_loop_fails_where_theory_says() -> None:
    section = found(practice.SECTION, 4)
    names = [name for name, sweep in practice.SWEEPS.items() for _ in sweep.thinned(4)[1]]
    cells = [(name, cell) for name, row in zip(names, section, strict=True) for cell in row]
    delayed = [cell for name, cell in cells if name == "delay"]
    agreeing = sum((cell.growth > 1.0) == (not cell.force < 5.0 * practice.FORCE_GOOD) for cell in delayed)
    assert agreeing >= 0.8 * len(delayed)
    assert any(cell.growth > 1.0 for cell in delayed)
    driven = [cell for name, cell in cells if name == "drives"]
    assert {cell.saturated != 0.0 for cell in driven} == {True, False}
    assert all(cell.path < 1e-3 for cell in driven if cell.saturated == 0.0)
    conclusion = practice.SECTION.conclude(section)
    assert all(svg.startswith(b"<?xml") for svg in conclusion.figures.values())
    assert practice.SECTION.text(conclusion, "evidence")
