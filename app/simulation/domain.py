"""Omega, the postures around the reference, and the constants over it: Property 1, Lipschitz constants, mobility."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from app.scenario.errors import PathOutOfReach, ScenarioError
from app.simulation.extremes import OUTSIDE, Effort, Objectives, ObjectiveValue, Omega, Place, largest
from app.simulation.observation import Observed, Observer
from app.simulation.planned_reference import Planned
from app.simulation.search_memory import Memory, Numbers, key_of
from controllers.bounds import InertiaRange, Uncertainty
from controllers.control_law import Reference
from controllers.estimate_rates import NO_RATES, LinkRates, Lipschitz, Steepness
from controllers.nominal_model import NominalModel
from environments.step_resolution import Mobility
from environments.surfaces.table import Surface

CENTRES = 192  # postures along the reference, around which Omega lies
NEAR = 1.0  # rad, between two of them that follow each other, and from the scenario's posture to the first
SWEEPS = 4  # number of times that the centres go from the reference to the shifted one and back
INERTIA, OTHERS = Effort(120, 3), Effort(40, 2)  # of the search; the other functions change less over Omega
MARGIN = 1.02  # factor on all results of searches; longer searches by another method find less than this above them
SLOWEST = 1e-3  # Hz: for a surface that moves more slowly, only the first 1000 s count

Observe = Callable[[np.ndarray, np.ndarray, float], Observed]


class DesiredPosture(NamedTuple):
    """Posture of the arm on the reference.
    q, q_dot: (n,) rad and rad/s, q_d and q_d_dot."""

    q: np.ndarray
    q_dot: np.ndarray


@dataclass(frozen=True)
class Constants:
    """Constants over Omega, as far as J_q is regular there.
    k_r_low, k_r_high: kg, of Property 1, for every arm inside the declared set.
    lipschitz: constants of the estimates.
    rates: of the links' errors, zero where none are declared."""

    k_r_low: float
    k_r_high: float
    lipschitz: Lipschitz
    rates: LinkRates
    omega: Omega

    @property
    def centres(self) -> np.ndarray:
        """Centres of Omega, (N, n) rad."""
        return self.omega.centres

    @property
    def radius(self) -> float:
        """Radius of Omega, rad."""
        return self.omega.radius


def posture_at(observe: Observe, q: np.ndarray, reference: Reference, t: float) -> DesiredPosture:
    """Posture with r(q_d, t) = r_d and the rate of both, by Newton's method from q (n,) rad."""
    task = observe(q, np.zeros_like(q), t).task
    for _ in range(8):
        away = task.J_q_inv @ (reference.r_d - task.r)
        if np.abs(away).max() < 1e-9:
            break
        q = q + away
        task = observe(q, np.zeros_like(q), t).task
    return DesiredPosture(q, task.J_q_inv @ (reference.r_d_dot - task.v_t))


def centres(
    observe: Observe,
    unshifted: Planned,
    shift: np.ndarray,
    q_0: np.ndarray,
    duration: float,
) -> np.ndarray:
    """Postures (N, n) along the reference, and between it and its shift by (n,) m.

    Raises PathOutOfReach when the arm cannot follow it.
    """
    found = [q_0]
    q = q_0
    for fraction in np.linspace(0.0, 1.0, CENTRES):
        t = fraction * duration
        reference = unshifted.at(t)
        reference.r_d[:] += 0.5 * (1.0 - np.cos(2 * np.pi * SWEEPS * fraction)) * shift
        try:
            q = posture_at(observe, q, reference, t).q
        except ValueError:  # J_q exactly singular
            q = np.full_like(q, np.nan)
        if not np.linalg.norm(q - found[-1]) < NEAR:
            raise PathOutOfReach(f"motion: the arm cannot follow the reference beyond t = {t:.3g} s")
        found.append(q)
    return np.array(found)


def span_of(surfaces: Sequence[Surface], duration: float) -> float:
    """Time until all places and forms of the surfaces have occurred, s: the run's duration (s) where a form changes or
    several surfaces move, 0 where all rest."""
    moving = [each.motion for each in surfaces if each.motion.amplitude > 0.0 and each.motion.frequency > 0.0]
    if any(each.changing for each in surfaces) or len({motion.frequency for motion in moving}) > 1:
        return duration
    return 1.0 / max(moving[0].frequency, SLOWEST) if moving else 0.0


def constants_over(
    omega: Omega, sigma_min: float, uncertainty: Uncertainty, nominal: NominalModel, observer: Observer, memory: Memory
) -> Constants:
    """Constants over Omega, where J_q's smallest singular value is at least `sigma_min` m.

    Raises ScenarioError where J_q is singular.
    """
    objectives, steepness = _inertia_objectives(sigma_min, uncertainty, observer), Steepness(nominal.model)
    arm, where = nominal.fingerprint, (omega.centres, omega.radius)

    def find_inertia() -> Numbers:
        lightness, heaviness = largest(omega, objectives, INERTIA)
        if not lightness > 0.0:
            raise ScenarioError(_nowhere(omega, sigma_min, uncertainty, observer))
        return 1.0 / (MARGIN * lightness), MARGIN * heaviness

    def find_lipschitz() -> Numbers:
        each = (steepness.k_C, steepness.k_M, steepness.k_Cq, steepness.k_G)
        still = Omega(*where)
        return tuple(MARGIN * largest(still, lambda p, k=k: (ObjectiveValue(k(p.q)),), OTHERS)[0] for k in each)

    def find_rates() -> Numbers:
        found = largest(Omega(*where), lambda p: tuple(ObjectiveValue(k) for k in steepness.links(p.q)), OTHERS)
        return tuple(MARGIN * k for k in found)

    seen = ("inertia", arm, observer.fingerprint, *where, omega.span, sigma_min, repr(uncertainty))
    k_r_low, k_r_high = memory.recall(key_of(*seen), 2, find_inertia)
    lipschitz = Lipschitz(*memory.recall(key_of("lipschitz", arm, *where), 4, find_lipschitz))
    in_doubt = uncertainty.rho_centre > 0.0 or uncertainty.rho_shape > 0.0
    rates = LinkRates(*memory.recall(key_of("rates", arm, *where), 3, find_rates)) if in_doubt else NO_RATES
    return Constants(k_r_low, k_r_high, lipschitz, rates, omega)


def _nowhere(omega: Omega, sigma_min: float, uncertainty: Uncertainty, observer: Observer) -> str:
    """Sentence on an Omega in which no place has the inertia that Property 1 needs."""
    certain = uncertainty._replace(rho=0.0, rho_rotor=0.0, rho_centre=0.0, rho_shape=0.0)
    values = _inertia_objectives(sigma_min, certain, observer)
    if any(values(place)[0].room >= 0.0 for place in omega.places(INERTIA.draws)):
        return (
            "declared.link_centre: with the other declared errors of the links, some arm would have no inertia left "
            "(k_r′ ≤ 0); allowed: a smaller link_centre, link_shape or link_scaling"
        )
    return "robot.posture: J_q is singular around it; allowed: a posture away from singularities"


def _inertia_objectives(sigma_min: float, uncertainty: Uncertainty, observer: Observer) -> Objectives:
    """Objectives for 1/lambda_min(H_low) and lambda_max(H_high), for the whole declared set."""

    def values(place: Place) -> tuple[ObjectiveValue, ObjectiveValue]:
        try:
            estimate, task = observer.at(place.q, np.zeros_like(place.q), place.t)
        except ValueError:
            return OUTSIDE, OUTSIDE  # J_q exactly singular
        inertia, J_inv = InertiaRange.at(uncertainty, estimate, task), task.J_q_inv
        matrices = np.array([inertia.H_low, inertia.H_high, J_inv.T @ J_inv])
        if not np.isfinite(matrices).all():
            return OUTSIDE, OUTSIDE
        eigenvalues = np.linalg.eigvalsh(matrices)
        low, high, sigma = eigenvalues[0, 0], eigenvalues[1, -1], 1.0 / np.sqrt(eigenvalues[2, -1])
        if not low > 0.0:
            return OUTSIDE, OUTSIDE
        room = sigma / sigma_min - 1.0 if sigma_min > 0.0 else np.inf
        return ObjectiveValue(1.0 / low, room), ObjectiveValue(high, room)

    return values


def mobility_over(
    omega: Omega, model: pin.Model, surfaces: Sequence[Surface], nominal: NominalModel, memory: Memory
) -> Mobility:
    """Largest mobility over Omega of an arm with this model, along and across any of the surfaces, also near
    singularities."""
    data = model.createData()

    def values(place: Place) -> tuple[ObjectiveValue, ...]:
        tool = nominal.evaluate(place.q, np.zeros_like(place.q))
        normals = np.array([each.chart(tool.p, place.t).G[0] for each in surfaces])
        M = pin.crba(model, data, place.q)
        mobility = Mobility.largest(M[None], tool.J_v[None], normals)
        return tuple(ObjectiveValue(value) if np.isfinite(value) else OUTSIDE for value in mobility)

    def find() -> Numbers:
        return tuple(MARGIN * value for value in largest(omega, values, OTHERS))

    saved = nominal.saved if model is nominal.model else model.saveToString()
    known = (saved, nominal.fingerprint, *(each.fingerprint for each in surfaces))
    key = key_of("mobility", *known, omega.centres, omega.radius, omega.span)
    return Mobility(*memory.recall(key, 3, find))
