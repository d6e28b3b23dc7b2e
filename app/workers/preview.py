"""Process that answers what-if questions: `python -m app.workers.preview FD`.

Started by `app.session.preview_client`; it ends when the other end of the connection does.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection

import structlog

from app.process.log import configure_as_parent
from app.scenario.errors import ScenarioError
from app.session.arm_band import LATER, ArmBand, ArmsAhead, BandStretch, TrueArms
from app.session.headless_run import engine_ready
from app.session.preview import PreviewRun
from app.session.preview_messages import Hurry, Preview, PreviewDone, PreviewMetrics, PreviewRefusal, PreviewRequest
from app.simulation.closed_loop import ClosedLoop
from app.simulation.omega.search_memory import Memory
from app.simulation.system import System
from app.storage.constants_store import kept_memory

log = structlog.get_logger()

DRAWING = 0.06  # s between two intermediate answers: each of them is drawn
BANDED = 0.1  # s from a request of a moving slider to its answer, during which the band may grow
GROWN = 0.3  # s between two answers with a band that grows
LOOK = 0.01  # s between two looks at how far the band is
REST = 0.6  # s for the band, before the answer to a request that differs from the last one in time only
PICTURES = 2  # of the band that grows, meanwhile
OLD = 0.5 * LATER  # s of simulated time, after which a band is computed anew
SOON = 0.06  # s: an answer to a moving slider that needs less than this is completed, also when a newer request waits
TURN = 5e-4  # s that a thread keeps the interpreter while another one waits for it


@dataclass
class _Known:
    """Results of earlier answers that the next one may use.
    band: of true arms.
    system: of the running scenario.
    running: an answer about the running scenario, which holds as long as the run is as it was foreseen."""

    memory: Memory
    band: _GrowingBand
    system: System | None = None
    running: PreviewRun | None = None

    def metrics_for(self, request: PreviewRequest) -> PreviewMetrics | None:
        """Metrics of this request about the running scenario, if they are known; else None."""
        if self.running is None:
            return None
        known = self.running.request
        same = (known.horizon, known.push, known.scenario) == (request.horizon, request.push, request.scenario)
        return self.running.metrics_from(request.state) if same and self.running.leads_to(request.state) else None


class _GrowingBand:
    """Band of true arms for the answers about one scenario. It grows, all arms together, and is computed anew when it
    is old; the old one is shown until the new one is as long as the preview."""

    def __init__(self, memory: Memory) -> None:
        self._arms = TrueArms(memory)
        self._of: object = None
        self._band: ArmBand | None = None
        self._problem = ""
        self._horizon = 0.0
        self._ahead: ArmsAhead | None = None
        self._wanted = 0  # number of rows from which the growing band is drawn

    def follow(self, preview_run: PreviewRun) -> None:
        """Take care of the band for the answer to this preview_run's request: keep, begin or forget it."""
        request = preview_run.request
        of = (request.scenario, request.horizon, request.push, request.arms)
        if of != self._of or preview_run.bandless or not request.arms:
            self.leave()
            self._of, self._horizon = of, request.horizon
        if preview_run.bandless or not request.arms or self._problem or self.going:
            return
        if self._band is None or not 0.0 <= request.state.t - self._band.since < OLD:
            self._attempt(lambda: self._begin(preview_run.stretch, request.arms))

    def leave(self) -> None:
        """Forget the band, and compute no more of it."""
        self._stop()
        self._of, self._band, self._problem = None, None, ""

    @property
    def going(self) -> bool:
        """Whether the band is being computed."""
        return self._ahead is not None

    def grow(self, until: float, asker: Connection | None = None) -> bool:
        """Wait while the band grows: until this instant of `time.perf_counter`, until the band is as long as the
        preview, or until the asker sends a message. Returns whether there is another band to draw, or a reason for
        none."""
        drawn, said = self._band, self._problem
        while self._ahead is not None and self._ahead.reached < self._wanted and self._ahead.going:
            left = until - time.perf_counter()
            if left <= 0.0 or (asker is not None and asker.poll(min(LOOK, left))):
                break
            if asker is None:
                time.sleep(min(LOOK, left))
        if self._ahead is not None:
            self._attempt(self._take)
        return self._band is not drawn or self._problem != said

    def behind(self, preview: Preview) -> Preview:
        """The preview with the band as far as it is known."""
        return replace(preview, band=self._band, bandless=preview.bandless or self._problem)

    def _begin(self, stretch: BandStretch, arms: int) -> None:
        self._ahead, self._wanted = self._arms.run(stretch, arms), stretch.drawn

    def _take(self) -> None:
        """Take the growing band as far as it is, unless it is shorter than the preview and the present one is not."""
        assert self._ahead is not None
        band = self._ahead.band()
        if band is None:
            return
        far = band.reach > self._horizon - 1e-9
        if far or self._band is None or self._band.reach < self._horizon - 1e-9:
            self._band = band
        if far:
            self._wanted = self._ahead.rows
        if band.whole:
            self._stop()

    def _stop(self) -> None:
        if self._ahead is not None:
            self._ahead.leave()
            self._ahead = None

    def _attempt(self, act: Callable[[], None]) -> None:
        """Call `act`; a refusal or an arithmetic error is noted as the reason why there is no band."""
        try:
            act()
        except (ScenarioError, ArithmeticError, ValueError) as error:
            self._stop()
            self._band, self._problem = None, str(error)


def serve(asker: Connection) -> None:
    """Answer one request at a time. Raises EOFError when the asker has gone."""
    memory = kept_memory()
    known, newest = _Known(memory, _GrowingBand(memory)), None
    try:
        while True:
            while newest is not None and known.band.going and not asker.poll():
                _grow(known.band, newest, asker, GROWN, asker)
            request, received = asker.recv(), time.perf_counter()
            if isinstance(request, Hurry):  # the band is not needed any more; or the message came late
                known.band.leave()
                continue
            if newest is not None and not request.partial:  # a running loop asks again and again
                for _ in range(PICTURES):
                    _grow(known.band, newest, asker, REST / PICTURES)
            newest = _answer(request, received, asker, known)
            asker.send(PreviewDone())
    finally:
        known.band.leave()


def _grow(
    band: _GrowingBand, newest: Preview, asker: Connection, seconds: float, interrupter: Connection | None = None
) -> None:
    """Let the band for the newest answer grow for `seconds`. interrupter: connection whose next message ends this."""
    try:
        if band.grow(time.perf_counter() + seconds, interrupter):
            asker.send(band.behind(newest))
    except (EOFError, ConnectionError):
        raise
    except Exception:  # the process's last resort: the answers do not need a band
        log.exception("fault", stage="the band of a preview")
        band.leave()


def _answer(request: PreviewRequest, received: float, asker: Connection, known: _Known) -> Preview | None:
    """Answer a request that came at this instant of `time.perf_counter`. Returns the answer if it is whole, so that a
    band may still be added to it."""
    try:
        preview_run = PreviewRun(request, known.system, known.memory, engine_ready())
        known.system = preview_run.base
        known.band.follow(preview_run)
        today = known.metrics_for(preview_run.unchanged)
        newest = _look_ahead(preview_run, received + BANDED, asker, today, known.band)
        if newest is not None and request.compared and today is None:
            newest = _compare(preview_run, asker, known) or newest
        return newest
    except (ScenarioError, ArithmeticError, ValueError) as error:
        asker.send(PreviewRefusal(request.number, str(error)))
    except (EOFError, ConnectionError):
        raise
    except Exception as error:  # the process's last resort: report it, and be ready for the next request
        log.exception("fault", stage="a preview")
        known.system = None
        asker.send(PreviewRefusal(request.number, f"internal error: {type(error).__name__}: {error}"))
    known.band.leave()
    return None


def _look_ahead(
    preview_run: PreviewRun, banded: float, asker: Connection, today: PreviewMetrics | None, band: _GrowingBand
) -> Preview | None:
    """Send the answer, before it intermediate ones if they are wanted, each with the band as far as it is. Returns the
    answer, None where a newer request has overtaken it.
    banded: instant until which the answer waits for a band that grows."""
    owed = moves = preview_run.request.partial
    began = drawn = time.perf_counter()
    while preview_run.progress < 1.0:
        preview_run.advance(preview_run.batch)
        now, progress = time.perf_counter(), preview_run.progress
        left = (now - began) * (1.0 - progress) / progress
        if (left > SOON or not moves) and not owed and asker.poll():
            return None
        if moves and now > max(drawn + DRAWING, banded if band.going else 0.0):
            _send(preview_run.preview(today), asker, band)
            owed, drawn = False, now
    if moves:
        band.grow(banded)
    return _send(preview_run.preview(today), asker, band)


def _send(answer: Preview | PreviewRefusal, asker: Connection, band: _GrowingBand) -> Preview | None:
    if isinstance(answer, PreviewRefusal):
        asker.send(answer)
        return None
    asker.send(band.behind(answer))
    return answer


def _compare(preview_run: PreviewRun, asker: Connection, known: _Known) -> Preview | None:
    """Answer once more, with the metrics of the running scenario. A newer request does not interrupt this, because all
    answers while the slider is held have the same metrics beside theirs."""
    known.running = PreviewRun(preview_run.unchanged, known.system, known.memory, engine_ready())
    today = known.running.metrics_from(preview_run.request.state)
    return None if today is None else _send(preview_run.preview(today), asker, known.band)


def load_for(loop: ClosedLoop) -> None:
    """Load what answers about this run need, in a process that is forked into those that answer."""
    scenario = loop.system.scenario
    request = PreviewRequest(0, loop.state.copy(), scenario, scenario.controller.period, partial=False)
    preview_run = PreviewRun(request, loop.system, engine=engine_ready())
    preview_run.advance(preview_run.batch)
    preview_run.preview()


def run(asker: Connection) -> None:
    """Answer requests until the asker has gone."""
    sys.setswitchinterval(TURN)
    with asker:
        try:
            serve(asker)
        except (EOFError, ConnectionError):
            log.debug("asker gone")


if __name__ == "__main__":
    configure_as_parent()
    run(Connection(int(sys.argv[1])))
