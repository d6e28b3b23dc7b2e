"""Linear algebra of small matrices, without memory of its own: results go to the last argument.

LAPACK through numpy costs 1 to 10 us a call at this size and memory for every result; these functions cost 0.01 to
0.3 us. The sizes are those of the last argument, which is part of a record: the compiler knows them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from kernels import Elsewhere, inline

# for arrays within records only: their shapes are known from their types
multiply: Any = Elsewhere("kernels.rows", "multiply")
transposed_multiply: Any = Elsewhere("kernels.rows", "transposed_multiply")
transposed_times: Any = Elsewhere("kernels.rows", "transposed_times")
spectral_norm: Any = Elsewhere("kernels.rows", "spectral_norm")
eliminate: Any = Elsewhere("kernels.rows", "eliminate")


@inline
def copy(a, out):
    """Copy a vector: out = a."""
    for i in range(out.shape[0]):
        out[i] = a[i]


@inline
def copy_matrix(A, out):
    """Copy a matrix: out = A."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = A[i, j]


@inline
def cross(a, b):
    """Cross product a x b of two vectors in space, as a tuple."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inline
def times(A, x, out):
    """Matrix times vector: out = A x."""
    for i in range(out.shape[0]):
        total = 0.0
        for j in range(x.shape[0]):
            total += A[i, j] * x[j]
        out[i] = total


@inline
def torque_of_wrench(J_v, J_w, wrench, out):
    """Joint torques of a wrench (f, m), (6,): out = J_v^T f + J_w^T m."""
    for j in range(out.shape[0]):
        total = 0.0
        for a in range(3):
            total += J_v[a, j] * wrench[a] + J_w[a, j] * wrench[3 + a]
        out[j] = total


@inline
def row_times(A, i, x):
    """Entry i of the product A x."""
    total = 0.0
    for j in range(x.shape[0]):
        total += A[i, j] * x[j]
    return total


@inline
def congruence(T, A, work, out):
    """Congruence out = T^T A T, of arrays in records; work has the shape of A T."""
    multiply(A, T, work)
    transposed_multiply(T, work, out)


@inline
def dot(a, b):
    """Scalar product a . b."""
    total = 0.0
    for i in range(a.shape[0]):
        total += a[i] * b[i]
    return total


@inline
def norm(v):
    """Euclidean norm of a vector, the norm of (6)."""
    return np.sqrt(dot(v, v))


@inline
def quadratic(x, A):
    """Quadratic form x . A x."""
    total = 0.0
    for i in range(x.shape[0]):
        total += x[i] * row_times(A, i, x)
    return total


@inline
def norm_of_product(A, x):
    """Euclidean norm ||A x|| of a product."""
    square = 0.0
    for i in range(A.shape[0]):
        square += row_times(A, i, x) ** 2
    return np.sqrt(square)


@inline
def invert(A, work, out):
    """Inverse out = A^-1 by Gauss and Jordan with row pivots, of arrays in records; work has the shape of A. Raises
    ValueError when A is singular."""
    n = out.shape[0]
    copy_matrix(A, out)
    for c in range(n):
        pivot = c
        for i in range(c + 1, n):
            if abs(out[i, c]) > abs(out[pivot, c]):
                pivot = i
        if out[pivot, c] == 0.0:
            raise ValueError("singular matrix")
        work[0, c] = pivot
        if pivot != c:
            for j in range(n):
                out[c, j], out[pivot, j] = out[pivot, j], out[c, j]
        eliminate(out, c)
    for back in range(n):  # two rows of A that changed places are two columns of the inverse to be changed back
        c = n - 1 - back
        pivot = int(work[0, c])
        if pivot != c:
            for i in range(n):
                out[i, c], out[i, pivot] = out[i, pivot], out[i, c]


@inline
def is_positive_definite(A, work):
    """Whether a symmetric A is positive definite, by Cholesky's factor, which work receives."""
    for i in range(A.shape[0]):
        for j in range(i + 1):
            total = A[i, j]
            for k in range(j):
                total -= work[i, k] * work[j, k]
            if i > j:
                work[i, j] = total / work[j, j]
            elif total > 0.0:
                work[i, i] = np.sqrt(total)
            else:
                return False
    return True


@inline
def solve_spd(A, b, work, out):
    """Solution out = A^-1 b for a symmetric positive definite A. work: receives Cholesky's factor, with the reciprocal
    of each diagonal entry in place of the entry."""
    n = out.shape[0]
    for i in range(n):
        for j in range(i):
            total = A[i, j]
            for k in range(j):
                total -= work[i, k] * work[j, k]
            work[i, j] = total * work[j, j]
        total = A[i, i]
        for k in range(i):
            total -= work[i, k] * work[i, k]
        work[i, i] = 1.0 / np.sqrt(total)
    for i in range(n):
        total = b[i]
        for k in range(i):
            total -= work[i, k] * out[k]
        out[i] = total * work[i, i]
    for i in range(n - 1, -1, -1):
        total = out[i]
        for k in range(i + 1, n):
            total -= work[k, i] * out[k]
        out[i] = total * work[i, i]


@inline
def solve_leading(A, b, k, x):
    """Solution x of A x = b with the leading (k, k) part of A, by Gauss's method with pivots; A and b are overwritten.
    Where that part is singular, x is not finite."""
    for c in range(k):
        pivot = c
        for i in range(c + 1, k):
            if abs(A[i, c]) > abs(A[pivot, c]):
                pivot = i
        if pivot != c:
            for j in range(k):
                A[c, j], A[pivot, j] = A[pivot, j], A[c, j]
            b[c], b[pivot] = b[pivot], b[c]
        for i in range(c + 1, k):
            share = A[i, c] / A[c, c]
            for j in range(c, k):
                A[i, j] -= share * A[c, j]
            b[i] -= share * b[c]
    for back in range(k):
        i = k - 1 - back
        rest = b[i]
        for j in range(i + 1, k):
            rest -= A[i, j] * x[j]
        x[i] = rest / A[i, i]
