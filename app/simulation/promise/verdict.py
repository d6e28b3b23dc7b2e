"""Verdict on the theorem's promise for a run, in words and numbers, and the findings on each premise."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from msgspec import Struct

from app.scenario.units import Units
from controllers.control_law import ControlLaw
from controllers.laws.table import LAWS
from controllers.premise_statements import STATEMENTS
from controllers.premises import Premise, PremiseTable, PromiseRecord

Outcome = Literal["holds", "broken", "nothing promised"]


class Finding(Struct, frozen=True):
    """One premise at this instant.
    value and limit: what is compared, in `unit`, by `sign`.
    margin: the least so far.
    holds: now.
    failed: when it first failed, s, None while it has not."""

    premise: str
    title: str
    value: float | None
    sign: str
    limit: float
    unit: str
    margin: float | None
    holds: bool
    failed: float | None


class PromiseVerdict(Struct, frozen=True):
    """Verdict on the theorem's promise, for a run or an instant.
    because: reason of the verdict, in one sentence.
    share: of the control periods so far in which all premises held.
    since: when the present promise began, s, None where nothing is promised."""

    verdict: Outcome
    because: str
    share: float
    since: float | None


@dataclass(frozen=True)
class Standing:
    """Standing of the theorem's promise in a run up to now.
    table: values, limits and failures of the premises.
    promise_record: how the promise has been kept.
    stopped: why the run has stopped, as a sentence; None where it goes on.
    outsiders: sentences on the declared bounds that the true arm violates.
    units: of the task space.
    law: the control law.
    losses: which rigid surfaces were lost, and when.
    waiting: whether the run has changed and no control period has been computed since."""

    table: PremiseTable
    promise_record: PromiseRecord
    stopped: str | None
    outsiders: Sequence[str]
    units: Units
    law: ControlLaw
    losses: str
    waiting: bool = False

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings on the premises that apply now, in the table's order."""
        return tuple(self._finding(p) for p in Premise if self.table.applies(p))

    @property
    def findings_of_run(self) -> tuple[Finding, ...]:
        """Findings on the premises that apply now or have failed before."""
        table = self.table
        told = (p for p in Premise if table.applies(p) or not math.isnan(table.failed[p] + table.limit[p]))
        return tuple(self._finding(p) for p in told)

    def _finding(self, premise: Premise) -> Finding:
        table, words = self.table, STATEMENTS[premise]
        value, failed, margin = (float(column[premise]) for column in (table.value, table.failed, table.margin))
        return Finding(
            premise=premise.name.lower(),
            title=words.title,
            value=_number(value),
            sign=words.sign,
            limit=float(table.limit[premise]),
            unit=unit_of(premise, self.units),
            margin=_number(margin),
            holds=not table.failing[premise],
            failed=_number(failed),
        )

    @property
    def now(self) -> PromiseVerdict:
        """Verdict on this instant; once a promise is broken, it stays so: nothing that the program says of promises can
        be relied on then."""
        if self.stopped is None and not math.isnan(self.promise_record.broken):
            return self._promise("broken", self._broken())
        if self.stopped is not None:
            return self._promise("nothing promised", f"the run has stopped: {self.stopped}")
        failing = [p for p in Premise if self.table.failing[p]]
        if failing:
            return self._promise("nothing promised", self._because(failing[0]))
        if self.waiting:
            what = "the change" if self.promise_record.periods else "the run"
            return self._promise("nothing promised", f"{what} is judged in the next control period")
        if not self.promise_record.promised:
            return self._promise("nothing promised", "a premise failed a control period ago")
        return self._promise(
            "holds",
            f"all premises hold, and ‖s‖ is under (20) plus the band, since {self._since}",
        )

    @property
    def reason(self) -> str:
        """Reason of the verdict on this instant, in a few words."""
        if self.stopped is not None:
            return "stopped"
        usual = f"all premises hold since {self._since}" if self.promise_record.promised else ""
        if self.waiting:
            usual = "judged in the next control period"
        return next((f"premise not met: {STATEMENTS[p].title}" for p in Premise if self.table.failing[p]), usual)

    @property
    def run(self) -> PromiseVerdict:
        """Verdict on the run as a whole: after one failure of a premise nothing is promised."""
        if not math.isnan(self.promise_record.broken):
            return self._promise("broken", self._broken())
        failed = [p for p in Premise if not math.isnan(self.table.failed[p])]
        if failed:
            first = min(failed, key=lambda p: self.table.failed[p])
            lost = f"; contact: {self.losses}" if self.losses else ""
            return self._promise(
                "nothing promised",
                f"from t = {self.table.failed[first]:.4g} s, premise not met: {STATEMENTS[first].title}{lost}",
            )
        if self.stopped is not None:
            return self._promise("nothing promised", f"the run has stopped: {self.stopped}")
        if not self.promise_record.periods:
            return self._promise("nothing promised", "no control period has been computed")
        return self._promise("holds", "all premises held, and ‖s‖ stayed under (20) plus the band")

    @property
    def _since(self) -> str:
        """Words on the instant at which the present promise began: an edit, a push or its end begins it anew."""
        record = self.promise_record
        change = "the change at " if record.since == record.begun > 0.0 else ""
        return f"{change}t = {record.since:.4g} s"

    def _broken(self) -> str:
        return f"at t = {self.promise_record.broken:.4g} s ‖s‖ was over (20) plus the band, though all premises held"

    def _because(self, premise: Premise) -> str:
        if premise is Premise.DECLARED and self.outsiders:
            return f"the true arm is outside the declared set: {self.outsiders[0]}"
        if premise is Premise.CONTACT and self.losses:
            return f"contact with a rigid surface is missing: {self.losses}"
        return sentence(premise, self.table.value[premise], self.table.limit[premise], self.units, self.law)

    def _promise(self, verdict: Outcome, because: str) -> PromiseVerdict:
        fraction = 1.0 - self.promise_record.lost / max(self.promise_record.periods, 1)
        return PromiseVerdict(
            verdict, because, fraction, self.promise_record.since if self.promise_record.promised else None
        )


def unit_of(premise: Premise, units: Units) -> str:
    """Unit of a premise in this task space."""
    of = STATEMENTS[premise].of
    return units.of_kind(of, {"r": "N", "joints": "rad", "J_q": "m", "": ""}[of]).removesuffix("1")


def sentence(premise: Premise, value: float, limit: float, units: Units, law: ControlLaw) -> str:
    """Sentence on a premise that fails under this law."""
    statement = STATEMENTS[premise]
    words = statement.unknown if math.isinf(value) and statement.unknown else statement.failed
    digits = next((k for k in (4, 6, 9) if f"{value:.{k}g}" != f"{limit:.{k}g}"), 12)  # so that both are told apart
    number, bound, unit = f"{value:.{digits}g}", f"{limit:.4g}", unit_of(premise, units)
    text = words.format(value=number, limit=bound, unit=unit, ways=_ways(law))
    return " ".join(text.split()).replace(" )", ")")  # as it reads without a unit


def _ways(law: ControlLaw) -> str:
    """Ways to a stable sampled loop, of what this law has; whether a law of one's own has the target model is not
    known."""
    delay = ["a smaller delay of the sensor"] if law.feels_force else []
    if law.robust:
        gains = ["a softer target model", "or smaller K_s and F_1"]
    else:
        gains = ["or a softer target model" if LAWS.get(law.kind) is law else "or smaller gains"]
    return ", ".join(["a shorter control period", *delay, *gains])


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
