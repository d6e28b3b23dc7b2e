"""Metrics of one run of a sweep: a row of the table, with the unit and meaning of each."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
import structlog

from app.analysis.metrics import Metrics
from app.process.worker_pool import Fallen
from app.scenario.errors import ScenarioError
from app.scenario.field_info import infos_of
from app.scenario.units import Units
from app.session.headless_run import simulate
from app.simulation.omega.search_memory import Memory
from app.simulation.system import System
from app.storage.constants_store import kept_memory
from app.sweep.plan import Sweep, SweepPlan, SweepRow
from parameters import UnitsOf

RunMetrics = dict[str, Any]
REFUSED = "refused: "  # begins the reason of a run that never began
# begins the reason of a run for which this program or its process has ended: the same command tries it again
ENDED = "ended by a fault"
log = structlog.get_logger()


class Column(NamedTuple):
    """Column of the table: unit in SI, "" for a word or a plain number, and meaning.
    more_is_better: whether the worst of several arms is the one with the least number.
    at_the_end: whether it is of the last fifth of the run only.
    may_never: whether a run without a number never came to it, or has no such promise, which is worse than any number.
    also_stopped: whether it means the same of a run that stopped.
    of: on whose units its own depends; `unit` is for revolute joints and where r is in metres.
    metric: its name in `Metrics`, "" for what is not there as a number."""

    unit: str
    meaning: str
    word: bool = False
    more_is_better: bool = False
    at_the_end: bool = False
    may_never: bool = False
    of: UnitsOf = ""
    also_stopped: bool = False
    metric: str = ""

    def unit_in(self, units: Units) -> str:
        """Unit in a task space with these units, "" for a word or a plain number."""
        unit = units.of_kind(self.of, self.unit)
        return "" if unit == "1" else unit

    def badness(self, values: object) -> np.ndarray:
        """Numbers of the size of `values`, the larger the worse. A value that is None or NaN is the worst where a run
        may never come to it, else the best."""
        known = np.asarray(values, dtype=float)
        none = np.inf if self.may_never else -np.inf
        return np.where(np.isnan(known), none, -known if self.more_is_better else known)

    @property
    def whole_meaning(self) -> str:
        """Meaning, with the part of the run that it is of."""
        return self.meaning + (", last fifth of the run" if self.at_the_end else "")


def _of_run(metric: str, **differing: Any) -> Column:
    """Column of a metric of a run. differing: what is not as in `Metrics`, or not said there."""
    info = infos_of(Metrics)[metric]
    column = Column(info.unit, info.doc, at_the_end="tail" in metric, of=info.of, metric=metric)
    return column._replace(**differing)


COLUMNS: dict[str, Column] = {
    "row": Column("", "number of the run from 0, for `--row` of `vsmrc run`"),
    "point": Column("", "number of the point from 0, of the varied fields"),
    "arm": Column("", "number of the true arm at this point, from 0"),
    "motion_error": _of_run("motion_error_tail"),
    "angle_error": _of_run("angle_error_tail"),
    "force_error": _of_run("force_error_tail"),
    "moment_error": _of_run("moment_error_tail"),
    "constraint_violation": _of_run("constraint_violation"),
    "settling_time": _of_run("settling_time", may_never=True),
    "reaching_time": _of_run("reaching_time", may_never=True),
    "layer_time_bound": _of_run("layer_time_bound", may_never=True),
    "reaching_time_bound": _of_run("reaching_time_bound"),
    "band_time": _of_run("band_time", may_never=True),
    "band_time_bound": _of_run("band_time_bound", may_never=True),
    "envelope_violation": _of_run("envelope_violation"),
    "gain_margin": _of_run("gain_condition_margin", more_is_better=True),
    "residual": _of_run("target_model_residual_tail"),
    "torque_variation": _of_run("torque_total_variation", meaning="summed changes of all commanded torques per second"),
    "saturated_share": _of_run("saturated_share"),
    "simulated_time": _of_run("simulated_time", more_is_better=True, also_stopped=True),
    "verdict": Column("", "of the theorem's promise: holds, nothing promised or broken", word=True),
    "failed": Column("", "premises of that promise that failed, by name", word=True),
    "promised_share": Column(
        "1", "share of the run for which something is promised", more_is_better=True, also_stopped=True
    ),
    "declared": Column(
        "1",
        "1 where the true arm is within what is declared, 0 where it is not",
        more_is_better=True,
        also_stopped=True,
    ),
    "stopped": Column("", "why the run ended before its time, or was refused", word=True),
    "wall_time": Column("s", "computing time", also_stopped=True),
}
TITLES = {"motion_error": "path error"}  # where the words of the page are others than those of the column's name
METRIC_COLUMNS = tuple(
    name for name, column in COLUMNS.items() if not column.word and name not in ("row", "point", "arm")
)


def metric_title(name: str) -> str:
    """Title of the metric in the column of this name."""
    return TITLES.get(name, name.replace("_", " "))


class SweepRunner:
    """Runner of a sweep's runs in one process; what runs have in common is computed once."""

    def __init__(self, sweep: Sweep) -> None:
        self._plan = SweepPlan(sweep)
        self._memory: Memory = kept_memory()
        self._previous: System | None = None

    @classmethod
    def computing(cls, sweep: Sweep) -> Callable[[tuple[int, ...]], list[RunMetrics]]:
        """Function that computes the metrics of runs by their numbers, for a pool of processes."""
        runner = cls(sweep)
        return lambda numbers: [runner.metrics(number) for number in numbers]

    def metrics(self, number: int) -> RunMetrics:
        """Metrics of the run of this number. A run that is refused or stops is a row, too."""
        return self.metrics_of(self._plan.row(number))

    def metrics_of(self, row: SweepRow) -> RunMetrics:
        """Metrics of a run, whose values may be others than those of the plan's design."""
        started = time.perf_counter()
        begun = self._plan.key_columns(row)
        try:
            scenario = self._plan.scenario(row)
            loop, metrics = simulate(
                scenario,
                until=self._plan.sweep.until,
                engine=self._plan.sweep.engine,
                previous=self._previous,
                memory=self._memory,
            )
        except (ScenarioError, ArithmeticError, ValueError) as error:
            return begun | {"stopped": f"{REFUSED}{error}", "wall_time": time.perf_counter() - started}
        except OSError as error:  # of this machine, not of this run
            raise ScenarioError(f"run {row.number} cannot be computed here: {error}; others are kept") from error
        except Exception as error:  # a fault of this program, which need not end the other runs
            log.exception("run failed", row=row.number)
            reason = f"{ENDED}: internal error: {type(error).__name__}: {error}"
            return begun | {"stopped": reason, "wall_time": time.perf_counter() - started}
        self._previous = loop.system
        inside = all(each.failed is None for each in metrics.premises if each.premise == "declared")
        return begun | _of(metrics) | {"declared": float(inside), "wall_time": time.perf_counter() - started}


def _of(metrics: Metrics) -> RunMetrics:
    row = {name: getattr(metrics, column.metric) for name, column in COLUMNS.items() if column.metric}
    row |= {
        "torque_variation": float(sum(metrics.torque_total_variation)),
        "verdict": metrics.promise.verdict,
        "failed": ", ".join(each.premise for each in metrics.premises if each.failed is not None) or None,
        "promised_share": metrics.promise.share,
        "stopped": metrics.stopped,
    }
    # JSON, in which rows wait for their Parquet file, has no infinite numbers
    return {name: None if isinstance(each, float) and not math.isfinite(each) else each for name, each in row.items()}


def rows_of(plan: SweepPlan, runs: Iterable[SweepRow], metrics: list[RunMetrics] | Fallen) -> list[RunMetrics]:
    """Metrics of these runs as they were computed; of runs whose process has ended, rows that say so."""
    if not isinstance(metrics, Fallen):
        return metrics
    return [plan.key_columns(run) | {"stopped": f"{ENDED}: the process that computed it has ended"} for run in runs]


def columns_of(rows: Sequence[RunMetrics]) -> dict[str, np.ndarray]:
    """Columns of rows by name: those of every run and of the varied fields, NaN or None where a row has no value."""
    names = {name for row in rows for name in row} | set(COLUMNS)
    words = {name for name, column in COLUMNS.items() if column.word}
    columns = {}
    for name in names:
        values = [row.get(name) for row in rows]
        columns[name] = (
            np.array(values, dtype=object)
            if name in words
            else np.array([np.nan if value is None else value for value in values])
        )
    return columns


def to_try_again(stopped: str | None) -> bool:
    """Whether a run with this reason for its end says nothing of its scenario."""
    return (stopped or "").startswith(ENDED)
