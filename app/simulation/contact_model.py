"""Target model (8) of a system against its true contact, at a posture."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from app.simulation.environment_builder import SOFTEST
from app.simulation.period_map import Posture, free_directions
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


def model_in_contact(system: System, at: Posture) -> SecondOrder:
    """(8) against the true contact, in the directions in which the arm can move."""
    model, kind, basis = system.controller.model, system.plant.kind, free_directions(system, at)
    M, B, K = model.M_m, model.B_m, model.K_m
    a, environment, k = at.across, system.plant.environment, len(system.surfaces)
    felt = model.K_f @ (system.controller.controlled[:, None] * a)
    if kind.massive:
        M = M + felt @ environment.M_e[:k, :k] @ a.T
    if kind.springs:
        B = B + felt @ environment.B_e[:k, :k] @ a.T
        K = K + felt @ environment.K_e[:k, :k] @ a.T
    moved = at.estimate.J_v @ at.task.J_q_inv  # velocity of the tool point by that of r
    for surface, contact in zip(system.surfaces, system.plant.contacts if kind.touches else (), strict=False):
        normal = surface.chart(at.estimate.p, at.t).G[0]
        along = moved - np.outer(normal, normal @ moved) / (normal @ normal)
        B = B + contact.friction_viscous * (model.K_f @ (system.controller.controlled[:, None] * (moved.T @ along)))
    first, K_t = system.plant.contacts[0], system.scenario.face.K_t
    for a in at.turning.T:
        felt = model.K_f @ np.outer(system.controller.controlled * a, a)
        B = B + felt * (first.B_e * K_t / max(first.K_e, SOFTEST) if kind.springs else 0.0)
        K = K + felt * (K_t if kind.springs else 0.0)
    return SecondOrder(basis.T @ M @ basis, basis.T @ B @ basis, basis.T @ K @ basis)
