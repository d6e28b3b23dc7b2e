"""The true arm in its world, (2): its masses, payload, friction and disturbance are what the controller never sees."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import pinocchio as pin
from numba import njit

from environments import contact as contacts
from environments.contact import Contact, Touch
from environments.robots import Robot
from environments.surfaces import Surface

Integrator = Literal["semi-implicit-euler", "rk4"]
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

    @property
    def silent(self) -> bool:
        return self.coulomb == 0.0 and self.viscous == 0.0 and self.disturbance == 0.0


class PlantState(NamedTuple):
    """q (n,), q_dot (n,); force (3,) N of the tool on the environment and its multiplier lambda; phi m; q_ddot (n,)
    at the beginning of the period that led here. With a rigid or heavy environment the force is that of the
    last substep, since it depends on the torque."""

    q: np.ndarray
    q_dot: np.ndarray
    force: np.ndarray
    multiplier: float
    phi: float
    q_ddot: np.ndarray


class Acceleration(NamedTuple):
    """q_ddot (n,) under a torque, with the contact force (3,) N and multiplier that go with it."""

    q_ddot: np.ndarray
    force: np.ndarray
    multiplier: float


@njit(cache=True)
def _tool(J, rotation, translation, lever, q_dot):
    """Tool point, its Jacobian and velocity from the world Jacobian J (6, n) of the joint that carries it."""
    p = translation + rotation @ lever
    J_v = np.empty((3, J.shape[1]))
    for j in range(J.shape[1]):
        J_v[0, j] = J[0, j] + J[4, j] * p[2] - J[5, j] * p[1]
        J_v[1, j] = J[1, j] + J[5, j] * p[0] - J[3, j] * p[2]
        J_v[2, j] = J[2, j] + J[3, j] * p[1] - J[4, j] * p[0]
    return p, J_v, J_v @ q_dot


class Plant:
    """M q_ddot + C q_dot + G + J^T F + f = tau, integrated with tau held over each control period."""

    def __init__(
        self,
        robot: Robot,
        truth: Truth,
        surface: Surface,
        contact: Contact,
        integrator: Integrator = "semi-implicit-euler",
        substeps: int = 1,
    ) -> None:
        self.truth, self.surface, self.contact = truth, surface, contact
        self.substeps = substeps
        self.model = truth.model(robot)
        self.data = self.model.createData()
        self._joint = robot.tool_joint
        self._placement = robot.tool_placement
        self._lever = np.array(robot.tool_placement.translation)
        self._J = self.data.J
        self._integrate = {"semi-implicit-euler": self._semi_implicit_euler, "rk4": self._rk4}[integrator]

    def start(self, q: np.ndarray, q_dot: np.ndarray, t: float) -> PlantState:
        """The state at rest in contact with whatever is there; on a rigid surface q is moved onto it.

        Raises ValueError when the rigid surface cannot be reached from q.
        """
        return self._measured(*self._constrained(q, q_dot, t), t, np.zeros_like(q))

    def advance(self, state: PlantState, tau: np.ndarray, t: float, period: float) -> PlantState:
        """One control period from time t with the torque tau (n,) N m."""
        h = period / self.substeps
        q, q_dot, first = self._integrate(state.q, state.q_dot, tau, t, h)
        last = first
        for i in range(1, self.substeps):
            q, q_dot, last = self._integrate(q, q_dot, tau, t + i * h, h)
        after = self._measured(q, q_dot, t + period, first.q_ddot)
        if self.contact.kind in ("rigid", "mass-damper-spring"):
            return after._replace(force=last.force, multiplier=last.multiplier)
        return after

    def respond(self, state: PlantState, tau: np.ndarray, t: float) -> Acceleration:
        """Acceleration and contact force that the torque tau (n,) N m causes at a state, without going on."""
        return self._acceleration(state.q, state.q_dot, tau, t)

    def force_of(self, state: PlantState, multiplier: float, t: float) -> np.ndarray:
        """Force (3,) N of the tool on the environment when the multiplier is the given one."""
        at, _ = self._touch(state.q, state.q_dot, t)
        return contacts.force(self.contact, at, multiplier)

    def _measured(self, q: np.ndarray, q_dot: np.ndarray, t: float, q_ddot: np.ndarray) -> PlantState:
        if self.contact.kind == "free":
            return PlantState(q, q_dot, np.zeros(3), 0.0, 0.0, q_ddot)
        at, _ = self._touch(q, q_dot, t)
        multiplier = contacts.spring_multiplier(self.contact, at)
        return PlantState(q, q_dot, contacts.force(self.contact, at, multiplier), multiplier, at.phi, q_ddot)

    def _touch(self, q: np.ndarray, q_dot: np.ndarray, t: float) -> tuple[Touch, np.ndarray]:
        """The contact at a state and the tool's Jacobian (3, n)."""
        pin.computeJointJacobians(self.model, self.data, q)
        carrier = self.data.oMi[self._joint]
        p, J_v, p_dot = _tool(self._J, carrier.rotation, carrier.translation, self._lever, q_dot)
        if self.contact.kind == "elastic":
            p_ddot_bias = np.zeros(3)  # phi_ddot is not needed
        else:
            pin.forwardKinematics(self.model, self.data, q, q_dot, np.zeros_like(q))
            p_ddot_bias = pin.getFrameClassicalAcceleration(
                self.model, self.data, self._joint, self._placement, pin.LOCAL_WORLD_ALIGNED
            ).linear
        return contacts.touch(self.contact, self.surface, t, p, J_v, p_dot, p_ddot_bias), J_v

    def _acceleration(self, q: np.ndarray, q_dot: np.ndarray, tau: np.ndarray, t: float) -> Acceleration:
        if not self.truth.silent:
            tau = tau - self.truth.torque(q_dot, t)
        contact = self.contact
        if contact.kind == "free":
            return Acceleration(pin.aba(self.model, self.data, q, q_dot, tau), np.zeros(3), 0.0)
        at, J_v = self._touch(q, q_dot, t)
        if contact.kind == "elastic":
            multiplier = contacts.spring_multiplier(contact, at)
            f = contacts.force(contact, at, multiplier)
            return Acceleration(pin.aba(self.model, self.data, q, q_dot, tau - J_v.T @ f), f, multiplier)
        rub = contacts.viscous_friction(contact, at)
        free = pin.aba(self.model, self.data, q, q_dot, tau - J_v.T @ rub)
        response = np.linalg.solve(pin.crba(self.model, self.data, q), at.n_q + J_v.T @ at.drag)
        multiplier = contacts.loaded_multiplier(
            contact, at, float(at.n_q @ free) + at.phi_ddot_bias, float(at.n_q @ response)
        )
        return Acceleration(free - response * multiplier, multiplier * (at.normal + at.drag) + rub, multiplier)

    def _semi_implicit_euler(
        self, q: np.ndarray, q_dot: np.ndarray, tau: np.ndarray, t: float, h: float
    ) -> tuple[np.ndarray, np.ndarray, Acceleration]:
        at = self._acceleration(q, q_dot, tau, t)
        q_dot = q_dot + h * at.q_ddot
        q = q + h * q_dot
        return *self._constrained(q, q_dot, t + h), at

    def _rk4(
        self, q: np.ndarray, q_dot: np.ndarray, tau: np.ndarray, t: float, h: float
    ) -> tuple[np.ndarray, np.ndarray, Acceleration]:
        at = self._acceleration(q, q_dot, tau, t)
        v_2 = q_dot + 0.5 * h * at.q_ddot
        a_2 = self._acceleration(q + 0.5 * h * q_dot, v_2, tau, t + 0.5 * h).q_ddot
        v_3 = q_dot + 0.5 * h * a_2
        a_3 = self._acceleration(q + 0.5 * h * v_2, v_3, tau, t + 0.5 * h).q_ddot
        v_4 = q_dot + h * a_3
        a_4 = self._acceleration(q + h * v_3, v_4, tau, t + h).q_ddot
        q = q + (h / 6) * (q_dot + 2 * v_2 + 2 * v_3 + v_4)
        q_dot = q_dot + (h / 6) * (at.q_ddot + 2 * a_2 + 2 * a_3 + a_4)
        return *self._constrained(q, q_dot, t + h), at

    def _constrained(self, q: np.ndarray, q_dot: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        """On a rigid surface: the nearest state (in the metric of M) with phi = 0 and phi_dot = 0."""
        if self.contact.kind != "rigid":
            return q, q_dot
        M = pin.crba(self.model, self.data, q)
        for _ in range(20):
            at, _ = self._touch(q, q_dot, t)
            response = np.linalg.solve(M, at.n_q)
            if abs(at.phi) < 1e-12:
                return q, q_dot - response * (at.phi_dot / (at.n_q @ response))
            q = q - response * (at.phi / (at.n_q @ response))
        raise ValueError(f"surface: the tool cannot be brought onto the rigid surface (phi = {at.phi:.2g} m)")
