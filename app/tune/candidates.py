"""Candidates of a tuning: judged by the worst of their true arms, and those of them that may be offered."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from app.sweep.axes import Value
from app.sweep.run_metrics import RunMetrics, metric_title
from app.tune.plan import Tuning
from controllers.premise_statements import STATEMENTS
from controllers.premises import Premise

LIMITS = {
    premise.name.lower(): STATEMENTS[premise].title
    for premise in (Premise.GAIN, Premise.LAYER, Premise.GAIN_BY_CHATTER, Premise.GAIN_BY_FORCE, Premise.FORCE_LOOP,
                    Premise.SAMPLED_LOOP)
}  # fmt: skip
LAW, GAIN = Premise.LAW.name.lower(), Premise.GAIN.name.lower()
INSTANT = re.compile(r"^t = \S+ s: ")  # at the head of the reason why a run stopped


@dataclass(frozen=True)
class Candidate:
    """Candidate, judged on some true arms.

    number: 0 has the scenario's own gains. values: of the gains, by path.
    aims: worst over the arms, in SI units; inf where an arm has none.
    badge: why it is not offered, "" where it may be. broken: share of the arms that are the reason.
    promised: share of the arms on which the theorem's promise holds throughout.
    """

    number: int
    values: dict[str, Value]
    aims: tuple[float, ...]
    badge: str
    broken: float
    promised: float

    def dominates(self, other: Candidate) -> bool:
        """Whether this candidate is better in one aim and worse in none."""
        pairs = list(zip(self.aims, other.aims, strict=True))
        return all(mine <= its for mine, its in pairs) and any(mine < its for mine, its in pairs)


def candidate_of(tuning: Tuning, number: int, values: dict[str, Value], runs: Sequence[RunMetrics]) -> Candidate:
    """Candidate with the metrics of its runs, one for each arm."""
    reasons = [_reason(tuning, run) for run in runs]
    broken = [reason for reason in reasons if reason]
    badge = ""
    if broken:
        (commonest, count), *others = Counter(broken).most_common()
        in_all = f", {len(broken)} for any reason" if others else ""
        badge = f"{commonest} ({count} of {len(runs)} arms{in_all})"
    aims = tuple(max(aim_of(run, aim) for run in runs) for aim in tuning.aims)
    promised = sum(run.get("verdict") == "holds" for run in runs) / len(runs)
    return Candidate(number, values, aims, badge, len(broken) / len(runs), promised)


def aim_of(run: RunMetrics, aim: str) -> float:
    """Metric of a run for an aim; inf where the run has none, or was stopped before its end."""
    value = None if run.get("stopped") else run.get(aim)
    return math.inf if value is None else float(value)


def _reason(tuning: Tuning, run: RunMetrics) -> str:
    """Reason why a run keeps its candidate from being offered; "" where it does not."""
    if run.get("stopped"):
        return INSTANT.sub("", str(run["stopped"]))  # equal causes are counted together
    failed = (run.get("failed") or "").split(", ")
    without_d = LAW in failed  # then (17) is about no gain of this law
    if over := [LIMITS[name] for name in failed if name in LIMITS and not (name == GAIN and without_d)]:
        return f"over its limit: {'; '.join(over)}"
    if run.get("verdict") == "broken":
        return "the promise was broken"
    return next((f"no {metric_title(aim)}" for aim in tuning.aims if math.isinf(aim_of(run, aim))), "")


def front(candidates: Iterable[Candidate]) -> list[Candidate]:
    """Candidates without a badge that no other one dominates, the best in the first aim first; of equal ones the
    earliest."""
    fit = {each.aims: each for each in reversed(list(candidates)) if not each.badge}
    best = [each for each in fit.values() if not any(other.dominates(each) for other in fit.values())]
    return sorted(best, key=lambda each: each.aims)
