"""Followed faces: surfaces of one elastic body whose distance is followed, and what they add to r_fd (33).

The surfaces P, whose force is controlled, and O, whose distance is followed, yield together. With C = K_e_hat^-1 over
both, (32) is

    r_f = C_PP f_n + C_PO lambda_O,        u_O = C_OP f_n + C_OO lambda_O.

u_O, where the followed faces are, is where the tool is, r_Od, as long as it presses them; one that it does not press
carries no force. So 0 <= lambda_O and u_O >= r_Od, and in each row one of the two is an equality. There is one
solution, since C is symmetric positive definite, and for each set of faces that are pressed it is linear in
w = (f_nd, r_Od): r_fd = C_PP f_nd + C_PO lambda_O. Without followed faces it is (33).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from kernels import inline

MOST = 3  # surfaces; the first of them is pressed, so no more than three sets of followed ones are pressed


class FollowedFaces(NamedTuple):
    """Addition of followed faces to r_fd, for each set of them that the tool may press.
    sets: number of these sets, 0 where no followed face belongs to the body.
    surfaces: number of all surfaces, k.
    added: (3, 3, 3), of each set the matrix D of r_fd = C_PP f_nd + D w.
    signs: (3, 3, 3), of each set the matrix S with S w >= 0 where it is the one that is pressed."""

    sets: int
    surfaces: int
    added: np.ndarray
    signs: np.ndarray

    @classmethod
    def none(cls) -> FollowedFaces:
        """No followed faces."""
        return cls(0, 0, np.zeros((MOST, MOST, MOST)), np.zeros((MOST, MOST, MOST)))

    @classmethod
    def of(cls, K_e_hat: np.ndarray, pressed: int, unilateral: Sequence[bool]) -> FollowedFaces:
        """Followed faces of a body. K_e_hat: (k, k) N/m, s.p.d. pressed: number of the surfaces P, the first ones.
        unilateral: (k,), whether a surface only pushes; one that pulls as well is always touched."""
        C, k = np.linalg.inv(K_e_hat), len(K_e_hat)
        added, signs, sets = np.zeros((MOST, MOST, MOST)), np.zeros((MOST, MOST, MOST)), 0
        gap = np.hstack([-C[pressed:, :pressed], np.eye(k - pressed)])  # r_Od - C_OP f_nd
        if not C[pressed:, :pressed].any():
            return cls.none()
        for meets in product((True, False), repeat=k - pressed):
            on = np.flatnonzero(meets)
            if not len(on) or any(not met and not one for met, one in zip(meets, unilateral[pressed:], strict=True)):
                continue
            within = pressed + on
            force = np.zeros((k - pressed, k))  # lambda_O per w
            force[on] = np.linalg.solve(C[np.ix_(within, within)], gap[on])
            added[sets, :pressed, :k] = C[:pressed, pressed:] @ force
            beyond = C[pressed:, pressed:] @ force - gap  # u_O - r_Od per w
            for i, (met, one) in enumerate(zip(meets, unilateral[pressed:], strict=True)):
                if one:
                    signs[sets, i, :k] = force[i] if met else beyond[i]
            sets += 1
        return cls(sets, k, added, signs)


@inline
def set_pressed(faces, w):
    """Number of the set of followed faces that are pressed at w, three numbers; `faces.sets` for none."""
    S = faces.signs
    for number in range(faces.sets):
        fits = True
        for i in range(MOST):
            fits = fits and S[number, i, 0] * w[0] + S[number, i, 1] * w[1] + S[number, i, 2] * w[2] >= 0.0
        if fits:
            return number
    return faces.sets
