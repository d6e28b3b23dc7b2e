"""The baseline: computed torque with the same target model and no robust term."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from controllers.vsmrc import Vsmrc


@dataclass(frozen=True)
class ComputedTorque(Vsmrc):
    """tau = M_hat q_ddot + C_hat q_dot + G_hat + J^T F with the r_ddot that (8) asks for; d = 0.

    z and s are carried along as in the unified law, so that both can be drawn in one plot.
    """

    robust: ClassVar[bool] = False
