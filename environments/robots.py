"""The catalogue of arms, and any URDF by path.

A `Robot` is a serial chain: every joint that does not move the tool is locked, continuous joints are given
limits, so that q lies in R^n. A new robot is one row of `CATALOGUE`.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, field
from importlib import metadata, resources
from pathlib import Path
from typing import Literal

import numpy as np
import pinocchio as pin

Geometry = Literal["pose", "position", "planar"]


class RobotError(ValueError):
    """A robot description that cannot be used; the message names the robot, what is wrong and what is allowed."""


@dataclass(frozen=True)
class RobotEntry:
    """One row of the catalogue. Angles in rad, inertias in kg m^2, lengths in m."""

    title: str
    urdf: str  # below the URDF root: "static:" or example-robot-data's folder
    tool_frame: str
    posture: dict[str, float]  # joint name -> working posture, away from singularities and joint limits
    rotor_inertia: tuple[float, ...]  # reflected, per joint of the chain
    rotor_source: str
    supplemental: tuple[str, ...] = ()  # joints whose angles complete a square task space (Remark 5)
    tool_offset: tuple[float, float, float] = (0.0, 0.0, 0.0)


_UR_POSTURE = {
    "shoulder_pan_joint": 0.0,
    "shoulder_lift_joint": -1.2,
    "elbow_joint": 1.8,
    "wrist_1_joint": -2.1708,
    "wrist_2_joint": -1.5708,
    "wrist_3_joint": 0.0,
}
_PANDA_POSTURE = {
    "panda_joint1": 0.0,
    "panda_joint2": -0.4,
    "panda_joint3": 0.0,
    "panda_joint4": -2.2,
    "panda_joint5": 0.0,
    "panda_joint6": 1.8,
    "panda_joint7": 0.7854,
}

CATALOGUE: dict[str, RobotEntry] = {
    "ur5": RobotEntry(
        title="Universal Robots UR5",
        urdf="ur_description/urdf/ur5_robot.urdf",
        tool_frame="tool0",
        posture=_UR_POSTURE,
        rotor_inertia=(1.0, 1.0, 1.0, 0.1, 0.1, 0.1),
        rotor_source="assumed",
    ),
    "ur3": RobotEntry(
        title="Universal Robots UR3",
        urdf="ur_description/urdf/ur3_robot.urdf",
        tool_frame="tool0",
        posture=_UR_POSTURE,
        rotor_inertia=(0.4, 0.4, 0.4, 0.05, 0.05, 0.05),
        rotor_source="assumed",
    ),
    "ur10": RobotEntry(
        title="Universal Robots UR10",
        urdf="ur_description/urdf/ur10_robot.urdf",
        tool_frame="tool0",
        posture=_UR_POSTURE,
        rotor_inertia=(2.0, 2.0, 2.0, 0.2, 0.2, 0.2),
        rotor_source="assumed",
    ),
    "panda": RobotEntry(
        title="Franka Emika Panda",
        urdf="panda_description/urdf/panda.urdf",
        tool_frame="panda_hand_tcp",
        posture=_PANDA_POSTURE,
        rotor_inertia=(0.6, 0.6, 0.5, 0.5, 0.2, 0.2, 0.2),
        rotor_source="assumed",
        supplemental=("panda_joint3",),
    ),
    "planar2r": RobotEntry(
        title="Planar 2R (vertical plane)",
        urdf="static:planar2r.urdf",
        tool_frame="tool",
        posture={"joint1": 1.2, "joint2": -1.7},
        rotor_inertia=(0.05, 0.05),
        rotor_source="assumed",
    ),
    "planar3r": RobotEntry(
        title="Planar 3R (vertical plane)",
        urdf="static:planar3r.urdf",
        tool_frame="tool",
        posture={"joint1": 1.2, "joint2": -1.5, "joint3": -1.0},
        rotor_inertia=(0.05, 0.05, 0.02),
        rotor_source="assumed",
    ),
}


@dataclass(frozen=True)
class Robot:
    """A serial arm of n joints with its tool point.

    model: Pinocchio's, reduced to the chain, `armature` filled, nq = nv = n.
    tool_joint, tool_placement: the joint that carries the tool, and the tool frame in it.
    posture: (n,) rad (m for prismatic joints), the working posture.
    geometry: which square task space fits: "planar" (two positions, then an angle), "pose" (three positions, three
        angles), "position" (three positions); joints in `supplemental` complete it (Remark 5).
    urdf, package_root: for the meshes; joint_names tells which of the URDF's joints move.
    """

    name: str
    title: str
    model: pin.Model
    tool_joint: int
    tool_placement: pin.SE3
    posture: np.ndarray
    geometry: Geometry
    supplemental: tuple[int, ...]
    rotor_source: str
    urdf: Path
    package_root: Path
    locked: dict[str, float] = field(default_factory=dict)

    @property
    def n(self) -> int:
        return self.model.nv

    @property
    def joint_names(self) -> list[str]:
        return [str(name) for name in list(self.model.names)[1:]]


def robot_data_root() -> Path:
    """The folder of example-robot-data that holds the robot descriptions."""
    files = metadata.files("example-robot-data") or []
    path = next(f for f in files if "example-robot-data/robots/" in str(f))
    located = Path(str(path.locate())).resolve()
    return next(parent for parent in located.parents if parent.name == "robots")


def load(
    name: str,
    *,
    urdf: str | None = None,
    tool_frame: str | None = None,
    tool_offset: tuple[float, float, float] | None = None,
    posture: tuple[float, ...] | None = None,
    rotor_inertia: tuple[float, ...] | None = None,
) -> Robot:
    """An arm of the catalogue, or with `urdf` any other.

    Raises RobotError for an unknown name, a file that is missing or no URDF, an unknown frame, a wrong number of
    joint values, and an arm for which no square task space exists.
    """
    entry = CATALOGUE.get(name)
    if urdf is not None:
        path = Path(urdf).expanduser()
        entry, root = None, path.parent
    elif entry is None:
        raise RobotError(f"robot.name: unknown robot {name!r}; allowed: {', '.join(CATALOGUE)} (or give robot.urdf)")
    elif entry.urdf.startswith("static:"):
        path = Path(str(resources.files("static").joinpath("robots", entry.urdf.removeprefix("static:"))))
        root = path.parent
    else:
        root = robot_data_root()
        path = root / entry.urdf
    full = _parse(path)
    frame_name = tool_frame or (entry.tool_frame if entry else str(full.frames[full.nframes - 1].name))
    if not full.existFrame(frame_name):
        names = ", ".join(str(f.name) for f in full.frames if f.type == pin.FrameType.BODY)
        raise RobotError(f"robot.tool_frame: no frame {frame_name!r} in {path.name}; allowed: {names}")
    model, locked = _chain(full, frame_name)
    n = model.nv
    if n == 0:
        raise RobotError(f"robot.tool_frame: {frame_name!r} is not moved by any joint of {path.name}")
    names = [str(joint) for joint in list(model.names)[1:]]
    home = np.array([entry.posture.get(joint, 0.0) if entry else 0.0 for joint in names])
    home = _vector("robot.posture", posture, home)
    rotor = np.array(entry.rotor_inertia if entry else [0.1] * n)
    model.armature = _vector("robot.rotor_inertia", rotor_inertia, rotor)
    if (model.armature < 0).any():
        raise RobotError(f"robot.rotor_inertia: {model.armature.tolist()} has a negative entry; allowed: >= 0 kg m^2")
    frame = model.frames[model.getFrameId(frame_name)]
    offset = np.array(tool_offset or (entry.tool_offset if entry else (0.0, 0.0, 0.0)))
    geometry, free = _geometry(model, home, path.name)
    supplemental = (
        tuple(names.index(joint) for joint in entry.supplemental)
        if entry
        else _supplemental(model, frame.parentJoint, frame.placement, home, geometry, free)
    )
    return Robot(
        name=name,
        title=entry.title if entry else path.stem,
        model=model,
        tool_joint=frame.parentJoint,
        tool_placement=frame.placement * pin.SE3(np.eye(3), offset),
        posture=home,
        geometry=geometry,
        supplemental=supplemental,
        rotor_source=entry.rotor_source if entry and rotor_inertia is None else "given by the user",
        urdf=path,
        package_root=root,
        locked=locked,
    )


def _vector(field_path: str, given: tuple[float, ...] | None, default: np.ndarray) -> np.ndarray:
    if given is None:
        return default
    if len(given) != len(default):
        raise RobotError(f"{field_path}: {len(given)} values given; this arm has {len(default)} joints")
    return np.array(given, dtype=float)


def _parse(path: Path) -> pin.Model:
    """Pinocchio's model of a URDF; continuous joints become revolute ones, so that each has one coordinate."""
    try:
        tree = ElementTree.parse(path)
    except OSError as error:
        raise RobotError(f"robot.urdf: cannot read {path}: {error.strerror}") from error
    except ElementTree.ParseError as error:
        raise RobotError(f"robot.urdf: {path} is not XML: {error}") from error
    for joint in tree.getroot().iter("joint"):
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
            limit = joint.find("limit")
            limit = ElementTree.SubElement(joint, "limit", effort="1000", velocity="10") if limit is None else limit
            limit.set("lower", str(-2 * np.pi))
            limit.set("upper", str(2 * np.pi))
    try:
        return pin.buildModelFromXML(ElementTree.tostring(tree.getroot(), encoding="unicode"))
    except (RuntimeError, ValueError) as error:
        raise RobotError(f"robot.urdf: {path} is no usable URDF: {str(error).splitlines()[0]}") from error


def _chain(full: pin.Model, frame_name: str) -> tuple[pin.Model, dict[str, float]]:
    """Lock at zero (or the nearest limit) every joint that does not move the tool."""
    moving = set(full.supports[full.frames[full.getFrameId(frame_name)].parentJoint])
    locked_ids = [j for j in range(1, full.njoints) if j not in moving]
    q = np.clip(pin.neutral(full), full.lowerPositionLimit, full.upperPositionLimit)
    locked = {str(full.names[j]): float(q[full.joints[j].idx_q]) for j in locked_ids}
    return pin.buildReducedModel(full, locked_ids, q), locked


def _geometry(model: pin.Model, posture: np.ndarray, file_name: str) -> tuple[Geometry, int]:
    """The richest square task space, and how many joints it leaves free: decided by the directions of the axes."""
    data = model.createData()
    pin.computeJointJacobians(model, data, posture)
    axes = data.J[3:].T
    n = model.nv
    planar = np.allclose(axes[:, [0, 2]], 0.0, atol=1e-9) and bool(np.allclose(np.abs(axes[:, 1]), 1.0))
    if planar and n >= 2:
        return "planar", max(n - 3, 0)
    if n >= 6:
        return "pose", n - 6
    if n >= 3 and not planar:
        return "position", n - 3
    raise RobotError(
        f"robot.urdf: {file_name} has {n} joint(s) to its tool; no square task space exists "
        "(allowed: planar about the y axis with 2 or more, otherwise 3 or more joints)"
    )


def _supplemental(
    model: pin.Model, tool_joint: int, placement: pin.SE3, posture: np.ndarray, geometry: Geometry, free: int
) -> tuple[int, ...]:
    """The joints that self-motion moves most: they complete the Jacobian best."""
    if free == 0:
        return ()
    data = model.createData()
    pin.computeJointJacobians(model, data, posture)
    pin.forwardKinematics(model, data, posture)
    J = pin.getJointJacobian(model, data, tool_joint, pin.LOCAL_WORLD_ALIGNED)
    arm = data.oMi[tool_joint].rotation @ placement.translation
    J[:3] -= pin.skew(arm) @ J[3:]
    rows = {"planar": [0, 2, 4], "pose": [0, 1, 2, 3, 4, 5], "position": [0, 1, 2]}[geometry]
    _, _, Vt = np.linalg.svd(J[rows])
    weight = np.linalg.norm(Vt[-free:], axis=0)
    return tuple(sorted(int(j) for j in np.argsort(weight)[-free:]))
