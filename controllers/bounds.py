"""Bounds of the modelling errors, and the gain d that they require: (6), (7), (17).

Declared: every link's inertia is scaled by a factor in [1 - rho, 1 + rho], then its centre of mass is moved by at most
rho_centre, and its inertia I about that is one between (1 - rho_shape) I and (1 + rho_shape) I; every rotor's is scaled
by a factor in [1 - rho_rotor, 1 + rho_rotor], a point mass of at most `payload_mass` is within `payload_offset` of the
tool point, joint friction and a disturbance are bounded. Then -E <= Delta M <= E (`inertia_spread`), and the same for
gravity link by link. Where the scenario states delta_M itself, E is delta_M I; stated delta_C, delta_G, delta_f take
the place of what follows from the links, too. Two sets of bounds follow:
- "paper": (7), norms of joint-space errors times ||J_q^-1|| and ||J_q^-1||^2;
- "tight": the same argument in task space. With w = J_q q_eq_ddot and E_H = J_q^-T E J_q^-1,
  ||Delta H w|| <= sqrt(lambda_max(E_H) w^T E_H w).
Both bound the same perturbation ||Delta H r_eq_ddot + Delta C r_eq_dot + Delta G + Delta F_t + F_tilde||.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from controllers.estimate_rates import NO_RATES, LinkRates
from controllers.nominal_model import Deviation, Estimate
from controllers.task_space import Scratch, TaskSpace
from kernels import inline, kernel
from kernels.algebra import congruence, multiply, norm, norm_of_product, quadratic, spectral_norm
from kernels.records import Record

GRAVITY = 9.81  # m/s^2, as in Pinocchio's models


class Uncertainty(NamedTuple):
    """Declared uncertainty of the controller's model.

    rho, rho_rotor: 1, half-widths of the scaling of the links and of the rotors.
    payload_mass, payload_offset: kg and m, largest mass at the tool and largest distance from the tool point.
    coulomb, viscous: N m and N m s/rad, largest friction of each joint.
    disturbance: N m, largest norm of the disturbing torque.
    force_error, moment_error: N and N m, largest norms of the sensor's errors.
    k_C: kg m^2/rad; the sum of the links' ||C_i(q, q_dot)|| is at most k_C ||q_dot|| over Omega.
    rho_centre: m, largest displacement of a link's centre of mass.
    rho_shape: 1, half-width of the scaling of a link's inertia about its centre of mass.
    rates: bounds over Omega of what errors of the links add to C.
    mass: kg, of all links.
    least_inertia: 1, where delta_M is stated: M >= least_inertia M_hat.
    """

    rho: float
    rho_rotor: float
    payload_mass: float
    payload_offset: float
    coulomb: float
    viscous: float
    disturbance: float
    force_error: float
    moment_error: float
    k_C: float
    rho_centre: float = 0.0
    rho_shape: float = 0.0
    rates: LinkRates = NO_RATES
    mass: float = 0.0
    least_inertia: float = 1.0


class RequiredGain(NamedTuple):
    """Terms of (17): d must be at least their sum.
    inertia, coriolis, gravity: N, of the errors of M_hat, C_hat and G_hat.
    task_motion: N, delta_Ft, of the errors under v_t and v_t_dot; 0 with the tight bounds, which have it in inertia and
    coriolis.
    disturbance: N, of friction, disturbance and errors of the force sensor.
    epsilon: N, margin."""

    inertia: float
    coriolis: float
    gravity: float
    task_motion: float
    disturbance: float
    epsilon: float

    @classmethod
    def zeros(cls) -> RequiredGain:
        """Terms that are zero, before they are computed."""
        return cls(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


# words for the cause of each term of `RequiredGain`, in its order
CAUSES = {
    "inertia": "inertia",
    "coriolis": "Coriolis",
    "gravity": "gravity",
    "task_motion": "moving task",
    "disturbance": "disturbance",
    "epsilon": "ε",
}


@inline
def list_terms(needed, terms):
    """Write the terms of (17) into `terms` (6,) N, in the order of `CAUSES`."""
    terms[0], terms[1], terms[2] = needed.inertia, needed.coriolis, needed.gravity
    terms[3], terms[4], terms[5] = needed.task_motion, needed.disturbance, needed.epsilon


@inline
def required_d(needed):
    """Smallest allowed d, (17): the sum of the terms."""
    known = needed.inertia + needed.coriolis + needed.gravity + needed.task_motion + needed.disturbance
    return known + needed.epsilon


class Equivalent(NamedTuple):
    """Equivalent motion: the one on which s stays 0, which (25) prescribes.
    r_dot, r_ddot: (n,) m/s and m/s^2, r_eq_dot and r_eq_ddot of (16).
    q_dot, q_ddot: (n,) rad/s and rad/s^2, the same in joints."""

    r_dot: np.ndarray
    r_ddot: np.ndarray
    q_dot: np.ndarray
    q_ddot: np.ndarray

    @classmethod
    def zeros(cls, n: int) -> Equivalent:
        """Motion of n coordinates."""
        return cls(*4 * (np.zeros(n),))


@inline
def inertia_spread(u, estimate, E):
    """Compute E (n, n) kg m^2: -E <= Delta M <= E, (6), for links and rotors of every declared arm.

    A centre of mass that is moved by d adds (1 + rho) m (2 a.b + b^2) with a = J_c v and ||b|| <= rho_centre ||J_w v||,
    and 2 a b <= a^2 / L + L b^2 for every L > 0: here the one with which both have the same trace.
    """
    n = E.shape[0]
    if not np.isnan(estimate.stated.delta_M):
        for i in range(n):
            for j in range(n):
                E[i, j] = estimate.stated.delta_M if i == j else 0.0
        return
    more, moved, swung = 1.0 + u.rho, 0.0, 0.0
    if u.rho_centre > 0.0:
        moving, spinning = 0.0, 0.0
        for i in range(n):
            moving += estimate.M_links[i, i] - estimate.M_turning[i, i]
            spinning += estimate.spin[i, i]
        swung = more * u.rho_centre**2
        if moving > 0.0 and spinning > 0.0:
            length = np.sqrt(moving / spinning)
            moved = more * u.rho_centre / length
            swung += more * u.rho_centre * length
    for i in range(n):
        for j in range(n):
            rotor, turning = estimate.M_hat[i, j] - estimate.M_links[i, j], estimate.M_turning[i, j]
            E[i, j] = u.rho * estimate.M_links[i, j] + u.rho_rotor * rotor + more * u.rho_shape * turning
            E[i, j] += moved * (estimate.M_links[i, j] - turning) + swung * estimate.spin[i, j]


@inline
def inertia_lower_bound(u, estimate, E, least):
    """Compute a lower bound `least` (n, n), kg m^2, of M of every declared arm, from the E of `inertia_spread`."""
    stated = not np.isnan(estimate.stated.delta_M)
    for i in range(E.shape[0]):
        for j in range(E.shape[0]):
            least[i, j] = u.least_inertia * estimate.M_hat[i, j] if stated else estimate.M_hat[i, j] - E[i, j]


@inline
def carried_mass(u, stated):
    """Mass (kg) of the largest payload; 0 where a bound is stated, since that includes the payload. stated: the bound,
    NaN for none."""
    return u.payload_mass if np.isnan(stated) else 0.0


@inline
def coriolis_rate(u):
    """Bound of ||Delta C|| over ||q_dot|| from the links' errors, kg m^2/rad."""
    c, rates = u.rho_centre, u.rates
    moved = c * rates.k_centre + c * c * rates.k_swing + u.rho_shape * rates.k_shape
    return u.rho * u.k_C + (1.0 + u.rho) * moved


@inline
def lever_weight(u):
    """Largest moment that moved centres of mass give to gravity, N m per unit of sqrt(||spin||/mass)."""
    return (1.0 + u.rho) * u.rho_centre * GRAVITY * np.sqrt(u.mass)


@inline
def friction_bound(u, estimate, q_dot):
    """Bound of ||f|| of friction and disturbance, N m."""
    if not np.isnan(estimate.stated.delta_f):
        return estimate.stated.delta_f
    return u.coulomb * np.sqrt(q_dot.shape[0]) + u.viscous * norm(q_dot) + u.disturbance


@inline
def payload_reach(u, estimate, task, work):
    """Largest F_r per N of a force on the declared payload, ||J_v J_q^-1|| + payload_offset ||J_w J_q^-1||."""
    multiply(estimate.J_v, task.J_q_inv, work.Y)
    reach = spectral_norm(work.Y)
    multiply(estimate.J_w, task.J_q_inv, work.Y)
    return reach + u.payload_offset * spectral_norm(work.Y)


@inline
def sensor_error(u, estimate, task, work):
    """Bound of the declared error of the force sensor as an F_r, N."""
    bound = 0.0
    if u.force_error > 0.0:
        multiply(estimate.J_v, task.J_q_inv, work.Y)
        bound += u.force_error * spectral_norm(work.Y)
    if u.moment_error > 0.0:
        multiply(estimate.J_w, task.J_q_inv, work.Y)
        bound += u.moment_error * spectral_norm(work.Y)
    return bound


@inline
def growth_with_speed(given, eq):
    """Bound of the growth of d by (17) per m/s of ||s||, N s/m, through q_dot = q_eq_dot + J_q^-1 s: of the terms of
    friction and of the errors of C_hat. The growth of the Jacobians' rates is left out.
    given: with the J_q^-1 and the bounds of the present state.
    eq: `Equivalent` motion."""
    u, stated, task, estimate = given.gains.uncertainty, given.estimate.stated, given.task, given.estimate
    J_inv, speed = task.J_q_inv_norm, norm(eq.q_dot)
    friction = u.viscous if np.isnan(stated.delta_f) else stated.rate_f
    rate = stated.rate_C
    if np.isnan(stated.delta_C):
        rate = coriolis_rate(u)
        if u.payload_mass > 0.0 and u.payload_offset > 0.0:
            reach = spectral_norm(estimate.J_v) + u.payload_offset * spectral_norm(estimate.J_w)
            rate += u.payload_mass * u.payload_offset * reach * spectral_norm(estimate.J_w) ** 2
    rate += given.feedforward.deviation.rate_C
    if not given.gains.tight:
        speed = J_inv * (norm(eq.r_dot) + norm(task.v_t))
    return J_inv**2 * (friction + rate * speed)


@inline
def paper_bound(given, eq, work, needed):
    """Compute each term of (17) with the bounds (7); delta_Ft is in `task_motion`."""
    u, deviation = given.gains.uncertainty, given.feedforward.deviation
    estimate, task, q_dot = given.estimate, given.task, given.q_dot
    J_inv, stated = task.J_q_inv_norm, estimate.stated
    J_v, J_w = spectral_norm(estimate.J_v), spectral_norm(estimate.J_w)
    reach = J_v + u.payload_offset * J_w
    inertia_spread(u, estimate, work.U)
    load = carried_mass(u, stated.delta_M)
    delta_M = spectral_norm(work.U) + load * reach**2 + deviation.delta_M
    delta_C_q = stated.delta_C
    if np.isnan(delta_C_q):
        turning = spectral_norm(estimate.J_w_dot) + norm_of_product(estimate.J_w, q_dot) * J_w
        reach_dot = spectral_norm(estimate.J_v_dot) + u.payload_offset * turning
        delta_C_q = coriolis_rate(u) * norm(q_dot) + u.payload_mass * reach * reach_dot
    delta_G_q = stated.delta_G
    if np.isnan(delta_G_q):
        weight = 0.0
        for i in range(q_dot.shape[0]):
            weight += norm(estimate.G_links[i])
        delta_G_q = u.rho * weight + u.payload_mass * GRAVITY * reach
        if u.rho_centre > 0.0:
            delta_G_q += lever_weight(u) * np.sqrt(spectral_norm(estimate.spin))
    delta_C_q += deviation.delta_C
    delta_G_q += deviation.delta_G
    delta_f = friction_bound(u, estimate, q_dot) + u.force_error * J_v + u.moment_error * J_w
    multiply(task.J_q_inv, task.J_q_dot, work.S)
    multiply(work.S, task.J_q_inv, work.T)
    delta_H = delta_M * J_inv**2
    delta_C = delta_C_q * J_inv**2 + delta_M * J_inv * spectral_norm(work.T)
    needed.inertia = delta_H * norm(eq.r_ddot)
    needed.coriolis = delta_C * norm(eq.r_dot)
    needed.gravity = J_inv * delta_G_q
    needed.task_motion = delta_H * norm(task.v_t_dot) + delta_C * norm(task.v_t)
    needed.disturbance = J_inv * delta_f


@inline
def tight_bound(given, eq, work, needed):
    """Compute each term of (17) with the "tight" bounds of the module, in task space; task_motion is 0."""
    u, deviation = given.gains.uncertainty, given.feedforward.deviation
    estimate, task, q_dot = given.estimate, given.task, given.q_dot
    J_inv, stated = task.J_q_inv_norm, estimate.stated
    inertia_spread(u, estimate, work.U)
    congruence(task.J_q_inv, work.U, work.S, work.T)
    E_H = spectral_norm(work.T)
    inertia = np.sqrt(max(E_H * quadratic(eq.q_ddot, work.U), 0.0))
    coriolis, gravity = J_inv * stated.delta_C * norm(eq.q_dot), J_inv * stated.delta_G
    if np.isnan(stated.delta_C):
        coriolis = coriolis_rate(u) * J_inv * norm(q_dot) * norm(eq.q_dot)
    if np.isnan(stated.delta_G):
        gravity = 0.0
        multiply(estimate.G_links, task.J_q_inv, work.S)
        for i in range(q_dot.shape[0]):
            gravity += u.rho * norm(work.S[i])
        if u.rho_centre > 0.0:
            congruence(task.J_q_inv, estimate.spin, work.S, work.T)
            gravity += lever_weight(u) * np.sqrt(spectral_norm(work.T))
    inertia += J_inv * deviation.delta_M * norm(eq.q_ddot)
    coriolis += J_inv * deviation.delta_C * norm(eq.q_dot)
    gravity += J_inv * deviation.delta_G
    if u.payload_mass > 0.0:
        c, load = u.payload_offset, payload_reach(u, estimate, task, work)
        turning = norm_of_product(estimate.J_w_dot, eq.q_dot)
        turning += norm_of_product(estimate.J_w, q_dot) * norm_of_product(estimate.J_w, eq.q_dot)
        pulled = norm_of_product(estimate.J_v, eq.q_ddot) + c * norm_of_product(estimate.J_w, eq.q_ddot)
        inertia += carried_mass(u, stated.delta_M) * load * pulled
        coriolis += carried_mass(u, stated.delta_C) * load * (norm_of_product(estimate.J_v_dot, eq.q_dot) + c * turning)
        gravity += carried_mass(u, stated.delta_G) * load * GRAVITY
    needed.inertia, needed.coriolis, needed.gravity, needed.task_motion = inertia, coriolis, gravity, 0.0
    needed.disturbance = J_inv * friction_bound(u, estimate, q_dot) + sensor_error(u, estimate, task, work)


class _GainBounds(NamedTuple):
    """Bounds of `Gains` on which (17) depends."""

    uncertainty: Uncertainty
    tight: bool


class _GainDeviation(NamedTuple):
    """Deviation of the `FeedforwardModel` on which (17) depends."""

    deviation: Deviation


class GainInput(NamedTuple):
    """Part of a `LawInput` on which (17) depends, by the same names."""

    gains: _GainBounds
    feedforward: _GainDeviation
    estimate: Estimate
    task: TaskSpace
    q_dot: np.ndarray


@inline
def terms_of_gain(given, eq, work, needed):
    """Compute the terms of (17) but its epsilon, by the tight bounds or by those of (7).
    given: `LawInput`.
    eq: `Equivalent` motion for which d has to suffice."""
    if given.gains.tight:
        tight_bound(given, eq, work, needed)
    else:
        paper_bound(given, eq, work, needed)


@kernel
def _required_gain(given, equivalent, work, needed):
    terms_of_gain(given[0], equivalent[0], work[0], needed[0])


def required_gain(
    bounds: Literal["tight", "paper"],
    u: Uncertainty,
    deviation: Deviation,
    estimate: Estimate,
    task: TaskSpace,
    q_dot: np.ndarray,
    equivalent: Equivalent,
) -> RequiredGain:
    """Terms of (17) at one state, without its epsilon, N; q_dot (n,) rad/s."""
    gains, feedforward = _GainBounds(u, tight=bounds == "tight"), _GainDeviation(deviation)
    given, work = Record(GainInput(gains, feedforward, estimate, task, q_dot)), Record(Scratch.zeros(len(q_dot)))
    needed = Record(RequiredGain.zeros())
    _required_gain(given.data, Record(equivalent).data, work.data, needed.data)
    return needed.read()


@kernel
def _spread_alone(u, estimate, E, least):
    inertia_spread(u[0], estimate[0], E)
    inertia_lower_bound(u[0], estimate[0], E, least)


@dataclass(frozen=True)
class InertiaRange:
    """Bounds of the inertia H_low <= H(r, t) <= H_high (..., n, n) kg for every arm inside the declared set, at one
    state or several."""

    H_low: np.ndarray
    H_high: np.ndarray

    @classmethod
    def at(cls, u: Uncertainty, estimate: Estimate, task: TaskSpace) -> InertiaRange:
        """Bounds at one state."""
        found = cls.over(u, Record(estimate).data, Record(task).data)
        return cls(found.H_low[0], found.H_high[0])

    @classmethod
    def over(cls, u: Uncertainty, estimates: np.ndarray, tasks: np.ndarray) -> InertiaRange:
        """Bounds at N states from the estimates M_hat there, records (N,) with the fields of `Estimate` and
        `TaskSpace`; the payload adds at most its whole mass."""
        J_inv, M_hat, declared = tasks["J_q_inv"], estimates["M_hat"], Record(u).data
        E, least = np.empty(M_hat.shape), np.empty(M_hat.shape)
        for k in range(len(M_hat)):
            _spread_alone(declared, estimates[k : k + 1], E[k], least[k])
        low = J_inv.swapaxes(1, 2) @ least @ J_inv
        high = J_inv.swapaxes(1, 2) @ (M_hat + E) @ J_inv
        carried, turned = estimates["J_v"] @ J_inv, estimates["J_w"] @ J_inv
        load = np.where(np.isnan(estimates["stated"]["delta_M"]), u.payload_mass, 0.0)[:, None, None]
        carried = carried.swapaxes(1, 2) @ carried
        if u.payload_offset > 0.0:  # (a + b)^2 <= 2 a^2 + 2 b^2
            high = high + 2 * load * (carried + u.payload_offset**2 * turned.swapaxes(1, 2) @ turned)
        else:
            high = high + load * carried
        return cls(low, high)
