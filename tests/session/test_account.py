"""Figures of a stretch of a run are what its rows say."""

import numpy as np
import pytest

from app.analysis.metrics import account
from app.scenario.data import edited, shipped
from app.session.timeline import Timeline
from tests.support.timelines import line_of, run

pytestmark = pytest.mark.slow  # long or many simulations


def test_the_account_of_a_stretch_is_what_its_rows_say(noisy: Timeline) -> None:
    figures = account(noisy.loop.system, noisy.recording, 0.3, 0.9)
    assert figures is not None
    record = noisy.recording.signals(tuple(noisy.recording.columns), 0.3, 0.9)
    force = record["multiplier"] - record["F_cd"][:, 0]
    assert figures.force_rms == pytest.approx(np.sqrt((force**2).mean()))
    assert figures.force_max == pytest.approx(np.abs(force).max())
    assert figures.effort == pytest.approx(np.sqrt((record["tau"] ** 2).sum(axis=1).mean()))
    assert figures.variation == pytest.approx(np.abs(np.diff(record["tau"], axis=0)).sum() / 0.6, rel=2e-3)
    assert figures.path_max == pytest.approx(np.linalg.norm(record["e_r"][:, 1:3], axis=1).max(), rel=0.05)
    assert account(noisy.loop.system, noisy.recording, 5.0, 6.0) is None


def test_the_account_of_a_motion_has_no_force() -> None:
    line = run(line_of(shipped()["ur5-motion"]), 100)
    figures = account(line.loop.system, line.recording, 0.0, 1.0)
    assert figures is not None
    assert figures.force_rms is None


def test_the_sliding_variable_is_measured_only_under_a_law_that_has_it(noisy: Timeline) -> None:
    robust = account(noisy.loop.system, noisy.recording, 0.0, noisy.loop.t)
    swapped = run(line_of(shipped()["planar3r-hybrid"]), 300)
    swapped.edit(edited(swapped.loop.system.scenario, "controller.law", "computed-torque"))
    run(swapped, 300)
    both = account(swapped.loop.system, swapped.recording, 0.0, swapped.loop.t)
    first = account(swapped.loop.system, swapped.recording, 0.0, 0.2995)
    assert robust is not None
    assert both is not None
    assert first is not None
    assert robust.s_max is not None
    assert both.s_max == first.s_max
