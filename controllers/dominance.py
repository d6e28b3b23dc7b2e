"""Diagonal dominance: a test that all convex combinations of some matrices are stable, Theorems 3 and 4 of the note on
interval matrices, of which the paper's first page shows the end.

For a matrix A = A^D + A^C, diagonal and off-diagonal part, with A^C >= 0: one stable matrix that the others dominate
proves every convex combination stable. With one vector d > 0 all of them are dominated by their diagonals, so that
max_i |x_i| / d_i (rowwise) or sum_i d_i |x_i| (columnwise) falls along x_dot = A x whichever of them A is: the
combination may even change with time, however fast.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

By = Literal["rows", "columns"]


def dominates(B: np.ndarray, B_0: np.ndarray, by: By) -> bool:
    """Whether B (n, n) proportionally dominates B_0: |b_ij| / b_ii <= |b0_ij| / b0_ii for all j != i.

    by columns: divided by b_jj. False where a diagonal has an entry <= 0.
    """
    if (np.diag(B) <= 0.0).any() or (np.diag(B_0) <= 0.0).any():
        return False
    return bool((_proportions(B, by) <= _proportions(B_0, by)).all())


def _proportions(B: np.ndarray, by: By) -> np.ndarray:
    diagonal = np.diag(B)
    proportions = np.abs(B) / (diagonal[:, None] if by == "rows" else diagonal)
    np.fill_diagonal(proportions, 0.0)
    return proportions


def schur_on_hull(A: Sequence[np.ndarray], by: By) -> bool:
    """Theorem 3 for matrices (n, n) >= 0: A_0 is Schur-stable and I - A_k proportionally dominates I - A_0.

    True: every convex combination is Schur-stable. False: nothing is said.
    """
    one = np.eye(len(A[0]))
    if any((A_k < 0.0).any() for A_k in A) or np.abs(np.linalg.eigvals(A[0])).max() >= 1.0:
        return False
    return all(dominates(one - A_k, one - A[0], by) for A_k in A[1:])


def hurwitz_on_hull(A: Sequence[np.ndarray], by: By) -> bool:
    """Theorem 4 for matrices (n, n) with A^C >= 0: A_0 is Hurwitz-stable and -A_k proportionally dominates -A_0.

    True: every convex combination is Hurwitz-stable. False: nothing is said.
    """
    if any((A_k - np.diag(np.diag(A_k)) < 0.0).any() for A_k in A) or np.linalg.eigvals(A[0]).real.max() >= 0.0:
        return False
    return all(dominates(-A_k, -A[0], by) for A_k in A[1:])
