"""Sentences on how a run has left the domain of Theorem 1: surfaces that were lost, drives at their limits, and numbers
that are not finite."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from app.scenario.units import Units, unit_of_joint
from app.simulation.period.control_period import Evaluation
from app.simulation.system import System
from environments.contact import Holding


def surface_named(system: System, number: int) -> str:
    """Words for a surface, counted from 0."""
    index = system.scenario.surfaces[number].index
    return "the surface" if len(system.surfaces) == 1 else f"the {('first', 'second', 'third')[index]} surface"


def last_loss(system: System, holding: Holding) -> str:
    """Words for the surface that was lost last, and how."""
    at_once = np.flatnonzero(holding.lost == np.nanmax(holding.lost))  # one that is let go may take others with it
    last = int(at_once[np.argmin(holding.pull[at_once])])
    name, force = surface_named(system, last), holding.pull[last]
    if np.isfinite(force):
        return f"{name} would have to pull (λ = {force:.4g} N)"
    return f"an impact has lifted the tool off {name}"


def losses(system: System, holding: Holding) -> str:
    """Words for the rigid surfaces that were lost, with the instants of the last loss and the last impact of each."""
    lost: list[str] = []
    for i in np.flatnonzero(np.isfinite(holding.lost)):
        again = f", made again at t = {holding.made[i]:.4g} s" if holding.held[i] else ""
        lost.append(f"{surface_named(system, int(i))}, lost at t = {holding.lost[i]:.4g} s{again}")
    return "; ".join(lost)


def saturation(tau: np.ndarray, applied: np.ndarray, slides: Sequence[bool]) -> str:
    """Sentence on the drive whose torque tau is cut off most."""
    worst = int(np.argmax(np.abs(tau - applied)))
    unit = unit_of_joint("N·m", slides=slides[worst])
    return (
        f"the drive of joint {worst + 1} saturates: the law asks for {tau[worst]:.4g} {unit} "
        f"and gets {applied[worst]:.4g} {unit}"
    )


def infinity(evaluation: Evaluation, units: Units) -> str:
    """Sentence on numbers that are not finite: the torque that the law asks for, or the arm's state."""
    seen, tau = evaluation.seen, evaluation.output.tau
    if np.isfinite(seen.q).all() and np.isfinite(seen.q_dot).all() and not np.isfinite(tau).all():
        return f"the control law asks for a torque that is no finite number: {tau.tolist()} {units.of_joints('N·m')}"
    return "the state is no longer finite: the loop diverged"
