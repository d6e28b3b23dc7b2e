"""Steady force: where the controlled forces settle by (37), if the references stood still."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np

from app.scenario.schema import Scenario
from app.simulation.builders.controller_builder import compensation, mode_of, true_stiffness
from app.simulation.builders.environment_builder import environment_of
from app.simulation.system import System
from controllers.control_law import ControlLaw
from controllers.target_model import TargetModel


def settled(law: ControlLaw, model: TargetModel, A: np.ndarray, s: np.ndarray) -> tuple[TargetModel, np.ndarray]:
    """Model (8) that the law settles by, and what the present s (..., n) m/s leaves of it, (..., n) N, (14). A law that
    reads no force presses with the desired one, as with K_f = 1, and knows no s. A: (n, n) 1/s."""
    if law.feels_force:
        return model, model.left_by_layer(A, s.T).T
    return replace(model, K_f=np.eye(model.n)), np.zeros_like(s)


def steady_forces(
    scenario: Scenario, model: TargetModel, r_d: np.ndarray, F_cd: np.ndarray, rest: np.ndarray
) -> np.ndarray:
    """Steady forces (N, m) N, moments over l among them, of a mode that controls them, on elastic surfaces.

    r_d, F_cd: (N, n), the references; rest: (N, n), see `TargetModel.left_by_layer`. On a body with followed faces the
    steady forces depend on which of them the tool presses there.
    """
    mode = mode_of(scenario)
    m, p, surfaces = mode.force_directions, mode.pressed, scenario.surfaces
    environment = environment_of(scenario)
    if p == len(surfaces) or not environment.coupled:
        return model.steady_forces(true_stiffness(scenario), r_d[:, :m], F_cd[:, :m], rest[:, :m])
    followed = range(p, len(surfaces))
    found = np.full((len(r_d), m), np.nan)
    for meets in product((True, False), repeat=len(followed)):
        on = [i for i, met in zip(followed, meets, strict=True) if met]
        off = [i for i in followed if i not in on]
        if any(not surfaces[i].contact.unilateral for i in off):
            continue
        acts, K_e = [*range(p), *on], np.zeros((model.n, model.n))
        K_e[np.ix_(acts, acts)] = within = environment.acting(acts)[2]
        forces = model.steady_forces(K_e, r_d, F_cd, rest)
        fits = (forces[:, [i for i in on if surfaces[i].contact.unilateral]] >= 0.0).all(axis=1)
        if off:
            u = np.linalg.solve(within, forces[:, acts].T)
            bulge = -np.linalg.solve(environment.K_e[np.ix_(off, off)], environment.K_e[np.ix_(off, acts)] @ u).T
            fits &= (bulge >= r_d[:, off]).all(axis=1)
        fits &= np.isnan(found[:, 0])
        found[fits] = forces[fits, :m]
    return found


def steady_force_error(system: System, r_d: np.ndarray, F_cd: np.ndarray, s: np.ndarray) -> float | None:
    """Steady-state force error f_n - f_nd (N) by (37), for constant references r_d, F_cd (n,); on several surfaces the
    norm of their errors; None where no force is controlled.
    It includes the error, by (14), due to an s (n,) m/s that stays within the boundary layer, where A is not 0.
    On a rigid surface r_fd = 0, and (41) leaves no error but that due to s."""
    if not (m := system.m):
        return None
    A, controller = compensation(system.scenario, system.layout.n), system.controller
    model, rest = settled(controller.law, controller.model, A, s)
    if system.plant.nature.rigid:
        errors = np.linalg.solve(model.K_f[:m, :m], rest[:m])
    else:
        errors = steady_forces(system.scenario, model, r_d[None], F_cd[None], rest[None])[0] - F_cd[:m]
    return float(errors[0]) if system.pressed == 1 else float(np.linalg.norm(errors[: system.pressed]))
