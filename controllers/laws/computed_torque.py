"""Computed torque: the usual law in place of the paper's (25), with the same target model."""

from __future__ import annotations

from controllers.control_law import ControlLaw, joint_acceleration
from kernels import inline
from kernels.algebra import copy, row_times, times


@inline
def torque(given, out):
    """Compute M_hat q_ddot + C_hat q_dot + G_hat + J^T F with the r_ddot that (8) prescribes."""
    model, task, q_dot = given.gains.model, given.task, given.q_dot
    asked, r_ddot = given.work.u, out.q_ddot
    for i in range(q_dot.shape[0]):
        known = row_times(model.B_m, i, out.e_r_dot) + row_times(model.K_m, i, out.e_r)
        asked[i] = known + row_times(model.K_f, i, out.e_Fc)
    for i in range(q_dot.shape[0]):
        r_ddot[i] = given.reference.r_d_ddot[i] - row_times(model.M_m_inv, i, asked)
    joint_acceleration(task, r_ddot, q_dot, given.work, out.q_ddot)
    times(given.feedforward.M_hat, out.q_ddot, out.terms.inertia)
    times(given.feedforward.C_hat, q_dot, out.terms.coriolis)
    copy(given.feedforward.G_hat, out.terms.gravity)
    copy(out.J_F, out.terms.force)


LAW = ControlLaw(
    kind="computed-torque",
    title="computed torque",
    about="Computed torque, the baseline: the same target model without z, s and the robust term. Residual and errors "
    "show what robustness buys.",
    torque=torque,
    told=("model", "gravity", "force", "rates"),
    terms={"inertia": "inertia", "coriolis": "Coriolis", "gravity": "gravity", "force": "Jᵀ F"},
)
