"""Rightmost eigenvalue on a segment of matrices, A_0 + alpha (A_1 - A_0) for alpha in [0, 1], found exactly, not by
samples.

An eigenvalue lies on the line Re = level exactly where A(alpha) - level I has a real eigenvalue 0, or two whose sum
is 0. The first is a generalised eigenvalue problem in alpha; so is the second, with the bialternate sum:
X -> A X + X A^T on antisymmetric X has the eigenvalues lambda_i + lambda_j, i < j. Between two such alphas no
eigenvalue crosses the line, so that the eigenvalues at one alpha between them tell on which side all are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigvals

SAMPLES = 17  # alphas to begin with
CLOSE = 1e-6  # of the fastest eigenvalue: how closely the rightmost one is found
NEARLY_REAL = 0.1  # roots with a smaller imaginary part are tried, too, which costs little


@dataclass(frozen=True)
class Rightmost:
    """Rightmost eigenvalue on a segment.
    alpha: 1, where it is found.
    eigenvalue: 1/s.
    at_most: 1/s, upper bound of every real part; exceeds that of `eigenvalue` by at most CLOSE times the largest
    modulus."""

    alpha: float
    eigenvalue: complex
    at_most: float


def rightmost(A_0: np.ndarray, A_1: np.ndarray) -> Rightmost:
    """Rightmost eigenvalue on the segment between two matrices (n, n), 1/s."""
    D = A_1 - A_0
    alpha, best, fastest = _look(A_0, D, np.linspace(0.0, 1.0, SAMPLES))
    close = CLOSE * fastest
    while True:
        level = best.real + close
        ends = np.concatenate([[0.0], _crossings(A_0 - level * np.eye(len(D)), D), [1.0]])
        between, further, _ = _look(A_0, D, np.concatenate([ends, 0.5 * (ends[1:] + ends[:-1])]))
        if further.real <= level:
            return Rightmost(alpha, best, level)
        alpha, best = between, further


def _look(A_0: np.ndarray, D: np.ndarray, alphas: np.ndarray) -> tuple[float, complex, float]:
    """The alpha with the rightmost eigenvalue, that eigenvalue (the upper one of a pair), and the largest modulus."""
    values = np.linalg.eigvals(A_0 + alphas[:, None, None] * D)
    i, j = np.unravel_index(np.argmax(values.real), values.shape)
    return float(alphas[i]), complex(values[i, j].real, abs(values[i, j].imag)), float(np.abs(values).max())


def _crossings(A: np.ndarray, D: np.ndarray) -> np.ndarray:
    """Sorted alphas in (0, 1) at which A + alpha D, Hurwitz-stable for alpha = 0, may have an eigenvalue on the
    imaginary axis."""
    found = []
    for constant, linear in ((A, D), (_bialternate(A), _bialternate(D))):
        roots: np.ndarray = np.asarray(eigvals(constant, -linear), dtype=complex)  # infinite ones where D is singular
        found.append(np.real(roots)[np.isfinite(roots) & (np.abs(np.imag(roots)) < NEARLY_REAL)])
    alphas = np.concatenate(found)
    return np.sort(alphas[(alphas > 0.0) & (alphas < 1.0)])


def _bialternate(A: np.ndarray) -> np.ndarray:
    """Bialternate sum of A (n, n): (n (n - 1) / 2) square, with the eigenvalues lambda_i + lambda_j, i < j."""
    n, one = len(A), np.eye(len(A))
    i, j = np.triu_indices(n, 1)
    antisymmetric = np.zeros((n, n, len(i)))
    antisymmetric[i, j, np.arange(len(i))], antisymmetric[j, i, np.arange(len(i))] = 1.0, -1.0
    basis = antisymmetric.reshape(n * n, len(i)) / np.sqrt(2.0)
    return basis.T @ (np.kron(A, one) + np.kron(one, A)) @ basis
