"""Compiled run: many control periods of a closed loop in one compiled call, without the interpreter lock.

`CompiledRun.advance` does what `ClosedLoop.step` does, in the same order and with the same parts; only the order of the
calls is written twice, here and in `ControlledArm` and `Plant`. Where a period needs the interpreter (the watch looks
at the posture, an alarm), the compiled function returns, and its caller does what `step` does there. Terms of the arm
come from `kernels.rigid_body`, not from Pinocchio, so the two differ by rounding; a discontinuous law turns rounding
into jumps, and then rows differ visibly.
"""

from __future__ import annotations

from typing import Any, NamedTuple, get_args

import numpy as np

from app.simulation.closed_loop import ClosedLoop
from app.simulation.control_period import Alarm
from app.simulation.controlled_arm import PeriodAddresses
from app.simulation.implicit_force import FORCE_ITERATIONS, better_guess, force_found, improve_inverse
from app.simulation.stations import APART
from controllers.premises import DOMAIN, periods_between_looks
from environments.integrators import (
    STAGES,
    Integrator,
    begin_stages,
    drift,
    end_stages,
    kick_and_drift,
    next_stage,
    semi_implicit_euler,
)
from environments.plant import PlantAddresses
from environments.push import TimedPush, push_at
from environments.readings_ahead import ReadingsAhead, known, read_force
from environments.rigid_surfaces import CORRECTIONS, NEAR_SURFACE, out_of_reach
from kernels import Elsewhere, compiled_for, inline, without_lock
from kernels.algebra import copy
from kernels.records import Record
from kernels.rigid_body import (
    Chain,
    Motion,
    estimated_terms,
    inertia,
    place,
    resist,
    same_geometry,
    take_place,
    travel,
    weigh,
)

# kernels that `step` uses, too, are called by their address, so that they are not compiled once more for this module
ask: Any = Elsewhere("kernels.pointers", "ask")
ask_integer: Any = Elsewhere("kernels.pointers", "ask_integer")
ask_number: Any = Elsewhere("kernels.pointers", "ask_number")
LEAPFROG, EULER, RK4 = range(len(get_args(Integrator)))
BATCH = 4096  # periods whose readings are prepared together


class Engine(NamedTuple):
    """Data of a compiled run.
    period_kernels, plant_kernels: addresses of kernels.
    known, true: the arm as the controller knows it, and the true arm.
    seen, moved: terms of these two arms, with the memory to compute them.
    alike: whether these two arms have the same geometry.
    period: s; substeps: of the plant in each; integrator: its place in `Integrator`.
    springs, massive, rigid: see `ContactKind`; ideal: see `ControlledArm`.
    carrier, turned: the link that carries the tool, counted from 0, and its transposed rotation.
    push: at fixed times; pushed: (n,) N m, its torque in the present period.
    F: (6,), the wrench as the law reads it.
    tau: (n,) N m, of drives and push.
    first: (n,), q_ddot of the first substep.
    guess, change, error, before: (3,) N, of the multipliers that an ideal sensor reads, and inverse (3, 3), see
    `implicit_force`.
    station: where the sampled loops were judged last, -1 off the reference.
    close: rad; nearer than this to a centre of Omega of that station, the sampled loops need not be judged again.
    nearest: centre of Omega at which the sampled loops have to be judged now, -1 for none.
    steps: periods since the epoch began, at the call.
    read: readings that were taken before the call.
    done, moving: periods that the call has completed, and whether the law of the next one is evaluated.
    unsolved, astray: whether the ideal sensor has no reading, and whether the tool cannot be brought onto the rigid
    surface.
    alarms: `Alarm` flags of the last completed period, not heeded yet."""

    period_kernels: PeriodAddresses
    plant_kernels: PlantAddresses
    known: Chain
    true: Chain
    seen: Motion
    moved: Motion
    alike: bool
    period: float
    substeps: int
    integrator: int
    springs: bool
    massive: bool
    rigid: bool
    ideal: bool
    carrier: int
    turned: np.ndarray
    push: TimedPush
    pushed: np.ndarray
    F: np.ndarray
    tau: np.ndarray
    first: np.ndarray
    guess: np.ndarray
    change: np.ndarray
    error: np.ndarray
    before: np.ndarray
    inverse: np.ndarray
    station: int
    close: float
    nearest: int
    steps: int
    read: int
    done: int
    moving: bool
    unsolved: bool
    astray: bool
    alarms: int


def obstacle(loop: ClosedLoop) -> str | None:
    """Why the compiled run cannot take this loop in its present state, None where it can."""
    law = loop.system.controller.law
    reasons = {
        f"controller.law: {law.kind!r} is a law of your own": loop.system.controller.gains.law < 0,
        "the force sensor has a stage that is known to the interpreter only": not known(loop.state.reader),
        "a hand holds the tool": loop.grip is not None,
    }
    return next((reason for reason, holds in reasons.items() if holds), None)


@inline
def _find_tool(engine, q):
    """Placement of the true arm at q (n,): Jacobian, rotation and position of the link that carries the tool."""
    motion, link = engine.moved, engine.carrier
    place(engine.true, q, motion)
    for a in range(3):
        for b in range(3):
            engine.turned[b, a] = motion.R[link, a, b]
    return motion.J.T, engine.turned.T, motion.p[link]


@inline
def _measure(engine, sensing, errors, line, k, around, arm, evaluation, t):
    """Compute the push at t (s) and the reading of the force sensor, as `ControlledArm.measure` does."""
    push, F = evaluation[0].push, engine.F
    if push_at(engine.push, t, push):
        J, R, p = _find_tool(engine, arm[0].q)
        ask(engine.plant_kernels.push, (around, J, R, p, push, engine.pushed))
    else:
        push[:] = 0.0
        engine.pushed[:] = 0.0
    for a in range(6):
        F[a] = arm[0].load.wrench[a] - push[a]
    read_force(sensing[0], errors, line, k, F)


@inline
def _observe(engine, arm, placed):
    """Compute the terms of the arm as the controller knows it, as `NominalModel.update` does. placed: whether the true
    arm's placement is known at its present q."""
    chain, motion = engine.known, engine.seen
    if placed and engine.alike:
        take_place(engine.moved, motion)
    else:
        place(chain, arm[0].q, motion)
    travel(arm[0].q_dot, motion)
    weigh(chain, motion)
    estimated_terms(chain, motion)


@inline
def _evaluate(engine, setting, evaluation, arm, t, row):
    """Evaluate the law at t (s) for the force F."""
    seen = engine.seen
    terms = (seen.momenta.T, seen.C.T, seen.J.T, seen.J_dot.T, seen.placements.T)
    ask(engine.period_kernels.law, (setting, evaluation, *terms, arm, engine.F, t, row))
    for i in range(engine.tau.shape[0]):
        engine.tau[i] = evaluation[0].applied[i] + engine.pushed[i]


@inline
def _accelerate(engine, around, arm, t):
    """Compute q_ddot at t (s), and the load that goes with it, as `Plant` does."""
    data, chain, motion, tau = arm[0], engine.true, engine.moved, engine.tau
    J, R, p = _find_tool(engine, data.q)
    travel(data.q_dot, motion)
    weigh(chain, motion)
    resist(chain, data.q_dot, motion)
    inertia(chain, motion)
    M, bias, J_dot, call = motion.M.T, motion.bias, motion.J_dot.T, engine.plant_kernels.accelerate
    if engine.massive or engine.rigid:
        ask(call, (around, M, bias, J, J_dot, R, p, arm, tau, t))
    elif engine.springs:
        ask(call, (around, M, bias, J, R, p, arm, tau, t))
    else:
        ask(call, (around, M, bias, arm, tau, t))


@inline
def _evaluated_at(engine, arm, twin, t):
    """Copy the arm to the state at which a period from t (s) on evaluates the acceleration first; returns the time."""
    copy(arm[0].q, twin[0].q)
    copy(arm[0].q_dot, twin[0].q_dot)
    copy(arm[0].holding.held, twin[0].holding.held)
    if engine.integrator != LEAPFROG:
        return t
    half = 0.5 * engine.period / engine.substeps
    drift(twin, half)
    return t + half


@inline
def _missed(engine, setting, evaluation, around, arm, twin, guess, t, row):
    """Compute the differences (3,) N between the multipliers that the law's torque for a guess causes, and the guess,
    as `ControlledArm` does, into the engine's `error`."""
    at = _evaluated_at(engine, arm, twin, t)
    J, R, p = _find_tool(engine, twin[0].q)
    ask(engine.plant_kernels.force, (around, J, R, p, twin, guess, at, engine.F))
    for a in range(6):
        engine.F[a] -= evaluation[0].push[a]
    _evaluate(engine, setting, evaluation, arm, t, row)
    at = _evaluated_at(engine, arm, twin, t)
    _accelerate(engine, around, twin, at)
    for i in range(3):
        engine.error[i] = twin[0].load.multiplier[i] - guess[i]


@inline
def _solve_for_force(engine, setting, evaluation, whole, spare, around, arm, twin, t, row):
    """Evaluate the law with the force that its own torque causes, as `ControlledArm` does; returns whether that force
    was found. whole, spare: the bytes of the evaluation, and memory for a copy; twin: memory for an arm."""
    guess, change, error, before, inverse = engine.guess, engine.change, engine.error, engine.before, engine.inverse
    copy(arm[0].load.multiplier, guess)
    copy(whole, spare)
    for i in range(3):
        for j in range(3):
            inverse[i, j] = -1.0 if i == j else 0.0
    for k in range(FORCE_ITERATIONS + 1):
        copy(spare, whole)
        _missed(engine, setting, evaluation, around, arm, twin, guess, t, row)
        if force_found(error, guess):
            return k < FORCE_ITERATIONS
        if k > 0:
            for i in range(3):
                before[i] = error[i] - before[i]
            improve_inverse(inverse, change, before)
        better_guess(inverse, error, change, guess)
        copy(error, before)
    return False


@inline
def _constrain(engine, around, arm, t, h):
    """Move the arm onto the rigid surfaces at t (s), after a step of h s, as `Plant` does."""
    J, R, p = _find_tool(engine, arm[0].q)
    weigh(engine.true, engine.moved)
    inertia(engine.true, engine.moved)
    for _ in range(CORRECTIONS):
        phi = ask_number(engine.plant_kernels.onto, (around, J, R, p, engine.moved.M.T, arm, t))
        _find_tool(engine, arm[0].q)
        if abs(phi) < NEAR_SURFACE:
            ask(engine.plant_kernels.along, (around, J, R, p, engine.moved.M.T, arm, t, h))
            return
    engine.astray = True
    raise ValueError("out of reach")


@inline
def _move(engine, around, arm, twin, t):
    """Advance the plant from t (s) by one period, as `Plant.advance` does. twin: memory for an arm."""
    h = engine.period / engine.substeps
    for i in range(engine.substeps):
        now = t + i * h
        if engine.integrator == LEAPFROG:
            drift(arm, 0.5 * h)
            _accelerate(engine, around, arm, now + 0.5 * h)
            kick_and_drift(arm, h)
        else:
            _accelerate(engine, around, arm, now)
            if engine.integrator == EULER:
                semi_implicit_euler(arm, h)
            else:
                begin_stages(around, arm, twin)
                for weight, ahead in STAGES:
                    next_stage(around, arm, twin, weight, ahead * h)
                    _accelerate(engine, around, twin, now + ahead * h)
                end_stages(around, arm, twin, h)
        if i == 0:
            copy(arm[0].q_ddot, engine.first)
        if engine.rigid:
            _constrain(engine, around, arm, now + h, h)
    copy(engine.first, arm[0].q_ddot)
    if engine.springs:
        J, R, p = _find_tool(engine, arm[0].q)
        ask(engine.plant_kernels.find, (around, J, R, p, arm, t + engine.period))


@without_lock
def _run(
    engine, setting, evaluation, arm, around, whole, spare, twin, centres, stations, sensing, errors, line, t, rows
):
    """Compute the periods that begin at t (N,) s, or fewer: after one with alarms, and before the plant moves when the
    watch has something to judge or an ideal sensor has no reading. `engine` has steps, read and moving of the first
    period, and where the call ended. centres, stations: (k, n) rad, of Omega, (k,), the station of each."""
    data = engine[0]
    data.alarms, data.nearest = 0, -1
    placed = False
    for k in range(rows.shape[0]):
        row = rows[k : k + 1]
        data.done = k
        if not data.moving:
            _measure(data, sensing, errors, line, data.read + k, around, arm, evaluation, t[k])
            _observe(data, arm, placed)
            if data.ideal:
                data.unsolved = not _solve_for_force(
                    data, setting, evaluation, whole, spare, around, arm, twin, t[k], row
                )
            else:
                _evaluate(data, setting, evaluation, arm, t[k], row)
            data.moving = True
            if (data.steps + k) % periods_between_looks(data.period) == 0:
                nearest = ask_integer(data.period_kernels.watch, (setting, evaluation, centres))
                if evaluation[0].table.value[DOMAIN] > data.close or stations[nearest] != data.station:
                    data.nearest = nearest
            if data.unsolved or data.nearest >= 0:
                return
        _move(data, around, arm, twin, t[k])
        placed = data.springs or data.rigid  # the tool's placement is known at the present q
        data.alarms = ask_integer(data.period_kernels.complete, (setting, evaluation, arm, row))
        data.done, data.moving = k + 1, False
        if data.alarms != 0:
            return


class CompiledRun:
    """Compiled run of a loop; after an edit of the loop another one has to be made.

    Raises ValueError where there is an `obstacle`.
    """

    def __init__(self, loop: ClosedLoop) -> None:
        reason = obstacle(loop)
        if reason is not None:
            raise ValueError(reason)
        system, n = loop.system, loop.system.robot.n
        plant = system.plant
        self._loop, rows = loop, loop.recording.new_rows(1)
        known, true = system.nominal.chain, plant.chain
        self._engine = Record(
            Engine(
                period_kernels=loop.addresses,
                plant_kernels=plant.addresses,
                known=known,
                true=true,
                seen=Motion.zeros(n),
                moved=Motion.zeros(n),
                alike=same_geometry(known, true),
                period=loop.period,
                substeps=plant.substeps,
                integrator=get_args(Integrator).index(system.scenario.simulation.integrator),
                springs=plant.kind.springs,
                massive=plant.kind.massive,
                rigid=plant.kind.rigid,
                ideal=loop.ideal,
                carrier=system.robot.tool_joint - 1,
                turned=np.zeros((3, 3)),
                push=system.push,
                pushed=np.zeros(n),
                F=np.zeros(6),
                tau=np.zeros(n),
                first=np.zeros(n),
                guess=np.zeros(3),
                change=np.zeros(3),
                error=np.zeros(3),
                before=np.zeros(3),
                inverse=np.zeros((3, 3)),
                station=-1,
                close=min(APART, system.constants.radius),
                nearest=-1,
                steps=0,
                read=0,
                done=0,
                moving=False,
                unsolved=False,
                astray=False,
                alarms=0,
            )
        )
        self._spare, self._twin = loop.state.evaluation.copy().data.view(np.uint8), loop.state.arm.copy().data
        self._centres, self._stations = system.constants.centres, system.stations.of
        self._run = compiled_for(_run, *self._arguments(ReadingsAhead(loop.state.reader, 1)), np.zeros(1), rows)

    def _arguments(self, ahead: ReadingsAhead) -> tuple[np.ndarray, ...]:
        """Arguments of the compiled function but for times and rows."""
        setting, evaluation, arm, around = self._loop.memory
        spare = evaluation.view(np.uint8), self._spare, self._twin
        watched, sensor = (self._centres, self._stations), (ahead.sensing, ahead.errors, ahead.line)
        return self._engine.data, setting, evaluation, arm, around, *spare, *watched, *sensor

    def advance(self, periods: int) -> int:
        """Compute `periods` control periods, or fewer when the run stops; an exception in one stops it, as in
        `ClosedLoop.advance`. Returns their number."""
        left = periods
        while left > 0 and self._loop.stopped is None:
            ahead = ReadingsAhead(self._loop.state.reader, min(left, BATCH))
            computed = self._advance(ahead)
            ahead.end(computed)
            left -= computed
        return periods - left

    def _advance(self, ahead: ReadingsAhead) -> int:
        """Compute the periods of these readings, or fewer when the run stops; returns how many were computed."""
        loop, engine, left, alike = self._loop, self._engine.fields, ahead.periods, 0
        while left > 0 and (engine.moving or loop.stopped is None):
            engine.done = 0
            try:
                alike = alike or loop.prepare(left)
                self._call(ahead, ahead.periods - left, alike if loop.stopped is None else 1)
            except Exception as error:
                loop.take(engine.done, Alarm(0))
                found = out_of_reach(float(np.abs(loop.state.arm.views.load.phi).max())) if engine.astray else error
                loop.fail("the plant" if engine.moving else "the control law", found)
                engine.moving = engine.astray = False
                return ahead.periods - left + engine.done
            left, alike = left - engine.done, alike - engine.done
            loop.take(engine.done, Alarm(engine.alarms))
            if engine.unsolved:
                loop.leave_unsolved()
                engine.unsolved = False
            if engine.nearest >= 0:
                loop.heed_posture(engine.nearest)
        return ahead.periods - left

    @property
    def _station(self) -> int:
        """Station where the sampled loops were judged last, -1 where they are to be judged anew wherever the arm is."""
        return self._loop.judged_station

    def _call(self, ahead: ReadingsAhead, read: int, periods: int) -> None:
        """Call the compiled function for at most `periods` periods. read: number of readings of `ahead` that earlier
        calls have used."""
        loop, engine = self._loop, self._engine.fields
        rows, begun, state = loop.recording.new_rows(periods), loop.state.steps, loop.state
        engine.steps, engine.read = begun, read
        engine.station = self._station
        t = state.epoch.t + np.arange(begun, begun + len(rows)) * loop.period
        self._run(*self._arguments(ahead), t, rows)


class UnjudgedRun(CompiledRun):
    """Compiled run that does not judge the premises that depend on the posture, which takes a third less time. The
    arm's motion is the same to the last bit, unless a broken promise stops the run."""

    def __init__(self, loop: ClosedLoop) -> None:
        super().__init__(loop)
        self._engine.fields.close, self._stations = np.inf, np.zeros_like(self._stations)

    @property
    def _station(self) -> int:
        return 0
