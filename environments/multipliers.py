"""Multipliers of several surfaces at once: of those with mass (28) and of rigid ones (39), of which some may let go."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from environments.coupled_surfaces import CoupledWork, coupled_equations, find_pressed
from environments.surfaces.chart import one_of
from kernels import inline
from kernels.algebra import solve_leading

SETS = 8  # of up to three surfaces that may be let go
LEAVES = 1e-9  # share of its terms by which an acceleration or speed away from a surface may miss zero, for rounding


@inline
def find_touched(world, touch, held, work):
    """Find the surfaces that the tool touches, `work.touches` (3,); held (3,): of rigid ones, see `Holding`."""
    if world.environment.coupled:
        find_pressed(world, touch, work)
        return
    for i in range(world.shapes.number):
        inside = one_of(touch, i).phi > 0.0 or not one_of(world.contacts, i).unilateral
        touches = held[i] > 0 if world.rigid else inside
        work.touches[i] = 1 if touches else 0


class MultiplierWork(NamedTuple):
    """Memory of `heavy_multipliers`, one entry or row for each of three surfaces.
    directions: (3, n), M^-1 J_v^T times the force of a unit multiplier.
    mobility: (3, 3) 1/kg; free: (3,) m/s^2: phi_ddot = free - mobility lambda.
    S, b: (3, 3) and (3,), the equations S lambda = b.
    side: (3,), the sign of the multiplier for which friction was computed.
    touches, acts: (3,), 1 where the tool touches the surface, and where the surface carries a force.
    found, whole: (3,) N, the multipliers, and those with every surface held.
    coupled: memory of coupled surfaces."""

    directions: np.ndarray
    mobility: np.ndarray
    free: np.ndarray
    S: np.ndarray
    b: np.ndarray
    side: np.ndarray
    touches: np.ndarray
    acts: np.ndarray
    found: np.ndarray
    whole: np.ndarray
    coupled: CoupledWork

    @classmethod
    def zeros(cls, n: int) -> MultiplierWork:
        """Memory for an arm with n joints."""
        v, square, no = np.zeros(3), np.zeros((3, 3)), np.zeros(3, dtype=np.int64)
        return cls(np.zeros((3, n)), square, v, square, v, v, no, no, v, v, CoupledWork.zeros())


@inline
def _separate_equations(world, touch, work):
    """Compute S and b of the equations S lambda = b of the surfaces that act, `work.acts`, with phi_ddot = free -
    mobility lambda; of the others lambda = 0."""
    k = world.shapes.number
    for i in range(k):
        contact, met = one_of(world.contacts, i), one_of(touch, i)
        weight, own, pull = 1.0, 0.0, 0.0
        if not world.rigid:
            weight, own = contact.M_e, 1.0
            pull = contact.M_e * met.a_e + contact.B_e * met.phi_dot + contact.K_e * met.phi
        work.b[i] = weight * work.free[i] + pull
        for j in range(k):
            work.S[i, j] = weight * work.mobility[i, j] + (own if i == j else 0.0)
            if not (work.acts[i] and work.acts[j]):
                work.S[i, j] = 1.0 if i == j else 0.0
        if not work.acts[i]:
            work.b[i] = 0.0


@inline
def heavy_multipliers(world, touch, work, multiplier):
    """Multipliers lambda (3,) N where they depend on the acceleration phi_ddot = free - mobility lambda: (28), (39), of
    the surfaces that the tool touches, `work.touches`.

    A unilateral surface that would have to pull carries no force, unless it is rigid: then its negative multiplier is
    returned, and the caller decides which contacts are lost.
    """
    k = world.shapes.number
    for i in range(k):
        work.acts[i] = work.touches[i]
    while True:
        if world.environment.coupled:
            coupled_equations(world, touch, work)
        else:
            _separate_equations(world, touch, work)
        solve_leading(work.S, work.b, k, multiplier)
        most, pulls = 0.0, -1
        for i in range(k):
            contact = one_of(world.contacts, i)
            if not world.rigid and contact.unilateral and work.acts[i] and multiplier[i] < most:
                most, pulls = multiplier[i], i
        if pulls < 0:
            return
        work.acts[pulls] = 0


@inline
def let_go(world, held, trial, touches):
    """Choose the surfaces that the tool stays on, `touches` (3,): all that are held but for a set that is let go. Bit i
    of `trial` releases surface i; `trial == SETS` releases every unilateral one. Returns False for a set with a surface
    that is not held or also pulls."""
    for i in range(3):
        touches[i] = 1 if held[i] > 0 else 0
    for i in range(world.shapes.number):
        free = held[i] > 0 and one_of(world.contacts, i).unilateral
        if trial == SETS:
            touches[i] = 0 if free else touches[i]
        elif trial >> i & 1:
            if not free:
                return False
            touches[i] = 0
    return trial == SETS or trial >> world.shapes.number == 0


@inline
def one_sided(world, held, work, before, push):
    """Whether no surface of `work.touches` pulls, and the tool enters no surface that is let go. push: (3,), forces or
    impulses of the surfaces; before: (3,), motions along phi without them, which become before - mobility push."""
    k = world.shapes.number
    for i in range(k):
        if work.touches[i]:
            if push[i] < 0.0 and one_of(world.contacts, i).unilateral:
                return False
        elif held[i] > 0:
            motion, size = before[i], abs(before[i])
            for j in range(k):
                part = work.mobility[i, j] * push[j]
                motion, size = motion - part, size + abs(part)
            if motion > LEAVES * size:
                return False
    return True
