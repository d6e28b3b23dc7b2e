"""Writing of a control period into its `Row`: one line per signal."""

from __future__ import annotations

import numpy as np

from controllers.bounds import list_terms, required_d
from controllers.premises import HELD
from kernels import inline
from kernels.algebra import copy


@inline
def write_row(row, t, arm, evaluation):
    """Write the evaluation into the row; `complete_row` rewrites the fields that depend on the plant's response."""
    output, task, needed = evaluation.output, evaluation.seen.task, evaluation.output.needed
    row.t = t
    copy(arm.q, row.q)
    copy(arm.q_dot, row.q_dot)
    copy(task.r, row.r)
    copy(task.r_dot, row.r_dot)
    copy(evaluation.reference.r_d, row.r_d)
    copy(output.e_r, row.e_r)
    copy(output.e_r_dot, row.e_r_dot)
    copy(evaluation.seen.estimate.p, row.tool)
    _write_wrench(evaluation.F, row.F, row.moment)
    _write_wrench(evaluation.push, row.F_push, row.moment_push)
    copy(output.F_c, row.F_c)
    copy(evaluation.reference.F_cd, row.F_cd)
    copy(evaluation.z, row.z)
    copy(output.s, row.s)
    copy(output.terms.inertia, row.tau_inertia)
    copy(output.terms.coriolis, row.tau_coriolis)
    copy(output.terms.gravity, row.tau_gravity)
    copy(output.terms.force, row.tau_force)
    copy(output.terms.linear, row.tau_linear)
    copy(output.terms.switching, row.tau_switching)
    copy(output.tau, row.tau)
    copy(evaluation.applied, row.tau_applied)
    copy(output.q_ddot, row.q_eq_ddot)
    list_terms(needed, row.needed)
    row.d = output.d
    row.d_required = required_d(needed)
    row.s_norm = output.s_norm
    row.s_bound = evaluation.promise_record.bound
    row.s_band = evaluation.promise_record.band
    row.V_band = evaluation.posture_check.V_band if evaluation.promise_record.promised else np.nan
    row.held_error = evaluation.table.value[HELD]
    row.sigma_min = 1.0 / task.J_q_inv_norm
    copy(evaluation.residual, row.residual)
    write_load(row, arm.load)
    row.phi, row.phi_2, row.phi_3 = arm.load.phi[0], arm.load.phi[1], arm.load.phi[2]


@inline
def _write_wrench(wrench, force, moment):
    for a in range(3):
        force[a], moment[a] = wrench[a], wrench[3 + a]


@inline
def write_load(row, load):
    """Write the force of all contacts."""
    _write_wrench(load.wrench, row.F_true, row.moment_true)
    row.multiplier, row.multiplier_2, row.multiplier_3 = load.multiplier[0], load.multiplier[1], load.multiplier[2]
