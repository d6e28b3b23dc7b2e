"""Dynamic compensator (9) and sliding variable (10), with which the sliding mode is the target model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from controllers.target_model import InvalidGain, TargetModel, as_matrix


@dataclass(frozen=True)
class Compensator:
    """Compensator z_dot = A z + K_pz e_r + K_vz e_r_dot + K_fz e_Fc, (9);  s = e_r_dot + F_1 e_r + F_2 z, (10).

    A (1/s), F_1 (1/s), F_2 (1): diagonal (n, n), A negative semidefinite, F_2 nonsingular. K_pz, K_vz, K_fz follow
    from the target model by (13). Raises InvalidGain.
    """

    A: np.ndarray
    F_1: np.ndarray
    F_2: np.ndarray
    K_pz: np.ndarray
    K_vz: np.ndarray
    K_fz: np.ndarray

    @classmethod
    def design(cls, model: TargetModel, A: np.ndarray, F_1: np.ndarray, F_2: np.ndarray) -> Compensator:
        """The compensator whose sliding mode is `model`; A, F_1, F_2 are (n,) diagonals."""
        diagonal = {
            name: as_matrix(f"controller.{name}", v, model.n) for name, v in (("A", A), ("F_1", F_1), ("F_2", F_2))
        }
        A, F_1, F_2 = diagonal["A"], diagonal["F_1"], diagonal["F_2"]
        for name, matrix in diagonal.items():
            if np.count_nonzero(matrix - np.diag(np.diag(matrix))):
                raise InvalidGain(f"controller.{name}: not diagonal; allowed: a diagonal matrix, (9) and (10)")
        if (np.diag(A) > 0.0).any():
            raise InvalidGain(f"controller.A: {np.diag(A).max():.4g} on the diagonal; allowed: entries <= 0, (9)")
        if (np.abs(np.diag(F_2)) < 1e-12).any():
            raise InvalidGain("controller.F_2: singular, a zero on the diagonal; allowed: nonsingular, (10)")
        M_m_inv, F_2_inv = np.linalg.inv(model.M_m), np.linalg.inv(F_2)
        return cls(
            A,
            F_1,
            F_2,
            K_pz=F_2_inv @ (M_m_inv @ model.K_m + A @ F_1),
            K_vz=F_2_inv @ (M_m_inv @ model.B_m - F_1 + A),
            K_fz=F_2_inv @ M_m_inv @ model.K_f,
        )

    def without_reaching(self, e_r: np.ndarray, e_r_dot: np.ndarray) -> np.ndarray:
        """State z (n,) that makes s = 0 now: Remark 2."""
        return -np.linalg.solve(self.F_2, e_r_dot + self.F_1 @ e_r)
