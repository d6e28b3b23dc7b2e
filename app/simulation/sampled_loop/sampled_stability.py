"""Stability of the sampled closed loop: the matrix by which one control period, with the torque held, maps a small
deviation from rest.

Theorem 1 is about continuous time. The law acts on samples: over a period its torque is constant while the arm moves
and the surface's force changes. The period itself, law, sensor and plant with its integrator, is differentiated at rest
at one posture. The loop contracts where the matrix has its spectral radius below 1, and its eigenvalues are the poles
that the target model really gets, `docs/theory.md`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from app.simulation.sampled_loop.contact_model import model_poles
from app.simulation.sampled_loop.force_margin import ForceLoop
from app.simulation.sampled_loop.period_map import Linearisation, PeriodMap, Posture
from app.simulation.sampled_loop.push_prediction import push_response
from app.simulation.sampled_loop.push_response import PushResponse
from app.simulation.sampled_loop.sampled_force_loop import drags, gain_by_force, unit_loads, worst_force_loop
from app.simulation.system import System
from controllers.force_loop import LONGEST_DELAY
from controllers.premises import Premise
from controllers.switching import SWITCHING
from environments.step_resolution import ROUNDING

Touched = tuple[int, ...]  # numbers of the surfaces that are touched

NOISE = 1e-6  # of an eigenvalue
DRIFT = 0.1  # 1/s: a pole this slow may be a drift, as the place on a moving or curved surface has to do with it
NO_POLES = np.zeros(0, dtype=complex)
HALVED = 0.5  # of s is taken away in a period, in the direction of least inertia, where the law is kept on its surface


@dataclass(frozen=True)
class SampledLoop:
    """The sampled loop at one posture.
    force_factor: factor of one sample on an error in the force of a rigid or heavy surface, nan without one.
    premises: values of those about sampled loops, nan where one does not apply, none of them where J_q is singular.
    A, C: Jacobians of the control period (k, k), and of the sensor's reading in it (r, k); None where nothing is
    judged."""

    force_factor: float
    premises: Mapping[Premise, float]
    A: np.ndarray | None
    C: np.ndarray | None


@dataclass(frozen=True)
class RespondingLoop(SampledLoop):
    """A sampled loop with its poles and responses, which a run does not need.
    model: (k,) 1/s, poles of (8) against the true contact.
    sampled: (k,) 1/s, the pole of the sampled loop for each of them, none where nothing is judged.
    response: of the tool to a push; None where nothing is judged.
    force_loop: the loop through the reading of the force; None where nothing is judged, or no force is read that the
    arm's own motion or torque changes."""

    model: np.ndarray
    sampled: np.ndarray
    response: PushResponse | None
    force_loop: ForceLoop | None


@dataclass(frozen=True)
class Oscillation:
    """Equal poles of the target model, with their conjugates, and what the sampled loop has in their place.
    omega: 1/s, natural frequency; zeta: damping ratio; count: number of these poles.
    slowest, fastest: 1/s, range of the sampled loop's natural frequencies; least_zeta: its least damping ratio."""

    omega: float
    zeta: float
    count: int
    slowest: float
    fastest: float
    least_zeta: float


def oscillations(loop: RespondingLoop) -> list[Oscillation]:
    """Oscillations of the poles on and above the real axis, fastest first. Equal poles are sensitive: a small coupling
    in the sampled loop spreads them widely."""
    alike: dict[tuple[float, float], list[complex]] = {}
    for model, sampled in zip(loop.model, loop.sampled, strict=True):
        if model.imag >= -1e-6 * abs(model):
            key = (float(f"{abs(model):.3g}"), round(float(-model.real / max(abs(model), 1e-12)), 3))
            alike.setdefault(key, []).append(complex(sampled))

    def damping(pole: complex) -> float:
        return -pole.real / max(abs(pole), 1e-12)

    return [
        Oscillation(omega, zeta, len(found), min(map(abs, found)), max(map(abs, found)), min(map(damping, found)))
        for (omega, zeta), found in sorted(alike.items(), reverse=True)
    ]


class SampledLoops:
    """The sampled loops of a system at its postures; what they have in common is built once."""

    def __init__(self, system: System) -> None:
        self.system = system
        self._whole, *self._fewer = touched_at_once(system)
        self._maps: dict[tuple[Touched, bool], PeriodMap] = {}  # by what is touched, and whether moments are read
        self._prompt: SampledLoops | None = None
        if system.contact_sensor.late > LONGEST_DELAY and not _reads_contact(system):
            self._prompt = SampledLoops(replace(system, sensor=system.sensor.prompt()))

    def at(self, q: np.ndarray, t: float) -> SampledLoop:
        """The sampled loop in contact with all surfaces, if the scenario has a contact, otherwise in free motion, at
        the posture q (n,) rad at time t (s); its premise is about fewer surfaces, too, see `touched_at_once`."""
        system = self.system
        if self._prompt is not None:  # a reading on which the arm does not act may be as late as it likes
            return replace(self._prompt.at(q, t), A=None, C=None)
        try:
            at = Posture.of(system, q, t)
        except (ValueError, np.linalg.LinAlgError):  # J_q is singular: `Premise.REGULAR` says so
            return SampledLoop(math.nan, {}, None, None)
        try:
            loads = unit_loads(system, at)
            feedback = gain_by_force(system, at, loads)
            force_loop = worst_force_loop(system, at, loads, tuple(each.added for each in feedback))
            growth, A, C = math.nan, None, None
            if system.contact_sensor.late > LONGEST_DELAY:
                growth = math.inf
            else:
                judged = [self._judged(at, touched) for touched in (self._whole, *self._fewer)]
                growth = max(growth for _, growth in judged)
                if not _chatters(system):
                    A, C = judged[0][0].A, judged[0][0].C
        except (ValueError, np.linalg.LinAlgError):
            return SampledLoop(math.nan, {Premise.SAMPLED_LOOP: math.inf}, None, None)
        premises = {
            Premise.FORCE_LOOP: force_loop.premise,
            Premise.GAIN_BY_FORCE: max(each.gain for each in feedback),
            Premise.SAMPLED_LOOP: growth - ROUNDING,
        }
        return SampledLoop(force_loop.factor, premises, A, C)

    def responding(self, loop: SampledLoop, q: np.ndarray, t: float) -> RespondingLoop:
        """The sampled loop of the posture q (n,) rad at time t (s), with its poles and responses."""
        system, force_loop = self.system, None
        if loop.A is None or loop.C is None:
            return RespondingLoop(**vars(loop), model=NO_POLES, sampled=NO_POLES, response=None, force_loop=None)
        at = Posture.of(system, q, t)
        around_rest = self._map(at, self._whole)
        model, sampled = _poles(system, at, loop.A)
        if around_rest.keeps_moments:
            response = push_response(system, at, loop.A, around_rest.by_push())
        elif system.sensor.late > LONGEST_DELAY:
            response = None
        else:
            pushed = self._map(at, self._whole, moments=True)
            response = push_response(system, at, pushed.jacobian(), pushed.by_push())
        if _reads_contact(system):
            force_loop = ForceLoop(system.scenario.controller.period, loop.A, around_rest.by_reading(), loop.C)
        return RespondingLoop(**vars(loop), model=model, sampled=sampled, response=response, force_loop=force_loop)

    def _judged(self, at: Posture, touched: Touched) -> tuple[Linearisation, float]:
        """Linearisation of a period, and the growth per period of a deviation, on springs with Coulomb friction in the
        direction of slip that is worst: it is another part of the force that grows with the penetration. Nothing pulls
        the tool back to a face that was pressed by force alone, and left: it drifts, which is no instability."""
        around_rest, period = self._map(at, touched), self.system.scenario.controller.period
        found = around_rest.linearised()
        drifting = len(self._whole) - len(touched) if self.system.mode.on_surface else 0
        maps, slips = [found.A], [] if self.system.plant.nature.heavy else drags(self.system, at, touched)
        if slips:
            by_push, k = around_rest.by_push()[:, :3], len(self.system.surfaces)
            maps += [found.A - by_push @ drag @ found.load[:k] for drag in slips]
        return found, max(_growth(A, drifting, DRIFT * period) for A in maps)

    def _map(self, at: Posture, touched: Touched, *, moments: bool = False) -> PeriodMap:
        """Map of a period; under the discontinuous law, on the sliding surface."""
        known = self._maps.get((touched, moments))
        if known is None:
            system = _kept_on_surface(self.system, at) if _chatters(self.system) else self.system
            known = self._maps[touched, moments] = PeriodMap(system, at, touched, moments=moments)
        else:
            known.rest_at(at)
        return known


def touched_at_once(system: System) -> list[Touched]:
    """Choices of surfaces that the tool may touch at once, all of them first: springs that only push may be left in
    each choice, but in a mode that keeps the tool on surfaces not all of them."""
    whole, contacts = tuple(range(len(system.surfaces))), system.plant.contacts
    if not system.plant.nature.springs:
        return [whole]
    kept = {i for i in whole if not contacts[i].unilateral}
    sizes = range(1 if system.mode.on_surface else 0, len(whole))
    return [whole, *(few for size in sizes for few in combinations(whole, size) if kept <= {*few})]


def sampled_loop(system: System, q: np.ndarray, t: float) -> RespondingLoop:
    """The sampled loop of a system at one posture, see `SampledLoops.at`."""
    loops = SampledLoops(system)
    return loops.responding(loops.at(q, t), q, t)


def _growth(A: np.ndarray, drifting: int, near: float) -> float:
    """Growth of a deviation per control period, from its Jacobian A (k, k). drifting: number of eigenvalues that are
    left out where they are this near to 1."""
    values = np.linalg.eigvals(A)
    away = np.abs(values - 1.0)
    drifts = [i for i in np.argsort(away)[:drifting] if away[i] < near]
    return float(np.abs(np.delete(values, drifts)).max())


def _poles(system: System, at: Posture, A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Poles of the model, and those of the sampled loop with the Jacobian A (k, k) of its period."""
    from scipy.optimize import linear_sum_assignment  # takes 0.1 s: a run without a page does not wait for it

    values = np.linalg.eigvals(A).astype(complex)
    moving = values[np.abs(values) > NOISE]  # a delayed reading has no pole of its own
    poles, model = np.log(moving) / system.scenario.controller.period, model_poles(system, at)
    apart = np.abs(model[:, None] - poles[None, :]) / np.maximum(np.abs(model), 1e-6)[:, None]
    rows, columns = linear_sum_assignment(apart)
    return model[rows], poles[columns]


def _chatters(system: System) -> bool:
    """Whether the law is the discontinuous one: it has no linear part, but the motion on its sliding surface has."""
    controller = system.controller
    return controller.law.robust and not controller.has_layer


def _kept_on_surface(system: System, at: Posture) -> System:
    """The system with a linear law that drives s to zero within a few periods, to linearise a discontinuous one."""
    controller = system.controller
    K_s = HALVED * np.linalg.eigvalsh(at.H_hat)[0] / system.scenario.controller.period * np.eye(system.layout.n)
    smooth = next(each for each in SWITCHING.values() if each.has_layer)
    return system.with_controller(replace(controller, K_s=K_s, d=np.finfo(float).tiny, switching=smooth, layer=1.0))


def _reads_contact(system: System) -> bool:
    """Whether the law takes a sampled reading of the contact's force."""
    nature, ideal = system.plant.nature, system.scenario.sensor.ideal
    return nature.touches and system.controller.law.feels_force and not (nature.heavy and ideal)
