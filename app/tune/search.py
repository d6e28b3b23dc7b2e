"""Search for better gains: a tree-structured Parzen estimator of optuna, asked in batches of a fixed size, so that its
answer does not depend on the number of processes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from app.sweep.axes import Value
from app.sweep.plan import SweepPlan
from app.tune.candidates import Candidate
from app.tune.plan import Tuning

if TYPE_CHECKING:
    from optuna.trial import Trial

FIRST = 16  # candidates of the design, before the estimator chooses


class Search:
    """Search of one tuning. The caller asks for candidates, and tells of them when they are judged, in the order of
    their numbers."""

    def __init__(self, tuning: Tuning) -> None:
        import optuna  # here: the other commands need not wait for it

        optuna.logging.set_verbosity(optuna.logging.WARNING)
        sampler = optuna.samplers.TPESampler(n_startup_trials=FIRST, seed=tuning.seed)
        self._study = optuna.create_study(directions=["minimize" for _ in tuning.aims], sampler=sampler)
        self._trials: dict[int, Trial] = {}
        self._axes = tuning.vary
        plan = SweepPlan(tuning)
        for point in range(1, min(FIRST + 1, tuning.points)):
            self._study.enqueue_trial(plan.values_at(point))

    def ask(self, numbers: Sequence[int]) -> dict[int, dict[str, Value]]:
        """Gains of the candidates with these numbers: by number, their values by path, rounded to four digits where
        that is within their range."""
        candidates: dict[int, dict[str, Value]] = {}
        for number in numbers:
            trial = self._trials[number] = self._study.ask()
            candidates[number] = {
                axis.path: _rounded(
                    trial.suggest_float(axis.path, axis.low, axis.high, log=axis.logarithmic), axis.low, axis.high
                )
                for axis in self._axes
            }
        return candidates

    def tell(self, candidate: Candidate) -> None:
        """Tell the estimator the aims of a candidate and, as a constraint, the share of arms that are the reason for
        its badge."""
        trial = self._trials.pop(candidate.number)
        trial.set_constraint("broken", candidate.broken)
        self._study.tell(trial, candidate.aims)


def _rounded(value: float, low: float, high: float) -> float:
    """The value with four digits; as it is where these are out of its range, or too few for a narrow one."""
    rounded = float(f"{value:.4g}")
    return rounded if low <= rounded <= high and abs(rounded - value) <= 1e-3 * (high - low) else value
