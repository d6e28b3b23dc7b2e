"""Second-order systems of the target model (8): omega and zeta of each coordinate alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Oscillators:
    """Natural frequency omega (n,) rad/s and damping ratio zeta (n,) 1 of each coordinate with the others held; nan
    where it does not oscillate."""

    omega: np.ndarray
    zeta: np.ndarray


@dataclass(frozen=True)
class Shaped:
    """Diagonal entries that give a coordinate its omega and zeta: B_m N s/m, K_m N/m, K_f 1. M_m is kept."""

    B_m: float
    K_m: float
    K_f: float


def oscillators(M_m: np.ndarray, B_m: np.ndarray, K_m: np.ndarray, K_f: np.ndarray, K_e: np.ndarray) -> Oscillators:
    """Oscillators with omega^2 = (K_m + K_f K_e) / M_m and 2 zeta omega = B_m / M_m on the diagonals of (8), matrices
    (n, n).

    K_e (n,) N/m is the environment's stiffness along each coordinate: 0 in free motion, as in (35) on an elastic
    surface, infinite on a rigid one, which admits no motion (42).
    """
    M, B = np.diag(M_m), np.diag(B_m)
    swings = np.isfinite(K_e)
    K = np.diag(K_m) + np.diag(K_f) * np.where(swings, K_e, 0.0)
    swings = swings & (K > 0.0) & (M > 0.0)
    ratio = np.divide(K, M, out=np.full(len(M), np.nan), where=swings)
    omega = np.sqrt(ratio)
    return Oscillators(omega, B / (2.0 * M * omega))


def poles_of(omega: float, zeta: float) -> tuple[complex, complex]:
    """The two poles (1/s) of s^2 + 2 zeta omega s + omega^2."""
    root = np.emath.sqrt(zeta**2 - 1.0)
    return complex(omega * (-zeta + root)), complex(omega * (-zeta - root))


def moved(pole: complex, other: complex) -> tuple[float, float]:
    """Natural frequency omega (rad/s) and damping ratio zeta after one pole (1/s) has been moved to `pole`, left of the
    imaginary axis. The other pole is its conjugate, or stays where both are real."""
    if pole.imag == 0.0 and other.imag == 0.0:
        omega = float(np.sqrt(pole.real * other.real))
        return omega, float(-(pole.real + other.real) / (2.0 * omega))
    return abs(pole), -pole.real / abs(pole)


def shaped(M_m: float, K_m: float, K_f: float, K_e: float, omega: float, zeta: float) -> Shaped:
    """Entries of one coordinate with this omega (rad/s) and zeta, on a surface of stiffness K_e (N/m).

    In free motion K_m = M_m omega^2. On an elastic surface K_m is kept, since K_m1 = 0 makes the force error vanish
    (37), and K_f = (M_m omega^2 - K_m) / K_e; (8) divided by K_f is (34) with M_m1 / K_f, B_m1 / K_f.
    """
    stiffness = M_m * omega**2
    B_m = 2.0 * zeta * omega * M_m
    if K_e > 0.0:
        return Shaped(B_m, K_m, (stiffness - K_m) / K_e)
    return Shaped(B_m, stiffness, K_f)
