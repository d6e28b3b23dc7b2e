"""Posture check of the promise: what the premises and the band take from the present posture, found anew every few
control periods, (c) and (d) of `docs/theory.md`."""

from __future__ import annotations

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
from controllers.premises import GAIN_BY_CHATTER, LAYER
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
    stiffness = gains.K_s_largest + held + at_rest / gains.layer
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
