"""Compiled run: many control periods of a closed loop in one compiled call, without the interpreter lock.

`CompiledRun.advance` does what `ClosedLoop.step` does, in its order and with its parts; only the order of the calls
stands twice, here and there. Where a period needs the interpreter (the watch looks at the posture, an alarm), the
compiled function returns, and its caller does there what `step` does. Terms of the arm come from `kernels.rigid_body`,
not from Pinocchio, so the two differ by rounding; a discontinuous law makes jumps of it, and then rows differ visibly.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from app.simulation.closed_loop import ClosedLoop
from app.simulation.control_period import Alarm, complete_row, control_period
from controllers.premises import WATCH
from environments.plant import (
    accelerate_elastic,
    accelerate_free,
    accelerate_heavy,
    drift,
    kick_and_drift,
    load_at,
    penetration_at,
    semi_implicit_euler,
)
from kernels import compiled_for, inline, without_lock
from kernels.algebra import copy
from kernels.records import Record
from kernels.rigid_body import Chain, Motion, estimated_terms, mass_and_bias, place, travel, weigh


class Engine(NamedTuple):
    """Data of a compiled run.
    known, true: the arm as the controller knows it, and as it is; seen, moved: their terms, with the memory for them.
    period: s; substeps: of the plant in each; leapfrog: whether it is integrated by that, or by semi-implicit Euler.
    springs, massive: see `ContactKind`.
    carrier: the link that carries the tool, counted from 0.
    first: (n,), q_ddot of the first substep.
    begun: s, of the epoch; steps: periods since then, at the call.
    done, moving: where a call is: completed periods, and whether the law of the next one is done.
    alarms: `Alarm` flags of the last completed period, not heeded yet."""

    known: Chain
    true: Chain
    seen: Motion
    moved: Motion
    period: float
    substeps: int
    leapfrog: bool
    springs: bool
    massive: bool
    carrier: int
    first: np.ndarray
    begun: float
    steps: int
    done: int
    moving: bool
    alarms: int


def obstacle(loop: ClosedLoop) -> str | None:
    """Why the compiled run cannot take this loop in its present state, None where it can."""
    system, scenario = loop.system, loop.system.scenario
    reasons = {
        "the law is the user's own": system.controller.gains.law < 0,
        "estimates are taken along the reference": loop.state.along is not None,
        "the force sensor has noise, bias, delay or a filter": not loop.state.reader.exact,
        "the force sensor is ideal on a heavy surface": scenario.sensor.ideal and system.plant.kind.heavy,
        "the surface is rigid": system.plant.kind.rigid,
        "the integrator is rk4": scenario.simulation.integrator == "rk4",
        "a push is scripted": any(system.push.force),
        "a hand holds the tool": loop.grip is not None,
        "a blend is planned": system.blend is not None,
    }
    return next((reason for reason, holds in reasons.items() if holds), None)


@inline
def _accelerate(engine, around, arm, tau, t):
    """Compute q_ddot under the torque tau at t (s), and the load that goes with it, as `Plant` does."""
    data, chain, motion = arm[0], engine.true, engine.moved
    R, p = motion.R[engine.carrier], motion.p[engine.carrier]
    place(chain, data.q, motion)
    travel(data.q_dot, motion)
    weigh(chain, motion)
    mass_and_bias(chain, data.q_dot, motion)
    if engine.massive:
        accelerate_heavy(around, motion.M, motion.bias, motion.J, motion.J_dot, R, p, arm, tau, t)
    elif engine.springs:
        accelerate_elastic(around, motion.M, motion.bias, motion.J, R, p, arm, tau, t)
    else:
        accelerate_free(around, motion.M, motion.bias, arm, tau, t)


@inline
def _move(engine, around, arm, tau, t):
    """Advance the plant from t (s) by one period, as `Plant.advance` does."""
    h = engine.period / engine.substeps
    for i in range(engine.substeps):
        now = t + i * h
        at = now
        if engine.leapfrog:
            drift(arm, 0.5 * h)
            at = now + 0.5 * h
        _accelerate(engine, around, arm, tau, at)
        if engine.leapfrog:
            kick_and_drift(arm, h)
        else:
            semi_implicit_euler(arm, h)
        if i == 0:
            copy(arm[0].q_ddot, engine.first)
    copy(engine.first, arm[0].q_ddot)
    if engine.springs:
        motion = engine.moved
        place(engine.true, arm[0].q, motion)
        R, p = motion.R[engine.carrier], motion.p[engine.carrier]
        if engine.massive:
            penetration_at(around, motion.J, R, p, arm, t + engine.period)
        else:
            load_at(around, motion.J, R, p, arm, t + engine.period)


@without_lock
def _run(engine, setting, period, arm, around, rows):
    """Compute as many periods as there are rows, or fewer: after one with alarms, and, at an instant of the watch,
    before the plant moves. `engine` has begun, steps and moving of the first period, and where the call ended."""
    data = engine[0]
    seen = data.seen
    data.alarms = 0
    for k in range(rows.shape[0]):
        t = data.begun + (data.steps + k) * data.period
        row = rows[k : k + 1]
        data.done = k
        if not data.moving:
            place(data.known, arm[0].q, seen)
            travel(arm[0].q_dot, seen)
            weigh(data.known, seen)
            estimated_terms(data.known, seen)
            F = arm[0].load.force
            control_period(setting, period, seen.momenta, seen.C, seen.J, seen.J_dot, seen.placements, arm, F, t, row)
            data.moving = True
            if (data.steps + k) % WATCH == 0:
                return
        _move(data, around, arm, period[0].applied, t)
        data.alarms = complete_row(setting, period, arm, row)
        data.done, data.moving = k + 1, False
        if data.alarms != 0:
            return


class CompiledRun:
    """Compiled run of one system in one state of a loop: to be made anew when the loop has been edited.

    Raises ValueError where there is an `obstacle`.
    """

    def __init__(self, loop: ClosedLoop) -> None:
        reason = obstacle(loop)
        if reason is not None:
            raise ValueError(f"the compiled run cannot take this scenario: {reason}")
        system, n = loop.system, loop.system.robot.n
        simulation, plant = system.scenario.simulation, system.plant
        self._loop = loop
        self._engine = Record(
            Engine(
                known=Chain.of(system.nominal.model),
                true=Chain.of(plant.model),
                seen=Motion.zeros(n),
                moved=Motion.zeros(n),
                period=loop.period,
                substeps=plant.substeps,
                leapfrog=simulation.integrator == "leapfrog",
                springs=plant.kind.springs,
                massive=plant.kind.massive,
                carrier=system.robot.tool_joint - 1,
                first=np.zeros(n),
                begun=0.0,
                steps=0,
                done=0,
                moving=False,
                alarms=0,
            )
        )
        self._run = compiled_for(_run, self._engine.data, *loop.memory, loop.recording.new_rows(1))

    def advance(self, periods: int) -> int:
        """Compute so many control periods, or fewer when the run stops; an exception in one stops it, as in
        `ClosedLoop.advance`. Returns how many were computed."""
        loop, engine, left = self._loop, self._engine.fields, periods
        loop.measure()  # without a hand there is no push
        while left > 0 and (engine.moving or loop.stopped is None):
            rows = loop.recording.new_rows(left if loop.stopped is None else 1)
            engine.begun, engine.steps = loop.state.epoch.t, loop.state.steps
            try:
                self._run(self._engine.data, *loop.memory, rows)
            except (ArithmeticError, ValueError) as error:
                loop.take(engine.done, Alarm(0))
                loop.fail("the plant" if engine.moving else "the control law", error)
                engine.moving = False
                return periods - left + engine.done
            loop.take(engine.done, Alarm(engine.alarms))
            left -= engine.done
            if engine.moving:
                loop.look()
        return periods - left
