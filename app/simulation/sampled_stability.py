"""What one control period makes of a small deviation from rest, with the torque held: the sampled closed loop's matrix.

Theorem 1 is about continuous time. The law acts on samples: over a period its torque is constant while the arm moves
and the surface's force changes. (9), (10), (15), (16), the force sensor, and the arm against its surface, all
linearised at rest at one posture, make a matrix of that; the arm's part is exact, a matrix exponential. The loop
contracts where the matrix has its spectral radius below 1, and its eigenvalues are the poles that the target model
really gets, `docs/theory.md`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.linalg import expm
from scipy.optimize import linear_sum_assignment

from app.simulation.system import System
from controllers.bounds import Equivalent, RequiredGain, required_gain
from controllers.force_loop import force_loop_factor
from controllers.nominal_model import ON_LINE, Estimate
from controllers.premises import Premise
from controllers.switching import Switching
from controllers.target_model import TargetModel
from controllers.task_space import TaskSpace
from controllers.vsmrc import Law
from environments.stiffness import ROUNDING

LONGEST_LINE = 100  # periods of delay, beyond which the matrix becomes too large to be judged in passing


@dataclass(frozen=True)
class Posture:
    """A posture q (n,) rad at rest at time t (s), as the sampled loop needs it. H_hat, H (n, n) kg: believed and true;
    across (n,): F_r per unit of the multiplier; d N: of the law there."""

    q: np.ndarray
    t: float
    estimate: Estimate
    task: TaskSpace
    H_hat: np.ndarray
    H: np.ndarray
    across: np.ndarray
    d: float

    @classmethod
    def of(cls, system: System, q: np.ndarray, t: float) -> Posture:
        """Of the system's arm, at rest on the surface. Raises ValueError where J_q is exactly singular."""
        estimate, task = system.observe(q, np.zeros_like(q), t)
        J_inv = task.J_q_inv
        M = pin.crba(system.plant.model, system.plant.model.createData(), q)
        law = system.law
        d = sum(_needed(system, estimate, task)) + law.epsilon if law.d is None else law.d
        across = J_inv.T @ (estimate.J_v.T @ system.surface.chart(estimate.p, t).G[0])
        return cls(
            q, t, estimate, task, J_inv.T @ estimate.M_hat @ J_inv, J_inv.T @ M @ J_inv, across, float(d)
        )  # fmt: skip


def _needed(system: System, estimate: Estimate, task: TaskSpace, r_eq_ddot: np.ndarray | None = None) -> RequiredGain:
    """(17) but for its epsilon where all errors and all rates of the reference are zero, or for another r_eq_ddot."""
    still = np.zeros(system.layout.n)
    q_eq_dot = -task.J_q_inv @ task.v_t
    asked = still if r_eq_ddot is None else r_eq_ddot
    q_eq_ddot = task.J_q_inv @ (asked - task.J_q_dot @ q_eq_dot - task.v_t_dot)
    at_rest = Equivalent(still, asked, q_eq_dot, q_eq_ddot)
    return required_gain(system.law.bounds, system.law.uncertainty, ON_LINE, estimate, task, still, at_rest)


@dataclass(frozen=True)
class SampledLoop:
    """The loop at one posture. model (k,) 1/s: poles of (8) against the true contact; sampled (k,) 1/s: what each of
    them has become, none where nothing is judged; force_factor: what one sample makes of an error in the force of a
    rigid or heavy surface, nan without one."""

    model: np.ndarray
    sampled: np.ndarray
    force_factor: float


@dataclass(frozen=True)
class Oscillation:
    """A pole of the target model, with its conjugate, by natural frequency (1/s) and damping ratio, and what the
    sampled loop makes of it; count: how many poles of the model are alike."""

    omega: float
    zeta: float
    sampled_omega: float
    sampled_zeta: float
    count: int


def oscillations(loop: SampledLoop) -> list[Oscillation]:
    """The poles on and above the real axis, fastest first; of those that are alike the one that is damped least."""
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


NO_POLES = np.zeros(0, dtype=complex)


def sampled_loop(system: System, q: np.ndarray, t: float) -> SampledLoop:
    """The loop in contact, if the scenario has a contact, otherwise in free motion, at the posture q (n,) rad at time
    t (s)."""
    try:
        at = Posture.of(system, q, t)
    except ValueError:  # J_q is singular: `Premise.REGULAR` says so
        return SampledLoop(NO_POLES, NO_POLES, math.nan)
    factor = force_factor(system, at)
    if not _judged(system):
        return SampledLoop(NO_POLES, NO_POLES, factor)
    values = np.linalg.eigvals(period_matrix(system, at, _late(system)))
    moving = values[np.abs(values) > 1e-9].astype(complex)  # a reading that is passed on has no pole of its own
    poles, model = np.log(moving) / system.scenario.controller.period, model_poles(system, at)
    apart = np.abs(model[:, None] - poles[None, :]) / np.maximum(np.abs(model), 1e-6)[:, None]
    rows, columns = linear_sum_assignment(apart)
    return SampledLoop(model[rows], poles[columns], factor)


def growth(system: System, at: Posture) -> float:
    """Of a deviation per control period, in contact and, where the arm may leave the surface, off it; nan where it is
    not judged."""
    if not _judged(system):
        return math.nan
    loops = [period_matrix(system, at, _late(system))]
    if not system.mode.on_surface and system.plant.kind != "free":
        loops.append(period_matrix(system, at, _late(system), touching=False))
    return max(float(np.abs(np.linalg.eigvals(loop)).max()) for loop in loops)


def _late(system: System) -> int:
    """Periods by which the sensor's reading is."""
    return round(system.sensor.delay / system.sensor.period)


def _judged(system: System) -> bool:
    """Not under the discontinuous law, which chatters in any case and has no linear part, nor with a very long delay of
    the sensor."""
    law = system.law
    chatters = law.law is Law.VSMRC and law.switching is Switching.DISCONTINUOUS
    return not chatters and _late(system) <= LONGEST_LINE


def model_poles(system: System, at: Posture) -> np.ndarray:
    """Poles (k,) 1/s of (8) against the true contact, as far as the arm can move."""
    model, contact, kind, a = system.law.model, system.plant.contact, system.plant.kind, at.across
    basis = _free_directions(system, at)
    felt = model.K_f @ np.outer(system.law.controlled * a, a)
    springy, heavy = kind in ("elastic", "mass-damper-spring"), kind == "mass-damper-spring"
    M = basis.T @ (model.M_m + felt * (contact.M_e if heavy else 0.0)) @ basis
    B = basis.T @ (model.B_m + felt * (contact.B_e if springy else 0.0)) @ basis
    K = basis.T @ (model.K_m + felt * (contact.K_e if springy else 0.0)) @ basis
    return TargetModel(M, B, K, np.zeros_like(M)).poles()


def period_matrix(system: System, at: Posture, late: int, *, touching: bool = True) -> np.ndarray:
    """What one control period makes of (x, v, z, line): deviations of r, r_dot and z, and the sensor's readings, the
    newest first, of which the law gets the one `late` periods old.

    An elastic surface is read at the period's beginning. The force on a heavy one depends on the torque: what is read
    then is the force that acted until then.
    """
    scenario, law, n = system.scenario, system.law, system.layout.n
    period, heavy = scenario.controller.period, system.plant.heavy and touching
    basis = _free_directions(system, at)
    k, length = basis.shape[1], late + 1
    size = 2 * k + n + length
    unit = np.eye(size)
    x, v, z, line = basis @ unit[:k], basis @ unit[k : 2 * k], unit[2 * k : 2 * k + n], unit[2 * k + n :]
    arm = _HeldArm.of(system, at, basis, touching=touching)
    cutoff = scenario.sensor.cutoff
    passed = 1.0 - np.exp(-2 * np.pi * cutoff * period) if cutoff > 0.0 else 1.0

    def read_on(line: np.ndarray, force: np.ndarray) -> np.ndarray:
        return np.vstack([line[:1] + passed * (force - line[:1]), line[:-1]])

    if not heavy:
        line = read_on(line, arm.force(x, v, np.zeros((n, size))))
    read = _own_force(system, at, arm, x, v, z) if heavy and scenario.sensor.ideal else line[late]
    torque, z_dot = _law(system, at, x, v, z, read)
    x_next, v_next = arm.after(x, v, torque)
    if heavy:
        line = read_on(line, arm.force(x_next, v_next, torque))
    z_next = z + period * z_dot if law.law is Law.VSMRC else 0.0 * z  # it takes no part in the others
    return np.vstack([basis.T @ x_next, basis.T @ v_next, z_next, line])


def _free_directions(system: System, at: Posture) -> np.ndarray:
    """Orthonormal (n, k): the directions in which the arm can move; a rigid surface takes one."""
    n = system.layout.n
    if system.plant.kind != "rigid":
        return np.eye(n)
    return np.linalg.qr(np.column_stack([at.across, np.eye(n)]))[0][:, 1:n]


def _law(
    system: System, at: Posture, x: np.ndarray, v: np.ndarray, z: np.ndarray, read: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """T_r and z_dot, linear in the state."""
    law, c = system.law, system.law.compensator
    F_r = np.outer(at.across, read)
    F_c = law.controlled[:, None] * F_r
    z_dot = c.A @ z + c.K_pz @ x + c.K_vz @ v + c.K_fz @ F_c
    if law.law is Law.VSMRC:
        robust = law.K_s + at.d / law.phi * np.eye(len(x))
        s = v + c.F_1 @ x + c.F_2 @ z
        return at.H_hat @ (-c.F_1 @ v - c.F_2 @ z_dot) + F_r - robust @ s, z_dot
    restoring = law.model.B_m @ v + law.model.K_m @ x
    if law.law is Law.PD_GRAVITY:
        return -restoring, z_dot
    return F_r - at.H_hat @ np.linalg.solve(law.model.M_m, restoring + law.model.K_f @ F_c), z_dot


@dataclass(frozen=True)
class _HeldArm:
    """The arm against its surface over one period under a constant T_r. advance: the exact exponential of its
    equations, with the torque as a further state; of_state, of_torque: what makes up the multiplier."""

    n: int
    advance: np.ndarray
    of_state: np.ndarray
    of_torque: np.ndarray

    @classmethod
    def of(cls, system: System, at: Posture, basis: np.ndarray, *, touching: bool) -> _HeldArm:
        contact, n, a = system.plant.contact, system.layout.n, at.across
        kind = system.plant.kind if touching else "free"
        springy = kind in ("elastic", "mass-damper-spring")
        K, B = (contact.K_e, contact.B_e) if springy else (0.0, 0.0)
        M_e = contact.M_e if kind == "mass-damper-spring" else 0.0
        if kind == "rigid":
            mobility = basis @ np.linalg.inv(basis.T @ at.H @ basis) @ basis.T
        else:
            mobility = np.linalg.inv(at.H + M_e * np.outer(a, a))
        spring = np.concatenate([K * a, B * a])
        rates = np.zeros((3 * n, 3 * n))
        rates[:n, n : 2 * n] = np.eye(n)
        rates[n : 2 * n] = np.hstack([-mobility @ np.outer(a, spring), mobility])
        if kind == "rigid":
            Y = np.linalg.solve(at.H, a)
            of_state, of_torque = np.zeros(2 * n), Y / (Y @ a)
        else:
            pushed = M_e * a @ rates[n : 2 * n]  # by the surface's own mass
            of_state, of_torque = spring + pushed[: 2 * n], pushed[2 * n :]
        return cls(n, expm(rates * system.scenario.controller.period), of_state, of_torque)

    def after(self, x: np.ndarray, v: np.ndarray, torque: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """x and v at the end of the period."""
        end = self.advance @ np.vstack([x, v, torque])
        return end[: self.n], end[self.n : 2 * self.n]

    def force(self, x: np.ndarray, v: np.ndarray, torque: np.ndarray) -> np.ndarray:
        """The multiplier under this torque."""
        return self.of_state @ np.vstack([x, v]) + self.of_torque @ torque


def _own_force(system: System, at: Posture, arm: _HeldArm, x: np.ndarray, v: np.ndarray, z: np.ndarray) -> np.ndarray:
    """The reading of an ideal sensor: the multiplier that the law's own answer to it causes."""
    zero, one = np.zeros(x.shape[1]), np.ones(1)
    alone = arm.force(x, v, _law(system, at, x, v, z, zero)[0])
    none = np.zeros((len(x), 1))
    slope = float(arm.force(none, none, _law(system, at, none, none, none, one)[0])[0])
    return alone / (1.0 - slope)


def force_factor(system: System, at: Posture) -> float:
    """See `controllers.force_loop`; nan where no force is fed back through a loop that sampling closes."""
    if not system.plant.heavy or system.scenario.sensor.ideal or system.law.law is Law.PD_GRAVITY:
        return math.nan
    felt = system.law.controlled * at.across
    return force_loop_factor(at.H_hat, at.H_hat, system.law.model, at.across, felt, _surface_mass(system))


def _surface_mass(system: System) -> float:
    return math.inf if system.plant.kind == "rigid" else system.plant.contact.M_e


def gain_by_force(system: System, at: Posture) -> tuple[float, float]:
    """Of a change in the force on a rigid or heavy surface, the share that d by (17) gives back when the loop through
    the force is solved, and what d adds to `force_factor`; nan and 0 where d does not depend on the force."""
    law = system.law
    if not system.plant.heavy or law.d is not None or law.law is not Law.VSMRC:
        return math.nan, 0.0
    M_e, Y = _surface_mass(system), np.linalg.solve(at.H_hat, at.across)
    asked = np.linalg.solve(law.model.M_m, law.model.K_f @ (law.controlled * at.across))
    pulled, back = float(np.linalg.norm(Y)) * _slope_of_gain(system, at, asked), float(at.across @ asked)
    if math.isinf(M_e):
        return (pulled / back if back > 0.0 else math.inf), pulled / float(Y @ at.across)
    return M_e * pulled / (1.0 + M_e * back), M_e * pulled / (1.0 + M_e * float(Y @ at.across))


def _slope_of_gain(system: System, at: Posture, r_eq_ddot: np.ndarray) -> float:
    """By how much d by (17) can change, at most, per unit of r_eq_ddot's change in this direction, N."""
    still = np.zeros_like(r_eq_ddot)
    rest = at.task._replace(v_t=still, v_t_dot=still)
    without, with_it = _needed(system, at.estimate, rest), _needed(system, at.estimate, rest, r_eq_ddot)
    return float(with_it.inertia - without.inertia)


def judge_posture(system: System, q: np.ndarray, t: float) -> dict[Premise, float]:
    """Values of the premises about the sampled loops at the posture q (n,) rad at time t (s); nan where one does not
    apply. Raises ValueError or LinAlgError where J_q is singular."""
    at = Posture.of(system, q, t)
    given_back, added = gain_by_force(system, at)
    return {
        Premise.FORCE_LOOP: abs(force_factor(system, at)) + added,
        Premise.GAIN_BY_FORCE: given_back,
        Premise.SAMPLED_LOOP: growth(system, at) - ROUNDING,
    }
