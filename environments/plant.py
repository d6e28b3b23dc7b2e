"""The true arm in its world, (2): its masses, payload, friction and disturbance are what the controller never sees."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
import pinocchio as pin
from numba import njit

from environments.contact import Contact, Load, Touch, World, elastic_load, heavy_multiplier, touch_at
from environments.held import hold
from environments.robots import Robot
from environments.surfaces import Surface

ContactKind = Literal["free", "elastic", "mass-damper-spring", "rigid"]
Integrator = Literal["semi-implicit-euler", "rk4"]
NO_BIAS = np.zeros(3)  # where phi_ddot is not asked for
SLIP_RATE = 0.01  # rad/s, the smooth transition of Coulomb friction in the joints


@dataclass(frozen=True)
class Truth:
    """How the true arm differs from the nominal one.

    link_scaling (n,): factor on each link's inertia; payload_mass kg, a point at payload_offset (3,) m in the tool
    frame; coulomb N m and viscous N m s/rad per joint; disturbance: a torque of this norm (N m) turning through the
    joints with disturbance_frequency Hz.
    """

    link_scaling: np.ndarray
    payload_mass: float
    payload_offset: np.ndarray
    coulomb: float
    viscous: float
    disturbance: float
    disturbance_frequency: float

    def model(self, robot: Robot) -> pin.Model:
        """Pinocchio's model of the true arm."""
        model = robot.model.copy()
        for joint, alpha in enumerate(self.link_scaling, start=1):
            link = model.inertias[joint]
            model.inertias[joint] = pin.Inertia(alpha * link.mass, link.lever, alpha * link.inertia)
        if self.payload_mass > 0.0:
            load = pin.Inertia(self.payload_mass, self.payload_offset, np.zeros((3, 3)))
            model.appendBodyToJoint(robot.tool_joint, load, robot.tool_placement)
        return model

    def torque(self, q_dot: np.ndarray, t: float) -> np.ndarray:
        """Joint friction plus disturbance, (n,) N m, on the left side of (2)."""
        total = np.zeros_like(q_dot)
        if self.coulomb > 0.0:
            total += self.coulomb * np.tanh(q_dot / SLIP_RATE)
        if self.viscous > 0.0:
            total += self.viscous * q_dot
        if self.disturbance > 0.0:
            n = len(q_dot)
            phase = 2 * np.pi * (self.disturbance_frequency * t + np.arange(n) / n)
            wave = np.sin(phase)
            total += self.disturbance * wave / max(np.linalg.norm(wave), 1.0)
        return total

    @cached_property
    def silent(self) -> bool:
        """Whether there is neither friction nor disturbance in the joints."""
        return self.coulomb == 0.0 and self.viscous == 0.0 and self.disturbance == 0.0


class PlantState(NamedTuple):
    """q (n,), q_dot (n,) and the contact's `Load` there; q_ddot (n,) at the beginning of the period that led here.
    With a rigid or heavy environment the load is that of the last substep, since it depends on the torque."""

    q: np.ndarray
    q_dot: np.ndarray
    load: Load
    q_ddot: np.ndarray


class Acceleration(NamedTuple):
    """q_ddot (n,) under a torque, with the contact's load that goes with it."""

    q_ddot: np.ndarray
    load: Load


@njit(cache=True, error_model="numpy")
def _euler(q, q_dot, q_ddot, h):
    q_dot_after = q_dot + h * q_ddot
    return q + h * q_dot_after, q_dot_after


class Plant:
    """M q_ddot + C q_dot + G + J^T F + f = tau, integrated with tau held over each control period.

    heavy: the contact force depends on the torque, as on rigid surfaces and those with a mass.
    """

    def __init__(
        self,
        robot: Robot,
        truth: Truth,
        surface: Surface,
        kind: ContactKind,
        contact: Contact,
        integrator: Integrator = "semi-implicit-euler",
        substeps: int = 1,
    ) -> None:
        self.truth, self.surface, self.kind, self.contact = truth, surface, kind, contact
        self.heavy = kind in ("mass-damper-spring", "rigid")
        self.substeps = substeps
        self.model = truth.model(robot)
        self.data = self.model.createData()
        self._joint = robot.tool_joint
        self._placement = robot.tool_placement
        # live views: Pinocchio fills them at every call
        carrier = self.data.oMi[robot.tool_joint]
        lever = np.array(robot.tool_placement.translation)
        self._held = hold(World(self.data.J, carrier.rotation, carrier.translation, lever, surface.shape, contact))
        self._no_load = Load(np.zeros(3), np.zeros(robot.n), 0.0, 0.0)
        self._integrate = {"semi-implicit-euler": self._semi_implicit_euler, "rk4": self._rk4}[integrator]

    def start(self, q: np.ndarray, q_dot: np.ndarray, t: float) -> PlantState:
        """The state q (n,), q_dot (n,) at time t; on a rigid surface it is moved onto it.

        Raises ValueError when the rigid surface cannot be reached from q.
        """
        q, q_dot = self._constrained(q, q_dot, t)
        return PlantState(q, q_dot, self._load(q, q_dot, t), np.zeros_like(q))

    def advance(self, state: PlantState, tau: np.ndarray, t: float, period: float) -> PlantState:
        """One control period from time t with the torque tau (n,) N m."""
        h = period / self.substeps
        q, q_dot, load = state.q, state.q_dot, state.load
        first: Acceleration | None = None
        for i in range(self.substeps):
            q, q_dot, at = self._integrate(q, q_dot, load, tau, t + i * h, h)
            after = self._load(q, q_dot, t + (i + 1) * h)
            load = at.load._replace(phi=after.phi) if self.heavy else after
            first = first or at
        assert first is not None
        return PlantState(q, q_dot, load, first.q_ddot)

    def respond(self, state: PlantState, tau: np.ndarray, t: float) -> Load:
        """The contact's load that the torque tau (n,) N m causes at a state, without going on."""
        return self._acceleration(state.q, state.q_dot, state.load, tau, t).load

    def force_of(self, state: PlantState, multiplier: float, t: float) -> np.ndarray:
        """Force (3,) N of the tool on the environment when the multiplier of a heavy contact is the given one."""
        at, _ = self._touch(state.q, state.q_dot, t)
        return multiplier * at.normal + abs(multiplier) * at.drag + self._viscous(at)

    def _load(self, q: np.ndarray, q_dot: np.ndarray, t: float) -> Load:
        """The contact's load at a state as far as it does not depend on the torque."""
        if self.kind == "free":
            return self._no_load
        if self.kind == "rigid":
            return self._no_load._replace(phi=self._touch(q, q_dot, t)[0].phi)
        pin.computeJointJacobians(self.model, self.data, q)
        return elastic_load(self._held, q_dot, t)

    def _touch(
        self, q: np.ndarray, q_dot: np.ndarray, t: float, p_ddot_bias: np.ndarray = NO_BIAS
    ) -> tuple[Touch, np.ndarray]:
        """The contact's geometry at a state, and the tool's Jacobian (3, n)."""
        pin.computeJointJacobians(self.model, self.data, q)
        return touch_at(self._held, q_dot, t, p_ddot_bias)

    def _drift(self, q: np.ndarray, q_dot: np.ndarray) -> np.ndarray:
        """J_v_dot q_dot of the tool, (3,) m/s^2: its acceleration without q_ddot."""
        pin.forwardKinematics(self.model, self.data, q, q_dot, np.zeros_like(q))
        frame = pin.LOCAL_WORLD_ALIGNED
        return pin.getFrameClassicalAcceleration(self.model, self.data, self._joint, self._placement, frame).linear

    def _viscous(self, at: Touch) -> np.ndarray:
        touching = self.kind == "rigid" or at.phi > 0.0 or not self.contact.unilateral
        return self.contact.friction_viscous * at.v_rel if touching else np.zeros(3)

    def _acceleration(self, q: np.ndarray, q_dot: np.ndarray, load: Load, tau: np.ndarray, t: float) -> Acceleration:
        """load: the contact's at this state, which a heavy contact replaces by the one that tau causes."""
        if not self.truth.silent:
            tau = tau - self.truth.torque(q_dot, t)
        if not self.heavy:
            return Acceleration(pin.aba(self.model, self.data, q, q_dot, tau - load.torque), load)
        at, J_v = self._touch(q, q_dot, t, self._drift(q, q_dot))
        rub = self._viscous(at)
        free = pin.aba(self.model, self.data, q, q_dot, tau - J_v.T @ rub)
        M, pull = pin.crba(self.model, self.data, q), J_v.T @ at.normal
        push, response, multiplier = at.normal, pull, -1.0
        for side in (1.0, -1.0):  # where a bilateral surface pulls, friction opposes the slip all the same
            push = at.normal + side * at.drag
            response = np.linalg.solve(M, J_v.T @ push)
            multiplier = heavy_multiplier(
                self.contact, self.kind == "rigid", at, float(pull @ free) + at.phi_ddot_bias, float(pull @ response)
            )
            if multiplier >= 0.0 or self.contact.unilateral:
                break
        force = multiplier * push + rub
        return Acceleration(free - response * multiplier, Load(force, J_v.T @ force, multiplier, at.phi))

    def _semi_implicit_euler(
        self, q: np.ndarray, q_dot: np.ndarray, load: Load, tau: np.ndarray, t: float, h: float
    ) -> tuple[np.ndarray, np.ndarray, Acceleration]:
        at = self._acceleration(q, q_dot, load, tau, t)
        q, q_dot = _euler(q, q_dot, at.q_ddot, h)
        return *self._constrained(q, q_dot, t + h), at

    def _rk4(
        self, q: np.ndarray, q_dot: np.ndarray, load: Load, tau: np.ndarray, t: float, h: float
    ) -> tuple[np.ndarray, np.ndarray, Acceleration]:
        def acceleration(q: np.ndarray, q_dot: np.ndarray, t: float) -> np.ndarray:
            return self._acceleration(q, q_dot, self._load(q, q_dot, t), tau, t).q_ddot

        at = self._acceleration(q, q_dot, load, tau, t)
        v_2 = q_dot + 0.5 * h * at.q_ddot
        a_2 = acceleration(q + 0.5 * h * q_dot, v_2, t + 0.5 * h)
        v_3 = q_dot + 0.5 * h * a_2
        a_3 = acceleration(q + 0.5 * h * v_2, v_3, t + 0.5 * h)
        v_4 = q_dot + h * a_3
        a_4 = acceleration(q + h * v_3, v_4, t + h)
        q = q + (h / 6) * (q_dot + 2 * v_2 + 2 * v_3 + v_4)
        q_dot = q_dot + (h / 6) * (at.q_ddot + 2 * a_2 + 2 * a_3 + a_4)
        return *self._constrained(q, q_dot, t + h), at

    def _constrained(self, q: np.ndarray, q_dot: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        """On a rigid surface: the nearest state (in the metric of M) with phi = 0 and phi_dot = 0."""
        if self.kind != "rigid":
            return q, q_dot
        M = pin.crba(self.model, self.data, q)
        phi = np.inf
        for _ in range(20):
            at, J_v = self._touch(q, q_dot, t)
            pull, phi = J_v.T @ at.normal, at.phi
            response = np.linalg.solve(M, pull)
            if abs(phi) < 1e-12:
                return q, q_dot - response * (at.phi_dot / (pull @ response))
            q = q - response * (phi / (pull @ response))
        raise ValueError(f"surface: the tool cannot be brought onto the rigid surface (phi = {phi:.2g} m)")
