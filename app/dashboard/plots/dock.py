"""Dock of plots at the page's left: tabs over a chosen window of time. Tabs that nobody looks at are not drawn."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import viser

from app.analysis.perturbation import PerturbationAnalysis
from app.analysis.thinning import BucketGrid
from app.dashboard.plots.chart_frames import Frame, Recent
from app.dashboard.plots.chart_widget import ChartWidget
from app.dashboard.plots.charts import BUCKETS, Setup, Signals
from app.dashboard.plots.law_drawings import LEAD
from app.dashboard.plots.pinned_runs import PinnedChart, RunLook, laid_on
from app.dashboard.plots.plot_table import TABS, Chooser, Tab
from app.dashboard.transport.page_values import PageEvent, from_pages
from app.dashboard.transport.visible_parts import VisibleParts
from app.dashboard.view_options import Viewing
from app.session.preview_messages import Preview
from app.session.snapshot import Snapshot
from app.simulation.recording import Recording

WINDOWS = {"0.5 s": 0.5, "2 s": 2.0, "4 s": 4.0, "8 s": 8.0, "20 s": 20.0, "60 s": 60.0}
WINDOW = "8 s"
ABOVE, NOTE, AROUND, LEGEND, MOST = 126, 20, 31, 18, 400  # px
LEAST, SCROLLED = 88, 140  # px: of a plot where all of a tab are in sight, and where they are not
_NONE: str = "–"
SETTLED = 0.05  # s: rows older than this at the refresh before are drawn as then, marks of events included
FORESEEN_EVERY = 4  # one in so many instants of a preview is examined


@dataclass(frozen=True)
class Shown:
    """Stretch of a run that is drawn.
    now: s, its last instant.
    window: s, its length.
    pinned: runs that are drawn behind.
    preview: preview after `now`, None for none.
    horizon: s, length of the preview."""

    now: float
    window: float
    pinned: tuple[PinnedChart, ...] = ()
    preview: Preview | None = None
    horizon: float = 0.0


class Plots:
    """Tabs of plots.
    viewing: stores the choices above the plots.
    turn: lock that is held while choices are shown, see `WidgetLock`."""

    def __init__(
        self, gui: viser.GuiApi, visible_parts: VisibleParts, viewing: Viewing, turn: AbstractContextManager[object]
    ) -> None:
        self._viewing, self._visible_parts = viewing, visible_parts
        panel = gui.add_panel()
        self._tabs: dict[str, _TabView] = {}
        for title, tab in TABS.items():
            with panel.add_tab(title):
                self._tabs[title] = _TabView(gui, title, tab, visible_parts, viewing, turn)
                visible_parts.add_field(gui)
        panel.dock_left()
        panel.expand()  # on a phone, too
        panel.set_width(400)
        self._analysis: PerturbationAnalysis | None = None
        self._recording: object = None
        self._drawn: dict[str, object] = {}
        self._reports: dict[str, int] = {}  # number of pages' reports of each tab when it was drawn last
        self._number = 0  # of the last refresh
        self._before: tuple[object, float] | None = None  # content and instant of the last refresh

    def show(self, snapshot: Snapshot, shown: Shown, looked_at: Collection[str]) -> None:
        """Draw the visible tabs, unless they are drawn already."""
        if shown.preview is not None and not shown.preview.follows(shown.now):
            shown = replace(shown, preview=None)
        if shown.preview is not None and not shown.preview.restarts:  # the response begins where it was computed from
            shown = replace(shown, now=min(shown.now, shown.preview.since))
        setup = Setup.of(snapshot, self._viewing.coordinate, self._viewing.joint)
        pinned = tuple((p.look, id(p.recording)) for p in shown.pinned)
        ahead = shown.preview
        band = None if ahead is None or ahead.band is None else (ahead.band.since, ahead.band.reach)
        preview = None if ahead is None else (ahead.number, len(ahead.ahead), band)
        drawn = (snapshot.run, snapshot.revision, shown.now, shown.window, setup, pinned, preview)
        reports = {title: self._visible_parts.reports(title) for title in looked_at if title in self._tabs}
        stale = [t for t, number in reports.items() if self._drawn.get(t) != drawn or self._reports.get(t) != number]
        if not stale:
            return
        begun = sum(map(len, snapshot.recording.pieces(shown.now - shown.window - LEAD, shown.now))) > 1
        frame = self._frame(snapshot, shown) if begun or ahead is not None else None
        for title in stale:
            if frame is not None:
                whole = self._reports.get(title) != reports[title]
                self._tabs[title].show(snapshot, setup, shown, frame, whole=whole)
            else:  # empties the plots after a reset, which would still show the run before
                self._tabs[title].clear(snapshot, setup, shown)
            self._drawn[title], self._reports[title] = drawn, reports[title]

    def _frame(self, snapshot: Snapshot, shown: Shown) -> Frame:
        recording, preview = snapshot.recording, shown.preview
        if self._analysis is None or self._recording is not recording:
            self._analysis, self._recording = PerturbationAnalysis(snapshot.system), recording
        begin = shown.now - shown.window
        grid = BucketGrid.up_to(shown.now, shown.window, BUCKETS)
        analysis = self._analysis
        known = _Later(lambda: _known(analysis, recording, grid, begin - LEAD, shown.now))
        recent = self._recent(snapshot, shown, grid, analysis)
        pinned = [laid_on(p, begin - LEAD, shown.now, snapshot) for p in shown.pinned]
        if preview is None:
            return Frame(shown.now, shown.window, grid, known, pinned, number=self._number, recent=recent)
        # a preview that begins the run anew is another run, to which the analysis does not apply
        openings = np.arange(0, 0 if preview.restarts else len(preview.ahead), FORESEEN_EVERY)
        foreseen = analysis.foreseen(preview.signals, preview.epochs, openings)
        # the run has gone on since the preview was requested
        ahead = preview.ahead if preview.restarts else preview.signals["t"] - shown.now
        frame = Frame(
            *(shown.now, shown.window, grid, known, pinned, ahead, foreseen),
            number=self._number,
            recent=recent,
        )
        if preview.band is None:
            return frame
        since = 0.0 if preview.restarts else preview.band.since - shown.now
        return replace(frame, band=preview.band, band_ahead=since + preview.band.ahead)

    def _recent(
        self, snapshot: Snapshot, shown: Shown, grid: BucketGrid, analysis: PerturbationAnalysis
    ) -> Recent | None:
        """Rows since the refresh before, None where that drew another run or another window, or is long ago."""
        before, of = self._before, (snapshot.run, snapshot.revision, id(snapshot.recording), shown.window)
        self._number, self._before = self._number + 1, (of, shown.now)
        if before is None or before[0] != of or not before[1] <= shown.now < before[1] + 0.5 * shown.window:
            return None
        since = max(grid.first, math.floor((before[1] - SETTLED) / grid.width))
        begin = since * grid.width - 1.1 * LEAD  # the total variation is a sum over LEAD
        return Recent(since, _known(analysis, snapshot.recording, grid.since(since), begin, shown.now))

    def fit(self, page_height: int) -> None:
        """Share the height of the page, px, among the plots of a tab."""
        for tab in self._tabs.values():
            tab.fit(page_height)


class _TabView:
    """Tab of the dock: a row of choices, then its plots."""

    def __init__(
        self,
        gui: viser.GuiApi,
        title: str,
        tab: Tab,
        visible_parts: VisibleParts,
        viewing: Viewing,
        turn: AbstractContextManager[object],
    ) -> None:
        self._title, self._tab, self._viewing = title, tab, viewing
        self._visible_parts, self._turn = visible_parts, turn
        with gui.add_form(None):
            self._window = gui.add_dropdown(
                "window", tuple(WINDOWS), initial_value=WINDOW, hint="Length of time that the plots show."
            )
            self._choosers: dict[Chooser, viser.GuiDropdownHandle[str]] = {
                chooser: gui.add_dropdown(chooser, (_NONE,), hint=f"Which {chooser} the plots below show.")
                for chooser in tab.choosers
            }
        self._window.on_update(from_pages(self._on_window))
        for chooser in self._choosers.values():
            chooser.on_update(from_pages(self._on_choice))
        self._note = gui.add_html(visible_parts.marker_html(title))
        self._charts = [ChartWidget(gui, plot) for plot in tab.plots]
        self._page_height = 0

    async def _on_window(self, _: PageEvent) -> None:
        self._viewing.window = WINDOWS[self._window.value]

    async def _on_choice(self, _: PageEvent) -> None:
        for chooser, widget in self._choosers.items():
            setattr(self._viewing, chooser, widget.options.index(widget.value))

    def show(self, snapshot: Snapshot, setup: Setup, shown: Shown, frame: Frame, *, whole: bool) -> None:
        """Draw the data of a refresh. whole: see `ChartWidget.draw`."""
        with self._turn:
            self._show_choices(setup)
        self._show_note(snapshot, shown)
        for chart in self._charts:
            chart.draw(setup, _looks(shown), frame, whole=whole)
        self._fit_heights()

    def clear(self, snapshot: Snapshot, setup: Setup, shown: Shown) -> None:
        """Remove the lines of all plots."""
        with self._turn:
            self._show_choices(setup)
        self._show_note(snapshot, shown)
        for chart in self._charts:
            chart.clear(setup, _looks(shown))
        self._fit_heights()

    def _show_note(self, snapshot: Snapshot, shown: Shown) -> None:
        ahead = 0.0 if shown.preview is None else shown.horizon
        self._note.content = self._visible_parts.marker_html(
            self._title, shown.window, ahead, self._tab.note(snapshot) if self._tab.note else ""
        )

    def _show_choices(self, setup: Setup) -> None:
        """Show the present choices, which somebody may have changed while the plots were drawn."""
        self._window.value = next(name for name, seconds in WINDOWS.items() if seconds == self._viewing.window)
        for chooser, widget in self._choosers.items():
            names, chosen = _choices(chooser, setup), getattr(self._viewing, chooser)
            if widget.options != names:
                widget.options = names
            widget.value = names[chosen if chosen < len(names) else 0]

    def fit(self, page_height: int) -> None:
        self._page_height = page_height
        self._fit_heights()

    def _fit_heights(self) -> None:
        rows = [chart.legend_rows for chart in self._charts if chart.legend_rows]
        rest = self._page_height - ABOVE - (NOTE if self._tab.note else 0) - LEGEND * sum(rows) - AROUND * len(rows)
        share = rest // max(len(rows), 1)
        height = min(share, MOST) if share >= LEAST else SCROLLED
        for chart in self._charts:
            chart.set_height(height)


def _looks(shown: Shown) -> list[RunLook]:
    return [pinned.look for pinned in shown.pinned]


def _choices(chooser: Chooser, setup: Setup) -> tuple[str, ...]:
    """Options of a chooser, the coordinates or the joints."""
    if chooser == "coordinate":
        return tuple(coordinate.name for coordinate in setup.coordinates)
    return tuple(f"{i + 1}  {name}" for i, name in enumerate(setup.joints))


class _Later(Mapping[str, np.ndarray]):
    """Signals that are computed when the first of them is read."""

    def __init__(self, find: Callable[[], Signals]) -> None:
        self._find = find

    @cached_property
    def _found(self) -> Signals:
        return self._find()

    def __getitem__(self, name: str) -> np.ndarray:
        return self._found[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._found)

    def __len__(self) -> int:
        return len(self._found)


def _known(
    analysis: PerturbationAnalysis, recording: Recording, grid: BucketGrid, t_from: float, t_to: float
) -> Signals:
    rows = recording.stretch(t_from, t_to)
    return analysis.recorded(rows, tuple(recording.epochs), grid.openings(rows["t"]))
