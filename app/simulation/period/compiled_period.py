"""Compiled periods: what `ClosedLoop.step` does, as one compiled function of many control periods.

The order of the calls is that of `ControlledArm` and `Plant`; each part is theirs. Terms of the arm come from
`kernels.rigid_body`, not from Pinocchio, so the two differ by rounding; a discontinuous law turns rounding into jumps,
and then rows differ visibly.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from app.simulation.period.controlled_arm import PeriodAddresses
from app.simulation.period.implicit_force import FORCE_ITERATIONS, better_guess, force_found, improve_inverse
from controllers.posture_check import periods_between_checks
from controllers.premises import DOMAIN
from environments.integrators import (
    RK4_STAGES,
    begin_stages,
    drift,
    end_stages,
    kick_and_drift,
    next_stage,
    semi_implicit_euler,
)
from environments.plant import PlantAddresses
from environments.push import TimedPush, push_at
from environments.readings_ahead import read_force
from environments.rigid_surfaces import CORRECTIONS, NEAR_SURFACE
from kernels import Elsewhere, inline, without_lock
from kernels.algebra import copy
from kernels.rigid_body import (
    Chain,
    Motion,
    bias_torque,
    copy_kinematics,
    estimated_terms,
    forward_kinematics,
    jacobian_rate,
    link_inertias,
    mass_matrix,
)

# kernels that `step` uses, too, are called by their address, so that they are not compiled once more for this module
ask: Any = Elsewhere("kernels.pointers", "ask")
ask_integer: Any = Elsewhere("kernels.pointers", "ask_integer")
ask_number: Any = Elsewhere("kernels.pointers", "ask_number")
LEAPFROG, EULER, RK4 = range(3)
INTEGRATOR_NUMBERS = {"leapfrog": LEAPFROG, "semi-implicit-euler": EULER, "rk4": RK4}  # of those that `_move` takes


class RunData(NamedTuple):
    """Data of a compiled run.
    period_kernels, plant_kernels: addresses of kernels.
    known, true: the arm as the controller knows it, and the true arm.
    seen, moved: terms of these two arms, with the memory to compute them.
    alike: whether these two arms have the same geometry.
    period: s; substeps: of the plant in each; integrator: see `INTEGRATOR_NUMBERS`; midpoint: see `Integrator`.
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
    known_until: s; later than this, every check has to be judged.
    nearest: centre of Omega at which the sampled loops have to be judged now, -1 for none.
    steps: periods since the epoch began, at the call.
    read: readings that were taken before the call.
    done, moving: periods that the call has completed, and whether the law of the next one is evaluated.
    asking: whether a separate law's torque is being computed.
    unsolved, astray: whether the ideal sensor has no reading, and whether the tool cannot be brought onto the rigid
    surface.
    alarms: `Alarm` flags of the last completed period, not handled yet."""

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
    midpoint: bool
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
    known_until: float
    nearest: int
    steps: int
    read: int
    done: int
    moving: bool
    asking: bool
    unsolved: bool
    astray: bool
    alarms: int


@inline
def _find_tool(run, q):
    """Placement of the true arm at q (n,): Jacobian, rotation and position of the link that carries the tool."""
    motion, link = run.moved, run.carrier
    forward_kinematics(run.true, q, motion)
    for a in range(3):
        for b in range(3):
            run.turned[b, a] = motion.R[link, a, b]
    return motion.J.T, run.turned.T, motion.p[link]


@inline
def _measure(run, sensing, errors, line, k, workspace, arm, evaluation, t):
    """Compute the push at t (s) and the reading of the force sensor, as `ControlledArm.measure` does."""
    push, F = evaluation[0].push, run.F
    if push_at(run.push, t, push):
        J, R, p = _find_tool(run, arm[0].q)
        ask(run.plant_kernels.push, (workspace, J, R, p, push, run.pushed))
    else:
        push[:] = 0.0
        run.pushed[:] = 0.0
    for a in range(6):
        F[a] = arm[0].load.wrench[a] - push[a]
    read_force(sensing[0], errors, line, k, F)


@inline
def _observe(run, arm, placed):
    """Compute the terms of the arm as the controller knows it, as `NominalModel.update` does. placed: whether the true
    arm's placement is known at its present q."""
    chain, motion = run.known, run.seen
    if placed and run.alike:
        copy_kinematics(run.moved, motion)
    else:
        forward_kinematics(chain, arm[0].q, motion)
    jacobian_rate(arm[0].q_dot, motion)
    link_inertias(chain, motion)
    estimated_terms(chain, motion)


@inline
def _evaluate(run, setting, evaluation, arm, law, t, row):
    """Evaluate the law at t (s) for the force F. law: its own state, and its memory."""
    seen, kernels = run.seen, run.period_kernels
    terms = (seen.momenta.T, seen.C.T, seen.J.T, seen.J_dot.T, seen.placements.T)
    if kernels.law != 0:
        ask(kernels.law, (setting, evaluation, *terms, arm, run.F, t, row))
    else:
        now, parameters, x, x_dot = law
        for i in range(x.shape[0]):
            x[i], x_dot[i] = now[i], 0.0
        ask(kernels.begin, (setting, evaluation, *terms, arm, run.F, t))
        run.asking = True
        ask(kernels.torque, (setting, evaluation, parameters, x, x_dot))
        run.asking = False
        ask(kernels.end, (setting, evaluation, arm, t, row))
    for i in range(run.tau.shape[0]):
        run.tau[i] = evaluation[0].applied[i] + run.pushed[i]


@inline
def _accelerate(run, workspace, arm, t):
    """Compute q_ddot at t (s), and the load that goes with it, as `Plant` does."""
    data, chain, motion, tau = arm[0], run.true, run.moved, run.tau
    J, R, p = _find_tool(run, data.q)
    jacobian_rate(data.q_dot, motion)
    link_inertias(chain, motion)
    bias_torque(chain, data.q_dot, motion)
    mass_matrix(chain, motion)
    M, bias, J_dot, call = motion.M.T, motion.bias, motion.J_dot.T, run.plant_kernels.accelerate
    if run.massive or run.rigid:
        ask(call, (workspace, M, bias, J, J_dot, R, p, arm, tau, t))
    elif run.springs:
        ask(call, (workspace, M, bias, J, R, p, arm, tau, t))
    else:
        ask(call, (workspace, M, bias, arm, tau, t))


@inline
def _evaluated_at(run, arm, twin, t):
    """Copy the arm to the state at which a period from t (s) on evaluates the acceleration first; returns the time."""
    copy(arm[0].q, twin[0].q)
    copy(arm[0].q_dot, twin[0].q_dot)
    copy(arm[0].holding.held, twin[0].holding.held)
    if not run.midpoint:
        return t
    half = 0.5 * run.period / run.substeps
    drift(twin, half)
    return t + half


@inline
def _missed(run, setting, evaluation, workspace, arm, law, twin, guess, t, row):
    """Compute the differences (3,) N between the multipliers that the law's torque for a guess causes, and the guess,
    as `ControlledArm` does, into the run's `error`."""
    at = _evaluated_at(run, arm, twin, t)
    J, R, p = _find_tool(run, twin[0].q)
    ask(run.plant_kernels.force, (workspace, J, R, p, twin, guess, at, run.F))
    for a in range(6):
        run.F[a] -= evaluation[0].push[a]
    _evaluate(run, setting, evaluation, arm, law, t, row)
    at = _evaluated_at(run, arm, twin, t)
    _accelerate(run, workspace, twin, at)
    for i in range(3):
        run.error[i] = twin[0].load.multiplier[i] - guess[i]


@inline
def _solve_for_force(run, setting, evaluation, whole, spare, workspace, arm, law, twin, t, row):
    """Evaluate the law with the force that its own torque causes, as `ControlledArm` does; returns whether that force
    was found. whole, spare: the bytes of the evaluation, and memory for a copy; twin: memory for an arm."""
    guess, change, error, before, inverse = run.guess, run.change, run.error, run.before, run.inverse
    copy(arm[0].load.multiplier, guess)
    copy(whole, spare)
    for i in range(3):
        for j in range(3):
            inverse[i, j] = -1.0 if i == j else 0.0
    for k in range(FORCE_ITERATIONS + 1):
        copy(spare, whole)
        _missed(run, setting, evaluation, workspace, arm, law, twin, guess, t, row)
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
def _constrain(run, workspace, arm, t, h):
    """Move the arm onto the rigid surfaces at t (s), after a step of h s, as `Plant` does."""
    J, R, p = _find_tool(run, arm[0].q)
    link_inertias(run.true, run.moved)
    mass_matrix(run.true, run.moved)
    for _ in range(CORRECTIONS):
        phi = ask_number(run.plant_kernels.onto, (workspace, J, R, p, run.moved.M.T, arm, t))
        _find_tool(run, arm[0].q)
        if abs(phi) < NEAR_SURFACE:
            ask(run.plant_kernels.along, (workspace, J, R, p, run.moved.M.T, arm, t, h))
            return
    run.astray = True
    raise ValueError("out of reach")


@inline
def _move(run, workspace, arm, twin, t):
    """Advance the plant from t (s) by one period, as `Plant.advance` does. twin: memory for an arm."""
    h = run.period / run.substeps
    for a in range(6):
        arm[0].impulse[a] = 0.0
    for i in range(run.substeps):
        now = t + i * h
        if run.integrator == LEAPFROG:
            drift(arm, 0.5 * h)
            _accelerate(run, workspace, arm, now + 0.5 * h)
            kick_and_drift(arm, h)
        else:
            _accelerate(run, workspace, arm, now)
            if run.integrator == EULER:
                semi_implicit_euler(arm, h)
            elif run.integrator == RK4:
                begin_stages(workspace, arm, twin)
                for weight, ahead in RK4_STAGES:
                    next_stage(workspace, arm, twin, weight, ahead * h)
                    _accelerate(run, workspace, twin, now + ahead * h)
                end_stages(workspace, arm, twin, h)
        if i == 0:
            copy(arm[0].q_ddot, run.first)
        if run.rigid:
            _constrain(run, workspace, arm, now + h, h)
    copy(run.first, arm[0].q_ddot)
    if run.springs:
        J, R, p = _find_tool(run, arm[0].q)
        ask(run.plant_kernels.find, (workspace, J, R, p, arm, t + run.period))


@without_lock
def run_periods(
    run,
    setting,
    evaluation,
    arm,
    workspace,
    now,
    parameters,
    x,
    x_dot,
    whole,
    spare,
    twin,
    centres,
    stations,
    sensing,
    errors,
    line,
    t,
    rows,
):
    """Compute the periods that begin at t (N,) s. Returns early after an alarm, and before the plant moves if a posture
    check is due or no force was found.
    run: steps, read and moving of the first period; afterwards, where the call ended.
    now: (k,), the law's own state; parameters, x, x_dot: its memory.
    centres: (k, n) rad, of Omega.
    stations: (k,), the station of each centre."""
    data, law = run[0], (now, parameters, x, x_dot)
    data.alarms, data.nearest = 0, -1
    placed = False
    for k in range(rows.shape[0]):
        row = rows[k : k + 1]
        data.done = k
        if not data.moving:
            _measure(data, sensing, errors, line, data.read + k, workspace, arm, evaluation, t[k])
            _observe(data, arm, placed)
            if data.ideal:
                data.unsolved = not _solve_for_force(
                    data, setting, evaluation, whole, spare, workspace, arm, law, twin, t[k], row
                )
            else:
                _evaluate(data, setting, evaluation, arm, law, t[k], row)
            data.moving = True
            regular = (data.steps + k) % periods_between_checks(data.period) == 0
            if setting[0].judged and (regular or evaluation[0].check_due):
                nearest = ask_integer(data.period_kernels.check, (setting, evaluation, centres))
                near = evaluation[0].table.value[DOMAIN] <= data.close and stations[nearest] == data.station
                if not near or t[k] > data.known_until + 0.5 * data.period:
                    data.nearest = nearest
            if data.unsolved or data.nearest >= 0:
                return
        _move(data, workspace, arm, twin, t[k])
        for i in range(now.shape[0]):
            now[i] += data.period * x_dot[i]
        placed = data.springs or data.rigid  # the tool's placement is known at the present q
        data.alarms = ask_integer(data.period_kernels.complete, (setting, evaluation, arm, row))
        data.done, data.moving = k + 1, False
        if data.alarms != 0:
            return
