"""Target model M_m e_r_ddot + B_m e_r_dot + K_m e_r = -K_f e_Fc, (8)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np


class InvalidGain(ValueError):
    """A matrix or number that the theory does not admit; the message names it, its value and what is allowed."""


def as_matrix(name: str, value: np.ndarray, n: int) -> np.ndarray:
    """Frozen (n, n) copy of a matrix, or of a diagonal given as (n,). Raises InvalidGain."""
    array = np.array(value, dtype=float)
    if array.shape == (n,):
        array = np.diag(array)
    if array.shape != (n, n):
        raise InvalidGain(f"{name}: shape {array.shape}; allowed: {n} diagonal entries or a {n} x {n} matrix")
    if not np.isfinite(array).all():
        raise InvalidGain(f"{name}: has an entry that is not a finite number")
    array.setflags(write=False)
    return array


def smallest_eigenvalue(name: str, matrix: np.ndarray) -> float:
    """Smallest eigenvalue of a symmetric matrix; raises InvalidGain when it is not symmetric."""
    if not np.allclose(matrix, matrix.T, rtol=1e-9, atol=1e-9):
        raise InvalidGain(f"{name}: not symmetric; allowed: symmetric positive definite")
    return float(np.linalg.eigvalsh(matrix)[0]) if matrix.size else np.inf


def companion(beta: np.ndarray, kappa: np.ndarray) -> np.ndarray:
    """Companion matrix (2n, 2n) of e_ddot + beta e_dot + kappa e = 0, for (e, e_dot), 1/s."""
    n = len(beta)
    return np.block([[np.zeros((n, n)), np.eye(n)], [-kappa, -beta]])


def require_spd(name: str, matrix: np.ndarray) -> None:
    """Raise InvalidGain unless the matrix is symmetric positive definite."""
    smallest = smallest_eigenvalue(name, matrix)
    if smallest <= 0.0:
        raise InvalidGain(f"{name}: smallest eigenvalue {smallest:.4g}; allowed: symmetric positive definite")


def require_spsd(name: str, matrix: np.ndarray) -> None:
    """Raise InvalidGain unless the matrix is symmetric positive semidefinite."""
    smallest = smallest_eigenvalue(name, matrix)
    if smallest < -1e-12 * max(1.0, float(np.abs(matrix).max())):  # that of a singular matrix is rounded
        raise InvalidGain(f"{name}: smallest eigenvalue {smallest:.4g}; allowed: symmetric positive semidefinite")


@dataclass(frozen=True)
class TargetModel:
    """Target model (8): M_m kg, B_m N s/m, K_m N/m, K_f 1: each (n, n), constant. M_m must be nonsingular.

    Raises InvalidGain for a wrong shape, an entry that is not finite, and a singular M_m.
    """

    M_m: np.ndarray
    B_m: np.ndarray
    K_m: np.ndarray
    K_f: np.ndarray

    def __post_init__(self) -> None:
        n = len(np.atleast_1d(self.M_m))
        for name in ("M_m", "B_m", "K_m", "K_f"):
            object.__setattr__(self, name, as_matrix(f"target_model.{name}", getattr(self, name), n))
        singular = np.linalg.svd(self.M_m, compute_uv=False)
        if singular[-1] <= 1e-12 * max(singular[0], 1.0):
            raise InvalidGain(
                f"target_model.M_m: singular (smallest singular value {singular[-1]:.4g}); allowed: nonsingular"
            )

    @property
    def n(self) -> int:
        return len(self.M_m)

    def same(self, other: TargetModel) -> bool:
        """Whether another model has the same matrices, to the last bit."""
        return all(np.array_equal(getattr(self, name), getattr(other, name)) for name in ("M_m", "B_m", "K_m", "K_f"))

    def companion(self) -> np.ndarray:
        """Companion matrix of M_m e_ddot + B_m e_dot + K_m e = 0, (2n, 2n) for (e, e_dot), 1/s."""
        M_inv = np.linalg.inv(self.M_m)
        return companion(M_inv @ self.B_m, M_inv @ self.K_m)

    def poles(self, K_e: np.ndarray | None = None) -> np.ndarray:
        """The 2n poles (1/s) of (8), interacting with a stiffness K_e (n, n) of the environment if one is given."""
        pressing = self if K_e is None else replace(self, K_m=self.K_m + self.K_f @ K_e)
        return np.linalg.eigvals(pressing.companion())

    def steady_forces(self, K_e: np.ndarray, r_d: np.ndarray, F_d: np.ndarray, rest: np.ndarray) -> np.ndarray:
        """Steady forces (..., m) N on m surfaces of stiffness K_e (m, m) N/m with constant r_d (..., m) m
        from them and F_d (..., m) N, (37): K_m1 (r - r_d) = -K_f1 (K_e r - F_d) + rest. rest: (..., m) N, see
        `left_by_layer`."""
        m = len(K_e)
        K_m, K_f = self.K_m[:m, :m], self.K_f[:m, :m]
        pulled = r_d @ K_m.T + F_d @ K_f.T + rest
        return np.linalg.solve(K_m + K_f @ K_e, pulled[..., None])[..., 0] @ K_e.T

    def left_by_layer(self, A: np.ndarray, s: np.ndarray) -> np.ndarray:
        """Term -M_m A s (n,) N, which (14) adds on the right of (8) while s (n,) m/s stays within the boundary
        layer."""
        return -self.M_m @ A @ s

    def residual(self, e_r: np.ndarray, e_r_dot: np.ndarray, e_r_ddot: np.ndarray, e_Fc: np.ndarray) -> np.ndarray:
        """Left side of (8) minus its right side, (..., n) N; errors (..., n)."""
        return e_r_ddot @ self.M_m.T + e_r_dot @ self.B_m.T + e_r @ self.K_m.T + e_Fc @ self.K_f.T
