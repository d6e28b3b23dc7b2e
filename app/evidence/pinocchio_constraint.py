"""Arm on a rigid surface at rest, solved by Pinocchio, in two ways that use nothing from `environments/`.

Pinocchio has no constraint to a surface. Solution (a) uses its solver for any constraint J q_ddot + drift = 0, with
phi's gradient and curvature written here from elementary geometry. Solution (b) uses its constraint dynamics of two
bodies joined in a point: the tool, and a slider of little mass m, which two joints of its own keep on the surface; then
Pinocchio computes the curvature itself. The difference of (b) from `environments/` is proportional to m.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, assert_never

import numpy as np
import pinocchio as pin

Kind = Literal["plane", "cylinder", "sphere"]


class PinocchioAnswer(NamedTuple):
    """Answer of Pinocchio. q_ddot: (n,) rad/s^2. multipliers: (k,) N, of each surface, positive where the tool
    presses."""

    q_ddot: np.ndarray
    multipliers: np.ndarray


@dataclass(frozen=True)
class RigidGround:
    """Ground: a plane, or a cylinder or sphere with the tool outside.
    origin: (3,) m, point of the plane or of the cylinder's axis, or centre of the sphere.
    normal: (3,) unit, into the plane.
    axis: (3,) unit, of the cylinder.
    radius: m."""

    kind: Kind
    origin: np.ndarray
    normal: np.ndarray
    axis: np.ndarray
    radius: float

    def gradient_and_curvature(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gradient (3,) and curvature (3, 3) 1/m of the penetration phi at p (3,) m."""
        match self.kind:
            case "plane":
                return self.normal, np.zeros((3, 3))
            case "cylinder":
                around = np.eye(3) - np.outer(self.axis, self.axis)
            case "sphere":
                around = np.eye(3)
            case _:
                assert_never(self.kind)
        away = around @ (p - self.origin)
        distance = float(np.linalg.norm(away))
        outward = away / distance
        return -outward, -(around - np.outer(outward, outward)) / distance

    def slider(self) -> tuple[pin.SE3, tuple[pin.JointModel, pin.JointModel], np.ndarray]:
        """Slider: placement of its first joint, its two joints, and its end (3,) m in the second one."""
        match self.kind:
            case "plane":
                frame = _rotation(self.normal)
                return pin.SE3(frame, self.origin), (pin.JointModelPX(), pin.JointModelPY()), np.zeros(3)
            case "cylinder":
                second = pin.JointModelPZ()
            case "sphere":
                second = pin.JointModelRY()
            case _:
                assert_never(self.kind)
        frame = _rotation(self.axis)
        return pin.SE3(frame, self.origin), (pin.JointModelRZ(), second), np.array([self.radius, 0.0, 0.0])


def by_jacobian(
    model: pin.Model, tool: pin.Frame, grounds: Sequence[RigidGround], q: np.ndarray, q_dot: np.ndarray, tau: np.ndarray
) -> PinocchioAnswer:
    """Solution (a) for the state q, q_dot (n,) on all surfaces at once, under the torque tau (n,) N m."""
    model = model.copy()
    frame = model.addFrame(tool)
    data = model.createData()
    axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    pin.forwardKinematics(model, data, q, q_dot, np.zeros_like(q))
    pin.updateFramePlacements(model, data)
    velocity = pin.getFrameVelocity(model, data, frame, axes).linear
    drift = pin.getFrameClassicalAcceleration(model, data, frame, axes).linear
    bent = [ground.gradient_and_curvature(data.oMf[frame].translation) for ground in grounds]
    J = np.array([gradient for gradient, _ in bent]) @ pin.computeFrameJacobian(model, data, q, frame, axes)[:3]
    bias = np.array([gradient @ drift + velocity @ curvature @ velocity for gradient, curvature in bent])
    q_ddot = pin.forwardDynamics(model, data, q, q_dot, tau, J, bias)
    return PinocchioAnswer(q_ddot.copy(), -data.lambda_c[: len(bent)])


def by_slider(
    model: pin.Model,
    tool: pin.Frame,
    ground: RigidGround,
    q: np.ndarray,
    q_dot: np.ndarray,
    tau: np.ndarray,
    mass: float,
) -> PinocchioAnswer:
    """Solution (b) for the state q, q_dot (n,) under the torque tau (n,) N m. mass: of the slider, kg."""
    n, model = len(q), model.copy()
    place, joints, end = ground.slider()
    first = model.addJoint(0, joints[0], place, "slider 1")
    second = model.addJoint(first, joints[1], pin.SE3.Identity(), "slider 2")
    model.appendBodyToJoint(second, pin.Inertia(mass, end, np.zeros((3, 3))), pin.SE3.Identity())
    at_end = pin.Frame("end", second, pin.SE3(np.eye(3), end), pin.FrameType.OP_FRAME)
    frames = (model.addFrame(tool), model.addFrame(at_end))
    q, q_dot, tau = (np.concatenate([part, np.zeros(2)]) for part in (q, q_dot, tau))
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    q[n:] = _slider_at(ground, place.actInv(data.oMf[frames[0]].translation))
    J = [pin.computeFrameJacobian(model, data, q, f, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)[:3].copy() for f in frames]
    q_dot[n:] = np.linalg.lstsq(J[1][:, n:], J[0] @ q_dot, rcond=None)[0]
    joined = pin.RigidConstraintModel(
        pin.ContactType.CONTACT_3D, model, tool.parentJoint, tool.placement, second, at_end.placement
    )
    models, datas = pin.StdVec_RigidConstraintModel([joined]), pin.StdVec_RigidConstraintData([joined.createData()])
    pin.initConstraintDynamics(model, data, models, datas)
    settings = pin.ProximalSettings(1e-14, 1e-10, 20)
    q_ddot = pin.constraintDynamics(model, data, q, q_dot, tau, models, datas, settings)[:n].copy()
    gradient, _ = ground.gradient_and_curvature(data.oMf[frames[0]].translation)
    missing = tau[:n] - pin.rnea(model, data, q, q_dot, np.concatenate([q_ddot, np.zeros(2)]))[:n]
    pull = gradient @ J[0][:, :n]
    return PinocchioAnswer(q_ddot, np.array([pull @ missing / (pull @ pull)]))


def _slider_at(ground: RigidGround, p: np.ndarray) -> tuple[float, float]:
    """Positions of the slider's joints that bring its end to p (3,) m, in the frame of its first joint."""
    match ground.kind:
        case "plane":
            return p[0], p[1]
        case "cylinder":
            return np.arctan2(p[1], p[0]), p[2]
        case "sphere":
            return np.arctan2(p[1], p[0]), -np.arcsin(p[2] / ground.radius)
        case _:
            assert_never(ground.kind)


def _rotation(z: np.ndarray) -> np.ndarray:
    """Rotation (3, 3) whose third axis is z (3,) unit."""
    return pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), z).matrix()
