"""Comparison of a run by one engine with the same run by another."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from app.simulation.closed_loop import ClosedLoop

PRECISION = 5e-11  # of the largest number of each signal: contact, friction and feedback amplify the terms' rounding
# the discontinuous law divides by ||s||; where s is 0 it makes jumps of rounding, so such a run ends while s is not
PRECISION_OF_SUDDEN = 1e-8


def require_same_rows(
    stepped: ClosedLoop, compiled: ClosedLoop, closer: Mapping[str, float] | None = None, precision: float = PRECISION
) -> None:
    """Fail unless the two have stopped alike, and all their signals are the same to the precision.
    closer: precision of some signals, by name."""
    assert (compiled.state.steps, compiled.t, compiled.stopped) == (stepped.state.steps, stepped.t, stepped.stopped)
    assert compiled.warning == stepped.warning
    assert compiled.state.judged.station == stepped.state.judged.station
    assert [epoch.t for epoch in compiled.recording.epochs] == [epoch.t for epoch in stepped.recording.epochs]
    expected, found = stepped.recording.stretch(), compiled.recording.stretch()
    sudden = not stepped.system.controller.switching.has_layer
    precision = PRECISION_OF_SUDDEN if sudden else precision
    for signal in expected:
        of_largest = (closer or {}).get(signal, precision)
        within = of_largest * np.nanmax(np.abs(expected[signal]), initial=1e-3)
        np.testing.assert_allclose(found[signal], expected[signal], rtol=0.0, atol=within, err_msg=signal)
