"""Alarm flags that a control period returns to its caller."""

from __future__ import annotations

from enum import IntFlag
from typing import NamedTuple

import numpy as np

from controllers.premises import CONTACT
from kernels import inline


class Alarm(IntFlag):
    """Alarms of a control period, as flags."""

    LAYER_REACHED = 1  # ||s|| is within the boundary layer for the first time
    NOT_FINITE = 2  # the state is not finite
    SINGULAR = 4  # J_q is nearly singular
    DIVERGING = 8  # the joints are too fast
    OVER_BOUND = 16  # ||s|| is over its bound, though all premises hold
    SATURATED = 32  # a drive's limit begins to cut the torque
    BAND_REACHED = 64  # ||s|| is within the band for the first time
    CONTACT_LOST = 128  # the tool has left a surface that it should press
    PROMISE_LOST = 256  # a premise fails before ||s|| was within both layer and band


LAYER_REACHED, NOT_FINITE, SINGULAR, DIVERGING, OVER_BOUND, SATURATED, BAND_REACHED, CONTACT_LOST, PROMISE_LOST = (
    int(alarm) for alarm in Alarm
)


class Limits(NamedTuple):
    """Thresholds of the alarms of a period.
    sigma_min: m.
    speed: rad/s.
    q_middle, q_half: (n,) rad or m, the range of each joint; q_half is infinite where it has none.
    rigid: (3,), 1 for each rigid surface.
    meets: (3,), 1 for each surface with a mass that the tool may leave and meet again.
    pressed: (3,), 1 for each surface that is not rigid, but that the tool should press."""

    sigma_min: float
    speed: float
    q_middle: np.ndarray
    q_half: np.ndarray
    rigid: np.ndarray
    meets: np.ndarray
    pressed: np.ndarray


@inline
def lost_contact(limits, evaluation, multiplier, absent):
    """Compare the contacts with those of the previous period; returns CONTACT_LOST where one was lost. `absent` (3,) is
    read, and set anew for the next period."""
    was, evaluation.touching, struck = evaluation.touching, True, 0.0
    for i in range(3):
        if limits.pressed[i] and multiplier[i] == 0.0:
            evaluation.touching = False
        if limits.rigid[i]:
            if absent[i]:
                evaluation.touching = False
                struck += 1.0
            absent[i] = 0
        elif limits.meets[i]:
            if absent[i] and multiplier[i] != 0.0:
                struck += 1.0
            absent[i] = 1 if multiplier[i] == 0.0 else 0
    evaluation.table.value[CONTACT] = struck
    return CONTACT_LOST if was and not evaluation.touching else 0


@inline
def began_to_saturate(evaluation):
    """Compare the torque as asked for with that of the drives; returns SATURATED in the first period that differs."""
    was, evaluation.saturated = evaluation.saturated, False
    for i in range(evaluation.applied.shape[0]):
        if evaluation.applied[i] != evaluation.output.tau[i]:
            evaluation.saturated = True
    return SATURATED if evaluation.saturated and not was else 0


@inline
def beyond_limits(limits, evaluation, speed):
    """Flags of the promise, and of what goes beyond a limit. speed: rad/s, of the joints."""
    s_norm, flags = evaluation.output.s_norm, evaluation.promise_alarms
    if not np.isfinite(speed + s_norm):
        flags += NOT_FINITE
    if limits.sigma_min * evaluation.seen.task.J_q_inv_norm > 1.0:
        flags += SINGULAR
    if speed > limits.speed:
        flags += DIVERGING
    return flags
