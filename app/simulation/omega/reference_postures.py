"""Postures of the arm on its reference, by Newton's method: at one instant, and all along it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from app.scenario.errors import PathOutOfReach
from app.simulation.period.observation import Observation
from app.simulation.period.planned_reference import Planned
from controllers.control_law import Reference
from controllers.task_space import TaskSpace, turn_towards

if TYPE_CHECKING:
    from kernels.records import Record

FEWEST, MOST = 192, 2048  # postures along the reference, unless more are needed to follow it
SELDOM = 0.5  # s, between two of them at most, unless that takes more than half of `MOST`
LOOKED_INTO = 0.1  # s: within a longer interval the arm may go away and come back
WITHIN = 0.38  # where in an interval that is looked for; no path is likely to have a rhythm with it
FAR = 0.5  # radii of Omega, between two that follow each other at most
SHORT = 0.01  # s, an interval that is not divided any more
LARGEST_STEP = 1.0  # rad (m), between two that follow each other: farther away the arm has not followed the reference
REACHED = 1e-6  # m (rad), from r_d
SWEEPS = 4  # number of times that they go from the reference to the shifted one and back

Observe = Callable[[np.ndarray, np.ndarray, float], "Record[Observation]"]


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
        turn_towards.py_func(reference.r_d, task)
        step = task.J_q_inv @ (reference.r_d - task.r)
        if np.abs(step).max() < 1e-9:
            return _Solution(q, task, reached=True)
        q = q + step
        task = observe(q, still, t).views.task
    turn_towards.py_func(reference.r_d, task)
    return _Solution(q, task, reached=bool(np.abs(reference.r_d - task.r).max() < REACHED))


def postures_along(
    observe: Observe, unshifted: Planned, shift: np.ndarray, q_0: np.ndarray, duration: float, radius: float
) -> ReferencePostures:
    """Postures along the reference over the duration (s), and between it and its shift by (n,) m, at most `FAR` times
    the radius (rad) of Omega from each other. Those late in a long run may be farther apart.

    Raises PathOutOfReach when the arm cannot follow it.
    """

    def on_path(near: np.ndarray, fraction: float) -> np.ndarray | None:
        t = fraction * duration
        reference = unshifted.at(t)
        reference.r_d[:] += 0.5 * (1.0 - np.cos(2 * np.pi * SWEEPS * fraction)) * shift
        try:
            found = _solved(observe, near, reference, t)
        except ValueError:  # J_q exactly singular
            return None
        return found.q if found.reached else None

    def apart(there: np.ndarray | None) -> float:
        return math.inf if there is None else float(np.linalg.norm(there - q[-1]))

    count = min(max(FEWEST, math.ceil(duration / SELDOM)), MOST // 2)
    waiting = np.linspace(1.0, 0.0, count).tolist()
    q, t = [q_0], [0.0]
    fraction = 0.0
    while waiting:
        then = waiting[-1]
        there, between = on_path(q[-1], then), (then - fraction) * duration
        way = apart(there)
        near = way < LARGEST_STEP
        if between > SHORT and (len(q) + len(waiting) < MOST or not near):
            if not way <= FAR * radius:
                waiting.append(0.5 * (fraction + then))
                continue
            within = fraction + WITHIN * (then - fraction)
            if between > LOOKED_INTO and not apart(on_path(q[-1], within)) <= FAR * radius:
                waiting.append(within)
                continue
        if there is None or not near:
            raise PathOutOfReach(
                f"motion: the arm cannot follow the reference beyond t = {then * duration:.3g} s; "
                "allowed: a path within its reach"
            )
        if len(q) == 1:  # the arm comes to the reference from where it stands, maybe off the surface
            steps = 1 + int(min(way / max(FAR * radius, np.finfo(float).tiny), MOST // 2))
            q += [q_0 + k / steps * (there - q_0) for k in range(1, steps)]
            t += [0.0] * (steps - 1)
        q.append(there)
        t.append(then * duration)
        fraction = waiting.pop()
    return ReferencePostures(np.array(q), np.array(t))
