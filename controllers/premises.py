"""Premises of Theorem 1 in a sampled loop, the promise while they hold, and whether it is kept.

`docs/theory.md` derives each limit and the band. A promise begins anew, from the s of that instant, whenever all
premises hold again; while one fails there is no promise, and the bound is NaN.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from controllers.reaching import ReachingBound, envelope
from kernels import inline

ROUNDING = 1e-9


class Premise(IntEnum):
    """Premise of the theorem's promise for a sampled loop."""

    LAW = 0
    DECLARED = 1
    DOMAIN = 2
    REGULAR = 3
    DRIVES = 4
    JOINTS = 5
    GAIN = 6
    HELD = 7
    LAYER = 8
    GAIN_BY_CHATTER = 9
    GAIN_BY_FORCE = 10
    FORCE_LOOP = 11
    SAMPLED_LOOP = 12
    CONTACT = 13


DECLARED, DOMAIN, REGULAR, DRIVES, JOINTS, GAIN, HELD = (
    int(p) for p in Premise if Premise.DECLARED <= p <= Premise.HELD
)
LAW, LAYER, CONTACT = int(Premise.LAW), int(Premise.LAYER), int(Premise.CONTACT)
GAIN_BY_CHATTER = int(Premise.GAIN_BY_CHATTER)
OF_ROBUST_TERMS = tuple(range(Premise.GAIN, Premise.GAIN_BY_FORCE + 1))  # about d and s, which only (25) has


class PremiseTable(NamedTuple):
    """Values of the premises: each field (P,), one entry per `Premise`.
    value: compared with limit; a limit of NaN: the premise does not apply.
    margin: the least distance to the limit so far.
    failed: when it first failed, s, NaN for never.
    failing: 1 while it fails."""

    value: np.ndarray
    limit: np.ndarray
    margin: np.ndarray
    failed: np.ndarray
    failing: np.ndarray

    @classmethod
    def fresh(cls) -> PremiseTable:
        """Table of a run that has not begun."""
        empty = np.full(len(Premise), np.nan)
        return cls(empty, empty, np.full(len(Premise), np.inf), empty, np.zeros(len(Premise)))

    def applies(self, premise: Premise) -> bool:
        """Whether a premise applies: those without a limit do not, nor those about d and s under a law without."""
        lawless = self.value[LAW] > self.limit[LAW]
        return not (np.isnan(self.limit[premise]) or (lawless and premise in OF_ROBUST_TERMS))


class PromiseRecord(NamedTuple):
    """Record of the present promise, and of how it has been kept; an instant that has not come is NaN.
    reaching: bound (19) of the promise, with V_0 at the instant `since`.
    since: s, when the promise began.
    promised: whether there is a promise.
    bound, band: m/s, (20) and the band added to it, NaN without a promise.
    layer_reached, band_reached: s, when ||s|| was first within the boundary layer and within the band.
    broken: s, when ||s|| was first over bound and band though all premises held.
    periods, lost: number of periods of the run so far, and of those without a promise.
    before: whether the premises held a period ago.
    begun: s, instant of the last change."""

    reaching: ReachingBound
    since: float
    promised: bool
    bound: float
    band: float
    layer_reached: float
    band_reached: float
    broken: float
    periods: int
    lost: int
    before: bool
    begun: float

    @classmethod
    def fresh(cls) -> PromiseRecord:
        """Record of a run that has not begun."""
        return cls(
            reaching=ReachingBound(1.0, 1.0, 1.0, 1.0, 0.0),
            since=0.0,
            promised=False,
            bound=np.nan,
            band=np.nan,
            layer_reached=np.nan,
            band_reached=np.nan,
            broken=np.nan,
            periods=0,
            lost=0,
            before=True,
            begun=np.nan,
        )


@inline
def judge(table, t):
    """Compare the value of each premise that applies with its limit, see `PremiseTable.applies`; returns whether all of
    them hold."""
    all_hold, lawless = True, table.value[LAW] > table.limit[LAW]
    for i in range(table.value.shape[0]):
        value, limit = table.value[i], table.limit[i]
        if np.isnan(limit) or (lawless and i in OF_ROBUST_TERMS):
            table.failing[i] = 0.0
            continue
        margin = value - limit if i == REGULAR else limit - value
        # those from LAYER on must be below their limits; a value that is not a number fails
        fails = not (margin > 0.0 if LAYER <= i < CONTACT else margin >= -ROUNDING * max(1.0, abs(limit)))
        table.failing[i] = 1.0 if fails else 0.0
        if fails:
            all_hold = False
            if np.isnan(table.failed[i]):
                table.failed[i] = t
        if not margin >= table.margin[i]:
            table.margin[i] = margin
    return all_hold


@inline
def keep_promise(all_hold, s_norm, check, t, record):
    """Begin, continue or end the promise, and compare ||s|| (m/s) with the promised bound; returns whether the promise
    is broken.

    The effect of a period is known at its end: a premise must have held then and at the period's beginning.
    """
    standing = all_hold and record.before
    record.periods += 1
    record.before = all_hold
    if np.isnan(record.layer_reached) and s_norm <= check.layer_width:  # measured, whatever is promised
        record.layer_reached = t
    if not standing:
        record.promised, record.bound, record.band = False, np.nan, np.nan
        record.lost += 1
        return False
    if not record.promised:
        record.promised, record.since = True, t
        if t != record.begun:  # otherwise the V_0 of the change is more exact
            record.reaching.V_0 = 0.5 * check.H_max * s_norm**2
    record.bound = envelope(record.reaching, t - record.since)
    record.band = np.sqrt(2.0 * check.V_band / check.H_min)
    if np.isnan(record.band_reached) and s_norm <= record.band:
        record.band_reached = t
    over = np.isfinite(s_norm) and s_norm > record.bound + record.band
    if over and np.isnan(record.broken):
        record.broken = t
    return over
