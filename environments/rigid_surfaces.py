"""Rigid surfaces: steps that bring the arm onto those that hold it, q by Newton's method and q_dot by an impact, (39).

`workspace` is a `PlantWorkspace`, `arm` an `Arm`, M (n, n) kg m^2, each as `environments.acceleration` has them.
"""

from __future__ import annotations

import numpy as np

from environments.contact import MET, touch_at
from environments.multipliers import SETS, let_go, one_sided
from environments.surfaces.chart import one_of
from kernels import inline, kernel
from kernels.algebra import dot, solve_leading, solve_spd

# m: this near a rigid surface one step of Newton's method ends on it, to rounding; most steps that are tried
NEAR_SURFACE, CORRECTIONS = 1e-9, 20


@inline
def _pulls(workspace, J, rotation, translation, M, arm, t):
    """Compute the contacts' kinematics, the change of q_dot by a unit impulse of each surface, `work.directions`, and
    the change of phi_dot of each surface by those, `work.mobility` (k, k)."""
    world, work = workspace.world, workspace.multipliers
    touch_at(world, J, rotation, translation, arm.q_dot, t, workspace.touch)
    for i in range(world.shapes.number):
        solve_spd(M, one_of(workspace.touch, i).pull, workspace.factor, work.directions[i])
    for i in range(world.shapes.number):
        for j in range(world.shapes.number):
            work.mobility[i, j] = dot(one_of(workspace.touch, i).pull, work.directions[j])


@inline
def _solve_held(work, k, away, push):
    """Solve for pushes (3,) of the k surfaces of `work.touches` with mobility push = away (3,)."""
    for i in range(k):
        work.b[i] = away[i] if work.touches[i] else 0.0
        for j in range(k):
            both = work.touches[i] and work.touches[j]
            work.S[i, j] = work.mobility[i, j] if both else 1.0 if i == j else 0.0
    solve_leading(work.S, work.b, k, push)


@inline
def _correct(work, k, push, moved):
    """Move q or q_dot (n,) by the pushes (3,) of k surfaces."""
    for j in range(k):
        for i in range(moved.shape[0]):
            moved[i] -= work.directions[j, i] * push[j]


@kernel
def onto_surface(workspace, J, rotation, translation, M, arm, t):
    """Newton step of q towards phi = 0 on the active surfaces and those newly penetrated. Returns the phi (m) of
    largest size before it."""
    workspace, arm = workspace[0], arm[0]
    work, k, away, held = workspace.multipliers, workspace.world.shapes.number, 0.0, arm.holding.held
    _pulls(workspace, J, rotation, translation, M, arm, t)
    for i in range(k):
        met = one_of(workspace.touch, i)
        if held[i] == 0 and (met.phi > NEAR_SURFACE or (met.phi >= 0.0 and met.phi_dot > 0.0)):
            held[i] = MET
        work.touches[i], work.whole[i] = held[i], met.phi
        if held[i] > 0 and not abs(met.phi) <= abs(away):
            away = met.phi
    _solve_held(work, k, work.whole, work.found)
    _correct(work, k, work.found, arm.q)
    return away


@kernel
def along_surface(workspace, J, rotation, translation, M, arm, t, h):
    """Move q_dot so that phi_dot = 0 on the surfaces that are held, and record phi, after a step of h s.

    Where the tool meets a surface, that is an inelastic impact without friction: q_dot becomes the nearest one, in the
    metric of M, that enters no surface. A surface that would have to pull for that is left: one that was held may take
    as much from its push over the step, h lambda, as there was.
    """
    workspace, arm = workspace[0], arm[0]
    world, work, k, holding = workspace.world, workspace.multipliers, workspace.world.shapes.number, arm.holding
    _pulls(workspace, J, rotation, translation, M, arm, t)
    impact = False
    for i in range(k):
        met = one_of(workspace.touch, i)
        arm.load.phi[i], work.whole[i] = met.phi, met.phi_dot
        work.free[i] = h * arm.load.multiplier[i]
        impact = impact or holding.held[i] == MET
    if not impact:
        for i in range(k):
            work.free[i] = 0.0
    else:  # an impact is solved without the impulse of the step before
        for i in range(k):
            for j in range(k):
                work.whole[i] += work.mobility[i, j] * work.free[j]
    for trial in range(SETS + 1):
        if not let_go(world, holding.held, trial, work.touches):
            continue
        _solve_held(work, k, work.whole, work.found)
        if not impact or one_sided(world, holding.held, work, work.whole, work.found):
            break
    for i in range(k):
        work.found[i] -= work.free[i]
    _correct(work, k, work.found, arm.q_dot)
    for i in range(k):
        before, holding.held[i] = holding.held[i], work.touches[i]
        if before == MET and holding.held[i] > 0:
            holding.made[i] = t
        if before == 1 and holding.held[i] == 0:
            holding.lost[i], holding.pull[i] = t, -np.inf
        if before != 1 or holding.held[i] == 0:
            holding.absent[i] = 1


def out_of_reach(phi: float) -> ValueError:
    """Error of a tool that cannot be brought onto the rigid surfaces, phi m away from the farthest."""
    return ValueError(f"surface: the tool cannot be brought onto the rigid surface (phi = {phi:.2g} m)")
