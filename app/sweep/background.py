"""Sweep in the background: processes of its own of low priority, whose rows come in one after the other."""

from __future__ import annotations

import subprocess
import threading
from collections.abc import Sequence
from multiprocessing import Pipe

from app.process import launcher
from app.sweep.figures_of_run import Figures
from app.sweep.question import Question, Sweep

STRIDES = (4, 2, 1)  # between the tiles of a map that are computed first, then, and last
LINGER = 10.0  # s that a process has to end


class BackgroundSweep:
    """Sweep that is computed from now on, until it is done or cancelled. May be used from any thread."""

    def __init__(self, sweep: Sweep, workers: int) -> None:
        self.question = Question(sweep)
        self._workers = workers
        self._rows: list[Figures] = []
        self._cancelled = threading.Event()
        self.problem = ""
        # launcher: its process ends with the thread that starts it
        self._thread = threading.Thread(target=self._run, name="sweep", daemon=True)
        self._thread.start()

    @property
    def rows(self) -> Sequence[Figures]:
        """Rows so far, in the order in which they were computed."""
        return self._rows[:]

    @property
    def going(self) -> bool:
        """Whether it is being computed."""
        return self._thread.is_alive()

    def cancel(self) -> None:
        """End it; its rows stay."""
        self._cancelled.set()

    def _run(self) -> None:
        ours, theirs = Pipe()
        process = None
        try:
            with ours:
                with theirs:
                    file = theirs.fileno()
                    process = launcher.start("app.workers.sweep", str(file), stdin=subprocess.DEVNULL, pass_fds=(file,))
                ours.send((self.question.sweep, coarse_first(self.question), self._workers))
                while len(self._rows) < self.question.count and not self._cancelled.is_set():
                    if ours.poll(0.1):
                        self._rows.append(ours.recv())
        except (EOFError, OSError) as error:
            self.problem = f"the map could not be computed: {error or 'its process has ended'}"
        finally:
            if process is not None:
                try:  # its connection is closed: it ends by itself, with all of its pool
                    process.wait(LINGER)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()


def coarse_first(question: Question) -> list[int]:
    """Numbers of all runs of a grid, every fourth tile in each direction first."""
    shape = [len(axis.values) for axis in question.sweep.vary]

    def fineness(point: int) -> int:
        places, rest = [], point
        for length in reversed(shape):
            rest, place = divmod(rest, length)
            places.append(place)
        return max(next(k for k, stride in enumerate(STRIDES) if place % stride == 0) for place in places)

    points = sorted(range(question.count_of_points), key=fineness)
    return [point * question.arms + arm for point in points for arm in range(question.arms)]
