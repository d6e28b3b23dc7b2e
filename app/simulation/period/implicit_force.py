"""Equation for the force of an ideal sensor: the law's torque depends on the force, and the force on the torque. It is
solved by Broyden's method, which for one surface is the secant method."""

from __future__ import annotations

from kernels import kernel

FORCE_ITERATIONS, FORCE_MISSED = 30, 1e-10  # most iterations; error as a share of 1 N and the force


@kernel
def force_found(error, guess):
    """Whether the multipliers that a guess (3,) N causes differ from it by no more than rounding; error: (3,) N."""
    found = True
    for i in range(3):
        found = found and abs(error[i]) <= FORCE_MISSED * (1.0 + abs(guess[i]))
    return found


@kernel
def better_guess(inverse, error, change, guess):
    """Compute the next guess (3,) N, and its change (3,) N; inverse: (3, 3), of the error's derivative."""
    for i in range(3):
        change[i] = 0.0
        for j in range(3):
            change[i] -= inverse[i, j] * error[j]
        guess[i] += change[i]


@kernel
def improve_inverse(inverse, change, difference):
    """Improve the inverse derivative (3, 3) by the difference (3,) N that a change (3,) N of the guess made of the
    error."""
    weight = 0.0
    for i in range(3):
        for j in range(3):
            weight += change[i] * inverse[i, j] * difference[j]
    if weight == 0.0:
        return
    across, missed = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(3):
        across = (
            across[1],
            across[2],
            change[0] * inverse[0, i] + change[1] * inverse[1, i] + change[2] * inverse[2, i],
        )
        reached = inverse[i, 0] * difference[0] + inverse[i, 1] * difference[1] + inverse[i, 2] * difference[2]
        missed = (missed[1], missed[2], (change[i] - reached) / weight)
    for i in range(3):
        for j in range(3):
            inverse[i, j] += missed[i] * across[j]
