"""Jacobian of one control period at rest, by central differences through law, sensor and plant; see
`docs/theory.md`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from app.simulation.builders.environment_builder import face_axes
from app.simulation.period.controlled_arm import ControlledArm
from app.simulation.period.planned_reference import Planned
from app.simulation.signals import Row
from app.simulation.state import State
from app.simulation.system import System
from controllers.nominal_model import Estimate
from controllers.reference_estimates import FeedforwardModel
from controllers.task_space import TaskSpace
from environments.push import TimedPush
from environments.sensors import ForceReader
from kernels.records import Record

STEP, FORCE_STEP = 1e-3, 1e-3  # steps of the differences: in boundary layers, and N
NO_PUSH = TimedPush(np.zeros(3), 0.0, 0.0)
NO_WRENCH = np.zeros(6)


class PeriodResult(NamedTuple):
    """Result of one control period.
    state: (k,), q, q_dot and the rest of the state that the next period depends on.
    reading: (6,) N and N m, of the force sensor.
    load: (3,) N, multipliers at the period's beginning."""

    state: np.ndarray
    reading: np.ndarray
    load: np.ndarray


class Linearisation(NamedTuple):
    """Linear map of small deviations over one control period.
    A: (k, k), Jacobian of the state.
    C: (r, k), Jacobian of the sensor's reading in the period.
    load: (3, k), Jacobian of the multipliers at the period's beginning."""

    A: np.ndarray
    C: np.ndarray
    load: np.ndarray


@dataclass(frozen=True)
class Posture:
    """A posture q (n,) rad at rest at time t (s), as the sampled loop needs it.
    H_hat: (n, n) kg.
    normals: (k, 3), grad(phi) of each of k surfaces.
    across: (n, k), F_r per unit of the multiplier of each; turning: (n, j), of each moment of a flat
    face, 1/m, none of a point."""

    q: np.ndarray
    t: float
    estimate: Estimate
    task: TaskSpace
    H_hat: np.ndarray
    normals: np.ndarray
    across: np.ndarray
    turning: np.ndarray

    @classmethod
    def of(cls, system: System, q: np.ndarray, t: float) -> Posture:
        """Posture of the system's arm, at rest on the surface. Raises ValueError where J_q is exactly singular."""
        estimate, task = system.observe(q, np.zeros_like(q), t)
        J_inv = task.J_q_inv
        normals = np.array([each.chart(estimate.p, t).G[0] for each in system.surfaces])
        across = J_inv.T @ (estimate.J_v.T @ normals.T)
        turning = np.zeros((len(q), 0))
        if system.plant.face.flat:
            axes = estimate.R @ face_axes(system.scenario).T
            turning = J_inv.T @ (estimate.J_w.T @ np.cross(axes, normals[:1].T, axis=0))
        return cls(q, t, estimate, task, J_inv.T @ estimate.M_hat @ J_inv, normals, across, turning)


def free_directions(system: System, at: Posture) -> np.ndarray:
    """Orthonormal directions (n, k) in which the arm can move; each rigid surface takes one away."""
    n = system.layout.n
    if not system.plant.nature.rigid:
        return np.eye(n)
    return np.linalg.qr(np.column_stack([at.across, np.eye(n)]))[0][:, at.across.shape[1] : n]


def curved_surfaces(system: System) -> list[int]:
    """Numbers of the pressed surfaces that turn under a tool which touches with a point."""
    pressed = () if system.layout.tilts else system.surfaces[: system.pressed]
    return [i for i, surface in enumerate(pressed) if not surface.form.normal_fixed]


class PeriodMap:
    """Map of one control period around rest at a posture, with s = 0: small deviations and a push on the tool in, the
    deviations one period later out. The arm has nothing with a kink (see `Plant.smooth`), and the reference stays at
    its present place.

    Deviations x: of the arm along the directions in which it can move and of their rates, in task coordinates, m and
    m/s; of z (m/s) under a law that reads it, and of a law's own state; of the next readings of the force sensor, N:
    the load of a heavy contact from the period before, and the delayed readings.

    touched: numbers of the surfaces that are touched, None for all.
    moments: whether the readings of a tool whose contact is a point have the moments of a push, too.
    """

    def __init__(
        self, system: System, at: Posture, touched: Sequence[int] | None = None, *, moments: bool = False
    ) -> None:
        self._felt = 6 if moments or system.plant.face.flat else 3  # entries of a reading
        touched = range(len(system.surfaces)) if touched is None else touched
        self._observer = system.observer
        self._loaded = [i for i in curved_surfaces(system) if i in touched]
        self._unilateral = [each.unilateral for each in system.plant.contacts]
        self._still = still = replace(
            system,
            plant=system.plant.smooth(touched),
            sensor=(system.sensor if moments else system.contact_sensor).steady(),
            push=NO_PUSH,
            blend=None,
        )
        self._state = state = State.at(still, at.q, np.zeros_like(at.q), at.t)
        self._arm, self._row = ControlledArm(still, state), Record.zeros(Row, system.layout.n).data
        self._arm.settings.data["online"] = system.scenario.controller.estimates == "online"
        self._blank, controller = state.evaluation.copy(), system.controller
        self._parts = [state.arm.views.q, state.arm.views.q_dot]
        if controller.law.compensated:
            self._parts.append(state.evaluation.views.z)
        if len(state.x):
            self._parts.append(state.x)
        model = controller.model
        self._yields = np.linalg.pinv(model.K_m) @ model.K_f  # where (8) rests, per N
        self._speeds = sum(len(part) for part in self._parts[2:])
        if still.plant.nature.heavy and not system.scenario.sensor.ideal:
            self._parts.append(state.arm.views.load.wrench[:3])
        self.rest_at(at)

    def rest_at(self, at: Posture) -> None:
        """Take the deviations from rest at another posture from now on."""
        system, state, controller, n = self._still, self._state, self._still.controller, len(at.q)
        task, basis = at.task, free_directions(system, at)
        q_dot = -task.J_q_inv @ task.v_t
        # a surface that only pushes is touched at least: a pull has a stiffness of its own on a curved surface
        force = self._desired_force(at.t)
        system.plant.press(at.estimate.p, at.t, self._unilateral, force)
        state.arm.take(system.plant.start(at.q, q_dot, at.t))
        if system.plant.nature.rigid:
            state.arm.views.load.multiplier[: len(force)] = force
            state.arm.views.load.wrench[:3] = at.normals.T @ force
        load = state.arm.read().load
        met = load.multiplier.copy()
        felt = at.across @ met[: len(system.surfaces)]
        felt += task.J_q_inv.T @ (at.estimate.J_w.T @ load.wrench[3:])
        if system.layout.tilts:
            met = felt[: system.m]
        e_Fc = np.zeros(n) if system.m else controller.controlled * felt
        r_d = task.r + self._yields @ e_Fc
        plan = system.plan.at_rest(r_d, met)
        self._arm.settings.write("plan", plan)
        state.evaluation.take(self._blank)
        state.t, state.x[:] = at.t, 0.0
        reference = Planned(plan).at(at.t)
        seen = self._observer.at(state.arm.views.q, state.arm.views.q_dot, at.t)
        if system.scenario.controller.estimates == "along-reference":  # they do not move with q
            state.evaluation.write("feedforward", FeedforwardModel.at(seen.estimate))
        e_r, e_r_dot = seen.task.r - reference.r_d, seen.task.r_dot - reference.r_d_dot
        state.evaluation.views.z[:] = controller.compensator.without_reaching(e_r, e_r_dot)
        state.reader = ForceReader(system.sensor, system.scenario.simulation.seed)
        while not state.reader.full:
            state.reader.read(state.arm.views.load.wrench)
        self._remembers = len(self._memory) > 0
        self._base = self._vector()
        self._prepare_deviations(task.J_q_inv @ basis, basis.T @ task.J_q)

    def _desired_force(self, t: float) -> np.ndarray:
        """Desired normal force (S,) N on each curved surface that is touched, at time t (s): where the surface turns
        under the tool, the law takes a force to have the direction of a moment ago, a negative damping. On a surface
        whose normal is fixed a force makes no difference, and is left out."""
        force = np.zeros(len(self._still.surfaces))
        if self._loaded:
            force[self._loaded] = self._still.planned.at(t).F_cd[self._loaded].clip(min=0.0)
        return force

    def _prepare_deviations(self, spread: np.ndarray, gather: np.ndarray) -> None:
        """Prepare the changes (k, N) of the state by a unit of each deviation, and the matrix (k, N) from a state back
        to deviations. spread, gather: (n, f) and (f, n), those of the arm."""
        (n, f), rest = spread.shape, len(self._base) - 2 * spread.shape[0]
        count, layer = 2 * f + rest, self._still.controller.layer
        speed = STEP * (layer if layer > 0.0 else 1.0)
        self._steps = np.full(count, FORCE_STEP)
        self._steps[f : 2 * f + self._speeds] = speed
        # steps by which s stays as small: s contains F_1 e and F_2 z
        compensator = self._still.controller.compensator
        self._steps[:f] = speed / max(10.0, float(np.abs(compensator.F_1).max()))
        if self._still.controller.law.compensated:
            self._steps[2 * f : 2 * f + n] = speed / np.abs(np.diag(compensator.F_2))
        self._ways, self._gather = np.zeros((count, 2 * n + rest)), np.zeros((count, 2 * n + rest))
        self._ways[:f, :n] = self._ways[f : 2 * f, n : 2 * n] = spread.T
        self._gather[:f, :n] = self._gather[f : 2 * f, n : 2 * n] = gather
        self._ways[2 * f :, 2 * n :] = self._gather[2 * f :, 2 * n :] = np.eye(rest)

    def _vector(self) -> np.ndarray:
        """q, q_dot and the rest of the state that the next period depends on."""
        return np.concatenate([*self._parts, self._memory.ravel()] if self._remembers else self._parts)

    @property
    def keeps_moments(self) -> bool:
        """Whether all that the next period depends on is in the state under a push with a moment, too."""
        return self._felt == 6 or not self._remembers

    @property
    def _memory(self) -> np.ndarray:
        """Readings in the sensor's memory, (k, 3) or (k, 6)."""
        return self._state.reader.memory[:, : self._felt]

    def _after(self, vector: np.ndarray, added: np.ndarray = NO_WRENCH, push: TimedPush | None = None) -> PeriodResult:
        """Result of a period that begins in this state. An elastic surface pushes as soon as it is met.
        added: (6,) N and N m, added to the reading of the force sensor.
        push: on the tool, None for none."""
        state, arm = self._state, self._arm
        for part in self._parts:
            part[:], vector = vector[: len(part)], vector[len(part) :]
        if self._remembers:
            readings = np.zeros((len(vector) // self._felt, 6))
            readings[:, : self._felt] = vector.reshape(-1, self._felt)
            state.reader.recall(readings)
        self._still.plant.find_load(state.arm, state.t)
        load = state.arm.views.load.multiplier.copy()
        arm.scripted = push
        reading = arm.measure() + added
        arm.apply_law(reading, self._row)
        arm.move()
        arm.complete(self._row)
        return PeriodResult(self._vector(), reading, load)

    def jacobian(self) -> np.ndarray:
        """Jacobian (k, k) of the period."""
        return self.linearised().A

    def linearised(self) -> Linearisation:
        """Linearisation of the period, by central differences."""
        changes, readings, loads = [], [], []
        for way, step in zip(self._ways, self._steps, strict=True):
            ahead, behind = (self._after(self._base + sign * step * way) for sign in (1.0, -1.0))
            changes.append((ahead.state - behind.state) / (2.0 * step))
            readings.append((ahead.reading - behind.reading)[: self._felt] / (2.0 * step))
            loads.append((ahead.load - behind.load) / (2.0 * step))
        return Linearisation(self._gather @ np.column_stack(changes), np.column_stack(readings), np.column_stack(loads))

    def by_reading(self) -> np.ndarray:
        """Change (k, r) of the state after the period per N (N m) that is added to the reading."""
        changes = []
        for entry in range(self._felt):
            ahead, behind = (self._after(self._base, added=_one(entry, sign)).state for sign in (1.0, -1.0))
            changes.append((ahead - behind) / (2.0 * FORCE_STEP))
        return self._gather @ np.column_stack(changes)

    def by_push(self) -> np.ndarray:
        """Change (k, 6) of the state after the period per N of a push along each of the world's axes, and per N m about
        each."""
        changes = []
        for axis in range(6):
            pushes = (_one(axis, sign) for sign in (1.0, -1.0))
            timed = (TimedPush(push[:3], 0.0, math.inf, moment=push[3:]) for push in pushes)
            ahead, behind = (self._after(self._base, push=push).state for push in timed)
            changes.append((ahead - behind) / (2.0 * FORCE_STEP))
        return self._gather @ np.column_stack(changes)


def _one(entry: int, sign: float) -> np.ndarray:
    """Wrench (6,) with one entry, a step of the differences."""
    wrench = np.zeros(6)
    wrench[entry] = sign * FORCE_STEP
    return wrench
