"""Omega, the postures around the reference, and the constants over it: Property 1, Lipschitz constants, mobility."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from app.scenario.errors import ScenarioError
from app.simulation.omega.extremes import Effort, Objectives, ObjectiveValues, Omega, Places, largest
from app.simulation.omega.search_memory import Memory, Numbers, key_of
from app.simulation.period.observation import Observer
from controllers.bounds import InertiaRange, Uncertainty
from controllers.estimate_rates import NO_RATES, LinkRates, Lipschitz, LocalRates
from controllers.nominal_model import NominalModel
from environments.step_resolution import Mobility, mobilities
from environments.surfaces.table import Surface

INERTIA, OTHERS = Effort(240, 8), Effort(40, 2)  # of the search; the other functions change less over Omega
MARGIN = 1.02  # factor on all results of searches; docs/symbols.md says what longer ones find
SLOWEST = 1e-3  # Hz: for a surface that moves more slowly, only the first 1000 s count


@dataclass(frozen=True)
class Constants:
    """Constants over Omega, as far as J_q is regular there.
    k_r_low, k_r_high: kg, of Property 1, for every arm inside the declared set.
    k_C: as in `bounds.Uncertainty`.
    lipschitz: constants of the estimates, known where these are taken along the reference; nothing else needs them.
    rates: of the links' errors, zero where none are declared.
    instants: (N,) s, at which the reference is at the centres of Omega."""

    k_r_low: float
    k_r_high: float
    k_C: float
    lipschitz: Lipschitz | None
    rates: LinkRates
    omega: Omega
    instants: np.ndarray

    @property
    def centres(self) -> np.ndarray:
        """Centres of Omega, (N, n) rad."""
        return self.omega.centres

    @property
    def radius(self) -> float:
        """Radius of Omega, rad."""
        return self.omega.radius


def span_of(surfaces: Sequence[Surface], duration: float) -> float:
    """Time until all places and forms of the surfaces have occurred, s: one period of what moves or turns, the run's
    duration (s) where nothing recurs, 0 where all rest."""
    frequencies = frequencies_of(surfaces)
    if not recurring(surfaces):
        return duration
    return 1.0 / max(*frequencies, SLOWEST) if frequencies else 0.0


def recurring(surfaces: Sequence[Surface]) -> bool:
    """Whether the surfaces rest, or all come back to their places and forms after one period."""
    return all(each.form.frequencies is not None for each in surfaces) and len(frequencies_of(surfaces)) <= 1


def covered(surfaces: Sequence[Surface]) -> bool:
    """Whether all places and forms of the surfaces occur within `span_of`, however long the run lasts."""
    return recurring(surfaces) and not any(0.0 < frequency < SLOWEST for frequency in frequencies_of(surfaces))


def frequencies_of(surfaces: Sequence[Surface]) -> set[float]:
    """Frequencies at which the surfaces move and turn, Hz."""
    return {frequency for each in surfaces for frequency in each.form.frequencies or ()}


def constants_over(
    omega: Omega,
    instants: np.ndarray,
    sigma_min: float,
    uncertainty: Uncertainty,
    nominal: NominalModel,
    observer: Observer,
    memory: Memory,
    *,
    along_reference: bool,
) -> Constants:
    """Constants over Omega, where J_q's smallest singular value is at least `sigma_min` m.
    instants: (N,) s, of its centres.
    along_reference: whether estimates are taken along the reference.

    Raises ScenarioError where J_q is singular.
    """
    objectives, steepness = _inertia_objectives(sigma_min, uncertainty, observer), LocalRates(nominal.model)
    arm, where = nominal.fingerprint, (omega.centres, omega.radius)

    def find_inertia() -> Numbers:
        lightness, heaviness = largest(omega, objectives, INERTIA)
        if not lightness > 0.0:
            raise ScenarioError(_nowhere(omega, sigma_min, uncertainty, observer))
        return 1.0 / (MARGIN * lightness), MARGIN * heaviness

    def steepest(rate: Callable[[np.ndarray], np.ndarray]) -> float:
        return MARGIN * largest(Omega(*where), lambda places: (ObjectiveValues.uncut(rate(places.q)),), OTHERS)[0]

    def find_lipschitz() -> Numbers:
        return tuple(steepest(rate) for rate in (steepness.k_M, steepness.k_Cq, steepness.k_G))

    def find_rates() -> Numbers:
        found = largest(
            Omega(*where), lambda p: tuple(ObjectiveValues.uncut(k) for k in steepness.links(p.q).T), OTHERS
        )
        return tuple(MARGIN * k for k in found)

    seen = ("inertia", arm, observer.fingerprint, *where, omega.span, sigma_min, repr(uncertainty))
    k_r_low, k_r_high = memory.recall(key_of(*seen), 2, find_inertia)
    (k_C,) = memory.recall(key_of("k_C", arm, *where), 1, lambda: (steepest(steepness.k_C),))
    lipschitz = None
    if along_reference:
        _require_ways(omega)
        lipschitz = Lipschitz(k_C, *memory.recall(key_of("lipschitz", arm, *where), 3, find_lipschitz))
    in_doubt = uncertainty.rho_centre > 0.0 or uncertainty.rho_shape > 0.0
    rates = LinkRates(*memory.recall(key_of("rates", arm, *where), 3, find_rates)) if in_doubt else NO_RATES
    return Constants(k_r_low, k_r_high, k_C, lipschitz, rates, omega, instants)


def _require_ways(omega: Omega) -> None:
    """Raise ScenarioError where `Omega.way` would lead out of Omega between two centres that follow each other."""
    gap = float(np.linalg.norm(np.diff(omega.centres, axis=0), axis=1).max())
    if gap > 2.0 * omega.radius:
        raise ScenarioError(
            f"controller.estimates: 'along-reference', with postures of the reference that are {gap:.3g} rad apart, "
            f"more than the width of Omega, {2.0 * omega.radius:.3g} rad; allowed: 'online', a larger "
            "simulation.domain_radius, a shorter simulation.duration, or a robot.posture nearer to the path"
        )


def without_inertia(uncertainty: Uncertainty) -> str:
    """Dotted path of the declared bound of the links that can leave an arm without inertia. Masses and rotors, which
    are known within less than 1, always leave some."""
    return "declared.link_centre" if uncertainty.rho_centre > 0.0 else "declared.link_shape"


def _nowhere(omega: Omega, sigma_min: float, uncertainty: Uncertainty, observer: Observer) -> str:
    """Sentence on an Omega in which no place has the inertia that Property 1 needs."""
    certain = uncertainty._replace(rho=0.0, rho_rotor=0.0, rho_centre=0.0, rho_shape=0.0)
    lightness, _ = _inertia_objectives(sigma_min, certain, observer)(omega.places(INERTIA.draws))
    if (lightness.room >= 0.0).any():
        return (
            f"{without_inertia(uncertainty)}: with the other declared errors of the links, their bound E would leave "
            "some arm no inertia (k_r′ ≤ 0); allowed: a smaller link_centre, link_shape or link_scaling"
        )
    return "robot.posture: J_q is singular around it; allowed: a posture away from singularities"


def _inertia_objectives(sigma_min: float, uncertainty: Uncertainty, observer: Observer) -> Objectives:
    """Objectives for 1/lambda_min(H_low) and lambda_max(H_high), for the whole declared set."""

    def values(places: Places) -> tuple[ObjectiveValues, ObjectiveValues]:
        seen = observer.at_rest(*places)
        inertia, J_inv = InertiaRange.over(uncertainty, seen["estimate"], seen["task"]), seen["task"]["J_q_inv"]
        matrices = np.array([inertia.H_low, inertia.H_high, J_inv.swapaxes(1, 2) @ J_inv])
        known = np.all(np.isfinite(matrices), axis=(0, 2, 3))
        eigenvalues = np.linalg.eigvalsh(np.where(known[:, None, None], matrices, np.eye(places.q.shape[1])))
        low, high, sigma = eigenvalues[0, :, 0], eigenvalues[1, :, -1], 1.0 / np.sqrt(eigenvalues[2, :, -1])
        inside = known & (low > 0.0)
        room = sigma / sigma_min - 1.0 if sigma_min > 0.0 else np.full(len(low), np.inf)
        room = np.where(inside, room, -1.0)
        lightness = np.divide(1.0, low, out=np.zeros_like(low), where=inside)
        return ObjectiveValues(lightness, room), ObjectiveValues(np.where(inside, high, 0.0), room)

    return values


def mobility_over(
    omega: Omega, model: pin.Model, surfaces: Sequence[Surface], nominal: NominalModel, memory: Memory
) -> Mobility:
    """Largest mobility over Omega of an arm with this model, along and across any of the surfaces, also near
    singularities."""
    data = model.createData()

    def values(places: Places) -> tuple[ObjectiveValues, ...]:
        tool = nominal.at_rest(places.q)
        normals = [[each.chart(p, t).G[0] for each in surfaces] for p, t in zip(tool["p"], places.t, strict=True)]
        M = np.array([pin.crba(model, data, q) for q in places.q])
        return tuple(ObjectiveValues.uncut(each) for each in mobilities(M, tool["J_v"], np.array(normals)).T)

    def find() -> Numbers:
        return tuple(MARGIN * value for value in largest(omega, values, OTHERS))

    saved = nominal.saved if model is nominal.model else model.saveToString()
    known = (saved, nominal.fingerprint, *(each.fingerprint for each in surfaces))
    key = key_of("mobility", *known, omega.centres, omega.radius, omega.span)
    return Mobility(*memory.recall(key, 3, find))
