"""Premises of Theorem 1 in a sampled loop, the promise while they hold, and whether it is kept.

`docs/theory.md` derives each limit and the band. A promise begins anew, from the s of that instant, whenever all
premises hold again; while one fails there is no promise, and the bound is NaN.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from controllers.bounds import (
    Equivalent,
    GainInput,
    RequiredGain,
    carried_mass,
    growth_with_speed,
    inertia_lower_bound,
    inertia_spread,
    payload_reach,
    required_d,
    sensor_error,
    terms_of_gain,
)
from controllers.control_law import joint_acceleration, joint_velocity
from controllers.reaching import ReachingBound, envelope
from controllers.switching import SAMPLING_SHARE, layer_width
from controllers.task_space import Scratch
from kernels import inline
from kernels.algebra import (
    congruence,
    copy,
    invert,
    is_positive_definite,
    multiply,
    row_times,
    spectral_norm,
)

# longest interval between two posture checks: control periods, and s
MOST_PERIODS, LONGEST_INTERVAL = 40, 0.04
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


class PostureCheck(NamedTuple):
    """Result of the last posture check; see `periods_between_checks`.
    H_min, H_max: kg, bounds of the eigenvalues of H of every declared arm at the posture; H_min is 0 where what is
    declared leaves no bound above 0.
    d: N, on the sliding surface.
    d_now: N, at the s of that instant.
    growth_by_speed: 1, part of `Premise.GAIN_BY_CHATTER` that comes through q_dot.
    growth_by_damping: s, the rest of it per 1/s of ||M_m^-1 B_m + A||.
    layer_width: m/s, of the boundary layer.
    radius: m/s, V falls while ||s|| is beyond it.
    V_band: J, once V is below this it stays so.
    held_limit: N, limit of `Premise.HELD` where s = 0.
    periods: number of periods of the run until then."""

    H_min: float
    H_max: float
    d: float
    d_now: float
    growth_by_speed: float
    growth_by_damping: float
    layer_width: float
    radius: float
    V_band: float
    held_limit: float
    periods: int

    @classmethod
    def fresh(cls) -> PostureCheck:
        """Check of a run that has not begun."""
        return cls(
            H_min=1.0,
            H_max=1.0,
            d=0.0,
            d_now=0.0,
            growth_by_speed=0.0,
            growth_by_damping=0.0,
            layer_width=0.0,
            radius=0.0,
            V_band=0.0,
            held_limit=0.0,
            periods=0,
        )


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


class PremiseScratch(NamedTuple):
    """Memory for intermediate results; equivalent, needed: of `gain_on_surface`."""

    work: Scratch
    equivalent: Equivalent
    needed: RequiredGain
    e_dot: np.ndarray
    torque: np.ndarray
    F: np.ndarray

    @classmethod
    def zeros(cls, n: int) -> PremiseScratch:
        """Memory for n coordinates."""
        return cls(Scratch.zeros(n), Equivalent.zeros(n), RequiredGain.zeros(), np.zeros(n), np.zeros(n), np.zeros(6))


@inline
def periods_between_checks(period):
    """Number of control periods of `period` s from one posture check to the next."""
    return min(MOST_PERIODS, max(1, round(LONGEST_INTERVAL / period)))


@inline
def inertia_range(given, work):
    """Bounds (H_min, H_max) of the eigenvalues of H of every declared arm at this state, kg, at most 3 % too wide; see
    `bounds.InertiaRange`. H_min is 0 where the lower bound of M is not positive definite."""
    u, estimate, task = given.gains.uncertainty, given.estimate, given.task
    n, load = task.r.shape[0], carried_mass(u, estimate.stated.delta_M)
    reach = payload_reach(u, estimate, task, work) if load > 0.0 else 0.0
    inertia_spread(u, estimate, work.U)
    for i in range(n):
        for j in range(n):
            work.U[i, j] += estimate.M_hat[i, j]
    congruence(task.J_q_inv, work.U, work.S, work.T)
    H_max = spectral_norm(work.T) + load * reach**2
    inertia_spread(u, estimate, work.U)
    inertia_lower_bound(u, estimate, work.U, work.U)
    invert(work.U, work.S, work.T)
    multiply(task.J_q, work.T, work.S)
    for i in range(n):
        for j in range(n):
            work.U[i, j] = row_times(task.J_q, j, work.S[i])
    return 1.0 / spectral_norm(work.U) if is_positive_definite(work.U, work.S) else 0.0, H_max


@inline
def inertia_error(given, work):
    """Bound delta_H of (6), kg: largest part of (17) per m/s^2 of r_eq_ddot."""
    gains, estimate, task, deviation = given.gains, given.estimate, given.task, given.feedforward.deviation
    u, J_inv, reach = gains.uncertainty, task.J_q_inv_norm, 0.0
    load = carried_mass(u, estimate.stated.delta_M)
    if load > 0.0 and gains.tight:
        reach = payload_reach(u, estimate, task, work)
    inertia_spread(u, estimate, work.U)
    if gains.tight:
        congruence(task.J_q_inv, work.U, work.S, work.T)
        return spectral_norm(work.T) + load * reach**2 + J_inv**2 * deviation.delta_M
    if load > 0.0:
        reach = spectral_norm(estimate.J_v)
        reach += u.payload_offset * spectral_norm(estimate.J_w)
    delta_M = spectral_norm(work.U) + load * reach**2 + deviation.delta_M
    return delta_M * J_inv**2


@inline
def _gain_of(given, scratch):
    """Gain d by (17) for the r_eq_dot and r_eq_ddot of `scratch`, N, with the q_dot of that r_eq_dot."""
    work, eq, needed = scratch.work, scratch.equivalent, scratch.needed
    joint_velocity(given.task, eq.r_dot, work, eq.q_dot)
    joint_acceleration(given.task, eq.r_ddot, eq.q_dot, work, eq.q_ddot)
    on_it = GainInput(given.gains, given.feedforward, given.estimate, given.task, eq.q_dot)
    terms_of_gain(on_it, eq, work, needed)
    needed.epsilon = given.gains.epsilon
    return required_d(needed)


@inline
def gain_at_rest(given, scratch):
    """Gain d where all errors are zero, N."""
    if not given.gains.by_theorem:
        return given.gains.d
    copy(given.reference.r_d_dot, scratch.equivalent.r_dot)
    copy(given.reference.r_d_ddot, scratch.equivalent.r_ddot)
    return _gain_of(given, scratch)


@inline
def gain_on_surface(given, output, scratch):
    """Gain d on the sliding surface, N: at the present e_r and z, with the e_r_dot that makes s zero."""
    gains, z, reference = given.gains, given.z, given.reference
    if not gains.by_theorem:
        return gains.d
    eq, e = scratch.equivalent, output.e_r
    for i in range(z.shape[0]):
        scratch.e_dot[i] = -gains.F_1[i] * e[i] - gains.F_2[i] * z[i]  # (10) with s = 0
    for i in range(z.shape[0]):
        fed_back = row_times(gains.K_pz, i, e) + row_times(gains.K_vz, i, scratch.e_dot)
        z_dot = gains.A[i] * z[i] + fed_back + row_times(gains.K_fz, i, output.e_Fc)
        eq.r_dot[i] = reference.r_d_dot[i] + scratch.e_dot[i]
        eq.r_ddot[i] = reference.r_d_ddot[i] - gains.F_1[i] * scratch.e_dot[i] - gains.F_2[i] * z_dot
    return _gain_of(given, scratch)


@inline
def _falling_from(alpha, beta, period, H_min, gains):
    """Least ||s|| (m/s) from which on a period takes (19)'s T (c_1 V + c_2 sqrt(V)) from V, for robust terms and
    perturbations of together A = alpha ||s|| + beta (N) against s; infinite for none.

    It is A (1 - T A / (2 h ||s||)) >= reaching_share epsilon + 3/4 lambda_min(K_s) ||s||, quadratic in ||s||.
    """
    tau = 0.5 * period / H_min
    square = alpha * (1.0 - tau * alpha) - (1.0 - SAMPLING_SHARE) * gains.K_s_smallest
    linear = beta * (1.0 - 2.0 * tau * alpha) - gains.reaching_share * gains.epsilon
    if square <= 0.0:
        return np.inf
    root = np.sqrt(linear**2 + 4.0 * square * tau * beta**2)
    return 2.0 * tau * beta**2 / (root + linear) if linear > 0.0 else (root - linear) / (2.0 * square)


@inline
def check_posture(given, output, record, period, scratch, table, check):
    """Compute the `PostureCheck` of the present state, and the premises in the table that depend on it.
    given, output: the `LawInput` and the `ControlOutput` of the period.
    record: the present `PromiseRecord`.
    period: s, of control."""
    gains, work, estimate, task = given.gains, scratch.work, given.estimate, given.task
    u = gains.uncertainty
    check.H_min, check.H_max = inertia_range(given, work)
    check.d, check.d_now = gain_on_surface(given, output, scratch), output.d
    steepness = growth = check.growth_by_speed = check.growth_by_damping = 0.0
    if gains.by_theorem:
        by_speed = growth_with_speed(given, scratch.equivalent)
        error = inertia_error(given, work)
        steepness = error * gains.damping_rate + by_speed  # by which (17) grows with ||s||, N s/m
        growth, check.growth_by_speed = steepness * period / check.H_min, by_speed * period / check.H_min
        check.growth_by_damping = error * period / check.H_min
    table.limit[GAIN_BY_CHATTER] = 1.0 if gains.by_theorem else np.nan
    table.value[GAIN_BY_CHATTER] = growth
    raised = 1.0 / max(1.0 - growth, 1e-3) if gains.by_theorem else 1.0  # largest factor of chattering on d

    at_rest = raised * gain_at_rest(given, scratch)
    held = SAMPLING_SHARE * gains.K_s_smallest  # of `Premise.HELD`, which counts against K_s
    stiffness = gains.K_s_largest + held + (at_rest / gains.layer if gains.switching > 0 else 0.0)
    table.limit[LAYER] = 2.0
    table.value[LAYER] = stiffness * period / check.H_min

    # outside of `radius` one period makes V smaller; from within it V can rise to `V` (docs/theory.md)
    check.layer_width = layer_width(gains.switching, gains.layer, check.d, steepness, gains.epsilon)
    stopping = check.H_min - period * (steepness + 0.5 * (gains.K_s_largest + held))
    chatter = period * check.d / stopping if stopping > 0.0 else np.inf
    given_up = 1.0 - SAMPLING_SHARE - gains.reaching_share  # of epsilon, by a function that only approaches 1
    most = gains.K_s_largest + held + 2.0 * steepness
    falling = max(
        _falling_from(gains.K_s_smallest, (1.0 - given_up) * gains.epsilon, period, check.H_min, gains),  # d >= epsilon
        _falling_from(most, 2.0 * check.d, period, check.H_min, gains),
    )
    check.radius = max(check.layer_width, chatter, falling)
    if np.isinf(check.radius) and table.value[LAYER] < table.limit[LAYER]:
        table.value[LAYER] = np.inf
    heaviest = max(check.H_max, 4.0 * check.H_min) if chatter > 0.5 * check.layer_width else check.H_max
    V = 0.5 * heaviest * check.radius**2
    before = check.V_band if np.isfinite(check.V_band) else 0.0  # infinite only where nothing was promised
    check.V_band = max(V, before * np.exp(-record.reaching.c_1 * period * (record.periods - check.periods)))
    check.periods = record.periods

    check.held_limit = SAMPLING_SHARE * gains.epsilon + sensor_error(u, estimate, task, work)


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
