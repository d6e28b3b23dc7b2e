"""Content of the page: all that is drawn of the runner that a dashboard shows."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection

import structlog
import viser

from app.dashboard.panels import PANELS, Panel
from app.dashboard.panels.robustness import RobustnessPanel
from app.dashboard.plots.dock import Plots, Shown
from app.dashboard.plots.pinned_runs import PinnedChart
from app.dashboard.scene.tool_drag import Hand
from app.dashboard.scene.view import SceneView
from app.dashboard.transport.repeated_inputs import RepeatedInputs
from app.dashboard.transport.visible_parts import VisibleParts
from app.dashboard.transport.widget_lock import WidgetLock
from app.dashboard.view_options import Viewing
from app.dashboard.widgets.chosen_sliders import ChosenSliders
from app.dashboard.widgets.controls import Desk
from app.dashboard.widgets.edit_lock import EditLock
from app.dashboard.widgets.equation import equation_html
from app.dashboard.widgets.field_words import refusal_in_words
from app.dashboard.widgets.guided_minute import GuidedMinute
from app.dashboard.widgets.last_session import LastSession, add_last_session
from app.dashboard.widgets.playback import Playback
from app.dashboard.widgets.scene_buttons import SceneButtons
from app.dashboard.widgets.scene_legend import SceneLegend
from app.dashboard.widgets.shortcuts import Shortcuts
from app.dashboard.widgets.status import status_html
from app.dashboard.widgets.symbols import Symbols
from app.dashboard.widgets.whatif import WhatIf
from app.dashboard.widgets.whatif_panel import WhatIfPanel
from app.export.export_jobs import ExportJobs
from app.lessons.answers import Notebook
from app.lessons.class_desk import ClassDesk
from app.scenario.data import shipped
from app.session.commands import DropWayOut
from app.session.preview_client import Previewer
from app.session.runner import Runner
from app.session.snapshot import Snapshot
from app.simulation.system import System
from app.storage.uploaded_urdfs import UploadedUrdfs
from app.sweep.background_jobs import BackgroundJobs

log = structlog.get_logger()


def panel_name(title: str) -> str:
    """Name by which a page reports that the tab of controls of this title is on its screen."""
    return f"controls: {title}"


_ACTING = frozenset(map(panel_name, ("Lessons", "Robustness")))  # panels that follow the run also when on no screen
REFRESH = 1 / 10  # s, plots and numbers
CONTROLS = 1 / 2  # s, controls while nobody uses them and the run is not changed
PLOTTING = 0.1  # share of the time for drawing plots: long windows are drawn less often
COMPLAINT_SHOWN = 12.0  # s


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
        self._complaint, self._complaint_until = "", 0.0
        self._complaint_after = 0  # number of commands that had been posted before the complaint
        # revision and run after these commands, None until the runner has heard them: later ones end the complaint
        self._complaint_of: tuple[int, int] | None = None
        self._refusals = runner.snapshot.refusal_number
        self._shipped = shipped()
        self._previewer = previewer
        self._whatif = WhatIf(previewer, wake)
        self._viewing = Viewing()
        self._export_jobs = ExportJobs()
        self._lock = lock = EditLock(runner.post, self.complain)
        self._visible_parts = VisibleParts(wake)
        desk = Desk(
            gui=server.gui,
            post=lock.post,
            snapshot=lambda: runner.snapshot,
            whatif=self._whatif,
            viewing=self._viewing,
            complain=self.complain,
            export_jobs=self._export_jobs,
            uploads=uploads,
            choose=lambda row: self._chosen_sliders.choose(row),
            sweep=lambda row: self._robustness.sweep(row),
            let_move=lambda row: self._robustness.let_move(row),
            lock=lock,
            notebook=notebook,
            classroom=classroom,
            background_jobs=background_jobs,
            scene_of=self._visible_parts.scene_of,
        )
        self._background_jobs = background_jobs
        self._hand = Hand(server.scene, desk, lambda client: client in server.get_clients())
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
        tabs = server.gui.add_tab_group()
        self._panels: dict[str, Panel] = {}
        for title, panel in PANELS.items():
            with tabs.add_tab(title):
                server.gui.add_html(self._visible_parts.panel_marker_html(panel_name(title)))
                self._panels[panel_name(title)] = panel(desk)
        (self._robustness,) = (panel for panel in self._panels.values() if isinstance(panel, RobustnessPanel))
        equation = server.gui.add_panel()
        with equation.add_tab("Target model"):
            self._equation = server.gui.add_html("")
        equation.float(x=12, y=-92, width=440)
        self._refreshed = self._controls_due = 0.0
        self._controls_of: object = None
        self._open_panels: frozenset[str] = frozenset()  # panels on a screen when the controls were shown last
        self._outdated: frozenset[str] = frozenset()  # panels that do not show the last change yet
        self._equation_of: System | None = None
        self._drawn: Snapshot | None = None
        self._page_height = 0

    @property
    def report_fields(self) -> frozenset[str]:
        return self._visible_parts.fields

    @property
    def hang(self) -> str:
        return self._runner.hang

    def is_unseen(self, clients: Collection[int]) -> bool:
        """Whether none of these clients has its page on its screen."""
        return self._visible_parts.all_away(clients)

    def complain(self, sentence: str) -> None:
        """Show a refusal, until another edit is accepted, another run begins or COMPLAINT_SHOWN is over."""
        log.info("refused", sentence=sentence)
        self._runner.post(DropWayOut())
        self._show_sentence("Refused", refusal_in_words(sentence))

    def fail(self, sentence: str) -> None:
        """Show a failure of this program; not again while the same one is shown."""
        if f"Failed: {sentence}" != self._complaint:
            self._show_sentence("Failed", sentence)

    def _show_sentence(self, title: str, sentence: str) -> None:
        """Show a sentence in the strip over the scene."""
        now = time.monotonic()
        self._complaint, self._complaint_until = f"{title}: {sentence}", now + COMPLAINT_SHOWN
        self._complaint_after, self._complaint_of = self._runner.posted, None

    def offer(self, last_session: LastSession) -> None:
        above = self._status.order + 0.5
        add_last_session(self._server.gui, last_session, above, self._lock, self.fail)

    def close(self) -> None:
        """End all that was started for the page. The caller ends the runner."""
        self._previewer.close()
        self._export_jobs.close()
        self._background_jobs.close()

    def draw(self, now: float) -> None:
        """Draw one frame: the scene always, everything else less often."""
        snapshot = self._runner.snapshot
        options = self._viewing.scene_options
        if snapshot is not self._drawn:
            self._viewing.legend = self._scene.show(snapshot, options)
            self._hand.show(snapshot, self._viewing.legend.newtons)
        foreseen = self._whatif.look(snapshot, self._server.get_clients())
        if foreseen or now - self._refreshed >= REFRESH:
            self._refresh(snapshot, now)
            self._refreshed = now
        self._drawn = snapshot

    def _refresh(self, snapshot: Snapshot, now: float) -> None:
        if snapshot.refusal_number != self._refusals:
            self._refusals = snapshot.refusal_number
            self._show_sentence("Refused", refusal_in_words(snapshot.refusal or ""))
        of = snapshot.revision, snapshot.run
        if self._complaint_of is None and snapshot.executed >= self._complaint_after:
            self._complaint_of = of
        if now > self._complaint_until or self._complaint_of not in (None, of):
            self._complaint = ""
        self._status.content = status_html(
            snapshot, self.hang or self._complaint, self._shipped.get(snapshot.scenario.name)
        )
        for part in (
            self._playback,
            self._whatif_panel,
            self._scene_buttons,
            self._scene_legend,
            self._symbols,
            self._chosen_sliders,
        ):
            with self._widget_lock.drawing:
                part.show(snapshot)
        self._show_controls(snapshot, now)
        self._fit()
        self._scene.draw_paths(self._viewing.scene_options)
        if now >= self._plots_due:
            self._plot(snapshot, now)

    def _show_controls(self, snapshot: Snapshot, now: float) -> None:
        """Show the running values in the controls that are on a screen and in the equation: at once when somebody has
        used a control or the run has changed, else now and then. Other controls follow a change a little later."""
        of = (
            *(snapshot.scenario, snapshot.revision, snapshot.run, snapshot.phase, snapshot.refusal_number),
            *(snapshot.blending, [(pinned.number, pinned.title) for pinned in snapshot.pinned]),
            *(self._whatif.held, self._widget_lock.used),
        )
        every = frozenset(self._panels)
        # the script of a page that reports no panel may not run at all
        on_screen = self._visible_parts.tabs(self._server.get_clients()) & every or every
        shown = on_screen - self._open_panels
        if of != self._controls_of:
            self._controls_of, self._outdated = of, every
            shown = on_screen
        if now >= self._controls_due:
            self._controls_due = now + CONTROLS
            shown = on_screen | self._outdated | _ACTING
        self._open_panels, self._outdated = on_screen, self._outdated - shown
        if snapshot.system is not self._equation_of:
            self._equation_of = snapshot.system
            self._equation.content = equation_html(snapshot)
        for name, panel in self._panels.items():
            if name in shown:
                with self._widget_lock.drawing:
                    panel.show(snapshot)

    def _plot(self, snapshot: Snapshot, now: float) -> None:
        whatif, looked_at = self._whatif, self._visible_parts.tabs(self._server.get_clients())
        pinned = tuple(map(PinnedChart.of, snapshot.pinned))
        shown = Shown(snapshot.t, self._viewing.window, pinned, whatif.outlook, whatif.horizon)
        began = time.thread_time()
        self._plots.show(snapshot, shown, looked_at)
        self._plots_due = now + (time.thread_time() - began) / PLOTTING

    def _fit(self) -> None:
        height = self._visible_parts.scene_height(self._server.get_clients())
        if height and height != self._page_height:
            self._page_height = height
            self._plots.fit(height)
