"""Offers of a tuning: which of its candidates may be used once some were tried on test arms, and why the others
may not."""

from __future__ import annotations

from dataclasses import replace

from app.tune.candidates import Candidate, aim_of, front
from app.tune.plan import Tuning
from app.tune.running import TuningResult

WITHOUT_EFFECT = "it changes nothing on any test arm"


def reason_against(tuning: Tuning, found: TuningResult, number: int) -> str:
    """Reason why a candidate that was tried is not offered, "" where it may be used: it has a badge on the arms that
    were not seen, too, or leaves every metric there as it is with the own gains, as gains without effect do."""
    if badge := found.tried[number].badge:
        return f"on the test arms, {badge}"
    return WITHOUT_EFFECT if _changes_nothing(tuning, found, number) else ""


def _changes_nothing(tuning: Tuning, found: TuningResult, number: int) -> bool:
    """Whether a candidate has the own gains' metrics on every test arm."""
    return all(
        aim_of(mine, aim) == aim_of(own, aim)
        for mine, own in zip(found.runs[number], found.runs[0], strict=True)
        for aim in tuning.aims
    )


def offered(tuning: Tuning, found: TuningResult) -> list[Candidate]:
    """Candidates that may be used, as judged on the test arms."""
    return [each for number, each in found.tried.items() if number and not reason_against(tuning, found, number)]


def front_left(tuning: Tuning, found: TuningResult) -> list[Candidate]:
    """Front of the candidates, as judged on the arms that were seen, without those that are not offered. No other one
    takes the place of these, since it was not tried."""
    return [
        each
        for each in front(found.candidates[1:])
        if each.number not in found.tried or not reason_against(tuning, found, each.number)
    ]


def badged(tuning: Tuning, found: TuningResult) -> list[Candidate]:
    """All candidates, as judged on the arms that were seen; those that were tried and are not offered have the reason
    as their badge."""
    against = {number: reason_against(tuning, found, number) for number in found.tried if number}
    return [replace(each, badge=each.badge or against.get(each.number, "")) for each in found.candidates]
