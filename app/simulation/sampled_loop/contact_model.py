"""Target model (8) of a system against its true contact, at a posture."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from app.simulation.builders.environment_builder import SOFTEST
from app.simulation.sampled_loop.period_map import Posture, free_directions
from app.simulation.system import System
from controllers.target_model import TargetModel


class SecondOrder(NamedTuple):
    """Second-order model in k directions.
    M: (k, k) kg, inertia.
    B: (k, k) N s/m, damping.
    K: (k, k) N/m, stiffness."""

    M: np.ndarray
    B: np.ndarray
    K: np.ndarray


def model_poles(system: System, at: Posture) -> np.ndarray:
    """Poles (k,) 1/s of (8) against the true contact, in the directions in which the arm can move."""
    contact = model_in_contact(system, at)
    return TargetModel(contact.M, contact.B, contact.K, np.zeros_like(contact.M)).poles()


def felt_per_wrench(system: System, at: Posture) -> np.ndarray:
    """F_c per wrench on the tool, (n, 6), as the law reads it, `controllers.sliding.controlled_force`: a force along a
    surface is not counted as its normal force."""
    estimate, controller = at.estimate, system.controller
    felt = at.task.J_q_inv.T @ np.vstack([estimate.J_v, estimate.J_w]).T
    k = controller.surfaces
    felt[:k, :3], felt[:k, 3:] = np.linalg.pinv(at.task.normals[:k]).T, 0.0
    return controller.controlled[:, None] * felt


def model_in_contact(system: System, at: Posture) -> SecondOrder:
    """(8) against the true contact, in the directions in which the arm can move."""
    model, nature, basis = system.controller.model, system.plant.nature, free_directions(system, at)
    M, B, K = model.M_m, model.B_m, model.K_m
    a, environment, k = at.across, system.plant.environment, len(system.surfaces)
    by_force = model.K_f @ felt_per_wrench(system, at)[:, :3]
    felt = by_force @ at.normals.T
    if nature.massive:
        M = M + felt @ environment.M_e[:k, :k] @ a.T
    if nature.springs:
        B = B + felt @ environment.B_e[:k, :k] @ a.T
        K = K + felt @ environment.K_e[:k, :k] @ a.T
    moved = at.estimate.J_v @ at.task.J_q_inv  # velocity of the tool point by that of r
    for normal, contact in zip(at.normals, system.plant.contacts if nature.touches else (), strict=False):
        along = moved - np.outer(normal, normal @ moved) / (normal @ normal)
        B = B + contact.friction_viscous * by_force @ along
    first, K_t = system.plant.contacts[0], system.scenario.face.K_t
    for a in at.turning.T:
        felt = model.K_f @ np.outer(system.controller.controlled * a, a)
        B = B + felt * (first.B_e * K_t / max(first.K_e, SOFTEST) if nature.springs else 0.0)
        K = K + felt * (K_t if nature.springs else 0.0)
    return SecondOrder(basis.T @ M @ basis, basis.T @ B @ basis, basis.T @ K @ basis)
