"""Benchmark of what-if previews: redraws per second while a slider is dragged, and their effect on the running loop.

No browser is open: the dashboard's controls, plots and drawing rate are those of a page, but their messages go nowhere.
"""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from operator import attrgetter
from typing import NamedTuple

import numpy as np
import viser

from app.dashboard.frame_rate import FPS
from app.dashboard.page import SOONEST
from app.dashboard.page_content import REFRESH
from app.dashboard.plots.dock import Plots, Shown
from app.dashboard.transport.visible_parts import VisibleParts
from app.dashboard.view_options import Viewing
from app.dashboard.widgets.run.whatif import HORIZON, HeldControl, WhatIf
from app.process.markdown import Table
from app.scenario.data import load
from app.scenario.schema import Scenario
from app.session.commands import Edit
from app.session.preview_client import Previewer
from app.session.preview_messages import Preview
from app.session.runner import Runner
from benchmarks.effort import Effort

SCENARIOS = ("ur5-hybrid", "panda-hybrid", "ur5-constrained")
CLIENT = 1
MOVEMENT = 0.05  # s between two movements of the slider: the browser sends no faster
LOOK = 0.001  # s between two readings of the loop's time
FEW, MANY = 16, 64  # true arms behind a preview
RESTS = 5.0  # s at rest, for the band of MANY arms
EARLY = 0.6  # s after the last movement, at which the length of that band is read


class Slider(NamedTuple):
    """Slider that is dragged to and fro: field, label, middle of its way and half its length."""

    path: str
    label: str
    middle: float
    swing: float

    def at(self, t: float) -> float:
        """Value after t s of the drag."""
        return self.middle + self.swing * math.sin(2.0 * t)


FORCE = Slider("force.value", "F_d", 30.0, 10.0)
RADIUS = Slider("motion.radius", "radius", 0.05, 0.02)  # moves Omega: the constants over it are searched for anew


class Pace(NamedTuple):
    """Pace of a running loop. rate: simulated seconds per second. late_median, late_p99, late_worst: lateness of its
    control periods, ms."""

    rate: float
    late_median: float
    late_p99: float
    late_worst: float


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


class Drawn(NamedTuple):
    """Drawn preview.
    t: s after the begin.
    span: length of the preview, s.
    delay: s since the slider had the preview's value.
    scenario: that of the preview.
    arms: true arms behind the preview.
    band: length of their band, s."""

    t: float
    span: float
    delay: float
    scenario: Scenario
    arms: int
    band: float

    def of(self, slider: Slider, value: float) -> bool:
        """Whether the preview is of this value of the slider."""
        return attrgetter(slider.path)(self.scenario) == value


@dataclass
class _Page:
    """Page of the benchmark: the work of the dashboard for a page, frame by frame, while the loop runs.
    value: the last one of the slider."""

    runner: Runner
    whatif: WhatIf
    plots: Plots
    viewing: Viewing
    awake: threading.Event
    value: float = math.nan

    def watch(self, seconds: float, drag: Slider | None = None) -> tuple[Pace, list[Drawn]]:
        """Draw frames for `seconds`. Returns the loop's pace, and the drawn previews. drag: the slider that moves."""
        recording, period = self.runner.snapshot.recording, self.runner.snapshot.scenario.controller.period
        began = time.perf_counter()
        framed = refreshed = -math.inf
        moving = 0.0
        ages, previews, moves = [], [], dict[float, float]()
        while (now := time.perf_counter() - began) < seconds:
            ages.append(now - len(recording) * period)
            if drag is not None and now >= moving:
                moving += MOVEMENT
                self.value = value = drag.at(now)
                moves[value] = now
                edit, run = Edit(drag.path, value), self.runner.snapshot.run
                self.whatif.hold(HeldControl(edit, drag.label, f"{value:.3g}", self, CLIENT, run))
            if now - framed >= 1.0 / FPS or (self.awake.is_set() and now - framed >= SOONEST):
                framed = now
                self.awake.clear()
                snapshot = self.runner.snapshot
                foreseen = self.whatif.look(snapshot, {CLIENT})
                if foreseen or now - refreshed >= REFRESH:
                    refreshed = now
                    preview, horizon = self.whatif.preview, self.whatif.horizon
                    shown = Shown(snapshot.t, self.viewing.window, preview=preview, horizon=horizon)
                    self.plots.show(snapshot, shown, ("Overview",))
                if foreseen and self.whatif.preview is not None:
                    preview = self.whatif.preview
                    moved = math.nan if drag is None else moves.get(attrgetter(drag.path)(preview.scenario), math.nan)
                    previews.append(_drawn(now, preview, now - moved))
            time.sleep(LOOK)
        late = 1e3 * (np.array(ages) - min(ages))
        rate = 1.0 - float(np.mean(ages[-20:]) - np.mean(ages[:20])) / seconds
        return Pace(rate, float(np.median(late)), float(np.quantile(late, 0.99)), float(late.max())), previews


def _drawn(t: float, preview: Preview, delay: float) -> Drawn:
    band = preview.band
    reach = (0, 0.0) if band is None else (band.arms, band.reach)
    return Drawn(t, preview.metrics.span, delay, preview.scenario, *reach)


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
    with _page(scenario) as page:
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
    with _page(scenario) as page:
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


@contextlib.contextmanager
def _page(scenario: str) -> Iterator[_Page]:
    """Page of a running scenario whose preview process is warm."""
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    runner, previewer = Runner(load(scenario)), Previewer()
    viewing, awake = Viewing(), threading.Event()
    plots = Plots(server.gui, VisibleParts(), viewing, contextlib.nullcontext())
    page = _Page(runner, WhatIf(previewer, awake.set), plots, viewing, awake)
    try:
        runner.start()
        page.watch(1.0)
        while not previewer.idle:
            time.sleep(0.05)
        yield page
    finally:
        previewer.close()
        runner.close()
        server.stop()
