"""Integrators of the plant: the table of them, and their steps of an `Arm` whose q_ddot is known, for `Plant` and the
compiled run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from kernels import inline, kernel
from kernels.algebra import copy

Acceleration = Callable[[np.ndarray, np.ndarray], np.ndarray]
Step = Callable[[Acceleration, np.ndarray, np.ndarray, float], tuple[np.ndarray, np.ndarray]]
RK4_STAGES = ((1.0, 0.5), (2.0, 0.5), (2.0, 1.0))  # weight of each, and where in the step the next is


@dataclass(frozen=True)
class Integrator:
    """Integrator of the plant, a row of `INTEGRATORS`.
    title: name on the page.
    step: one step of h s from x and v, for an acceleration a(x, v): (x, v) at its end.
    midpoint: whether it evaluates the acceleration first in the middle of its step, not at the beginning."""

    title: str
    step: Step
    midpoint: bool = False


def _leapfrog(acceleration: Acceleration, x: np.ndarray, v: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
    x = x + 0.5 * h * v
    v = v + h * acceleration(x, v)
    return x + 0.5 * h * v, v


def _semi_implicit_euler(
    acceleration: Acceleration, x: np.ndarray, v: np.ndarray, h: float
) -> tuple[np.ndarray, np.ndarray]:
    v = v + h * acceleration(x, v)
    return x + h * v, v


def _rk4(acceleration: Acceleration, x: np.ndarray, v: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
    a_1 = acceleration(x, v)
    v_2 = v + 0.5 * h * a_1
    a_2 = acceleration(x + 0.5 * h * v, v_2)
    v_3 = v + 0.5 * h * a_2
    a_3 = acceleration(x + 0.5 * h * v_2, v_3)
    v_4 = v + h * a_3
    a_4 = acceleration(x + h * v_3, v_4)
    return x + (h / 6) * (v + 2 * v_2 + 2 * v_3 + v_4), v + (h / 6) * (a_1 + 2 * a_2 + 2 * a_3 + a_4)


INTEGRATORS = {
    "leapfrog": Integrator("leapfrog", _leapfrog, midpoint=True),
    "semi-implicit-euler": Integrator("semi-implicit Euler", _semi_implicit_euler),
    "rk4": Integrator("Runge-Kutta 4", _rk4),
}
if TYPE_CHECKING:
    IntegratorName = str
else:
    IntegratorName = Literal[tuple(INTEGRATORS)]


@inline
def _add_impulse(arm, wrench, h):
    """Add h s of a wrench (6,) to the arm's impulse."""
    for a in range(6):
        arm.impulse[a] += h * wrench[a]


@kernel
def drift(arm, h):
    """Move q along q_dot for h s."""
    arm = arm[0]
    for i in range(arm.q.shape[0]):
        arm.q[i] += h * arm.q_dot[i]


@kernel
def kick_and_drift(arm, h):
    """Change q_dot by h s of q_ddot, then move q along it for half as long."""
    arm = arm[0]
    for i in range(arm.q.shape[0]):
        arm.q_dot[i] += h * arm.q_ddot[i]
        arm.q[i] += 0.5 * h * arm.q_dot[i]
    _add_impulse(arm, arm.load.wrench, h)


@kernel
def semi_implicit_euler(arm, h):
    """Change q_dot by h s of q_ddot, then move q along it."""
    arm = arm[0]
    for i in range(arm.q.shape[0]):
        arm.q_dot[i] += h * arm.q_ddot[i]
        arm.q[i] += h * arm.q_dot[i]
    _add_impulse(arm, arm.load.wrench, h)


@kernel
def begin_stages(workspace, arm, stage):
    """Begin the method of Runge and Kutta: the first stage has the state of the arm, and its acceleration. A contact
    that a later stage lets go is lost with the first one of the next step."""
    workspace, arm, stage = workspace[0], arm[0], stage[0]
    copy(arm.q, stage.q)
    copy(arm.q_dot, stage.q_dot)
    copy(arm.q_ddot, stage.q_ddot)
    copy(arm.holding.held, stage.holding.held)
    copy(arm.load.wrench, stage.load.wrench)
    for i in range(arm.q.shape[0]):
        workspace.speeds[i] = workspace.accelerations[i] = 0.0
    for a in range(6):
        workspace.wrenches[a] = 0.0


@kernel
def next_stage(workspace, arm, stage, weight, ahead):
    """Add q_dot, q_ddot and the wrench of the stage to the sums, with a weight; then make the stage the next one,
    `ahead` s from the arm's state along them."""
    workspace, arm, stage = workspace[0], arm[0], stage[0]
    for i in range(arm.q.shape[0]):
        speed, acceleration = stage.q_dot[i], stage.q_ddot[i]
        workspace.speeds[i] += weight * speed
        workspace.accelerations[i] += weight * acceleration
        stage.q[i] = arm.q[i] + ahead * speed
        stage.q_dot[i] = arm.q_dot[i] + ahead * acceleration
    for a in range(6):
        workspace.wrenches[a] += weight * stage.load.wrench[a]


@kernel
def end_stages(workspace, arm, stage, h):
    """Move the arm by h s along the mean of the stages, of which the last one is not in the sums yet."""
    workspace, arm, stage = workspace[0], arm[0], stage[0]
    for i in range(arm.q.shape[0]):
        arm.q[i] += h / 6.0 * (workspace.speeds[i] + stage.q_dot[i])
        arm.q_dot[i] += h / 6.0 * (workspace.accelerations[i] + stage.q_ddot[i])
    _add_impulse(arm, workspace.wrenches, h / 6.0)
    _add_impulse(arm, stage.load.wrench, h / 6.0)
