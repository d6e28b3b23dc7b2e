"""Points of a sweep with one number each, over the true arms of each point."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from app.scenario.errors import ScenarioError
from app.sweep.plan import Sweep
from app.sweep.run_metrics import COLUMNS, METRIC_COLUMNS, Column
from controllers.premises import Premise
from parameters import allowed

Statistic = Literal["share", "median", "worst"]
Kind = Literal["map", "slices", "scatter", "parallel"]
CONFIDENCE = 0.95


@dataclass(frozen=True)
class SweepView:
    """View: what a chart of a sweep shows.

    metric: column of the table.
    within: limit, for the share of arms that keep it, None for none.
    statistic: over the arms of a point.
    over: paths of the axes, by default all.
    kind: of the chart, None for the one that suits the sweep.
    """

    metric: str
    within: float | None = None
    statistic: Statistic | None = None
    over: tuple[str, ...] = ()
    kind: Kind | None = None

    @property
    def name(self) -> str:
        """Name that tells it from other views of the same sweep."""
        limit = None if self.within is None else f"within-{self.within:g}"
        return "-".join(filter(None, (self.metric, limit, self.statistic, self.kind, *self.over)))


@dataclass(frozen=True)
class Points:
    """Points of a sweep with one number each.

    values: of the axes by path, (N,) each.
    number: (N,), NaN where no arm has one, where `never`, and where `absent`, also of a share: a run without the metric
        neither keeps a limit nor misses it, nor does one that stopped where no run has the metric.
    never: (N,) bool, whether an arm never reached the event that is measured: it did not settle, or its run stopped.
    good, arms: (N,), number of arms that keep the limit, and of all arms.
    counted: (N,), number of arms that have the metric, or never came to it: those of a share, median or worst.
    stopped: (N,) bool, whether a run stopped or was refused.
    absent: (N,) bool, whether no arm has the metric although a run went on to its end, as a force error where no force
        is controlled.
    theorem, declared: (N,), 1 where (17) and the declaration hold for all arms, 0 where not, NaN where none is known.
    holding, broken: (N,), number of arms whose promise holds, and of those whose promise is broken.
    failed: names of the premises that failed for at least one arm, N tuples, in the order of the theorem's table.
    """

    values: Mapping[str, np.ndarray]
    number: np.ndarray
    never: np.ndarray
    good: np.ndarray
    arms: np.ndarray
    counted: np.ndarray
    stopped: np.ndarray
    absent: np.ndarray
    theorem: np.ndarray
    declared: np.ndarray
    holding: np.ndarray
    broken: np.ndarray
    failed: tuple[tuple[str, ...], ...]


def points_of(sweep: Sweep, columns: Mapping[str, np.ndarray], view: SweepView) -> Points:
    """Points of a table's columns. Raises ScenarioError for a metric that there is not."""
    if view.metric not in METRIC_COLUMNS:
        raise ScenarioError(f"--of {view.metric!r:.60}; {allowed(view.metric, METRIC_COLUMNS)}")
    statistic = statistic_of(view)
    if (statistic == "share") != (view.within is not None):
        given = "without --within" if view.within is None else f"with --within {view.within:g}"
        raise ScenarioError(f"--show {statistic}: {given}; allowed: share with --within, others without")
    order = np.argsort(columns["point"], kind="stable")
    point = columns["point"][order]
    begins = np.flatnonzero(np.r_[True, np.diff(point) > 0])
    metric = np.asarray(columns[view.metric], dtype=float)[order]
    stopped = np.array([bool(each) for each in columns["stopped"]])[order]
    column = COLUMNS[view.metric]
    limit = np.inf if view.within is None else view.within
    keeps = (metric >= limit if column.more_is_better else metric <= limit) & (~stopped | column.also_stopped)
    margin, inside = (np.asarray(columns[name], dtype=float)[order] for name in ("gain_margin", "declared"))
    has = ~np.isnan(metric) & (~stopped | column.also_stopped)
    lacks = np.isnan(metric) & ~stopped & (not column.may_never)
    groups = [slice(a, b) for a, b in zip(begins, [*begins[1:], len(point)], strict=True)]
    arms = np.array([g.stop - g.start for g in groups])
    good = np.array([int(keeps[g].sum()) for g in groups])
    counted = np.array([int((~lacks[g]).sum()) for g in groups])
    number = (
        good / np.maximum(counted, 1)
        if statistic == "share"
        else np.array([_statistic(metric[g], stopped[g], statistic, column) for g in groups])
    )
    absent = np.array([bool(lacks[g].any() and not has[g].any()) for g in groups])
    nowhere = absent.any() and not has.any()
    verdict = np.array([str(each) for each in columns["verdict"]])[order]
    return Points(
        values={axis.path: np.asarray(columns[axis.path])[order][begins] for axis in sweep.vary},
        number=np.where(np.isinf(number) | absent | nowhere, np.nan, number),
        never=np.isinf(number),
        good=good,
        arms=arms,
        counted=counted,
        stopped=np.array([bool(stopped[g].any()) for g in groups]),
        absent=absent,
        theorem=np.array([_all_from(margin[g], -1e-9) for g in groups]),
        declared=np.array([_all_from(inside[g], 1.0) for g in groups]),
        holding=np.array([int((verdict[g] == "holds").sum()) for g in groups]),
        broken=np.array([int((verdict[g] == "broken").sum()) for g in groups]),
        failed=tuple(_failed(columns["failed"][order][g]) for g in groups),
    )


def require_metric(columns: Mapping[str, np.ndarray], metric: str) -> None:
    """Raise ScenarioError for a metric that no run of a table has, of which a chart would be empty."""
    known = [name for name in METRIC_COLUMNS if np.isfinite(np.asarray(columns[name], dtype=float)).any()]
    if metric in METRIC_COLUMNS and metric not in known:
        raise ScenarioError(f"--of {metric}: no run of this sweep has it; {allowed(metric, known)}")


def statistic_of(view: SweepView) -> Statistic:
    """Statistic that a view shows: by default the share where the view has a limit, else the worst."""
    return view.statistic or ("worst" if view.within is None else "share")


def interval(good: int, arms: int) -> tuple[float, float]:
    """Confidence interval of a share, Wilson's of 95 %; from 0 to 1 where there is no arm."""
    if not arms:
        return 0.0, 1.0
    from scipy.stats import binomtest  # a page without a map need not load it

    found = binomtest(good, arms).proportion_ci(CONFIDENCE, "wilson")
    return float(found.low), float(found.high)


def _failed(listed: np.ndarray) -> tuple[str, ...]:
    """Names of premises in these cells of the column "failed", each once."""
    names = {name for cell in listed if cell for name in cell.split(", ")}
    return tuple(premise.name.lower() for premise in Premise if premise.name.lower() in names)


def _all_from(values: np.ndarray, least: float) -> float:
    """1 where all known ones of these values are at least `least`, 0 where one is not, NaN where none is known."""
    known = values[~np.isnan(values)]
    return float((known >= least).all()) if len(known) else math.nan


def _statistic(values: np.ndarray, stopped: np.ndarray, statistic: Statistic, column: Column) -> float:
    """Median or worst of a column's values; inf where an arm never reached the measured event, NaN where no arm has a
    value. An arm that stopped or was refused counts as never, unless stopped runs have the metric too
    (`also_stopped`)."""
    ended = stopped & (not column.also_stopped)
    lacks = np.isnan(values) | ended
    never = lacks if column.may_never else lacks & stopped
    if lacks.all():
        return math.nan
    if never.any() and statistic == "worst":
        return math.inf
    badness = np.where(never, np.inf, column.badness(values))[~lacks | never]
    found = float(np.median(badness) if statistic == "median" else np.max(badness))
    return found if math.isinf(found) else -found if column.more_is_better else found
