"""Loops that sampling closes: through the force reading, and through the boundary layer; see docs/symbols.md."""

from __future__ import annotations

import numpy as np

from controllers.target_model import TargetModel


def force_loop_factor(H: np.ndarray, H_hat: np.ndarray, model: TargetModel, M_e: float = np.inf) -> float:
    """What one sample makes of an error in the normal force that the law feeds back; it must stay within (-1, 1).

    With r_ddot = ... + H^-1 [(I - H_hat M_m^-1 K_f) e_1 lambda_measured - e_1 lambda] and lambda = M_e phi_ddot + ...:
    M_e e_1^T H^-1 (I - H_hat M_m^-1 K_f) e_1 / (1 + M_e e_1^T H^-1 e_1); a rigid surface is M_e -> infinity, where
    for H = H_hat it is 1 - h / M_m1 with the effective mass h = 1 / (H^-1)_11 (for one axis, 1 - H_ff M_m1^-1).
    """
    Y = np.linalg.inv(H)[0]
    fed_back = np.eye(len(H))[:, 0] - H_hat @ np.linalg.solve(model.M_m, model.K_f[:, 0])
    if np.isinf(M_e):
        return float(Y @ fed_back / Y[0])
    return float(M_e * (Y @ fed_back) / (1.0 + M_e * Y[0]))


def layer_loop_factor(H: np.ndarray, K_s: np.ndarray, d: float, phi: float, period: float) -> float:
    """(lambda_max(K_s) + d/phi) T / lambda_min(H): the boundary layer stops the chattering only below 2."""
    return float((np.linalg.eigvalsh(K_s)[-1] + d / phi) * period / np.linalg.eigvalsh(H)[0])
