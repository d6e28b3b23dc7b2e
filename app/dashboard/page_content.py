"""Content of the page: all that is drawn of the runner that a dashboard shows."""

from __future__ import annotations

import operator
import time
from collections.abc import Callable, Collection

import viser

from app.dashboard.panels.tabs import ControlTabs
from app.dashboard.plots.dock import Plots, Shown
from app.dashboard.plots.pinned_runs import PinnedChart
from app.dashboard.scene.tool_drag import ToolDrag
from app.dashboard.scene.view import SceneView
from app.dashboard.transport.repeated_inputs import RepeatedInputs
from app.dashboard.transport.visible_parts import VisibleParts
from app.dashboard.transport.widget_lock import WidgetLock
from app.dashboard.view_options import Viewing
from app.dashboard.widgets.fields.chosen_sliders import ChosenSliders
from app.dashboard.widgets.fields.controls import Desk
from app.dashboard.widgets.fields.edit_lock import EditLock
from app.dashboard.widgets.lesson.guided_minute import GuidedMinute
from app.dashboard.widgets.page.complaint import Complaint
from app.dashboard.widgets.page.last_session import LastSession, add_last_session
from app.dashboard.widgets.page.shortcuts import Shortcuts
from app.dashboard.widgets.page.status import status_html
from app.dashboard.widgets.run.playback import Playback
from app.dashboard.widgets.run.scene_buttons import SceneButtons
from app.dashboard.widgets.run.scene_legend import SceneLegend
from app.dashboard.widgets.run.whatif import WhatIf
from app.dashboard.widgets.run.whatif_panel import WhatIfPanel
from app.dashboard.widgets.target_model.equation import equation_html
from app.dashboard.widgets.theorem.symbols import Symbols
from app.export.export_jobs import ExportJobs
from app.lessons.answers import Notebook
from app.lessons.class_desk import ClassDesk
from app.scenario.data import shipped
from app.session.preview_client import Previewer
from app.session.runner import Runner
from app.session.snapshot import Snapshot
from app.simulation.system import System
from app.storage.uploaded_urdfs import UploadedUrdfs
from app.sweep.background_jobs import BackgroundJobs

REFRESH = 1 / 10  # s, plots and numbers
PLOTTING = 0.1  # fraction of the time for drawing plots: long windows are drawn less often


class PageContent:
    """Content of the page while a runner is attached."""

    def __init__(
        self,
        server: viser.ViserServer,
        *,
        status: viser.GuiHtmlHandle,
        scene: SceneView,
        runner: Runner,
        uploads: UploadedUrdfs,
        previewer: Previewer,
        notebook: Notebook,
        classroom: ClassDesk,
        background_jobs: BackgroundJobs,
        wake: Callable[[], None],
    ) -> None:
        self._server, self._status, self._scene, self._runner = server, status, scene, runner
        self._complaint = Complaint(runner, lambda: self._lock.words)
        self._shipped = shipped()
        self._previewer = previewer
        self._whatif = WhatIf(previewer, wake)
        self._viewing = Viewing()
        self._export_jobs = ExportJobs()
        self._lock = EditLock(runner.post, self._complaint.refuse)
        self._visible_parts = VisibleParts(wake)
        self._background_jobs = background_jobs
        desk = self._desk(uploads, notebook, classroom)
        self._hand = ToolDrag(server.scene, desk, lambda client: client in server.get_clients())
        self._playback = Playback(desk)
        self._shortcuts = Shortcuts(desk)
        self._scene_buttons = SceneButtons(desk)
        self._scene_legend = SceneLegend(desk)
        self._whatif_panel = WhatIfPanel(desk)
        self._guided_minute = GuidedMinute(desk)
        self._symbols = Symbols(server.gui)
        self._chosen_sliders = ChosenSliders(desk)
        self._widget_lock = WidgetLock(server)
        RepeatedInputs(server)
        self._visible_parts.add_field(server.gui)
        self._plots = Plots(server.gui, self._visible_parts, self._viewing, self._widget_lock.drawing)
        self._plots_due = 0.0
        self._tabs = ControlTabs(server.gui, desk, self._visible_parts, self._widget_lock)
        self._equation = _add_equation(server.gui)
        self._refreshed = 0.0
        self._equation_of: System | None = None
        self._drawn: Snapshot | None = None
        self._drawn_with: tuple[object, ...] = ()  # what else the scene was last drawn of
        self._page_height = 0

    def _desk(self, uploads: UploadedUrdfs, notebook: Notebook, classroom: ClassDesk) -> Desk:
        """Desk, all that widgets share; some of those that it names are made later, and with it."""
        return Desk(
            gui=self._server.gui,
            post=self._lock.post,
            snapshot=lambda: self._runner.snapshot,
            whatif=self._whatif,
            viewing=self._viewing,
            complain=self._complaint.tell,
            withdraw_complaint=self._complaint.withdraw,
            export_jobs=self._export_jobs,
            uploads=uploads,
            choose=lambda row: self._chosen_sliders.choose(row),
            sweep=lambda row: self._tabs.robustness.sweep(row),
            let_move=lambda row: self._tabs.robustness.let_move(row),
            lock=self._lock,
            notebook=notebook,
            classroom=classroom,
            background_jobs=self._background_jobs,
            scene_of=self._visible_parts.scene_of,
        )

    @property
    def report_fields(self) -> frozenset[str]:
        return self._visible_parts.fields

    @property
    def hang(self) -> str:
        return self._runner.hang

    def is_unseen(self, clients: Collection[int]) -> bool:
        """Whether none of these clients has its page on its screen."""
        return self._visible_parts.all_away(clients)

    def refuse(self, sentence: str) -> None:
        """Show a refusal by the page."""
        self._complaint.refuse(sentence)

    def fail(self, sentence: str) -> None:
        """Show a failure of this program."""
        self._complaint.fail(sentence)

    def offer(self, last_session: LastSession) -> None:
        above = self._status.order + 0.5
        add_last_session(self._server.gui, last_session, above, self._lock, self.fail)

    def close(self) -> None:
        """End all that was started for the page. The caller ends the runner."""
        self._widget_lock.ended = True
        self._previewer.close()
        self._export_jobs.close()
        self._background_jobs.close()

    def draw(self, now: float) -> None:
        """Draw one frame: the scene where it has changed, everything else less often. A run that stands still has no
        new snapshot, but its page gets other options, and the target is dragged."""
        snapshot = self._runner.snapshot
        options = self._viewing.scene_options
        drawn_with = options, self._hand.held
        same = snapshot is self._drawn and _same(drawn_with, self._drawn_with)
        if not same or self._scene.has_new_meshes:
            self._viewing.legend = self._scene.show(snapshot, options)
            self._hand.show(snapshot, self._viewing.legend.newtons)
        foreseen = self._whatif.look(snapshot, self._server.get_clients(), now)
        if foreseen or now - self._refreshed >= REFRESH:
            self._refresh(snapshot, now)
            self._refreshed = now
        self._drawn, self._drawn_with = snapshot, drawn_with

    def _refresh(self, snapshot: Snapshot, now: float) -> None:
        complaint = self._complaint.text(snapshot, now)
        begun_from = self._shipped.get(snapshot.scenario.name)
        self._status.content = status_html(snapshot, self.hang or complaint, begun_from, self._lock.words)
        for part in (
            self._playback,
            self._whatif_panel,
            self._guided_minute,
            self._scene_buttons,
            self._scene_legend,
            self._symbols,
            self._chosen_sliders,
        ):
            with self._widget_lock.drawing:
                part.show(snapshot)
        self._tabs.show(snapshot, self._server.get_clients(), self._whatif.held, now)
        if snapshot.system is not self._equation_of:
            self._equation_of = snapshot.system
            self._equation.content = equation_html(snapshot)
        self._fit()
        self._scene.draw_paths(self._viewing.scene_options)
        if now >= self._plots_due:
            self._plot(snapshot, now)

    def _plot(self, snapshot: Snapshot, now: float) -> None:
        whatif, looked_at = self._whatif, self._visible_parts.tabs(self._server.get_clients())
        pinned = tuple(map(PinnedChart.of, snapshot.pinned))
        shown = Shown(snapshot.t, self._viewing.window, pinned, whatif.preview, whatif.horizon)
        began = time.thread_time()
        self._plots.show(snapshot, shown, looked_at)
        self._plots_due = now + (time.thread_time() - began) / PLOTTING

    def _fit(self) -> None:
        height = self._visible_parts.scene_height(self._server.get_clients())
        if height and height != self._page_height:
            self._page_height = height
            self._plots.fit(height)


def _add_equation(gui: viser.GuiApi) -> viser.GuiHtmlHandle:
    """Floating panel for the equation of the target model; returns its text."""
    panel = gui.add_panel()
    with panel.add_tab("Target model"):
        text = gui.add_html("")
    panel.float(x=12, y=-92, width=440)
    return text


def _same(shown: tuple[object, ...], drawn: tuple[object, ...]) -> bool:
    """Whether these are the same objects, which never change."""
    return len(shown) == len(drawn) and all(map(operator.is_, shown, drawn))
