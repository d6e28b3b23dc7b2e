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
from itertools import product

import numpy as np

from app.simulation.environment_builder import SOFTEST
from app.simulation.force_margin import ForceLoop
from app.simulation.period_map import PeriodMap, Posture, free_directions
from app.simulation.push_response import FORCE, MOMENT, PushAxis, PushResponse
from app.simulation.system import System
from controllers.bounds import Equivalent, RequiredGain, required_gain
from controllers.force_loop import LONGEST_LINE, force_loop_factors, through_sensor, with_gain
from controllers.nominal_model import ON_LINE, Estimate
from controllers.premises import Premise
from controllers.switching import Switching
from controllers.target_model import TargetModel
from controllers.task_space import TaskSpace
from environments.step_resolution import ROUNDING

NOISE = 1e-6  # of an eigenvalue
SLIPS = 36  # directions of slip on one surface: the worst one of all is missed by at most 0.4 % of friction's part


def _needed(system: System, estimate: Estimate, task: TaskSpace, r_eq_ddot: np.ndarray | None = None) -> RequiredGain:
    """Gain required by (17), without its epsilon, where all errors and all rates of the reference are zero, or for
    another r_eq_ddot."""
    still = np.zeros(system.layout.n)
    q_eq_dot = -task.J_q_inv @ task.v_t
    asked = still if r_eq_ddot is None else r_eq_ddot
    q_eq_ddot = task.J_q_inv @ (asked - task.J_q_dot @ q_eq_dot - task.v_t_dot)
    at_rest = Equivalent(still, asked, q_eq_dot, q_eq_ddot)
    controller = system.controller
    return required_gain(controller.bounds, controller.uncertainty, ON_LINE, estimate, task, still, at_rest)


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
    """A pole of the target model, with its conjugate, by natural frequency (1/s) and damping ratio, and the same of the
    sampled loop. count: number of equal poles of the model."""

    omega: float
    zeta: float
    sampled_omega: float
    sampled_zeta: float
    count: int


def oscillations(loop: RespondingLoop) -> list[Oscillation]:
    """Oscillations of the poles on and above the real axis, fastest first; of equal poles the one with the least
    damping."""
    alike: dict[tuple[float, float], list[complex]] = {}
    for model, sampled in zip(loop.model, loop.sampled, strict=True):
        if model.imag >= -1e-6 * abs(model):
            key = (float(f"{abs(model):.3g}"), round(float(-model.real / max(abs(model), 1e-12)), 3))
            alike.setdefault(key, []).append(complex(sampled))

    def damping(pole: complex) -> float:
        return -pole.real / max(abs(pole), 1e-12)

    return [
        Oscillation(omega, zeta, abs(worst), damping(worst), len(found))
        for (omega, zeta), found in sorted(alike.items(), reverse=True)
        for worst in [min(found, key=lambda pole: (damping(pole), abs(pole)))]
    ]


class SampledLoops:
    """The sampled loops of a system at its postures; what they have in common is built once."""

    def __init__(self, system: System) -> None:
        self.system = system
        self._maps: dict[tuple[bool, bool], PeriodMap] = {}  # by whether the arm touches, and whether moments are read
        self._sliding: PeriodMap | None = None

    def at(self, q: np.ndarray, t: float) -> SampledLoop:
        """The sampled loop in contact, if the scenario has a contact, otherwise in free motion, at the posture q (n,)
        rad at time t (s)."""
        system = self.system
        try:
            at = Posture.of(system, q, t)
            loads = _unit_loads(system, at)
            given_back, added = zip(*(gain_by_force(system, at, load) for load in loads), strict=True)
            force_loop, value = _worst_force_loop(system, at, loads, added)
            growth, A, C = math.nan, None, None
            if system.sensor.late > LONGEST_LINE:
                growth = math.inf if _reads_contact(system) else math.nan
            elif _chatters(system):
                growth = self._growth_while_sliding(at) if _reads_contact(system) else math.nan
            else:
                A, C = self._map(at, touching=True).linearised()
                growth = _growth(A)
                if not system.mode.on_surface and system.plant.kind.touches:  # where the arm may leave the surface
                    growth = max(growth, _growth(self._map(at, touching=False).jacobian()))
        except (ValueError, np.linalg.LinAlgError):  # J_q is singular: `Premise.REGULAR` says so
            return SampledLoop(math.nan, {}, None, None)
        premises = {
            Premise.FORCE_LOOP: value,
            Premise.GAIN_BY_FORCE: max(given_back),
            Premise.SAMPLED_LOOP: growth - ROUNDING,
        }
        return SampledLoop(force_loop, premises, A, C)

    def responding(self, loop: SampledLoop, q: np.ndarray, t: float) -> RespondingLoop:
        """The sampled loop of the posture q (n,) rad at time t (s), with its poles and responses."""
        system, force_loop = self.system, None
        if loop.A is None or loop.C is None:
            return RespondingLoop(**vars(loop), model=NO_POLES, sampled=NO_POLES, response=None, force_loop=None)
        at = Posture.of(system, q, t)
        around_rest = self._map(at, touching=True)
        model, sampled = _poles(system, at, loop.A)
        if around_rest.keeps_moments:
            response = _push_response(system, at, loop.A, around_rest.by_push())
        else:
            pushed = self._map(at, touching=True, moments=True)
            response = _push_response(system, at, pushed.jacobian(), pushed.by_push())
        if _reads_contact(system):
            force_loop = ForceLoop(system.scenario.controller.period, loop.A, around_rest.by_reading(), loop.C)
        return RespondingLoop(**vars(loop), model=model, sampled=sampled, response=response, force_loop=force_loop)

    def _growth_while_sliding(self, at: Posture) -> float:
        """Growth per control period of a deviation under the discontinuous law, on the sliding surface."""
        if self._sliding is None:
            self._sliding = PeriodMap(_kept_on_surface(self.system, at), at)
        else:
            self._sliding.rest_at(at)
        return _growth(self._sliding.jacobian())

    def _map(self, at: Posture, *, touching: bool, moments: bool = False) -> PeriodMap:
        known = self._maps.get((touching, moments))
        if known is None:
            known = PeriodMap(self.system, at, touching=touching, moments=moments)
            self._maps[touching, moments] = known
        else:
            known.rest_at(at)
        return known


def sampled_loop(system: System, q: np.ndarray, t: float) -> RespondingLoop:
    """The sampled loop of a system at one posture, see `SampledLoops.at`."""
    loops = SampledLoops(system)
    return loops.responding(loops.at(q, t), q, t)


def _growth(A: np.ndarray) -> float:
    """Growth of a deviation per control period, from its Jacobian A (k, k)."""
    return float(np.abs(np.linalg.eigvals(A)).max())


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
    return controller.law.robust and controller.switching is Switching.DISCONTINUOUS


def _kept_on_surface(system: System, at: Posture) -> System:
    """The system with a linear law that takes s away within some periods, in place of one that chatters about s = 0."""
    controller = system.controller
    K_s = HALVED * np.linalg.eigvalsh(at.H_hat)[0] / system.scenario.controller.period * np.eye(system.layout.n)
    return system.with_controller(
        replace(controller, K_s=K_s, d=np.finfo(float).tiny, switching=Switching.SATURATION, layer=1.0)
    )


def _reads_contact(system: System) -> bool:
    """Whether the law takes a sampled reading of the contact's force."""
    kind, ideal = system.plant.kind, system.scenario.sensor.ideal
    return kind.touches and system.controller.law.feels_force and not (kind.heavy and ideal)


def model_poles(system: System, at: Posture) -> np.ndarray:
    """Poles (k,) 1/s of (8) against the true contact, in the directions in which the arm can move."""
    M, B, K = _in_contact(system, at)
    return TargetModel(M, B, K, np.zeros_like(M)).poles()


def _in_contact(system: System, at: Posture) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Inertia, damping and stiffness of (8) against the true contact, in the directions in which the arm can move."""
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
    return basis.T @ M @ basis, basis.T @ B @ basis, basis.T @ K @ basis


def _push_response(system: System, at: Posture, A: np.ndarray, by_push: np.ndarray) -> PushResponse:
    """Response of the tool to a push. A (k, k), by_push (k, 6): of the control period."""
    controller, estimate, J_inv = system.controller, at.estimate, at.task.J_q_inv
    axes = _push_axes(system, at)
    wrenches = np.array([axis.wrench for axis in axes])
    basis = free_directions(system, at)
    place = wrenches @ np.vstack([estimate.J_v, estimate.J_w]) @ J_inv  # of the tool, from r
    felt = controller.model.K_f @ (controller.controlled[:, None] * place.T)
    M, D, K = _in_contact(system, at)
    C = np.zeros((len(axes), len(A)))
    C[:, : basis.shape[1]] = place @ basis
    return PushResponse(
        axes=axes,
        period=system.scenario.controller.period,
        l=system.layout.l,
        A=A,
        B=by_push @ wrenches.T,
        C=C,
        M=M,
        D=D,
        K=K,
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
        names = tuple(coordinates[i].name for i in layout.places)
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


def force_factor(system: System, at: Posture) -> float:
    """Force loop factor, see `controllers.force_loop`, with Coulomb friction in the direction of slip that makes it
    largest; nan where no force is fed back through a loop that sampling closes."""
    loads = _unit_loads(system, at)
    return _worst_force_loop(system, at, loads, (0.0,) * len(loads))[0]


def _worst_force_loop(
    system: System, at: Posture, loads: list[np.ndarray], added: tuple[float, ...]
) -> tuple[float, float]:
    """Factor of the force loop of largest size among these loads, see `_unit_loads`, and the value of its premise, with
    what d adds for each of them; nan where no force is fed back through a loop that sampling closes."""
    if not system.plant.kind.heavy or system.scenario.sensor.ideal or not system.controller.law.feels_force:
        return math.nan, math.nan
    model, masses, sensor = system.controller.model, _surface_mass(system), (system.sensor.gain, system.sensor.late)
    loops = [
        force_loop_factors(at.H_hat, at.H_hat, model, at.across, load, _felt(system, at, load), masses)
        for load in loads
    ]
    factor = through_sensor(np.concatenate(loops), *sensor)
    if not any(added):
        return factor, abs(factor)
    return factor, max(with_gain(loop, more, *sensor) for loop, more in zip(loops, added, strict=True))


def _unit_loads(system: System, at: Posture) -> list[np.ndarray]:
    """F_r (n, k) per unit of the multiplier of each of k surfaces: without Coulomb friction, and with that of a slip in
    each direction along all surfaces."""
    normals = np.array([each.chart(at.estimate.p, at.t).G[0] for each in system.surfaces])
    contacts = system.plant.contacts[: len(normals)]
    drag = [each.friction_coulomb * np.linalg.norm(row) for each, row in zip(contacts, normals, strict=True)]
    if not system.plant.kind.heavy or not any(drag):
        return [at.across]
    across_plane = [[0.0, 1.0, 0.0]] if system.layout.positions == 2 else np.zeros((0, 3))
    held = np.vstack([normals, across_plane])
    along = np.linalg.svd(held)[2][len(held) :]
    angles = np.linspace(0.0, 2 * np.pi, SLIPS, endpoint=False)
    around = {0: [], 1: [[1.0], [-1.0]], 2: np.column_stack([np.cos(angles), np.sin(angles)])}[len(along)]
    by_slip = at.task.J_q_inv.T @ at.estimate.J_v.T @ along.T
    return [at.across, *(at.across + np.outer(by_slip @ slip, drag) for slip in around)]


def _felt(system: System, at: Posture, load: np.ndarray) -> np.ndarray:
    """Part (n, k) of `load` in F_c, see `controllers.sliding.controlled_force`: friction along a surface whose force
    is controlled is not counted as its normal force."""
    felt = load.copy()
    felt[: system.controller.surfaces] = at.across[: system.controller.surfaces]
    return system.controller.controlled[:, None] * felt


def _surface_mass(system: System) -> np.ndarray:
    """Mass of the surfaces (k, k) kg, infinite on the diagonal of rigid ones."""
    k = len(system.surfaces)
    return np.diag(np.full(k, math.inf)) if system.plant.kind.rigid else system.plant.environment.M_e[:k, :k]


def gain_by_force(system: System, at: Posture, load: np.ndarray) -> tuple[float, float]:
    """Gain of the loop from the force on rigid or heavy surfaces through d by (17) back to the force, when the loop
    through the multiplier is solved; and the part that d adds to the size of the force loop's factor. nan and 0 where d
    does not depend on the force. Of several surfaces, changes of all their forces add up. load: (n, k), see
    `_unit_loads`."""
    controller = system.controller
    if not system.plant.kind.heavy or controller.d is not None or not controller.law.robust:
        return math.nan, 0.0
    masses, Y = _surface_mass(system), np.linalg.solve(at.H_hat, at.across)
    asked = np.linalg.solve(controller.model.M_m, controller.model.K_f @ _felt(system, at, load))
    slopes = np.array([_slope_of_gain(system, at, each) for each in asked.T])
    yielding, solved = (_by_acceleration(masses, back) for back in (Y.T @ load, at.across.T @ asked))
    return _largest(Y @ solved.T, slopes), _largest(Y @ yielding.T, slopes)


def worst_gain_by_force(system: System, q: np.ndarray, t: float) -> float:
    """Largest gain of `gain_by_force` over all directions of slip at the posture q (n,) rad at time t (s); nan where
    there is none, or J_q is singular."""
    if not system.plant.kind.heavy:
        return math.nan
    try:
        at = Posture.of(system, q, t)
        return max(gain_by_force(system, at, load)[0] for load in _unit_loads(system, at))
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


def _slope_of_gain(system: System, at: Posture, r_eq_ddot: np.ndarray) -> float:
    """Largest change of d by (17), N, per unit of r_eq_ddot's change in this direction."""
    still = np.zeros_like(r_eq_ddot)
    rest = at.task._replace(v_t=still, v_t_dot=still)
    without, with_it = _needed(system, at.estimate, rest), _needed(system, at.estimate, rest, r_eq_ddot)
    return float(with_it.inertia - without.inertia)
