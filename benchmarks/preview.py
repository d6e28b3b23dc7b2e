"""Benchmark of what-if previews: redraws per second while a slider is dragged, and their effect on the running loop.

No browser is open, see `watched_page`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from app.dashboard.widgets.run.whatif import HORIZON
from app.process.markdown import Table
from benchmarks.effort import Effort
from benchmarks.watched_page import Pace, Slider, watched_page

SCENARIOS = ("ur5-hybrid", "panda-hybrid", "ur5-constrained")
FEW, MANY = 16, 64  # true arms behind a preview
RESTS = 5.0  # s at rest, for the band of MANY arms
EARLY = 0.6  # s after the last movement, at which the length of that band is read
FORCE = Slider("force.value", "F_d", 30.0, 10.0)
RADIUS = Slider("motion.radius", "radius", 0.05, 0.02)  # moves Omega: the constants over it are searched for anew


class DragMetrics(NamedTuple):
    """Metrics of previews.
    first: s from the first movement to the first drawing, with a warm process.
    redraws: per second while the slider moves.
    reach: median length of the drawn previews, s.
    delay: median s from a movement to the drawing of its whole horizon.
    settled: s from the last movement to the drawing of the whole horizon.
    alone, dragging: pace of the running loop before and during the drag."""

    first: float
    redraws: float
    reach: float
    delay: float
    settled: float
    alone: Pace
    dragging: Pace


class BandMetrics(NamedTuple):
    """Metrics of previews with true arms behind them.
    redraws: per second while the slider moves.
    banded: redraws per second with a band of true arms.
    reach: median length of these bands, s.
    early: length of the band of `MANY` arms `EARLY` s after the last movement, s; 0 where there is none.
    rested: s from the last movement to that band over the whole horizon.
    dragging: pace of the running loop during the drag."""

    redraws: float
    banded: float
    reach: float
    early: float
    rested: float
    dragging: Pace


def measure(effort: Effort) -> Table:
    """Table of previews."""
    metrics = [dragged(scenario, FORCE, effort.drag) for scenario in SCENARIOS]
    moved = [dragged(scenario, RADIUS, effort.drag) for scenario in SCENARIOS]
    rows = [
        ("redraws per s while dragging", *(f"{f.redraws:.1f}" for f in metrics)),
        ("first drawing after the first movement, s", *(f"{f.first:.2f}" for f in metrics)),
        ("median reach of these drawings, s", *(f"{f.reach:.1f}" for f in metrics)),
        ("from a movement to its whole horizon, median, ms", *(f"{1e3 * f.delay:.0f}" for f in metrics)),
        ("whole horizon after the last movement, s", *(f"{f.settled:.2f}" for f in metrics)),
        ("real-time factor, alone / dragging", *(f"{f.alone.rate:.3f} / {f.dragging.rate:.3f}" for f in metrics)),
    ]
    rows += [
        ("the path's radius is dragged: redraws per s", *(f"{f.redraws:.1f}" for f in moved)),
        ("from a movement to its whole horizon, median, ms", *(f"{1e3 * f.delay:.0f}" for f in moved)),
        ("real-time factor meanwhile", *(f"{f.dragging.rate:.3f}" for f in moved)),
    ]
    for title, name in (("median", "late_median"), ("p99", "late_p99"), ("max", "late_worst")):
        pairs = (f"{getattr(f.alone, name):.2f} / {getattr(f.dragging, name):.2f}" for f in metrics)
        rows.append((f"lateness {title}, alone / dragging, ms", *pairs))
    bands = [banded(scenario, effort.drag) for scenario in SCENARIOS]
    rows += [
        (f"with {FEW} true arms behind it: redraws per s", *(f"{b.redraws:.1f}" for b in bands)),
        ("of these with their band, per s", *(f"{b.banded:.1f}" for b in bands)),
        ("median reach of that band, s", *(f"{b.reach:.1f}" for b in bands)),
        ("real-time factor meanwhile", *(f"{b.dragging.rate:.3f}" for b in bands)),
        (
            f"length of the band of {MANY} arms {EARLY:g} s after the last movement, s",
            *(f"{b.early:.1f}" for b in bands),
        ),
        ("its whole horizon after the last movement, s", *(f"{b.rested:.2f}" for b in bands)),
    ]
    return Table(("a slider is dragged", *SCENARIOS), rows)


def banded(scenario: str, seconds: float) -> BandMetrics:
    """Metrics of previews with true arms: a drag with few of them, then a rest with many."""
    with watched_page(scenario) as page:
        page.whatif.arms = FEW
        page.watch(1.0, FORCE)  # builds the arms
        pace, drawn = page.watch(seconds, FORCE)
        page.whatif.arms = MANY
        page.watch(1.0, FORCE)
        _, later = page.watch(RESTS)
        still = [each for each in later if each.arms == MANY and each.of(FORCE, page.value)]
        behind = [each for each in drawn if each.arms == FEW]
        return BandMetrics(
            redraws=len(drawn) / seconds,
            banded=len(behind) / seconds,
            reach=float(np.median([each.band for each in behind])) if behind else 0.0,
            early=max((each.band for each in still if each.t <= EARLY), default=0.0),
            rested=next((each.t for each in still if each.band >= HORIZON), math.inf),
            dragging=pace,
        )


def dragged(scenario: str, slider: Slider, seconds: float, horizon: float = HORIZON) -> DragMetrics:
    """Metrics of previews: the scenario runs alone, then with a drag of the slider, both for `seconds`."""
    with watched_page(scenario) as page:
        page.whatif.horizon, page.whatif.arms = horizon, 0
        alone, _ = page.watch(seconds)
        dragging, drawn = page.watch(seconds, slider)
        _, later = page.watch(2.0)
        still = [each for each in later if each.of(slider, page.value)]
        times = [each.t for each in drawn]
        return DragMetrics(
            first=times[0],
            redraws=(len(times) - 1) / (times[-1] - times[0]),
            reach=float(np.median([each.span for each in drawn])),
            delay=float(np.nanmedian([each.delay for each in drawn if each.span >= horizon - 1e-6] or [math.nan])),
            settled=next((each.t for each in still if each.span >= horizon - 1e-6), math.inf),
            alone=alone,
            dragging=dragging,
        )
