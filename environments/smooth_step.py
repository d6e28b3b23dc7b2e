"""Smooth steps by minimum jerk: from 0 to 1, and from rest to a steady speed, each with two exact derivatives."""

from kernels import inline


@inline
def minimum_jerk(t, duration):
    """Step sigma(t) from 0 to 1 in `duration` s with zero speed and acceleration at both ends, and two derivatives."""
    if t <= 0.0:
        return 0.0, 0.0, 0.0
    if t >= duration:
        return 1.0, 0.0, 0.0
    u = t / duration
    return (
        u**3 * (10 - 15 * u + 6 * u**2),
        30 * u**2 * (1 - u) ** 2 / duration,
        60 * u * (1 - u) * (1 - 2 * u) / duration**2,
    )


@inline
def phase(t, omega, ramp):
    """Phase theta(t) whose rate rises smoothly from 0 to omega within `ramp` s (the integral of minimum jerk)."""
    if ramp <= 0.0:
        return omega * t, omega, 0.0
    if t >= ramp:
        return omega * (t - 0.5 * ramp), omega, 0.0
    sigma, sigma_dot, _ = minimum_jerk(t, ramp)
    u = max(t, 0.0) / ramp
    return omega * ramp * u**4 * (2.5 - 3 * u + u**2), omega * sigma, omega * sigma_dot
