"""Metrics: what a run and a stretch of it say of the same rows is the same."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from app.analysis.metrics import TAIL, account, metrics_of
from app.scenario.data import shipped
from app.simulation.closed_loop import ClosedLoop
from app.storage.constants_store import kept_memory


@pytest.mark.parametrize("name", ["planar3r-hybrid", "ur5-motion"])
def test_the_end_of_a_run_and_the_same_stretch_have_the_same_figures(name: str) -> None:
    loop = ClosedLoop.begin(shipped()[name], memory=kept_memory())
    while loop.t < 0.5 - 0.5 * loop.period:
        loop.advance()
    whole, t = metrics_of(loop), loop.recording.stretch()["t"]
    begin = t[-1] - TAIL * (t[-1] - t[0])
    end = account(loop.system, loop.recording, begin - 1e-9, t[-1] + 1e-9)
    assert end is not None
    rows = loop.recording.stretch(begin - 1e-9, t[-1] + 1e-9)
    assert end.residual_rms == pytest.approx(np.sqrt((rows["residual"] ** 2).sum(axis=1).mean()), rel=1e-12)
    for of_run, of_stretch in (
        ("target_model_residual_tail", "residual_rms"),
        ("motion_error_tail", "path_max"),
        ("force_error_tail", "force_max"),
        ("angle_error_tail", "angle_max"),
    ):
        one, other = msgspec.to_builtins(whole)[of_run], getattr(end, of_stretch)
        assert (one is None) == (other is None), of_run
        assert one is None or one == pytest.approx(other, rel=1e-12), of_run
