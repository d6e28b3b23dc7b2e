"""Running of a tuning on all cores: batch after batch of candidates, then those to be offered on test arms."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from tqdm import tqdm

from app.process import worker_pool
from app.process.cores import usable_cores
from app.scenario.errors import ScenarioError
from app.sweep.axes import Value
from app.sweep.plan import SweepPlan, SweepRow
from app.sweep.run_metrics import RunMetrics, SweepRunner, rows_of, to_try_again
from app.sweep.running import CHUNK, SweepEstimate, last_wall_time
from app.tune.candidates import Candidate, candidate_of, front
from app.tune.plan import Tuning
from app.tune.search import Search

if TYPE_CHECKING:
    from app.sweep.run_store import RunStore  # pyarrow is large, and the page needs none

BATCH = 8  # candidates that are asked for at once, with any number of processes
MOST_OFFERED = 9  # of a front
# measured with searches of 4 and 12 candidates on two busy cores
BEGIN = 4.5  # s of a search besides its runs: its processes, the optimiser and the figure
FILES = 35_500  # bytes besides its runs: those of a sweep, the candidates and the figure
SCENARIO = 3_900  # bytes of a scenario that is offered
Task = tuple[SweepRow, ...]


@dataclass(frozen=True)
class TuningResult:
    """Result of a tuning.

    candidates: all, judged on the arms that the search sees; the scenario's own gains first.
    tried: by number, the scenario's own gains and the candidates that are offered, judged on the test arms.
    runs: by the same numbers, the metrics on each test arm.
    """

    candidates: list[Candidate]
    tried: dict[int, Candidate]
    runs: dict[int, list[RunMetrics]]


def estimated(tuning: Tuning, left: int, workers: int | None = None) -> SweepEstimate:
    """Estimate for `left` runs of a tuning, from the computing time of one run. Two are played, of different true
    arms: the first one also computes what all runs have in common, and the second what each has for itself."""
    seconds = last_wall_time(computing, tuning, (SweepRow(0, 0, 0, {}), SweepRow(1, 0, 1, {}))) if left else 0.0
    whole = None if seconds is None else left * seconds
    files = FILES + _most_offered(tuning) * SCENARIO
    return SweepEstimate.of(left, left * tuning.length, whole, workers, begin=BEGIN, files=files)


def most_runs(tuning: Tuning) -> int:
    """Number of runs of a tuning, where as many candidates as possible are offered."""
    return tuning.points * tuning.seen + (1 + _most_offered(tuning)) * tuning.unseen


def _most_offered(tuning: Tuning) -> int:
    """Largest number of candidates that are offered."""
    return 1 if len(tuning.aims) == 1 else MOST_OFFERED


def run(store: RunStore, tuning: Tuning, workers: int | None = None, *, show_progress: bool = False) -> TuningResult:
    """Compute the runs that are not done, in `workers` processes (None: one for each core), and judge all candidates.

    Raises ScenarioError where the folder has other candidates, and OSError where a run cannot be written; what was
    written stays.
    """
    schedule = TuningSchedule(tuning, without_faults(tuning, {row["row"]: row for row in store.rows}))
    total, workers = most_runs(tuning), workers or usable_cores()
    with tqdm(total=total, initial=len(schedule.known), unit=" runs", desc="tune", disable=not show_progress) as bar:
        for rows, metrics in worker_pool.results(computing, (tuning,), schedule.tasks(), workers):
            for each in schedule.take(rows, metrics):
                store.add(each)
            bar.update(len(rows))
    store.flush()
    return schedule.found()


def without_faults(tuning: Tuning, known: dict[int, RunMetrics]) -> dict[int, RunMetrics]:
    """The known runs without those that a fault has ended and that are tried again: all but those of candidates after
    which the search has chosen further ones, which could differ then."""
    candidates = [number // tuning.arms for number in known if number % tuning.arms < tuning.seen]
    batch = 1 + (max(candidates, default=0) - 1) // BATCH * BATCH  # first candidate of the last batch
    return {
        number: row
        for number, row in known.items()
        if not to_try_again(row.get("stopped"))
        or (number % tuning.arms < tuning.seen and 0 < number // tuning.arms < batch)
    }


def ended(store: RunStore) -> int:
    """Number of runs that a fault has ended."""
    last = {row["row"]: row.get("stopped") for row in store.rows}
    return sum(map(to_try_again, last.values()))


def computing(tuning: Tuning) -> Callable[[Task], list[RunMetrics]]:
    """Function that computes the metrics of runs, for a pool of processes."""
    runner = SweepRunner(tuning)
    return lambda rows: [runner.metrics_of(row) for row in rows]


class TuningSchedule:
    """Schedule of a tuning: gives out its tasks, which depend on the metrics so far, and takes their metrics."""

    def __init__(self, tuning: Tuning, known: dict[int, RunMetrics]) -> None:
        self.known = known
        self._tuning, self._plan = tuning, SweepPlan(tuning)
        self.candidates: list[Candidate] = []  # as far as they are judged
        self._offered: list[Candidate] = []

    def take(self, rows: Task, metrics: list[RunMetrics] | worker_pool.Fallen) -> list[RunMetrics]:
        """Take up the metrics of a task's runs, which are known from now on; returns them."""
        known = rows_of(self._plan, rows, metrics)
        self.known |= {each["row"]: each for each in known}
        return known

    def tasks(self) -> Iterator[Task | worker_pool.Barrier]:
        """Tasks of all runs that are not known."""
        tuning, search = self._tuning, Search(self._tuning)
        seen, unseen = range(tuning.seen), range(tuning.seen, tuning.arms)
        yield from self._missing(0, {}, seen)
        yield worker_pool.BARRIER
        self.candidates.append(self._candidate(0, {}, seen))
        for begun in range(1, tuning.points, BATCH):
            candidates = search.ask(range(begun, min(begun + BATCH, tuning.points)))
            for number, values in candidates.items():
                yield from self._missing(number, values, seen)
            yield worker_pool.BARRIER
            for number, values in candidates.items():
                self.candidates.append(self._candidate(number, values, seen))
                search.tell(self.candidates[-1])
        best = front(self.candidates[1:])
        places = np.linspace(0, len(best) - 1, min(len(best), MOST_OFFERED)).round().astype(int)
        self._offered = [best[k] for k in places]
        for each in (self.candidates[0], *self._offered):
            yield from self._missing(each.number, each.values, unseen)

    def found(self) -> TuningResult:
        """Result, when all tasks are done."""
        tried = [self.candidates[0], *self._offered]
        unseen = range(self._tuning.seen, self._tuning.arms)
        return TuningResult(
            self.candidates,
            {each.number: self._candidate(each.number, each.values, unseen) for each in tried},
            {each.number: self._runs(each.number, unseen) for each in tried},
        )

    def _candidate(self, number: int, values: dict[str, Value], arms: range) -> Candidate:
        return candidate_of(self._tuning, number, values, self._runs(number, arms))

    def _runs(self, number: int, arms: range) -> list[RunMetrics]:
        return [self.known[number * self._tuning.arms + arm] for arm in arms]

    def _missing(self, number: int, values: dict[str, Value], arms: range) -> Iterator[Task]:
        rows = [SweepRow(number * self._tuning.arms + arm, number, arm, values) for arm in arms]
        for row in rows:
            there = self.known.get(row.number)
            if there and any(there[path] != value for path, value in values.items()):
                raise ScenarioError(f"--out: candidate {number} there is another one; allowed: a folder of its own")
        left = [row for row in rows if row.number not in self.known]
        for begun in range(0, len(left), CHUNK):
            yield worker_pool.Chunk(left[begun : begun + CHUNK])
