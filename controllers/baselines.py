"""The baselines: what engineers would use where the paper has its law, with the same target model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from controllers.vsmrc import Law, Vsmrc


@dataclass(frozen=True)
class ComputedTorque(Vsmrc):
    """tau = M_hat q_ddot + C_hat q_dot + G_hat + J^T F with the r_ddot that (8) asks for; d = 0.

    z and s are carried along as in the unified law, so that both can be drawn in one plot.
    """

    law: ClassVar[Law] = Law.COMPUTED_TORQUE


@dataclass(frozen=True)
class PdGravity(Vsmrc):
    """tau = J_q^T (F_cd - K_m e_r - B_m e_r_dot) + G_hat: PD with gravity compensation in task space, after Takegaki
    and Arimoto (1981), as in Siciliano, Sciavicco, Villani and Oriolo, Robotics (2009), section 8.6.1, and for a force
    their open-loop J^T F_d.

    K_m and B_m of (8) are its gains, so that it has the target model's stiffness and damping, and instead of M_m
    whatever inertia the arm has; it needs neither force sensor nor M_hat, C_hat. z and s are carried along.
    """

    law: ClassVar[Law] = Law.PD_GRAVITY
