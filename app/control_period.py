"""What the controller does in one control period, as one compiled function: the paper from (3) to (25) in its order."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from controllers.nominal_model import LinkConstants, Terms, estimates
from controllers.norms import norm
from controllers.reaching import Promise, envelope, sampling_band
from controllers.reference_estimates import believed_estimate
from controllers.task_space import TaskLayout, task_space
from controllers.vsmrc import Gains, Reference, control_law
from environments.surfaces import Shape, surface_chart


class ReferencePlan(NamedTuple):
    """start (n,): r at t = 0, to which trajectories add; compliance m/N: r_fd per f_nd, 1/K_e_hat in (33), 0 on a
    rigid surface (41); m: number of force-controlled directions."""

    start: np.ndarray
    compliance: float
    m: int


class Outcome(NamedTuple):
    """tau (n,) N m; z_next (n,) m/s; the residual of (8) is residual_gain (n, n) q_ddot + residual_rest (n,);
    s_norm and what it is allowed, m/s; sigma_min m."""

    tau: np.ndarray
    z_next: np.ndarray
    residual_gain: np.ndarray
    residual_rest: np.ndarray
    s_norm: float
    s_allowed: float
    s_band: float
    sigma_min: float


@njit(cache=True, error_model="numpy")
def reference_at(plan, path, force):
    """r_d(t) = start + path, but r_fd = f_nd / K_e_hat (33) in the first m coordinates; F_cd = f_nd there."""
    r_d, r_d_dot, r_d_ddot = plan.start + path.value, path.rate.copy(), path.acceleration.copy()
    F_cd = np.zeros_like(r_d)
    for i in range(plan.m):
        r_d[i] = plan.compliance * force.value
        r_d_dot[i] = plan.compliance * force.rate
        r_d_ddot[i] = plan.compliance * force.acceleration
        F_cd[i] = force.value
    return Reference(r_d, r_d_dot, r_d_ddot, F_cd)


@njit(cache=True, error_model="numpy")
def _lay_down(row, parts):
    """Lay the parts one behind the other."""
    i = 0
    for part in parts:
        row[i : i + part.shape[0]] = part
        i += part.shape[0]


class Setting(NamedTuple):
    """What stays the same between two edits. terms, links: see `NominalModel`; shape: the surface (or Cartesian axes)
    that gives the task coordinates; promise: `ReachingCertificate`'s, counted from `since` (s); period s."""

    terms: Terms
    links: LinkConstants
    shape: Shape
    layout: TaskLayout
    plan: ReferencePlan
    gains: Gains
    promise: Promise
    since: float
    period: float


@njit(cache=True, error_model="numpy")
def control_period(held, override, path, force, z, q, q_dot, F, t, row):
    """Evaluate the law at time t (s) for the state q, q_dot (n,) and the measured force F (3,) N, and write what it
    saw and did into `row`. held: a `Setting`; override: see `ReferenceEstimates`.
    """
    terms, links, shape, layout, plan, gains, promise, since, period = held.value
    estimate = estimates(terms, links, q_dot)
    chart = surface_chart(shape, estimate.p, t)
    task = task_space(layout, chart, estimate, q, q_dot)
    reference = reference_at(plan, path, force)
    believed = believed_estimate(estimate, override)
    output = control_law(gains, z, reference, task, believed, override.deviation, q_dot, F)

    model = gains.model
    known = task.J_q_dot @ q_dot + task.v_t_dot - reference.r_d_ddot
    rest = model.M_m @ known + model.B_m @ output.e_r_dot + model.K_m @ output.e_r + model.K_f @ output.e_Fc
    s_norm = norm(output.s)
    s_bound = envelope(promise, t - since)
    s_band = sampling_band(
        promise.k_r_low,
        promise.k_r_high,
        gains.K_s_largest,
        gains.switching,
        gains.phi,
        output.d,
        gains.epsilon,
        period,
    )
    sigma_min = 1.0 / task.J_q_inv_norm
    needed = np.array(
        [
            output.needed.inertia,
            output.needed.coriolis,
            output.needed.gravity,
            output.needed.task_motion,
            output.needed.disturbance,
            output.needed.epsilon,
        ]
    )
    _lay_down(
        row,
        (
            np.array([t]), q, q_dot, task.r, task.r_dot, reference.r_d, output.e_r, output.e_r_dot, estimate.p, F,
            output.F_c, reference.F_cd, output.z, output.s, output.terms.inertia, output.terms.coriolis,
            output.terms.gravity, output.terms.force, output.terms.linear, output.terms.switching, output.tau, needed,
            np.array([output.d, needed.sum(), s_norm, s_bound, s_band, sigma_min]),
        ),
    )  # fmt: skip
    return Outcome(
        output.tau, z + period * output.z_dot, model.M_m @ task.J_q, rest, s_norm, s_bound + s_band, s_band, sigma_min
    )


@njit(cache=True, error_model="numpy")
def complete_row(row, residual_gain, residual_rest, q_ddot, q_dot, force, multiplier, phi):
    """Write what is known only when the plant has answered behind the rest.

    Returns the residual of (8), (n,) N, and ||q_dot||, rad/s.
    """
    residual = residual_gain @ q_ddot + residual_rest
    _lay_down(row[row.shape[0] - residual.shape[0] - 5 :], (residual, force, np.array([multiplier, phi])))
    return residual, norm(q_dot)
