"""Plots while a run goes on: courses that are continued, and pages that receive only what they lack."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.analysis.perturbation import DerivedSignals, PerturbationAnalysis
from app.analysis.thinning import BucketGrid
from app.dashboard.plots.chart_frames import DecimatedLines
from app.dashboard.plots.charts import BUCKETS, Setup
from app.dashboard.plots.dock import SETTLED
from app.dashboard.plots.law_drawings import LEAD
from app.dashboard.plots.plot_table import TABS
from app.dashboard.transport import plot_feed
from app.dashboard.transport.plot_feed import PlotFeed
from app.scenario.data import edited, shipped
from app.session.snapshot import snapshot_of
from app.simulation.closed_loop import ClosedLoop

LONG = 1.0  # s, window of the plots here


def test_a_course_that_is_continued_is_that_of_all_rows() -> None:
    """For every line of every tab, over a push, which is reached, and a change of the law's gain."""
    loop = ClosedLoop.from_scenario(edited(shipped()["ur5-hybrid"], "truth.push", [0.0, 0.0, 5.0]))
    analysis, setup = PerturbationAnalysis(loop.system), Setup.of(snapshot_of(loop), 0, 0)
    plots = [plot for tab in TABS.values() for plot in tab.plots if not plot.spectral]
    lines = [line for plot in plots if (drawing := plot.draw(setup)) for line in drawing.lines]
    assert len(lines) > 40

    def known(grid: BucketGrid, begin: float) -> DerivedSignals:
        rows = loop.recording.stretch(begin, loop.t)
        return analysis.recorded(rows, tuple(loop.recording.epochs), grid.openings(rows["t"]))

    course, drawn_at = None, 0.0
    for steps in (40, 103, 97, 250, 400, 411, 333):
        for _ in range(steps):
            loop.step()
        if steps == 411:
            loop.edit(edited(loop.system.scenario, "controller.layer", 0.03))
        grid = BucketGrid.up_to(loop.t, LONG, BUCKETS)
        whole = DecimatedLines.of(grid, known(grid, loop.t - LONG - LEAD), lines)
        if course is not None:
            since = max(grid.first, int((drawn_at - SETTLED) // grid.width))
            rows = known(grid.since(since), since * grid.width - 1.1 * LEAD)
            assert len(rows["t"]) < len(known(grid, loop.t - LONG)["t"]) or loop.t < LONG
            course = course.continued(grid, since, rows, lines)
            assert course.begins == whole.begins
            np.testing.assert_allclose(course.points, whole.points, rtol=1e-9, atol=1e-12)
            np.testing.assert_allclose(course.newest, whole.newest, rtol=1e-9, atol=1e-12)
        course, drawn_at = course or whole, loop.t


@dataclass
class Page:
    """A page as `static/page/points.js` makes it, which receives a message only when it reads."""

    unread: dict[str, tuple[str, Any]] = field(default_factory=dict)  # a message replaces the last one of its kind
    mark: int = -1
    number: int = -1
    at: np.ndarray = field(default_factory=lambda: np.empty(0))
    lines: list[np.ndarray] = field(default_factory=list)
    behind: bool = False

    def read(self) -> None:
        for kind, what in self.unread.values():
            self._take(kind, what)
        self.unread.clear()

    def _take(self, kind: str, what: dict[str, Any]) -> None:
        if kind == "whole":
            self.mark, self.number, self.at, self.lines = what["mark"], 0, what["at"], list(what["lines"])
            self.behind = False
            return
        if self.mark != what["mark"] or self.number < what["after"]:
            self.behind = True
            return
        begin, stay = int(np.searchsorted(self.at, what["begin"] - 5e-7)), what["stay"]
        assert len(self.at) >= begin + stay
        self.at = np.concatenate([self.at[begin : begin + stay], what["at"]])
        joined = zip(self.lines, what["values"], strict=True)
        self.lines = [np.concatenate([old[begin : begin + stay], new]) for old, new in joined]
        self.number = what["number"]


@settings(deadline=None, max_examples=60)
@given(st.data())
def test_pages_have_what_was_drawn_whenever_they_have_read_everything(data: st.DataObject) -> None:
    """Pages that read rarely, come late, or see a run that is looked back into, changed, or begins anew."""
    pages, sent = [Page()], 0

    def put(kind: str, what: dict[str, Any]) -> None:
        nonlocal sent
        sent += 1
        for page in pages:
            page.unread.pop(kind, None)
            page.unread[kind] = kind, what

    def whole(_chart: object, arrays: tuple[np.ndarray, ...], _most: int, base: dict[str, Any]) -> None:
        put("whole", base | {"lines": [a.astype(np.float32) for a in arrays[1:]]})

    def further(_chart: object, points: dict[str, Any]) -> int:
        put("further", points)
        return sent

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plot_feed, "whole_plot", whole)
        patch.setattr(plot_feed, "further_points", further)
        patch.setattr(plot_feed, "is_with_all", lambda *_: not any(page.unread for page in pages))
        feed, now, seed = PlotFeed(None, 48), 5.0, 0  # pyright: ignore[reportArgumentType]
        for _ in range(data.draw(st.integers(1, 30))):
            match data.draw(st.sampled_from(["on", "on", "on", "back", "changed", "comes", "read", "read one"])):
                case "on":
                    now += data.draw(st.sampled_from([0.1, 0.033, 0.7, 4.0]))
                case "back":
                    now = max(now - data.draw(st.sampled_from([0.05, 0.5, 2.0])), 0.2)
                case "changed":
                    seed += 1
                case "comes":
                    pages.append(Page())
                    feed.forget()
                case "read":
                    for page in pages:
                        page.read()
                case _:
                    pages[-1].read()
            grid = BucketGrid.up_to(now, 2.0, 20)
            x = np.append(np.minimum(grid.times - now, 0.0), 0.0)
            # of a changed run all but the beginning is another
            lines = [np.sin(3.0 * (x + now)) + seed * (x + now > 3.0 + seed), np.where(x + now > 1.0, 1.0, np.nan)]
            feed.send(now, x, lines)
            if data.draw(st.booleans()):
                for page in pages:
                    page.read()
                    assert not page.behind
                    np.testing.assert_allclose(page.at, x + now, atol=1e-6)
                    np.testing.assert_array_equal(page.lines, np.array(lines, dtype=np.float32))


def test_a_run_that_goes_on_costs_its_new_points_only(monkeypatch: pytest.MonkeyPatch) -> None:
    sizes: list[int] = []
    monkeypatch.setattr(plot_feed, "whole_plot", lambda _chart, data, *_: sizes.append(sum(map(len, data))))
    monkeypatch.setattr(
        plot_feed, "further_points", lambda _chart, points: sizes.append(points["values"].size + len(points["at"])) or 0
    )
    monkeypatch.setattr(plot_feed, "is_with_all", lambda *_: True)
    feed = PlotFeed(None, 48)  # pyright: ignore[reportArgumentType]
    for now in np.arange(20.0, 25.0, 0.1):
        grid = BucketGrid.up_to(now, 8.0, BUCKETS)
        x = np.append(np.minimum(grid.times - now, 0.0), 0.0)
        feed.send(now, x, [np.sin(x + now)] * 5)
    assert max(sizes[1:]) < 0.06 * sizes[0]
