"""Background computation: a sweep, or a search for gains, in processes of its own of low priority, whose results come
in one after the other."""

from __future__ import annotations

import subprocess
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from multiprocessing import Pipe
from typing import Any

from app.process import launcher, worker_pool
from app.sweep.plan import Sweep, SweepPlan
from app.sweep.run_metrics import RunMetrics, SweepRunner, rows_of
from app.sweep.running import tasks_of

STRIDES = (4, 2, 1)  # from one tile of a map to the next, of those computed first, second and last
LINGER = 10.0  # s that a process has to end


@dataclass(frozen=True)
class ComputeRequest:
    """Message to the process: compute this.
    request: a sweep, or a tuning.
    workers: processes of the pool. at_once: see `app.process.slots`."""

    request: Sweep
    workers: int
    at_once: int | None


@dataclass(frozen=True)
class Waiting:
    """Message from the process: all slots are taken, it waits for one."""


@dataclass(frozen=True)
class Begun:
    """Message from the process: it has a slot."""


@dataclass(frozen=True)
class SweepDone:
    """Message from the process, the last."""


@dataclass(frozen=True)
class SweepFailed:
    """Message from the process, instead of the last: why it does not go on."""

    reason: str


class Background:
    """Computation that is started now and goes on until it is done or cancelled. May be used from any thread.

    waiting: whether it waits for a slot, until computations of other sessions are done.
    problem: why it has failed, "" where it has not.
    """

    noun = "computation"

    def __init__(self, request: Sweep, workers: int, at_once: int | None = None) -> None:
        self.plan = SweepPlan(request)
        self.problem, self.waiting = "", False
        self._work = ComputeRequest(request, workers, at_once)
        self._done, self._cancelled = threading.Event(), threading.Event()
        # launcher: its process ends with the thread that starts it
        self._thread = threading.Thread(target=self._run, name=self.noun, daemon=True)
        self._thread.start()

    @property
    def going(self) -> bool:
        """Whether the computation goes on."""
        return self._thread.is_alive()

    @property
    def complete(self) -> bool:
        """Whether everything has been computed."""
        return self._done.is_set()

    def cancel(self) -> None:
        """End the computation; its results so far stay."""
        self._cancelled.set()

    def take(self, result: Any) -> None:
        """Keep a result that the process has sent."""
        raise NotImplementedError

    def _run(self) -> None:
        process = None
        try:
            ours, theirs = Pipe()
            with ours:
                with theirs:
                    file = theirs.fileno()
                    process = launcher.start(
                        "app.workers.sweep", str(file), niceness=19, stdin=subprocess.DEVNULL, pass_fds=(file,)
                    )
                ours.send(self._work)
                while not (self.complete or self.problem or self._cancelled.is_set()):
                    if ours.poll(0.1):
                        self._handle(ours.recv())
        except (EOFError, ConnectionError):
            self._fail("its process has ended")
        except OSError as error:
            self._fail(error.strerror or str(error))
        finally:
            self.waiting = False
            if process is not None:
                if self._cancelled.is_set():  # otherwise it would notice only when it has the next result
                    process.terminate()
                try:  # its connection is closed: it ends by itself, with all of its pool
                    process.wait(LINGER)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()

    def _fail(self, reason: str) -> None:
        self.problem = f"the {self.noun} could not be computed: {reason}"

    def _handle(self, message: Any) -> None:
        if isinstance(message, Waiting | Begun):
            self.waiting = isinstance(message, Waiting)
        elif isinstance(message, SweepDone):
            self._done.set()
        elif isinstance(message, SweepFailed):
            self._fail(message.reason)
        else:
            self.take(message)


class BackgroundSweep(Background):
    """Sweep that is computed in the background, the tiles of a map coarse first."""

    noun = "map"

    def __init__(self, sweep: Sweep, workers: int, at_once: int | None = None) -> None:
        self._rows: list[RunMetrics] = []
        super().__init__(sweep, workers, at_once)

    @property
    def rows(self) -> Sequence[RunMetrics]:
        """Rows so far, in the order in which they were computed."""
        return self._rows[:]

    def take(self, result: RunMetrics) -> None:
        self._rows.append(result)


def results(sweep: Sweep, workers: int) -> Iterator[RunMetrics]:
    """Rows of a sweep, in the order in which they are computed, coarse first."""
    plan = SweepPlan(sweep)
    tasks = tasks_of(coarse_first(plan), workers)
    for task, metrics in worker_pool.results(SweepRunner.computing, (sweep,), tasks, workers):
        yield from rows_of(plan, map(plan.row, task), metrics)


def coarse_first(plan: SweepPlan) -> list[int]:
    """Numbers of all runs of a grid, every fourth tile in each direction first."""
    shape = [len(axis.values) for axis in plan.sweep.vary]

    def fineness(point: int) -> int:
        places, rest = [], point
        for length in reversed(shape):
            rest, place = divmod(rest, length)
            places.append(place)
        return max(next(k for k, stride in enumerate(STRIDES) if place % stride == 0) for place in places)

    points = sorted(range(plan.count_of_points), key=fineness)
    return [point * plan.arms + arm for point in points for arm in range(plan.arms)]
