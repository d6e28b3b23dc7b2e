"""Page of the benchmarks: a running loop whose page is drawn frame by frame, without a browser.

The dashboard's controls, plots and drawing rate are those of a page, but their messages go nowhere.
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
from app.dashboard.widgets.run.whatif import OPENING, HeldControl, WhatIf
from app.scenario.data import load
from app.scenario.schema import Scenario
from app.session.commands import Edit
from app.session.preview_client import Previewer
from app.session.preview_messages import Preview
from app.session.runner import Runner

CLIENT = 1
MOVEMENT = 0.05  # s between two movements of the slider: the browser sends no faster
LOOK = 0.001  # s between two readings of the loop's time


class Slider(NamedTuple):
    """Slider that is dragged to and fro: field, label, middle of its way and half its length."""

    path: str
    label: str
    middle: float
    swing: float

    def at(self, t: float) -> float:
        """Value after t s of the drag."""
        return self.middle + self.swing * math.sin(2.0 * t)


class Pace(NamedTuple):
    """Pace of a running loop. rate: simulated seconds per second. late_median, late_p99, late_worst: lateness of its
    control periods, ms."""

    rate: float
    late_median: float
    late_p99: float
    late_worst: float


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
class WatchedPage:
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
                foreseen = self.whatif.look(snapshot, {CLIENT}, now)
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


@contextlib.contextmanager
def watched_page(scenario: str) -> Iterator[WatchedPage]:
    """Page of a running scenario whose preview process is warm."""
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    runner, previewer = Runner(load(scenario)), Previewer()
    viewing, awake = Viewing(), threading.Event()
    plots = Plots(server.gui, VisibleParts(), viewing, contextlib.nullcontext())
    page = WatchedPage(runner, WhatIf(previewer, awake.set), plots, viewing, awake)
    try:
        runner.start()
        page.watch(OPENING + 1.0)
        while not previewer.idle:
            time.sleep(0.05)
        yield page
    finally:
        previewer.close()
        runner.close()
        server.stop()
