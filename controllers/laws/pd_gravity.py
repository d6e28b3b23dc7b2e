"""PD with gravity compensation in task space, after Takegaki and Arimoto (1981), as in Siciliano, Sciavicco, Villani
and Oriolo, Robotics (2009), section 8.6.1, and for a force their open-loop J^T F_d.

K_m and B_m of (8) are its gains, so that it has the target model's stiffness and damping, and instead of M_m whatever
inertia the arm has; it needs neither force sensor nor M_hat, C_hat.
"""

from __future__ import annotations

from controllers.control_law import ControlLaw
from kernels import inline
from kernels.algebra import copy, row_times, transposed_times


@inline
def torque(given, out):
    """Compute J_q^T (F_cd - K_m e_r - B_m e_r_dot) + G_hat."""
    model, terms, pulled = given.gains.model, out.terms, given.work.u
    for i in range(out.tau.shape[0]):
        pulled[i] = -row_times(model.K_m, i, out.e_r) - row_times(model.B_m, i, out.e_r_dot)
    transposed_times(given.task.J_q, pulled, terms.linear)
    transposed_times(given.task.J_q, given.reference.F_cd, terms.force)
    copy(given.feedforward.G_hat, terms.gravity)


LAW = ControlLaw(
    kind="pd-gravity",
    title="PD + gravity",
    about="PD + gravity, the simplest baseline: K_m and B_m as gains, Ĝ and the desired force added; no model of "
    "inertia, no force sensor.",
    torque=torque,
    told=("gravity", "rates"),
    terms={"gravity": "gravity", "force": "J_qᵀ F_cd", "linear": "K_m e_r + B_m ė_r"},
)
