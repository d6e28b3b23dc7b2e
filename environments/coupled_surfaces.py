"""Surfaces that belong to one elastic body: M_e, B_e and K_e of (28) as matrices over up to three of them.

A bracket that is touched on two faces yields on both where one of them is pressed. With u (k,) the displacement of
each surface along its phi, the forces of the tool on them are

    lambda = M_e (u_ddot + a_e) + B_e u_dot + K_e u,

with a_e (k,) the acceleration of the surfaces along their phi where they move.
A surface that acts, that is carries a force, is where the tool is, u_i = phi_i. One that the tool does not touch
carries none, and rests where the others leave it: K_e u = 0 in its row. So u = L phi of those that act, and

    lambda = L^T (M_e (L phi_ddot + a_e) + B_e L phi_dot + K_e L phi)

for them: L^T K_e L is the Schur complement of K_e, which is exact for an elastic body; L^T B_e L and L^T M_e L are
the damping and the mass of the body in the shape that it then has. docs/theory.md says why.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from environments.surfaces.chart import one_of
from kernels import inline
from kernels.algebra import solve_leading

MOST = 3  # surfaces
NEARLY = 1e-9  # share of its terms by which a force or a distance may miss zero, for rounding


class EnvironmentMatrices(NamedTuple):
    """Matrices (3, 3) of (28) and (32), symmetric: M_e kg, B_e N s/m, K_e N/m. Of k surfaces the leading (k, k) count.
    coupled: whether one of them has an entry beside its diagonal; kernels read them only then, otherwise the numbers of
    each contact."""

    coupled: bool
    M_e: np.ndarray
    B_e: np.ndarray
    K_e: np.ndarray

    @classmethod
    def of(cls, M_e: np.ndarray, B_e: np.ndarray, K_e: np.ndarray) -> EnvironmentMatrices:
        """Matrices (k, k) of k surfaces."""
        given, whole = (M_e, B_e, K_e), np.zeros((3, MOST, MOST))
        for matrix, place in zip(given, whole, strict=True):
            place[: len(matrix), : len(matrix)] = matrix
        coupled = any(np.count_nonzero(matrix - np.diag(np.diag(matrix))) for matrix in given)
        return cls(coupled, *whole)

    @classmethod
    def apart(cls, M_e: Sequence[float], B_e: Sequence[float], K_e: Sequence[float]) -> EnvironmentMatrices:
        """Diagonals (k,) of surfaces that do not feel each other."""
        return cls.of(np.diag(M_e), np.diag(B_e), np.diag(K_e))

    def acting(self, acts: Sequence[int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Matrices L^T X L, (a, a), of M_e, B_e and K_e: those of the surfaces `acts` while no other one is touched."""
        free = [i for i in range(MOST) if i not in acts and self.K_e[i, i] > 0.0]
        L = np.zeros((MOST, len(acts)))
        L[acts, np.arange(len(acts))] = 1.0
        L[free] = -np.linalg.solve(self.K_e[np.ix_(free, free)], self.K_e[np.ix_(free, acts)])
        return L.T @ self.M_e @ L, L.T @ self.B_e @ L, L.T @ self.K_e @ L


class CoupledWork(NamedTuple):
    """Memory of coupled surfaces.
    L: (3, 3), with u = L phi; the columns of surfaces that do not act are 0.
    mass: (3, 3) kg, L^T M_e L.
    u, u_dot: (3,) m and m/s.
    column: (3,), one column of L while it is computed."""

    L: np.ndarray
    mass: np.ndarray
    u: np.ndarray
    u_dot: np.ndarray
    column: np.ndarray

    @classmethod
    def zeros(cls) -> CoupledWork:
        """Memory before it is used."""
        square, v = np.zeros((MOST, MOST)), np.zeros(MOST)
        return cls(square, square, v, v, v)


@inline
def _yield(world, touch, work):
    """Compute L, u and u_dot for the surfaces that act, `work.acts`."""
    K_e, k, own = world.environment.K_e, world.shapes.number, work.coupled
    for j in range(k):
        for i in range(k):
            work.b[i] = 1.0 if i == j else 0.0 if work.acts[i] else -K_e[i, j]
            for a in range(k):
                both_free = work.acts[i] == 0 and work.acts[a] == 0
                work.S[i, a] = K_e[i, a] if both_free else 1.0 if i == a else 0.0
        if work.acts[j]:
            solve_leading(work.S, work.b, k, own.column)
        for i in range(k):
            own.L[i, j] = own.column[i] if work.acts[j] else 0.0
    for i in range(k):
        own.u[i] = own.u_dot[i] = 0.0
        for j in range(k):
            met = one_of(touch, j)
            own.u[i] += own.L[i, j] * met.phi
            own.u_dot[i] += own.L[i, j] * met.phi_dot


@inline
def _rests(world, touch, work):
    """Whether the surfaces that act are those that the tool presses on a body at rest. Of the surfaces that only push,
    none that acts may pull, and the tool may be inside none of the others, where the body has left it."""
    K_e, k, u = world.environment.K_e, world.shapes.number, work.coupled.u
    for i in range(k):
        if not one_of(world.contacts, i).unilateral:
            continue
        if work.acts[i]:
            away, size = 0.0, 0.0
            for j in range(k):
                away -= K_e[i, j] * u[j]
                size += abs(K_e[i, j] * u[j])
        else:
            away, size = one_of(touch, i).phi - u[i], abs(one_of(touch, i).phi) + abs(u[i])
        if away > NEARLY * size:
            return False
    return True


@inline
def find_pressed(world, touch, work):
    """Find the surfaces that the tool touches, `work.touches` (3,): for a symmetric positive definite K_e there is just
    one such set, which is the solution of 0 <= K_e u, u >= phi with one of the two an equality for each surface."""
    k = world.shapes.number
    for trial in range(1 << MOST):
        possible = trial >> k == 0
        for i in range(k):
            work.acts[i] = 0 if trial >> i & 1 else 1
            possible = possible and (work.acts[i] == 1 or one_of(world.contacts, i).unilateral)
        if possible:
            for i in range(k):
                work.touches[i] = work.acts[i]
            _yield(world, touch, work)
            if _rests(world, touch, work):
                return


@inline
def coupled_equations(world, touch, work):
    """Compute S and b of the equations S lambda = b of the surfaces that act, `work.acts`, with phi_ddot = free -
    mobility lambda; of the others lambda = 0."""
    matrices, k, own = world.environment, world.shapes.number, work.coupled
    _yield(world, touch, work)
    for i in range(k):
        for j in range(k):
            own.mass[i, j] = 0.0
            for a in range(k):
                for c in range(k):
                    own.mass[i, j] += own.L[a, i] * matrices.M_e[a, c] * own.L[c, j]
    for i in range(k):
        work.b[i] = 0.0
        for a in range(k):
            for c in range(k):
                pull = matrices.K_e[a, c] * own.u[c] + matrices.B_e[a, c] * own.u_dot[c]
                work.b[i] += own.L[a, i] * (pull + matrices.M_e[a, c] * one_of(touch, c).a_e)
        for j in range(k):
            work.b[i] += own.mass[i, j] * work.free[j]
            work.S[i, j] = 1.0 if i == j else 0.0
            for a in range(k):
                work.S[i, j] += own.mass[i, a] * work.mobility[a, j]
