"""True arm's differences from the nominal one: masses, payload, friction, disturbance and drives, unknown to the
controller."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from environments.robots import Robot
from kernels import inline, kernel
from kernels.records import Record

SLIP_RATE = 0.01  # rad/s, the smooth transition of Coulomb friction in the joints


@dataclass(frozen=True)
class Truth:
    """Differences of the true arm from the nominal one.

    link_scaling: (n,), factor on each link's inertia.
    payload_mass, payload_offset: kg, a point at (3,) m in the tool frame.
    coulomb, viscous: N m and N m s/rad per joint.
    disturbance, disturbance_frequency: a torque of this norm (N m) at all times, turning through the joints with this
    frequency, Hz.
    torque_limit: (n,) N m, of the drives, see `limited`.
    rotor_scaling: (n,), factor on each rotor's inertia.
    link_centre: (n, 3) m, shift of each link's centre of mass, in the link's frame.
    link_shape: (n, 3, 3), symmetric Z: each link's inertia I about its centre of mass is I^1/2 (1 + Z) I^1/2.
    """

    link_scaling: np.ndarray
    payload_mass: float
    payload_offset: np.ndarray
    coulomb: float
    viscous: float
    disturbance: float
    disturbance_frequency: float
    torque_limit: np.ndarray | float = np.inf
    rotor_scaling: np.ndarray | float = 1.0
    link_centre: np.ndarray | float = 0.0
    link_shape: np.ndarray | float = 0.0

    @classmethod
    def as_believed(cls, n: int) -> Truth:
        """Truth of n joints that is the nominal arm."""
        return cls(np.ones(n), 0.0, np.zeros(3), 0.0, 0.0, 0.0, 0.0)

    def model(self, robot: Robot) -> pin.Model:
        """Pinocchio's model of the true arm."""
        model = robot.model.copy()
        n = len(self.link_scaling)
        shifts, shapes = np.broadcast_to(self.link_centre, (n, 3)), np.broadcast_to(self.link_shape, (n, 3, 3))
        for joint, (alpha, shift, Z) in enumerate(zip(self.link_scaling, shifts, shapes, strict=True), start=1):
            link, I = model.inertias[joint], model.inertias[joint].inertia
            if Z.any():
                squares, axes = np.linalg.eigh(I)
                root = axes * np.sqrt(squares.clip(min=0.0)) @ axes.T
                I = I + root @ Z @ root
            model.inertias[joint] = pin.Inertia(alpha * link.mass, link.lever + shift, alpha * I)
        model.armature = self.rotor_scaling * model.armature
        if self.payload_mass > 0.0:
            load = pin.Inertia(self.payload_mass, self.payload_offset, np.zeros((3, 3)))
            model.appendBodyToJoint(robot.tool_joint, load, robot.tool_placement)
        return model

    def torque(self, q_dot: np.ndarray, t: float) -> np.ndarray:
        """Joint friction plus disturbance, (n,) N m, on the left side of (2)."""
        torque = np.empty_like(q_dot)
        _resistance_alone(Record(self.resistance).data, q_dot, t, torque)
        return torque

    @property
    def resistance(self) -> Resistance:
        """Friction and disturbance in the joints, for kernels."""
        omega = 2 * np.pi * self.disturbance_frequency
        return Resistance(float(self.coulomb), float(self.viscous), float(self.disturbance), omega)


class Resistance(NamedTuple):
    """Friction and disturbance of `Truth` in the joints; omega: of the disturbance, rad/s."""

    coulomb: float
    viscous: float
    disturbance: float
    omega: float


@inline
def limited(limits, tau, applied):
    """Compute the torque that the drives apply: applied (n,) = tau, within the limits (n,) N m."""
    for i in range(applied.shape[0]):
        applied[i] = min(max(tau[i], -limits[i]), limits[i])


@inline
def resistance_torque(resistance, q_dot, t, torque):
    """Compute friction and disturbance in the joints, torque (n,) N m, on the left side of (2)."""
    n = q_dot.shape[0]
    for i in range(n):
        torque[i] = resistance.viscous * q_dot[i]
        if resistance.coulomb > 0.0:
            torque[i] += resistance.coulomb * np.tanh(q_dot[i] / SLIP_RATE)
    if resistance.disturbance > 0.0:
        # squares of n sines that are 2 pi/n apart add up to n/2 at all times if n > 2; for two they would be equal
        apart = 2 * np.pi / n if n > 2 else np.pi / 2
        size = resistance.disturbance * np.sqrt(2 / n)
        for i in range(n):
            torque[i] += size * np.sin(resistance.omega * t + apart * i)


@kernel
def _resistance_alone(resistance, q_dot, t, torque):
    resistance_torque(resistance[0], q_dot, t, torque)
