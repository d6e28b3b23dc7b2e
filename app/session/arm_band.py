"""Band of a preview: the same seconds ahead with other true arms, drawn from the scenario's declared set."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from functools import cache

import numpy as np

from app.analysis.metrics import MULTIPLIERS
from app.process.cores import usable_cores
from app.process.priority import lower_priority
from app.scenario.departures import Departure
from app.simulation.closed_loop import ClosedLoop
from app.simulation.compiled_run import CompiledRun
from app.simulation.omega.search_memory import Memory
from app.simulation.recording import Recording
from app.simulation.state import State
from app.simulation.system import System

SIGNALS = ("t", "e_r", "r", "F", "F_c", "F_cd", "s_norm", "d", *MULTIPLIERS)  # of which plots show a band
LATER = 1.0  # s beyond the preview: the run goes on while arms are computed
SLICE = 500  # control periods that an arm is run at once, in some two milliseconds
NICENESS = 19  # of the threads
SEED = 0  # the same arms in every preview: what moves in the picture is the slider's doing


@dataclass(frozen=True)
class ArmBand:
    """Band of true arms: their signals over a stretch of time.
    since: s, the instant of the run from which they are computed.
    reach: s after `since` up to which all arms are known.
    ahead: (N,) s after `since`, the instants whose signals are kept.
    arms: number of arms.
    signals: (arms · N, ...), one arm after the other; nan beyond the end of an arm that stopped.
    stopped: number of arms that stopped; because: why the first of them did.
    whole: whether the stretch is complete."""

    since: float
    reach: float
    ahead: np.ndarray
    arms: int
    signals: Mapping[str, np.ndarray]
    stopped: int
    because: str
    whole: bool


@dataclass(frozen=True)
class BandStretch:
    """Stretch of time over which arms are run.
    since: s, the present instant of the run.
    begins: the state from which all arms go on: that of `since`, or the start where an edit begins the scenario anew.
    rows: number of control periods; drawn: number of those that the preview has, the first ones.
    points: (N,), numbers of the rows that are kept."""

    since: float
    begins: State
    rows: int
    drawn: int
    points: np.ndarray

    @classmethod
    def beyond(cls, since: float, begins: State, rows: int, points: np.ndarray) -> BandStretch:
        """Stretch of a preview and of `LATER` s more. rows: number of the preview's rows. points: numbers of
        the drawn ones."""
        more = round(LATER / begins.scenario.controller.period)
        later = np.linspace(rows, rows + more - 1, 20).astype(int)
        return cls(since, begins, rows + more, rows, np.append(points, later))


class _Arm:
    """One true arm, run over a stretch a slice at a time.

    signals: at the points of the stretch, (N, ...), nan beyond the rows that are computed.
    ended: number of computed rows.
    reached: the same, or the number of all rows where the arm has stopped.
    """

    def __init__(self, loop: ClosedLoop, stretch: BandStretch) -> None:
        self.loop, self._stretch, self._run = loop, stretch, CompiledRun(loop)
        columns, count = loop.recording.columns, len(stretch.points)
        widths = {name: columns[name].stop - columns[name].start for name in SIGNALS}
        self.signals = {name: np.full((count, width) if width > 1 else count, np.nan) for name, width in widths.items()}
        self.reached = self.ended = 0

    def advance(self, recording: Recording) -> None:
        """Run the arm a slice further, and keep the signals that the band needs. recording: for the slice only."""
        self.loop.recording = recording
        points, begun = self._stretch.points, self.ended
        done = self._run.advance(min(SLICE, self._stretch.rows - begun))
        first, last = np.searchsorted(points, (begun, begun + done))
        known = recording.picked(points[first:last] - begun, SIGNALS)
        for name, values in self.signals.items():
            values[first:last] = known[name]
        recording.forget()
        self.ended = begun + done
        self.reached = self._stretch.rows if self.loop.stopped else self.ended


def _memory_of_slice(loop: ClosedLoop) -> Recording:
    """Recording of the present slice of one arm after the other: with memory for each arm, the rows of a slice would
    not stay in the processor's cache."""
    recording = Recording(loop.system.layout.n, SLICE)
    recording.epochs.append(loop.state.epoch)
    return recording


@cache
def _departure(number: int, n: int) -> Departure:
    """Departure of an arm with this number and n coordinates."""
    return Departure.inside(np.random.default_rng([SEED, number, n]), n)


class ArmsAhead:
    """True arms that are run over a stretch in threads of a pool, each at most a slice ahead of the others. The loop of
    each arm is built when a thread is free for it, while the other threads run arms that are there."""

    def __init__(
        self,
        begun: ClosedLoop,
        loop_of: Callable[[int], ClosedLoop],
        count: int,
        stretch: BandStretch,
        pool: ThreadPoolExecutor,
    ) -> None:
        """begun: the run of the scenario's own true arm. loop_of: builds that of the arm with this number, of `count`
        arms."""
        self._begun, self._loop_of, self._count, self._stretch = begun, loop_of, count, stretch
        self._arms, self._waiting = list[_Arm](), list[_Arm]()
        self._lock, self._left = threading.Lock(), threading.Event()
        self._running: list[Future[None]] = [pool.submit(self._advance) for _ in range(usable_cores())]

    @property
    def reached(self) -> int:
        """Number of rows that all arms have computed."""
        return min(arm.reached for arm in self._arms) if len(self._arms) == self._count else 0

    @property
    def rows(self) -> int:
        """Number of rows of the stretch."""
        return self._stretch.rows

    @property
    def going(self) -> bool:
        """Whether any thread still runs arms."""
        return not all(each.done() for each in self._running)

    def leave(self) -> None:
        """Stop running arms; returns when all threads have stopped."""
        self._left.set()
        wait(self._running)

    def band(self) -> ArmBand | None:
        """Band of the rows that all arms have computed, None for no row. Raises what the run of an arm has raised, and
        ScenarioError where an arm cannot be built."""
        for running in self._running:
            if running.done():
                running.result()
        reached, stretch = self.reached, self._stretch
        count = int(np.searchsorted(stretch.points, reached))
        if count == 0:
            return None
        ended = [arm.loop.stopped for arm in self._arms if arm.loop.stopped and arm.ended < reached]
        period = stretch.begins.scenario.controller.period
        return ArmBand(
            stretch.since,
            reached * period,
            stretch.points[:count] * period,
            len(self._arms),
            {name: np.concatenate([arm.signals[name][:count] for arm in self._arms]) for name in SIGNALS},
            len(ended),
            ended[0] if ended else "",
            whole=reached == stretch.rows,
        )

    def _advance(self) -> None:
        """Run slices, each of the arm that has fewest rows, until all rows are computed."""
        recording = _memory_of_slice(self._begun)
        try:
            while not self._left.is_set():
                with self._lock:
                    arm = self._next()
                if arm is None:
                    return
                arm.advance(recording)
                with self._lock:
                    self._waiting.append(arm)
        except BaseException:
            self._left.set()
            raise

    def _next(self) -> _Arm | None:
        """Arm to run next, which nobody else runs meanwhile; None where there is none. To be called with the lock."""
        if len(self._arms) < self._count:
            self._arms.append(_Arm(self._loop_of(len(self._arms)), self._stretch))
            return self._arms[-1]
        behind = [arm for arm in self._waiting if arm.reached < self._stretch.rows]
        if not behind:
            return None
        arm = min(behind, key=lambda each: each.reached)
        self._waiting.remove(arm)
        return arm


class TrueArms:
    """True arms of declared sets, each with its system from one preview to the next, and threads to run them in."""

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._begun: ClosedLoop | None = None
        self._systems: dict[int, System] = {}  # by the arm's number; two threads cannot step with the same one
        self._pool = ThreadPoolExecutor(usable_cores(), "arms", lower_priority, (NICENESS,))

    def run(self, stretch: BandStretch, count: int) -> ArmsAhead:
        """Start running `count` arms over a stretch. `ArmsAhead.leave` has to be called before the next start. Raises
        ScenarioError where the scenario cannot be built."""
        begun = self._begun = ClosedLoop.from_state(stretch.begins, 1, self._begun and self._begun.system, self._memory)
        scenario, n, recording = begun.system.scenario, begun.system.robot.n, _memory_of_slice(begun)

        def loop_of(number: int) -> ClosedLoop:
            truth = _departure(number, n).truth(scenario.declared, of=scenario.truth)
            built = begun.with_truth(truth, recording, self._systems.get(number))
            self._systems[number] = built.system
            return built

        return ArmsAhead(begun, loop_of, count, stretch, self._pool)
