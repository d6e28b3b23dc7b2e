"""Search for better gains in the background: candidates come in as they are judged, and at the end what was found."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from app.process import worker_pool
from app.sweep.background import Background
from app.sweep.run_metrics import RunMetrics
from app.tune.candidates import Candidate, front
from app.tune.offers import badged, front_left
from app.tune.plan import Tuning
from app.tune.running import TuningResult, TuningSchedule, computing, most_runs

Result = RunMetrics | Candidate | TuningResult


class BackgroundTuning(Background):
    """Tuning that is computed in the background, with the same answer as `vsmrc tune`.

    most: largest number of runs. found: None until the end.
    """

    noun = "search"

    def __init__(self, tuning: Tuning, workers: int, at_once: int | None = None) -> None:
        self.tuning, self.most = tuning, most_runs(tuning)
        self.found: TuningResult | None = None
        self._rows: list[RunMetrics] = []
        self._candidates: list[Candidate] = []
        super().__init__(tuning, workers, at_once)

    @property
    def candidates(self) -> Sequence[Candidate]:
        """Candidates so far, the scenario's own gains first. At the end those that are not offered since they failed on
        the test arms have that as their badge."""
        return self._candidates[:] if self.found is None else badged(self.tuning, self.found)

    @property
    def front(self) -> Sequence[Candidate]:
        """Front of the candidates so far, at the end without those that are not offered."""
        return front(self._candidates[1:]) if self.found is None else front_left(self.tuning, self.found)

    @property
    def rows(self) -> Sequence[RunMetrics]:
        """Rows so far, in the order in which they were computed."""
        return self._rows[:]

    @property
    def runs(self) -> int:
        """Number of runs so far."""
        return len(self._rows)

    def take(self, result: Result) -> None:
        if isinstance(result, Candidate):
            self._candidates.append(result)
        elif isinstance(result, TuningResult):
            self.found = result
        else:
            self._rows.append(result)


def results(tuning: Tuning, workers: int) -> Iterator[Result]:
    """Rows of runs, candidates as soon as they are judged, and at the end what was found."""
    schedule, sent = TuningSchedule(tuning, {}), 0
    for rows, metrics in worker_pool.results(computing, (tuning,), schedule.tasks(), workers):
        yield from schedule.take(rows, metrics)
        yield from schedule.candidates[sent:]
        sent = len(schedule.candidates)
    yield from schedule.candidates[sent:]
    yield schedule.found()
