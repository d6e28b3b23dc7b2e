"""The dashboard: one viser server that shows the newest snapshot of one runner and posts commands to it."""

from __future__ import annotations

import asyncio
import socket
import threading
import time
from collections.abc import Callable, Collection

import structlog
import viser

from app.access.admission import Names, PortTaken, Tokens
from app.access.rate_limits import takes_part
from app.dashboard.frame_rate import FPS, check_fps
from app.dashboard.panels import PANELS, Panel
from app.dashboard.panels.robustness import RobustnessPanel
from app.dashboard.plots.charts import PinnedChart
from app.dashboard.plots.dock import Plots, Shown
from app.dashboard.scene.appearance import Appearance
from app.dashboard.scene.tool_drag import Hand
from app.dashboard.scene.view import SceneView
from app.dashboard.theme.colors import RUNS, Theme
from app.dashboard.theme.style import injected_html
from app.dashboard.transport.callback_errors import watch
from app.dashboard.transport.handshake import behind_doors
from app.dashboard.transport.message_filter import MessageFilter
from app.dashboard.transport.repeated_inputs import RepeatedInputs
from app.dashboard.transport.stalled_clients import StalledClients
from app.dashboard.transport.viser_private import let_any_thread_send
from app.dashboard.transport.visible_tabs import VisibleTabs
from app.dashboard.transport.widget_lock import WidgetLock
from app.dashboard.view_options import Viewing
from app.dashboard.widgets.chosen_sliders import ChosenSliders
from app.dashboard.widgets.controls import Desk
from app.dashboard.widgets.edit_lock import EditLock
from app.dashboard.widgets.equation import equation_html
from app.dashboard.widgets.guided_minute import GuidedMinute
from app.dashboard.widgets.help import Help, tools_html
from app.dashboard.widgets.last_session import LastSession, add_last_session
from app.dashboard.widgets.playback import Playback
from app.dashboard.widgets.scene_buttons import SceneButtons
from app.dashboard.widgets.scene_legend import SceneLegend
from app.dashboard.widgets.shortcuts import Shortcuts
from app.dashboard.widgets.status import splash_html, status_html
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
from app.sweep.share import Allowance, Share, allowance_of

log = structlog.get_logger()


def panel_name(title: str) -> str:
    """Name by which a page reports that the tab of controls of this title is on its screen."""
    return f"controls: {title}"


_ACTING = frozenset(map(panel_name, ("Lessons", "Robustness")))  # panels that follow the run also when on no screen
REFRESH = 1 / 10  # s, plots and numbers
CONTROLS = 1 / 2  # s, controls while nobody uses them and the run is not changed
PLOTTING = 0.1  # share of the time for drawing plots: long windows are drawn less often
COMPLAINT_SHOWN = 12.0  # s
SLOW = 2.0  # s, from which on the drawing of a frame is logged
SOONEST = 0.005  # s, the least time from one frame to the next
UNWATCHED = 1.0  # s, between two searches for stalled clients while no page is on a screen
ENDING = 0.7  # s to wait for the end of viser's server
FRAME_ENDING = 0.7  # s to wait for the end of a frame


class Dashboard:
    """Dashboard on a viser server: its page can be opened as soon as the dashboard is made, and shows a run after
    `attach`.

    port: 0 takes any free port.
    fps: pictures of the scene per second; for a machine without a graphics card, few are better.
    key: requests without it in the header KEY_HEADER are refused.
    tokens: that visitors must show, None for a page without.
    previewer: answers what-if questions; ends with the dashboard.
    allowance: of computations beside the loop; None for that of a session alone on this machine.
    Raises PortTaken, and ValueError for an fps outside of the allowed range.
    """

    def __init__(
        self,
        runner: Runner | None = None,
        host: str = "127.0.0.1",
        port: int = 8080,
        theme: Theme = "dark",
        fps: float = FPS,
        key: str | None = None,
        tokens: Tokens | None = None,
        previewer: Previewer | None = None,
        allowance: Allowance | None = None,
    ) -> None:
        check_fps(fps)
        self._allowance = allowance or allowance_of(shared=False)
        self._previewer = previewer or Previewer()
        self._frame = 1.0 / fps
        if port and (reason := _unusable(host, port)):
            raise PortTaken(f"port {port} of {host} cannot be used: {reason}; choose another one with --port")
        self._view: _View | None = None
        with behind_doors(Names(host), key, tokens, self._fault):
            self._server = viser.ViserServer(host=host, port=port, label="VSMRC Lab", verbose=False)
        let_any_thread_send(self._server)
        MessageFilter(self._server)
        self._tokens = tokens
        self.host, self.port = host, self._server.get_port()
        if port and self.port != port:
            self._server.stop()
            raise PortTaken(f"port {port} of {host} cannot be used; choose another one with --port")
        gui = self._server.gui
        gui.main_panel.dock_right()
        gui.main_panel.set_width(396)
        gui.add_html(tools_html() + injected_html())
        self._status = gui.add_html(splash_html("starting…"))
        self._scene = SceneView(self._server)
        self._appearance = Appearance(gui, self._scene, theme)
        self._help = Help(self._server)
        self._closed, self._drawing = threading.Event(), threading.RLock()
        # set where the drawing loop should not wait for its next frame: a page has been opened or has reported its
        # visible tabs, a slider is held or its preview has come, the dashboard is closed
        self._awake = threading.Event()
        self.uploads, self.notebook, self.classroom = UploadedUrdfs(), Notebook(), ClassDesk()
        self._stalled_clients = StalledClients(self._server)
        watch(self._server.get_event_loop(), self.fail)
        self._server.on_client_connect(self._on_connect)
        self._server.on_client_disconnect(self._on_disconnect)
        if runner is not None:
            self.attach(runner)

    @property
    def url(self) -> str:
        return f"http://[{self.host}]:{self.port}" if ":" in self.host else f"http://{self.host}:{self.port}"

    def _fault(self) -> str:
        """Sentence on a fault of the run; "" where there is none."""
        return "" if self._view is None else self._view.hang

    def come_round(self) -> None:
        """Wait until the event loop of the web sockets has had a turn, which is soon unless the loop hangs."""
        asyncio.run_coroutine_threadsafe(asyncio.sleep(0), self._server.get_event_loop()).result()

    @property
    def link(self) -> str:
        """Address of the page, with the token where one is required."""
        return self.url if self._tokens is None else f"{self.url}/?token={self._tokens.steer}"

    @property
    def clients(self) -> dict[int, viser.ClientHandle]:
        """Open pages, by number, in the order in which they came."""
        return self._server.get_clients()

    @property
    def looking_fields(self) -> frozenset[str]:
        """Ids of the fields in which pages report their visible tabs of plots; none before `attach`."""
        return frozenset() if self._view is None else self._view.looking_fields

    def show_progress(self, text: str) -> None:
        """Show a text on the preparation of a run, while there is no runner yet."""
        self._status.content = splash_html(text)

    def attach(self, runner: Runner) -> None:
        """Build the controls for this runner, and show it from now on."""
        self._view = _View(
            self._server,
            self._status,
            self._scene,
            runner,
            self.uploads,
            self._previewer,
            self.notebook,
            self.classroom,
            Share(self._allowance),
            self._awake.set,
        )

    def offer(self, last_session: LastSession) -> None:
        """Ask above the controls whether to continue the last session; does nothing before `attach`."""
        if self._view is not None:
            self._view.offer(last_session)

    def fail(self, sentence: str) -> None:
        """Show a failure of this program on every page."""
        if self._view is not None:
            self._view.fail(sentence)

    def run_forever(self, until: Callable[[], bool] = lambda: False) -> None:
        """Draw frames until `close`, or until `until` returns True. Draws nothing while no page is on a screen."""
        while not self._closed.is_set() and not until():
            started = time.monotonic()
            self._awake.clear()
            with self._drawing:
                self._stalled_clients.drop()
                clients, view = self._server.get_clients(), self._view
                drawn = bool(clients) and not (view is not None and view.is_unseen(clients))
                if view is not None and drawn and not self._closed.is_set():
                    self._draw(view, started)
            if drawn:
                self._closed.wait(max(SOONEST - (time.monotonic() - started), 0.002))
                self._awake.wait(max(self._frame - (time.monotonic() - started), 0.0))
            elif not self._closed.is_set():
                self._awake.wait(UNWATCHED)

    def close(self) -> None:
        """End `run_forever` and stop the server. The caller ends the runner."""
        self._closed.set()
        self._awake.set()
        # a frame that is being drawn would fail at a stopped server
        drawn = self._drawing.acquire(timeout=FRAME_ENDING)
        try:
            if self._view is not None:
                self._view.close()
            self._stalled_clients.drop_all()
            self._stop()
        finally:
            if drawn:
                self._drawing.release()

    def _stop(self) -> None:
        # viser may wait for seconds for a client that does not answer, which must not delay the end of this process
        stopping = threading.Thread(target=self._server.stop, name="stopping", daemon=True)
        stopping.start()
        stopping.join(ENDING)

    def _draw(self, view: _View, started: float) -> None:
        """Draw one frame; a fault is shown and logged, and must not end the drawing."""
        try:
            with self._server.atomic():  # one wake of the server's thread for all messages of a frame
                view.draw(started)
        except Exception as error:
            if self._closed.is_set():  # the server has stopped meanwhile
                return
            log.error("fault", stage="drawing", exc_info=error)
            view.fail(f"the page could not be drawn ({type(error).__name__}: {error}); the run goes on")
            self._closed.wait(1.0)
        if (took := time.monotonic() - started) > SLOW:
            log.info("slow drawing", seconds=round(took, 2))

    async def _on_connect(self, client: viser.ClientHandle) -> None:
        self._awake.set()
        log.info("client connected", client=client.client_id, clients=len(self.clients))

    async def _on_disconnect(self, client: viser.ClientHandle) -> None:
        log.info("client left", client=client.client_id, clients=len(self.clients))


class _View:
    """Content of the page while a runner is attached."""

    def __init__(
        self,
        server: viser.ViserServer,
        status: viser.GuiHtmlHandle,
        scene: SceneView,
        runner: Runner,
        uploads: UploadedUrdfs,
        previewer: Previewer,
        notebook: Notebook,
        classroom: ClassDesk,
        share: Share,
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
        desk = Desk(
            server.gui,
            lock.post,
            lambda: runner.snapshot,
            self._whatif,
            self._viewing,
            self.complain,
            self._export_jobs,
            uploads,
            lambda row: self._chosen_sliders.choose(row),
            lambda row: self._robustness.sweep(row),
            lambda row: self._robustness.let_move(row),
            lock,
            notebook,
            classroom,
            share,
        )
        self._share = share
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
        self._visible_tabs = VisibleTabs(wake)
        self._visible_tabs.add_field(server.gui)
        self._plots = Plots(server.gui, self._visible_tabs, self._viewing, self._widget_lock.drawing)
        self._plots_due = 0.0
        tabs = server.gui.add_tab_group()
        self._panels: dict[str, Panel] = {}
        for title, panel in PANELS.items():
            with tabs.add_tab(title):
                server.gui.add_html(self._visible_tabs.panel_marker_html(panel_name(title)))
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
    def looking_fields(self) -> frozenset[str]:
        return self._visible_tabs.fields

    @property
    def hang(self) -> str:
        return self._runner.hang

    def is_unseen(self, clients: Collection[int]) -> bool:
        """Whether none of these clients has its page on its screen."""
        return self._visible_tabs.all_away(clients)

    def complain(self, sentence: str) -> None:
        """Show a refusal, until another edit is accepted, another run begins or COMPLAINT_SHOWN is over."""
        log.info("refused", sentence=sentence)
        self._runner.post(DropWayOut())
        self._say("Refused", sentence)

    def fail(self, sentence: str) -> None:
        """Show a failure of this program; not again while the same one is shown."""
        if f"Failed: {sentence}" != self._complaint:
            self._say("Failed", sentence)

    def _say(self, title: str, sentence: str) -> None:
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
        self._share.close()

    def draw(self, now: float) -> None:
        """Draw one frame: the scene always, everything else less often."""
        snapshot = self._runner.snapshot
        look = self._viewing.look
        if snapshot is not self._drawn:
            self._viewing.legend = self._scene.show(snapshot, look)
            self._hand.show(snapshot, self._viewing.legend.newtons)
        foreseen = self._whatif.look(snapshot, self._server.get_clients())
        if foreseen or now - self._refreshed >= REFRESH:
            self._refresh(snapshot, now)
            self._refreshed = now
        self._drawn = snapshot

    def _refresh(self, snapshot: Snapshot, now: float) -> None:
        if snapshot.refusal_number != self._refusals:
            self._refusals = snapshot.refusal_number
            self._say("Refused", snapshot.refusal or "")
        of = snapshot.revision, snapshot.run
        if self._complaint_of is None and snapshot.heard >= self._complaint_after:
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
        self._scene.draw_paths(self._viewing.look)
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
        on_screen = self._visible_tabs.tabs(self._server.get_clients()) & every or every
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
        whatif, looked_at = self._whatif, self._visible_tabs.tabs(self._server.get_clients())
        pinned = tuple(
            PinnedChart(p.title, p.recording, p.system.units, p.system.coordinates, color=RUNS[p.place])
            for p in snapshot.pinned
        )
        shown = Shown(snapshot.t, self._viewing.window, pinned, whatif.outlook, whatif.horizon)
        began = time.thread_time()
        self._plots.show(snapshot, shown, looked_at)
        self._plots_due = now + (time.thread_time() - began) / PLOTTING

    def _fit(self) -> None:
        cameras = [client.camera for client in self._server.get_clients().values()]
        height = min((c.image_height for c in cameras if takes_part(c.image_width, c.image_height)), default=0)
        if height and height != self._page_height:
            self._page_height = height
            self._plots.fit(height)


def _unusable(host: str, port: int) -> str:
    """Reason why nothing can listen at this address, "" where it can."""
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except OSError as error:
        return error.strerror or str(error)
    return ""
