"""Force loop of a system at a posture, see `controllers.force_loop`, and the feedback of the gain (17) through it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from app.simulation.sampled_loop.contact_model import felt_per_wrench
from app.simulation.sampled_loop.period_map import Posture
from app.simulation.system import System
from controllers.bounds import Equivalent, RequiredGain, required_gain
from controllers.force_loop import force_loop_factors, through_sensor, with_gain
from controllers.nominal_model import ON_LINE, Estimate
from controllers.task_space import TaskSpace

SLIPS = 36  # directions of slip on one surface: the worst one of all is missed by at most 0.4 % of friction's part


class UnitLoad(NamedTuple):
    """Load per unit of the multiplier of each of k surfaces, with Coulomb friction in one direction of slip.
    F_r: (n, k), all of it; F_c: (n, k), what the law feeds back of it, see `felt_per_wrench`."""

    F_r: np.ndarray
    F_c: np.ndarray


class ForceLoopFactor(NamedTuple):
    """Factor of the force loop, nan where no force is fed back through a loop that sampling closes.
    factor: of largest size.
    premise: value of `Premise.FORCE_LOOP`, which includes the feedback of the gain."""

    factor: float
    premise: float


class GainFeedback(NamedTuple):
    """Feedback of the gain d by (17) through the force on rigid or heavy surfaces.
    gain: of the loop from the force through d back to the force, when the loop through the multiplier is solved; nan
    where d does not depend on the force.
    added: part that d adds to the size of the force loop's factor, 0 where d does not depend on the force."""

    gain: float
    added: float


def force_factor(system: System, at: Posture) -> float:
    """Force loop factor, see `controllers.force_loop`, with Coulomb friction in the direction of slip that makes it
    largest; nan where no force is fed back through a loop that sampling closes."""
    loads = unit_loads(system, at)
    return worst_force_loop(system, at, loads, (0.0,) * len(loads)).factor


def worst_force_loop(system: System, at: Posture, loads: list[UnitLoad], added: tuple[float, ...]) -> ForceLoopFactor:
    """Largest force-loop factor over the loads, and its premise value including the gain's feedback. loads: see
    `unit_loads`; added: `GainFeedback.added` of each."""
    if not system.plant.nature.heavy or system.scenario.sensor.ideal or not system.controller.law.feels_force:
        return ForceLoopFactor(math.nan, math.nan)
    model, masses = system.controller.model, _surface_mass(system)
    sensor = system.contact_sensor.gain, system.contact_sensor.late
    loops = [force_loop_factors(at.H_hat, at.H_hat, model, at.across, *load, masses) for load in loads]
    factor = through_sensor(np.concatenate(loops), *sensor)
    if not any(added):
        return ForceLoopFactor(factor, abs(factor))
    return ForceLoopFactor(factor, max(with_gain(loop, more, *sensor) for loop, more in zip(loops, added, strict=True)))


def unit_loads(system: System, at: Posture) -> list[UnitLoad]:
    """Loads without Coulomb friction, and with that of a slip in each direction along all surfaces."""
    forces = [at.normals.T]
    if system.plant.nature.heavy:
        forces += [at.normals.T + drag for drag in drags(system, at, range(len(at.normals)))]
    by_force, felt = at.task.J_q_inv.T @ at.estimate.J_v.T, felt_per_wrench(system, at)[:, :3]
    return [UnitLoad(by_force @ force, felt @ force) for force in forces]


def drags(system: System, at: Posture, touched: Sequence[int]) -> list[np.ndarray]:
    """Coulomb friction (3, k) of the tool on k surfaces per unit of their multipliers, for a slip in each direction
    along the touched ones; none where they have no friction."""
    mu = [each.friction_coulomb for each in system.plant.contacts[: len(at.normals)]]
    drag = [mu[i] * float(np.linalg.norm(row)) * (i in touched) for i, row in enumerate(at.normals)]
    if not any(drag):
        return []
    across_plane = [[0.0, 1.0, 0.0]] if system.layout.positions == 2 else np.zeros((0, 3))
    held = np.vstack([at.normals[list(touched)], across_plane])
    along = np.linalg.svd(held)[2][len(held) :]
    angles = np.linspace(0.0, 2 * np.pi, SLIPS, endpoint=False)
    around = {0: [], 1: [[1.0], [-1.0]], 2: np.column_stack([np.cos(angles), np.sin(angles)])}[len(along)]
    return [np.outer(slip @ along, drag) for slip in around]


def _surface_mass(system: System) -> np.ndarray:
    """Mass of the surfaces (k, k) kg, infinite on the diagonal of rigid ones."""
    k = len(system.surfaces)
    return np.diag(np.full(k, math.inf)) if system.plant.nature.rigid else system.plant.environment.M_e[:k, :k]


def gain_by_force(system: System, at: Posture, loads: Sequence[UnitLoad]) -> list[GainFeedback]:
    """Feedback of the gain d by (17) through the force on rigid or heavy surfaces, for each of the loads. Of several
    surfaces, changes of all their forces add up."""
    controller = system.controller
    if not system.plant.nature.heavy or controller.d is not None or not controller.law.robust:
        return [GainFeedback(math.nan, 0.0)] * len(loads)
    masses, Y, slope = _surface_mass(system), np.linalg.solve(at.H_hat, at.across), _slope_of_gain(system, at)
    found = []
    for load in loads:
        commanded = np.linalg.solve(controller.model.M_m, controller.model.K_f @ load.F_c)
        slopes = np.array([slope(each) for each in commanded.T])
        yielding, solved = (_by_acceleration(masses, back) for back in (Y.T @ load.F_r, at.across.T @ commanded))
        found.append(GainFeedback(_largest(Y @ solved.T, slopes), _largest(Y @ yielding.T, slopes)))
    return found


def worst_gain_by_force(system: System, q: np.ndarray, t: float) -> float:
    """Largest gain of `gain_by_force` over all directions of slip at the posture q (n,) rad at time t (s); nan where
    there is none, or J_q is singular."""
    if not system.plant.nature.heavy:
        return math.nan
    try:
        at = Posture.of(system, q, t)
        return max(each.gain for each in gain_by_force(system, at, unit_loads(system, at)))
    except (ValueError, np.linalg.LinAlgError):
        return math.nan


def _by_acceleration(masses: np.ndarray, mobility: np.ndarray) -> np.ndarray:
    """Multipliers (k, k), N per m/s^2 of phi_ddot without them.
    masses: (k, k) kg, of the surfaces, see `_surface_mass`.
    mobility: (k, k) m/s^2 per N, by which the multipliers reduce phi_ddot."""
    if np.isinf(masses).any():
        return np.linalg.inv(mobility)
    return np.linalg.solve(np.eye(len(masses)) + masses @ mobility, masses)


def _largest(pull: np.ndarray, slopes: np.ndarray) -> float:
    """Largest change of d by a unit vector (n,) of the switching term. pull: (n, k), change of the multipliers by that
    vector; slopes: (k,), change of d by each multiplier."""
    signs = product((1.0, -1.0), repeat=len(slopes))
    return max(float(np.linalg.norm(pull @ (slopes * sign))) for sign in signs)


def _slope_of_gain(system: System, at: Posture) -> Callable[[np.ndarray], float]:
    """Largest change of d by (17), N, per unit of r_eq_ddot's change, as a function of the change's direction."""
    still = np.zeros(system.layout.n)
    rest = at.task._replace(v_t=still, v_t_dot=still)
    without = _needed(system, at.estimate, rest, still)
    return lambda r_eq_ddot: float(_needed(system, at.estimate, rest, r_eq_ddot).inertia - without.inertia)


def _needed(system: System, estimate: Estimate, task: TaskSpace, r_eq_ddot: np.ndarray) -> RequiredGain:
    """Gain required by (17), without its epsilon, where all errors and all rates of the reference are zero. r_eq_ddot:
    (n,) m/s^2."""
    still = np.zeros(system.layout.n)
    q_eq_dot = -task.J_q_inv @ task.v_t
    q_eq_ddot = task.J_q_inv @ (r_eq_ddot - task.J_q_dot @ q_eq_dot - task.v_t_dot)
    at_rest = Equivalent(still, r_eq_ddot, q_eq_dot, q_eq_ddot)
    controller = system.controller
    return required_gain(controller.bounds, controller.uncertainty, ON_LINE, estimate, task, still, at_rest)
