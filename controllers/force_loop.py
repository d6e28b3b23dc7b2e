"""Force loop: the loop that sampling closes through the force reading; see docs/symbols.md."""

from __future__ import annotations

import numpy as np

from controllers.target_model import TargetModel

LONGEST_DELAY = 100  # periods of delay, beyond which roots and matrices become too large to be judged in passing


def force_loop_factors(
    H: np.ndarray,
    H_hat: np.ndarray,
    model: TargetModel,
    normal: np.ndarray,
    load: np.ndarray,
    felt: np.ndarray,
    M_e: np.ndarray,
) -> np.ndarray:
    """Factors (k,) of the force loop, those of errors in the fed-back normal forces from one sample to the next,
    through a sensor without a low-pass: the eigenvalues of the surfaces' matrix, real or complex.

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
    return np.linalg.eigvals(loop)


def through_sensor(factors: np.ndarray, gain: float, late: int) -> float:
    """Largest force-loop factor behind a low-pass of this gain and `late` periods of delay; stable within (-1, 1).

    With kappa for `gain`, the reading is y_k+1 = y_k + kappa (lambda_k-late - y_k), and lambda_k = f y_k. Hence
    z^late (z - 1 + kappa) = kappa f. Without a low-pass, kappa = 1, a delay does not change whether |f| < 1, and f is
    returned. Without a delay the factor is 1 - kappa (1 - f). Behind a very long delay the bound
    1 - kappa + kappa |f| is returned, which holds for any delay.
    """
    if late == 0 or gain == 1.0:
        found = 1.0 - gain * (1.0 - factors)
    elif late > LONGEST_DELAY:
        found = 1.0 - gain + gain * np.abs(factors)
    else:  # of real factors only the ends matter, and roots take long
        real = np.real(factors[np.isreal(factors)])
        ends = [*factors[~np.isreal(factors)], *([real.min(), real.max()] if len(real) else [])]
        rows = [[1.0, gain - 1.0, *np.zeros(late - 1), -gain * factor] for factor in ends]
        found = np.array([np.abs(np.roots(row)).max() for row in rows])
    worst = found[np.argmax(np.abs(found))]
    return float(worst.real) if worst.imag == 0.0 else float(abs(worst))


def with_gain(factors: np.ndarray, added: float, gain: float, late: int) -> float:
    """Size of the force loop's factor with what d by (17) adds to it, through the sensor of `through_sensor`.

    d changes by at most `added` per unit of the reading, along with the reading's size, so it is no linear part of the
    loop: behind a low-pass of gain kappa and a delay together the bound 1 - kappa + kappa (|f| + added) is taken, which
    holds for any delay.
    """
    if added == 0.0 or late == 0 or gain == 1.0:
        return abs(through_sensor(factors, gain, late)) + gain * added
    return 1.0 - gain + gain * (float(np.abs(factors).max()) + added)
