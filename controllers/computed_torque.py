"""The baseline: computed torque with the same target model and no robust term."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit

from controllers.nominal_model import Deviation, Estimate
from controllers.task_space import TaskSpace
from controllers.vsmrc import ControlOutput, LawState, Reference, TorqueTerms, Vsmrc, vsmrc_law


@njit(cache=True)
def _computed_torque(unified, target_ddot, task, estimate, q_dot):
    q_ddot = task.J_q_inv @ (target_ddot - task.J_q_dot @ q_dot - task.v_t_dot)
    zero = np.zeros_like(q_dot)
    terms = TorqueTerms(
        estimate.M_hat @ q_ddot, estimate.C_hat @ q_dot, unified.terms.gravity, unified.terms.force, zero, zero.copy()
    )
    tau = terms.inertia + terms.coriolis + terms.gravity + terms.force
    return ControlOutput(
        tau, terms, unified.e_r, unified.e_r_dot, unified.F_c, unified.e_Fc, unified.z, unified.z_dot, unified.s,
        0.0, unified.needed,
    )  # fmt: skip


@dataclass(frozen=True)
class ComputedTorque(Vsmrc):
    """tau = M_hat q_ddot + C_hat q_dot + G_hat + J^T F with the r_ddot that (8) asks for; d = 0.

    z and s are carried along as in the unified law, so that both can be drawn in one plot.
    """

    @cached_property
    def _feedback(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        M_m_inv = np.linalg.inv(self.model.M_m)
        return M_m_inv @ self.model.B_m, M_m_inv @ self.model.K_m, M_m_inv @ self.model.K_f

    def evaluate(
        self,
        state: LawState,
        reference: Reference,
        task: TaskSpace,
        estimate: Estimate,
        deviation: Deviation,
        q_dot: np.ndarray,
        F: np.ndarray,
    ) -> ControlOutput:
        """See `Vsmrc.evaluate`."""
        unified = vsmrc_law(self.gains, state.z, reference, task, estimate, deviation, q_dot, F)
        damping, stiffness, force = self._feedback
        target_ddot = (
            reference.r_d_ddot - damping @ unified.e_r_dot - stiffness @ unified.e_r - force @ unified.e_Fc
        )  # (8)
        return _computed_torque(unified, target_ddot, task, estimate, q_dot)
