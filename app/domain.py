"""Omega, the postures around the reference, and what holds over it: Property 1, Lipschitz constants, mobility."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from app.control_period import Planned
from app.scenario import Formula, Scenario, ScenarioError
from controllers.bounds import InertiaRange, Uncertainty
from controllers.nominal_model import Estimate, Lipschitz, NominalModel, lipschitz_constants
from controllers.task_space import TaskSpace
from controllers.vsmrc import Reference
from environments.plant import Plant
from environments.stiffness import Mobility

SAMPLES = 240  # postures drawn from Omega for the constants over it
CENTRES = 192  # postures along the reference, around which Omega lies
SWEEPS = 4  # how often they go over from the reference to the shifted one and back
MARGIN = 1.1  # on k_r_low and k_r_high, for what lies between the samples

Observe = Callable[[np.ndarray, np.ndarray, float], tuple[Estimate, TaskSpace]]


@dataclass(frozen=True)
class Constants:
    """What holds over Omega, the postures within `radius` (rad) of one that the reference passes through, `centres`
    (N, n), as far as J_q is regular there: Property 1's k_r_low and k_r_high (kg) for every arm inside the declared
    set, and the Lipschitz constants of the estimates."""

    k_r_low: float
    k_r_high: float
    lipschitz: Lipschitz
    centres: np.ndarray
    radius: float

    def distance(self, q: np.ndarray) -> float:
        """Of q (n,) rad from the nearest of the centres, rad; Omega ends at `radius`."""
        return float(np.sqrt(np.square(self.centres - q).sum(axis=1).min()))

    def holds_at(self, q: np.ndarray) -> bool:
        """Whether q (n,) rad lies in Omega."""
        return self.distance(q) <= self.radius


def posture_at(observe: Observe, q: np.ndarray, reference: Reference, t: float) -> tuple[np.ndarray, np.ndarray]:
    """q_d, q_d_dot with r(q_d, t) = r_d and its rate, by Newton's method from q (n,) rad."""
    _, task = observe(q, np.zeros_like(q), t)
    for _ in range(8):
        away = task.J_q_inv @ (reference.r_d - task.r)
        if np.abs(away).max() < 1e-9:
            break
        q = q + away
        _, task = observe(q, np.zeros_like(q), t)
    return q, task.J_q_inv @ (reference.r_d_dot - task.v_t)


def centres(
    observe: Observe,
    unshifted: Planned,
    shift: np.ndarray,
    q_0: np.ndarray,
    duration: float,
) -> np.ndarray:
    """Postures (N, n) along the reference, and between it and its shift by (n,) m.

    Raises ScenarioError when the arm cannot follow it.
    """
    found = [q_0]
    q = q_0
    for share in np.linspace(0.0, 1.0, CENTRES):
        t = share * duration
        reference = unshifted.at(t)
        reference.r_d[:] += 0.5 * (1.0 - np.cos(2 * np.pi * SWEEPS * share)) * shift
        try:
            q, _ = posture_at(observe, q, reference, t)
        except ValueError:  # J_q exactly singular
            q = np.full_like(q, np.nan)
        if not np.linalg.norm(q - found[-1]) < 1.0:
            raise ScenarioError(f"motion: the arm cannot follow the reference beyond t = {t:.3g} s")
        found.append(q)
    return np.array(found)


def _postures(along: np.ndarray, radius: float, random: np.random.Generator) -> np.ndarray:
    """Samples of Omega, (N, n) rad: some of its centres and postures drawn around them."""
    n = along.shape[1]
    directions = random.standard_normal((SAMPLES, n))
    directions *= radius / np.linalg.norm(directions, axis=1, keepdims=True)
    spread = np.linspace(0, len(along) - 1, SAMPLES).astype(int)
    around = along[spread] + directions * random.uniform(size=(SAMPLES, 1)) ** (1 / n)
    return np.vstack([along[::8], around])


def constants_over(
    along: np.ndarray, scenario: Scenario, uncertainty: Uncertainty, nominal: NominalModel, observe: Observe
) -> Constants:
    """What holds over Omega around the postures `along` (N, n) rad. Raises ScenarioError where J_q is singular."""
    random = np.random.default_rng(1)
    n, radius = along.shape[1], scenario.simulation.domain_radius
    samples = _postures(along, radius, random)
    typed = isinstance(scenario.surface, Formula)  # it may change all the time, not only with its motion's period
    period = scenario.simulation.duration if typed else 1.0 / max(scenario.surface.motion.frequency, 1e-3)
    low, high = np.inf, 0.0
    for q in samples:
        try:
            estimate, task = observe(q, np.zeros(n), period * random.uniform())
        except ValueError:
            continue  # J_q exactly singular: not in Omega
        if np.linalg.norm(task.J_q_inv, 2) * scenario.simulation.sigma_min > 1.0:
            continue
        inertia = InertiaRange.at(uncertainty, estimate, task)
        low = min(low, float(np.linalg.eigvalsh(inertia.H_low)[0]))
        high = max(high, float(np.linalg.eigvalsh(inertia.H_high)[-1]))
    if not low < np.inf:
        raise ScenarioError("robot.posture: J_q is singular around it; allowed: a posture away from singularities")
    lipschitz = lipschitz_constants(nominal.model, samples[:: len(samples) // 50])
    return Constants(low / MARGIN, high * MARGIN, lipschitz, along, radius)


def mobility_over(constants: Constants, plant: Plant, nominal: NominalModel) -> Mobility:
    """How mobile the true arm is at most over Omega; the surface at rest."""
    postures = _postures(constants.centres, constants.radius, np.random.default_rng(1))
    data = plant.model.createData()
    tools = [nominal.evaluate(q, np.zeros_like(q)) for q in postures]
    return Mobility.largest(
        np.array([pin.crba(plant.model, data, q).copy() for q in postures]),
        np.array([tool.J_v for tool in tools]),
        np.array([plant.surface.chart(tool.p, 0.0).G[0] for tool in tools]),
    )
