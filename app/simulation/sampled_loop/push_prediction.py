"""Response of a system's tool to a push, from the control period at a posture."""

from __future__ import annotations

import numpy as np

from app.simulation.sampled_loop.contact_model import felt_per_wrench, model_in_contact
from app.simulation.sampled_loop.period_map import Posture, free_directions
from app.simulation.sampled_loop.push_response import FORCE, MOMENT, PushAxis, PushResponse
from app.simulation.system import System


def push_response(system: System, at: Posture, A: np.ndarray, by_push: np.ndarray) -> PushResponse:
    """Response of the tool to a push at a posture.
    A: (k, k), Jacobian of the control period.
    by_push: (k, 6), change of the state after the period by a unit push."""
    estimate, J_inv = at.estimate, at.task.J_q_inv
    axes = _push_axes(system, at)
    wrenches = np.array([axis.wrench for axis in axes])
    basis = free_directions(system, at)
    place = wrenches @ np.vstack([estimate.J_v, estimate.J_w]) @ J_inv  # of the tool, from r
    felt = system.controller.model.K_f @ felt_per_wrench(system, at) @ wrenches.T
    model = model_in_contact(system, at)
    C = np.zeros((len(axes), len(A)))
    C[:, : basis.shape[1]] = place @ basis
    return PushResponse(
        axes=axes,
        period=system.scenario.controller.period,
        l=system.layout.l,
        A=A,
        B=by_push @ wrenches.T,
        C=C,
        M=model.M,
        D=model.B,
        K=model.K,
        pushed=basis.T @ felt,
        place=place @ basis,
    )


def _push_axes(system: System, at: Posture) -> tuple[PushAxis, ...]:
    """Axes of pushes: along the positions in r, and those about which the tool turns when one of its angles changes
    alone; where r = q, along and about the world's axes as far as the arm can follow."""
    layout, coordinates = system.layout, system.coordinates
    rows = system.charted.chart(at.estimate.p, at.t).G[: layout.positions]
    forces = np.hstack([rows / np.linalg.norm(rows, axis=1, keepdims=True), np.zeros_like(rows)])
    planar = layout.positions == 2
    if layout.joint:
        names = ("x", "z") if planar else ("x", "y", "z")
        about = ("y",) if planar and layout.n > 2 else ("x", "y", "z") if layout.n > 5 else ()
        turns = {name: (f"about {name}", np.eye(3)["xyz".index(name)]) for name in about}
    else:
        names = tuple(coordinates[i].name for i in layout.position_indices)
        omega = at.estimate.J_w @ at.task.J_q_inv
        turns = {
            name: (f"about the axis of {name}", omega[:, i] / np.linalg.norm(omega[:, i]))
            for i in layout.turns
            for name in [coordinates[i].name.removeprefix("ℓ·")]
        }
    return (
        *(PushAxis(name, f"along {name}", FORCE, wrench) for name, wrench in zip(names, forces, strict=True)),
        *(PushAxis(name, words, MOMENT, np.concatenate([np.zeros(3), axis])) for name, (words, axis) in turns.items()),
    )
