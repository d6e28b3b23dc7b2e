"""Computed torque: the usual law in place of the paper's (25), with the same target model."""

from __future__ import annotations

from controllers.control_law import ControlLaw, joint_acceleration
from kernels import inline
from kernels.algebra import copy, row_times, times


@inline
def torque(told, out):
    """Compute M_hat q_ddot + C_hat q_dot + G_hat + J^T F with the r_ddot that (8) prescribes."""
    model, task, q_dot = told.gains.model, told.task, told.q_dot
    asked, r_ddot = told.work.u, out.q_ddot
    for i in range(q_dot.shape[0]):
        known = row_times(model.B_m, i, out.e_r_dot) + row_times(model.K_m, i, out.e_r)
        asked[i] = known + row_times(model.K_f, i, out.e_Fc)
    for i in range(q_dot.shape[0]):
        r_ddot[i] = told.reference.r_d_ddot[i] - row_times(model.M_m_inv, i, asked)
    joint_acceleration(task, r_ddot, q_dot, told.work, out.q_ddot)
    times(told.feedforward.M_hat, out.q_ddot, out.terms.inertia)
    times(told.feedforward.C_hat, q_dot, out.terms.coriolis)
    copy(told.feedforward.G_hat, out.terms.gravity)
    copy(out.J_F, out.terms.force)


LAW = ControlLaw(
    kind="computed-torque",
    title="computed torque",
    about="Computed torque, the baseline: the same target model without z, s and the robust term. Residual and errors "
    "show what robustness buys.",
    torque=torque,
)
