"""Band of a preview: the same next seconds with other true arms, drawn within what the scenario declares."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass

import msgspec
import numpy as np

from app.analysis.metrics import MULTIPLIERS
from app.scenario.departures import Departure
from app.scenario.schema import Declared
from app.simulation.closed_loop import ClosedLoop
from app.simulation.compiled_run import CompiledRun
from app.simulation.search_memory import Memory
from app.simulation.state import State
from app.simulation.system import System

SIGNALS = ("t", "e_r", "r", "F", "F_c", "F_cd", "s_norm", "d", *MULTIPLIERS)  # of which plots show a band
LATER = 1.0  # s beyond the preview: the run goes on while arms are computed
NICENESS = 19  # of the threads
SEED = 0  # the same arms in every preview: what moves in the picture is the slider's doing


@dataclass(frozen=True)
class Band:
    """Signals of true arms over a stretch of time.
    since: s, the instant of the run from which they are computed.
    ahead: (N,) s after that.
    arms: number of them, so many of `asked`.
    signals: (arms · N, ...), one arm after the other; nan beyond the end of an arm that stopped.
    stopped: number of those, and `because`, the reason of the first one."""

    since: float
    ahead: np.ndarray
    arms: int
    asked: int
    signals: Mapping[str, np.ndarray]
    stopped: int
    because: str


@dataclass(frozen=True)
class Course:
    """Course of one true arm.
    signals: at some instants, (N, ...), nan beyond its end.
    stopped: why it stopped, None where it did not."""

    signals: Mapping[str, np.ndarray]
    stopped: str | None


@dataclass(frozen=True)
class Stretch:
    """Stretch of time over which arms are run.
    since: s, the instant of the run that is looked ahead from.
    begins: the state from which all arms go on, of another instant where an edit begins the scenario anew.
    rows: control periods.
    points: (N,), numbers of the rows that are kept."""

    since: float
    begins: State
    rows: int
    points: np.ndarray

    @classmethod
    def beyond(cls, since: float, begins: State, rows: int, points: np.ndarray) -> Stretch:
        """Stretch of a preview with so many rows, of which these points are drawn, and of `LATER` s more."""
        more = round(LATER / begins.scenario.controller.period)
        return cls(since, begins, rows + more, np.append(points, np.linspace(rows, rows + more - 1, 20).astype(int)))

    def band(self, courses: list[Course], asked: int) -> Band:
        """Band of the courses so far."""
        reasons = [course.stopped for course in courses if course.stopped is not None]
        return Band(
            self.since,
            self.points * self.begins.scenario.controller.period,
            len(courses),
            asked,
            {name: np.concatenate([course.signals[name] for course in courses]) for name in SIGNALS},
            len(reasons),
            reasons[0] if reasons else "",
        )


def uncertain(declared: Declared) -> bool:
    """Whether true arms may differ from the believed one."""
    return msgspec.structs.replace(declared, force_error=0.0) != Declared()


class TrueArms:
    """True arms of declared sets, each with its system from one preview to the next, and threads to run them in."""

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._begun: ClosedLoop | None = None
        self._systems: dict[int, System] = {}  # by the arm's number; two threads cannot step with the same one
        self._count = os.cpu_count() or 1
        self._pool = ThreadPoolExecutor(self._count, "arms", initializer=_yield_to_others)

    def courses(self, stretch: Stretch, count: int) -> Iterator[list[Course]]:
        """The courses so far, longer by one each time, of so many arms. The compiled run must be able to take them.
        Raises ScenarioError where an arm cannot be built."""
        begun = self._begun = ClosedLoop.resume(stretch.begins, 1, self._begun and self._begun.system, self._memory)
        done: list[Course] = []
        running: list[Future[Course]] = []
        try:
            for number in range(count):
                loop = self._branch(begun, stretch.rows, number)
                running.append(self._pool.submit(_course, loop, stretch))
                while len(running) >= self._count:
                    done.append(running.pop(0).result())
                    yield done
            while running:
                done.append(running.pop(0).result())
                yield done
        finally:
            wait(running)  # their systems are used again

    def _branch(self, begun: ClosedLoop, rows: int, number: int) -> ClosedLoop:
        scenario, n = begun.system.scenario, begun.system.robot.n
        departure = Departure.inside(np.random.default_rng([SEED, number, n]), n)
        truth = departure.truth(scenario.declared, of=scenario.truth)
        changed = msgspec.structs.replace(scenario, truth=truth)
        loop = begun.branch(changed, rows, self._systems.get(number), self._memory)
        self._systems[number] = loop.system
        return loop


def _yield_to_others() -> None:
    os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICENESS)


def _course(loop: ClosedLoop, stretch: Stretch) -> Course:
    CompiledRun(loop).advance(stretch.rows)
    known = loop.recording.picked(stretch.points[stretch.points < len(loop.recording)])
    signals = {}
    for name in SIGNALS:
        values = known[name]
        signals[name] = np.full((len(stretch.points), *values.shape[1:]), np.nan)
        signals[name][: len(values)] = values
    return Course(signals, loop.stopped)
