"""The dashboard: one viser server that shows the newest snapshot of one runner and posts commands to it."""

from __future__ import annotations

import asyncio
import socket
import threading
import time
from collections.abc import Callable

import structlog
import viser

from app.access.admission import Names, PortTaken, Tokens
from app.dashboard.frame_rate import FPS, check_fps
from app.dashboard.page_content import PageContent
from app.dashboard.scene.appearance import Appearance
from app.dashboard.scene.view import SceneView
from app.dashboard.theme.colors import Theme
from app.dashboard.theme.style import injected_html
from app.dashboard.transport.callback_errors import watch
from app.dashboard.transport.handshake import behind_doors
from app.dashboard.transport.message_filter import MessageFilter
from app.dashboard.transport.stalled_clients import StalledClients
from app.dashboard.transport.viser_private import let_any_thread_send
from app.dashboard.widgets.page.help import Help, tools_html
from app.dashboard.widgets.page.last_session import LastSession
from app.dashboard.widgets.page.status import splash_html
from app.lessons.answers import Notebook
from app.lessons.class_desk import ClassDesk
from app.session.preview_client import Previewer
from app.session.runner import Runner
from app.storage.uploaded_urdfs import UploadedUrdfs
from app.sweep.background_jobs import Allowance, BackgroundJobs, allowance_of

log = structlog.get_logger()
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
        self._content: PageContent | None = None
        with behind_doors(Names(host), key, tokens, self._fault):
            self._server = viser.ViserServer(host=host, port=port, label="VSMRC Lab", verbose=False)
        let_any_thread_send(self._server)
        MessageFilter(self._server, self._refuse)
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
        return "" if self._content is None else self._content.hang

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
    def report_fields(self) -> frozenset[str]:
        """Ids of the fields in which pages report their visible tabs of plots; none before `attach`."""
        return frozenset() if self._content is None else self._content.report_fields

    def show_progress(self, text: str) -> None:
        """Show a text on the preparation of a run, while there is no runner yet."""
        self._status.content = splash_html(text)

    def attach(self, runner: Runner) -> None:
        """Build the controls for this runner, and show it from now on."""
        self._content = PageContent(
            self._server,
            status=self._status,
            scene=self._scene,
            runner=runner,
            uploads=self.uploads,
            previewer=self._previewer,
            notebook=self.notebook,
            classroom=self.classroom,
            background_jobs=BackgroundJobs(self._allowance),
            wake=self._awake.set,
        )

    def offer(self, last_session: LastSession) -> None:
        """Ask above the controls whether to continue the last session; does nothing before `attach`."""
        if self._content is not None:
            self._content.offer(last_session)

    def _refuse(self, sentence: str) -> None:
        """Show a refusal on every page."""
        if self._content is not None:
            self._content.refuse(sentence)

    def fail(self, sentence: str) -> None:
        """Show a failure of this program on every page."""
        if self._content is not None:
            self._content.fail(sentence)

    def run_forever(self, until: Callable[[], bool] = lambda: False) -> None:
        """Draw frames until `close`, or until `until` returns True. Draws nothing while no page is on a screen."""
        while not self._closed.is_set() and not until():
            started = time.monotonic()
            self._awake.clear()
            with self._drawing:
                self._stalled_clients.drop()
                clients, view = self._server.get_clients(), self._content
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
            if self._content is not None:
                self._content.close()
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

    def _draw(self, view: PageContent, started: float) -> None:
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
