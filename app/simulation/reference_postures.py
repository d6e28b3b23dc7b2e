"""Postures of the arm on its reference, by Newton's method: at one instant, and all along it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from app.scenario.errors import PathOutOfReach
from app.simulation.observation import Observation
from app.simulation.planned_reference import Planned
from controllers.control_law import Reference
from controllers.task_space import TaskSpace
from kernels.records import Record

FEWEST, MOST = 192, 1024  # postures along the reference
SELDOM = 0.5  # s, between two of them at most, unless that takes more than half of `MOST`
FAR = 0.5  # radii of Omega, between two that follow each other at most
SHORT = 0.01  # s, an interval that is not divided any more
NEAR = 1.0  # rad, between two that follow each other: farther away the arm has not followed the reference
REACHED = 1e-6  # m, from r_d
SWEEPS = 4  # number of times that they go from the reference to the shifted one and back

Observe = Callable[[np.ndarray, np.ndarray, float], Record[Observation]]


class DesiredPosture(NamedTuple):
    """Posture of the arm on the reference.
    q, q_dot: (n,) rad and rad/s, q_d and q_d_dot."""

    q: np.ndarray
    q_dot: np.ndarray


class ReferencePostures(NamedTuple):
    """Postures along the reference.
    q: (N, n) rad, first the scenario's own posture.
    t: (N,) s."""

    q: np.ndarray
    t: np.ndarray


class _Solution(NamedTuple):
    """Solution of r(q, t) = r_d. q: (n,) rad; task: task coordinates there; reached: whether it is one."""

    q: np.ndarray
    task: TaskSpace
    reached: bool


def posture_at(observe: Observe, q: np.ndarray, reference: Reference, t: float) -> DesiredPosture:
    """Posture with r(q_d, t) = r_d and the rate of both, by Newton's method from q (n,) rad."""
    found = _solved(observe, q, reference, t)
    return DesiredPosture(found.q, found.task.J_q_inv @ (reference.r_d_dot - found.task.v_t))


def _solved(observe: Observe, q: np.ndarray, reference: Reference, t: float) -> _Solution:
    """Solution by Newton's method from q (n,) rad. Raises ValueError where J_q is exactly singular."""
    still = np.zeros_like(q)
    task = observe(q, still, t).views.task
    for _ in range(8):
        left = reference.r_d - task.r
        away = task.J_q_inv @ left
        if np.abs(away).max() < 1e-9:
            return _Solution(q, task, reached=True)
        q = q + away
        task = observe(q, still, t).views.task
    return _Solution(q, task, reached=bool(np.abs(reference.r_d - task.r).max() < REACHED))


def postures_along(
    observe: Observe, unshifted: Planned, shift: np.ndarray, q_0: np.ndarray, duration: float, radius: float
) -> ReferencePostures:
    """Postures along the reference over the duration (s), and between it and its shift by (n,) m: so close that balls
    of this radius (rad) around them overlap, unless that takes more than `MOST`.

    Raises PathOutOfReach when the arm cannot follow it.
    """

    def on_path(q: np.ndarray, fraction: float) -> DesiredPosture | None:
        t = fraction * duration
        reference = unshifted.at(t)
        reference.r_d[:] += 0.5 * (1.0 - np.cos(2 * np.pi * SWEEPS * fraction)) * shift
        try:
            found = _solved(observe, q, reference, t)
        except ValueError:  # J_q exactly singular
            return None
        rate = found.task.J_q_inv @ (reference.r_d_dot - found.task.v_t)
        return DesiredPosture(found.q, rate) if found.reached else None

    count = min(max(FEWEST, math.ceil(duration / SELDOM)), MOST // 2)
    waiting = np.linspace(1.0, 0.0, count).tolist()
    q, t = [q_0], [0.0]
    fraction, speed = 0.0, 0.0
    while waiting:
        then = waiting[-1]
        there = on_path(q[-1], then)
        apart = math.inf if there is None else float(np.linalg.norm(there.q - q[-1]))
        pace = math.inf if there is None else float(np.linalg.norm(there.q_dot))
        between = (then - fraction) * duration
        # the speeds, too: a path that comes back is elsewhere between two instants
        way = max(apart, 0.5 * (speed + pace) * between)
        if way > FAR * radius and between > SHORT and len(q) + len(waiting) < MOST:
            waiting.append(0.5 * (fraction + then))
            continue
        if there is None or not apart < NEAR:
            raise PathOutOfReach(f"motion: the arm cannot follow the reference beyond t = {then * duration:.3g} s")
        # no further one is on the reference there: on the straight way, for the balls to overlap
        parts = min(math.ceil(apart / (FAR * radius)), MOST) or 1
        q.extend(np.linspace(q[-1], there.q, parts + 1)[1:])
        t.extend([then * duration] * parts)
        fraction, speed = waiting.pop(), pace
    return ReferencePostures(np.array(q), np.array(t))
