"""Force loop: the loop that sampling closes through the force reading; see docs/symbols.md."""

from __future__ import annotations

import numpy as np

from controllers.target_model import TargetModel


def force_loop_factor(
    H: np.ndarray,
    H_hat: np.ndarray,
    model: TargetModel,
    normal: np.ndarray,
    load: np.ndarray,
    felt: np.ndarray,
    M_e: np.ndarray,
) -> float:
    """Factor of the force loop: that of an error in the fed-back normal force from one sample to the next; it must stay
    within (-1, 1). Of several surfaces it is the one of largest size among the eigenvalues of their matrix.

    normal: (n, k), F_r per unit of each lambda without friction, a, which is e_1 in the task coordinates of a surface.
    load: (n, k), the same with Coulomb friction in one direction of slip, a_mu.
    felt: (n, k), the part of that in F_c, a_F.
    M_e: (k, k) kg, infinite on the diagonal for rigid surfaces.
    With r_ddot = ... + H^-1 [(a_mu - H_hat M_m^-1 K_f a_F) lambda_measured - a_mu lambda],
    phi_ddot = a^T r_ddot + ... and lambda = M_e phi_ddot + ... the factor is
    M_e a^T H^-1 (a_mu - H_hat M_m^-1 K_f a_F) / (1 + M_e a^T H^-1 a_mu). A rigid surface is M_e -> infinity, where for
    H = H_hat and a = a_mu = a_F = e_1 it is 1 - h / M_m1 with the effective mass h = 1 / (H^-1)_11 (for one axis,
    1 - H_ff M_m1^-1).
    """
    Y = np.linalg.solve(H, normal)
    fed_back = Y.T @ (load - H_hat @ np.linalg.solve(model.M_m, model.K_f @ felt))
    if np.isinf(M_e).any():
        loop = np.linalg.solve(Y.T @ load, fed_back)
    else:
        loop = np.linalg.solve(np.eye(len(M_e)) + M_e @ (Y.T @ load), M_e @ fed_back)
    factors = np.linalg.eigvals(loop)
    worst = factors[np.argmax(np.abs(factors))]
    return float(worst.real) if worst.imag == 0.0 else float(abs(worst))
