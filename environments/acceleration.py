"""Acceleration of the true arm, (2), under a torque and the load of its contacts, in compiled functions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from environments.contact import (
    ContactForce,
    Holding,
    ToolContacts,
    World,
    add_contact_force,
    add_drift,
    elastic_load,
    place_tool,
    touch_at,
)
from environments.multipliers import SETS, MultiplierWork, find_touched, heavy_multipliers, let_go, one_sided
from environments.surfaces.chart import one_of
from environments.truth import Resistance, resistance_torque
from kernels import inline, kernel
from kernels.algebra import copy, cross, dot, solve_spd, transposed_times
from kernels.records import Record


class Arm(NamedTuple):
    """State of the arm.
    q, q_dot: (n,).
    load: the contact's `ContactForce` in this state; with a rigid or heavy environment that of the last step, since it
    depends on the torque.
    q_ddot: (n,), of the period before: that of its first integration step.
    holding: rigid surfaces that the tool is held on.
    impulse: (6,) N s and N m s, of the load's wrench over the period before."""

    q: np.ndarray
    q_dot: np.ndarray
    load: ContactForce
    q_ddot: np.ndarray
    holding: Holding
    impulse: np.ndarray

    @classmethod
    def zeros(cls, n: int) -> Arm:
        """State at rest, all joints at zero."""
        return cls(np.zeros(n), np.zeros(n), ContactForce.zeros(n), np.zeros(n), Holding.none(), np.zeros(6))


PlantState = Record[Arm]


class PlantWorkspace(NamedTuple):
    """Workspace of the plant, for what its kernels compute between two of Pinocchio's calls.
    resistance: friction and disturbance of the arm's joints.
    touch, multipliers: geometry of the contacts, and memory for their multipliers.
    torque: (n,) N m, that moves the arm.
    push, pushed: (3,) N, a force on the tool, and (n,) N m, its torque.
    factor: (n, n), memory for Cholesky's factor.
    speeds, accelerations, wrenches: (n,), (n,), (6,), sums of q_dot, q_ddot and the load's wrench over the stages of
    Runge and Kutta."""

    world: World
    resistance: Resistance
    touch: ToolContacts
    multipliers: MultiplierWork
    torque: np.ndarray
    push: np.ndarray
    pushed: np.ndarray
    factor: np.ndarray
    speeds: np.ndarray
    accelerations: np.ndarray
    wrenches: np.ndarray

    @classmethod
    def of(cls, world: World, resistance: Resistance, n: int) -> PlantWorkspace:
        """Workspace of an arm with n joints."""
        v = np.zeros(n)
        met = (ToolContacts.zeros(n), MultiplierWork.zeros(n))
        return cls(world, resistance, *met, v, np.zeros(3), v, np.zeros((n, n)), v, v, np.zeros(6))


@inline
def _accelerate(workspace, M, bias, arm, tau, t):
    """Compute q_ddot under the torque tau and the present load."""
    torque = workspace.torque
    resistance_torque(workspace.resistance, arm.q_dot, t, torque)
    for i in range(torque.shape[0]):
        torque[i] = tau[i] - bias[i] - torque[i] - arm.load.torque[i]
    solve_spd(M, torque, workspace.factor, arm.q_ddot)


@kernel
def accelerate_free(workspace, M, bias, arm, tau, t):
    """Compute q_ddot in free space under the torque tau; bias (n,) N m: C q_dot + G."""
    _accelerate(workspace[0], M, bias, arm[0], tau, t)


@kernel
def accelerate_elastic(workspace, M, bias, J, rotation, translation, arm, tau, t):
    """Compute the load in the present state, and q_ddot under the torque tau against it."""
    workspace, arm = workspace[0], arm[0]
    touch_at(workspace.world, J, rotation, translation, arm.q_dot, t, workspace.touch)
    elastic_load(workspace.world, workspace.touch, workspace.multipliers, arm.load)
    _accelerate(workspace, M, bias, arm, tau, t)


@inline
def _find_multipliers(workspace, M):
    """Compute the multipliers of heavy contacts, with friction for the signs `side` of them."""
    world, touch, work = workspace.world, workspace.touch, workspace.multipliers
    k = world.shapes.number
    for j in range(k):
        met = one_of(touch, j)
        for a in range(3):
            workspace.push[a] = met.chart.G[0, a] + work.side[j] * met.drag[a]
        transposed_times(touch.tool.J_v, workspace.push, workspace.pushed)
        solve_spd(M, workspace.pushed, workspace.factor, work.directions[j])
        for i in range(k):
            work.mobility[i, j] = dot(one_of(touch, i).pull, work.directions[j])
    heavy_multipliers(world, touch, work, work.found)


@inline
def _accelerate_against(workspace, M, bias, arm, tau, t):
    """Compute the multipliers of the surfaces that the tool touches, `work.touches`, under the torque tau, and q_ddot
    without them. A surface that yields and would have to pull is not touched: it has no viscous friction either."""
    while True:
        _balance(workspace, M, bias, arm, tau, t)
        if not _leave_pulling(workspace.world, workspace.multipliers):
            return


@inline
def _leave_pulling(world, work):
    """Take the surfaces that carry no force, though the tool touches them, out of `work.touches`; returns whether there
    was one. A rigid one is left to `one_sided`, and one without viscous friction makes no difference."""
    left = False
    for i in range(world.shapes.number):
        contact = one_of(world.contacts, i)
        may_leave = not world.rigid and contact.unilateral and contact.friction_viscous > 0.0
        if may_leave and work.touches[i] > 0 and work.found[i] == 0.0:
            work.touches[i], left = 0, True
    return left


@inline
def _balance(workspace, M, bias, arm, tau, t):
    """Compute the multipliers of the surfaces of `work.touches`, and q_ddot without them."""
    world, touch, torque, n = workspace.world, workspace.touch, workspace.torque, arm.q.shape[0]
    work = workspace.multipliers
    for a in range(3):
        workspace.push[a] = 0.0
    for i in range(world.shapes.number):
        add_contact_force(one_of(world.contacts, i), 0.0, work.touches[i] > 0, one_of(touch, i), workspace.push)
    transposed_times(touch.tool.J_v, workspace.push, workspace.pushed)
    resistance_torque(workspace.resistance, arm.q_dot, t, torque)
    for i in range(n):
        torque[i] = tau[i] - bias[i] - torque[i] - workspace.pushed[i]
    solve_spd(M, torque, workspace.factor, arm.q_ddot)  # without the multipliers
    for i in range(world.shapes.number):
        met = one_of(touch, i)
        work.free[i] = dot(met.pull, arm.q_ddot) + met.phi_ddot_bias
        work.side[i] = 1.0
    _find_multipliers(workspace, M)
    turned = False
    for i in range(world.shapes.number):  # where a bilateral surface pulls, friction still opposes the slip
        if work.found[i] < 0.0 and not one_of(world.contacts, i).unilateral:
            work.side[i], turned = -1.0, True
    if turned:
        _find_multipliers(workspace, M)


@kernel
def accelerate_heavy(workspace, M, bias, J, J_dot, rotation, translation, arm, tau, t):
    """Compute q_ddot under the torque tau, and the load, which depends on it.

    A rigid surface that only pushes, but would have to pull, is let go, each by itself: of the sets of surfaces to let
    go, the first one is taken with which none that is held pulls, and none that is let go is entered. Without friction
    there is just one. With much Coulomb friction there may be none; then all are let go.
    """
    workspace, arm = workspace[0], arm[0]
    world, touch, n = workspace.world, workspace.touch, arm.q.shape[0]
    work, load, holding = workspace.multipliers, arm.load, arm.holding
    touch_at(world, J, rotation, translation, arm.q_dot, t, touch)
    add_drift(world, J, J_dot, arm.q_dot, touch)
    for trial in range(SETS + 1):
        if not world.rigid:
            find_touched(world, touch, holding.held, work)
        elif not let_go(world, holding.held, trial, work.touches):
            continue
        _accelerate_against(workspace, M, bias, arm, tau, t)
        if trial == 0:
            copy(work.found, work.whole)
        if not world.rigid or one_sided(world, holding.held, work, work.free, work.found):
            break
    if world.rigid:
        for i in range(world.shapes.number):
            if holding.held[i] > 0 and work.touches[i] == 0:
                holding.held[i], holding.lost[i], holding.pull[i] = 0, t, work.whole[i]
    for a in range(6):
        load.wrench[a] = 0.0
    for i in range(world.shapes.number):
        contact, met, multiplier = one_of(world.contacts, i), one_of(touch, i), work.found[i]
        load.multiplier[i], load.phi[i] = multiplier, met.phi
        for j in range(n):
            arm.q_ddot[j] -= work.directions[i, j] * multiplier
        add_contact_force(contact, multiplier, work.touches[i] > 0, met, load.wrench)
    transposed_times(touch.tool.J_v, load.wrench, load.torque)


@kernel
def load_at(workspace, J, rotation, translation, arm, t):
    """Compute the load of elastic surfaces at the arm's state and t (s)."""
    workspace, arm = workspace[0], arm[0]
    world = workspace.world
    touch_at(world, J, rotation, translation, arm.q_dot, t, workspace.touch)
    elastic_load(world, workspace.touch, workspace.multipliers, arm.load)


@kernel
def penetration_at(workspace, J, rotation, translation, arm, t):
    """Compute phi (m) of each surface at the arm's state and t (s)."""
    touch_at(workspace[0].world, J, rotation, translation, arm[0].q_dot, t, workspace[0].touch)
    for i in range(workspace[0].world.shapes.number):
        arm[0].load.phi[i] = one_of(workspace[0].touch, i).phi


@kernel
def force_of(workspace, J, rotation, translation, arm, multiplier, t, force):
    """Compute the wrench (6,) of the tool on the environment for multipliers (3,) N."""
    world, workspace = workspace[0].world, workspace[0]
    touch_at(world, J, rotation, translation, arm[0].q_dot, t, workspace.touch)
    find_touched(world, workspace.touch, arm[0].holding.held, workspace.multipliers)
    copy(multiplier, workspace.multipliers.found)
    _leave_pulling(world, workspace.multipliers)
    for a in range(6):
        force[a] = 0.0
    for i in range(world.shapes.number):
        contact, met = one_of(world.contacts, i), one_of(workspace.touch, i)
        touches = workspace.multipliers.touches[i] > 0
        add_contact_force(contact, multiplier[i], touches, met, force)


@kernel
def torque_of_push(workspace, J, rotation, translation, push, torque):
    """Compute the torque (n,) N m of a push on the tool, a wrench (6,)."""
    tool = workspace[0].touch.tool.p
    place_tool(workspace[0].world.lever, rotation, translation, tool)
    for j in range(torque.shape[0]):
        about = cross(tool, (J[3, j], J[4, j], J[5, j]))
        torque[j] = 0.0
        for a in range(3):
            torque[j] += (J[a, j] - about[a]) * push[a] + J[3 + a, j] * push[3 + a]
