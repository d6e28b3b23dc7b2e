"""Robust law of Theorem 1, (25), with the reaching terms (15) and the gain (17)."""

from __future__ import annotations

from controllers.bounds import required_d
from controllers.control_law import ControlLaw
from controllers.switching import unit_factor
from kernels import inline
from kernels.algebra import copy, times


@inline
def torque(given, out):
    """Compute M_hat q_eq_ddot + C_hat q_eq_dot + G_hat + J^T F - J_q^T (K_s s + d sigma(s)), (25)."""
    gains, model, J_q = given.gains, given.feedforward, given.task.J_q
    eq, terms, reached = out.equivalent, out.terms, given.work.u
    times(model.M_hat, eq.q_ddot, terms.inertia)
    times(model.C_hat, eq.q_dot, terms.coriolis)
    copy(model.G_hat, terms.gravity)
    copy(out.J_F, terms.force)
    copy(eq.q_ddot, out.q_ddot)
    out.d = gains.d
    if gains.by_theorem:
        out.d = required_d(out.needed)  # (17)
    switched = out.d * unit_factor(out.s_norm, gains.switching, gains.layer)  # d sigma(s) is s times this
    times(gains.K_s, out.s, reached)
    for j in range(out.tau.shape[0]):
        linear, switching = 0.0, 0.0
        for i in range(out.tau.shape[0]):
            linear -= J_q[i, j] * reached[i]
            switching -= J_q[i, j] * (switched * out.s[i])
        terms.linear[j], terms.switching[j] = linear, switching


LAW = ControlLaw(
    kind="vsmrc",
    title="robust (25)",
    about="The paper's law (25): sliding mode makes the arm follow the target model (8), whatever the declared errors.",
    torque=torque,
    terms={
        "inertia": "inertia",
        "coriolis": "Coriolis",
        "gravity": "gravity",
        "force": "Jᵀ F",
        "linear": "K_s s",
        "switching": "switching",
    },
    robust=True,
)
