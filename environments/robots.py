"""Loading of arms: those of the catalogue, and any URDF by path.

A `Robot` is a serial chain: every joint that does not move the tool is locked, continuous joints are given
limits, so that q lies in R^n. For a URDF that is not in the catalogue the tool frame, the working posture and the
supplemental joints are determined where they are not given.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, field
from functools import cache, cached_property
from importlib import metadata, resources
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from environments import urdf as description
from environments.catalogue import CATALOGUE, RobotEntry
from environments.urdf import RobotError
from environments.working_posture import Geometry, Tool, geometry_of
from parameters import allowed

FEWEST_JOINTS, MOST_JOINTS = 2, 8  # between base and tool
USUAL_JOINTS = 7  # links beyond are probably a gripper
ROTOR_INERTIA = 0.1  # kg m^2, assumed where nothing is said
_READ = {"link": ("inertial",), "joint": ("parent", "child", "origin", "axis", "limit", "mimic", "dynamics")}


@dataclass(frozen=True)
class Robot:
    """A serial arm of n joints with its tool point.

    model: Pinocchio's, reduced to the chain, `armature` filled, nq = nv = n.
    tool_joint, tool_placement: the joint that carries the tool, and the tool frame in it.
    posture: (n,) rad (m for prismatic joints), the working posture.
    geometry: which square task space fits: "planar" (two positions, then an angle), "pose" (three positions, three
        angles), "position" (three positions); joints in `supplemental` complete it (Remark 5).
    endless: whether each joint turns without limits.
    tool_frame, tool_offset: the URDF's link and the tool point (3,) m in it; frames: the links that it may be.
    urdf: for the meshes; its joints in `joint_names` move, the others stay where `locked` says, rad or m.
    shipped: whether the arm comes with the program, not from a user.
    """

    name: str
    title: str
    model: pin.Model
    tool_joint: int
    tool_placement: pin.SE3
    posture: np.ndarray
    geometry: Geometry
    supplemental: tuple[int, ...]
    endless: tuple[bool, ...]
    rotor_source: str
    tool_frame: str
    tool_offset: np.ndarray
    frames: tuple[str, ...]
    urdf: Path
    shipped: bool
    locked: dict[str, float] = field(default_factory=dict)

    @property
    def n(self) -> int:
        return self.model.nv

    @cached_property
    def slides(self) -> tuple[bool, ...]:
        """Whether each joint is prismatic."""
        return _slides(self.model)

    @cached_property
    def ranges(self) -> tuple[np.ndarray, np.ndarray]:
        """Middle and half (n,) rad or m of each joint's range; 0 and infinity for an endless one."""
        low, high = self.model.lowerPositionLimit, self.model.upperPositionLimit
        endless = np.array(self.endless)
        return np.where(endless, 0.0, (low + high) / 2), np.where(endless, np.inf, (high - low) / 2)

    @property
    def joint_names(self) -> list[str]:
        return [str(name) for name in list(self.model.names)[1:]]


@cache
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
    entry = None if urdf is not None else _entry(name)
    path = _file(entry) if entry is not None else _given(str(urdf))
    root, full = _described(path) if entry is None else _shipped(path)
    frames = _tool_frames(full)
    frame_name = tool_frame or (entry.tool_frame if entry else _farthest(frames, path))
    if not full.existFrame(frame_name, pin.BODY):
        raise RobotError(f"robot.tool_frame: no frame {frame_name!r:.60} in {path.name}; {_allowed(frames)}")
    model, locked = _chain(full, frame_name, path)
    _require_moving_bodies(model, root, path)
    frame = model.frames[model.getFrameId(frame_name, pin.BODY)]
    # the catalogue's point of a tool holds for its own tool only; the rest is about the joints
    own = entry if entry is not None and frame_name == entry.tool_frame else None
    offset = np.array(tool_offset or (own.tool_offset if own else (0.0, 0.0, 0.0)))
    placement = frame.placement * pin.SE3(np.eye(3), offset)
    geometry = geometry_of(model, path.name)
    tool = Tool(model, frame.parentJoint, placement, geometry)
    names = [str(joint) for joint in list(model.names)[1:]]
    # the catalogue's row, where exactly its joints move the tool
    whole = entry if entry is not None and set(names) == entry.posture.keys() else None
    endless = {joint.get("name") for joint in root.iter("joint") if joint.get(description.ENDLESS)}
    if posture is not None:
        home = _posture(posture, model, names)
    elif whole is not None:
        home = np.array([whole.posture[joint] for joint in names])
    else:
        home = tool.working_posture(path.name)
    model.armature, source = _rotors(entry, rotor_inertia, names)
    return Robot(
        name=name,
        title=entry.title if entry else path.stem,
        model=model,
        tool_joint=frame.parentJoint,
        tool_placement=placement,
        posture=home,
        geometry=geometry,
        supplemental=tuple(names.index(j) for j in whole.supplemental) if whole else tool.supplemental(home),
        endless=tuple(name in endless for name in names),
        rotor_source=source,
        tool_frame=frame_name,
        tool_offset=offset,
        frames=tuple(frames),
        urdf=path,
        shipped=entry is not None,
        locked=locked,
    )


def _rotors(entry: RobotEntry | None, given: tuple[float, ...] | None, names: list[str]) -> tuple[np.ndarray, str]:
    """Rotor inertia of each joint (n,) and where it is from. They belong to the joints, whatever the tool. Raises
    RobotError. given: by the user, kg m^2. names: of the joints."""
    known = dict(zip(entry.posture, entry.rotor_inertia, strict=True)) if entry else {}
    if given is None:
        source = entry.rotor_source if entry is not None and set(names) <= known.keys() else "assumed"
        return np.array([known.get(joint, ROTOR_INERTIA) for joint in names]), source
    rotors = _vector("robot.rotor_inertia", given, len(names))
    if (rotors < 0).any():
        raise RobotError(f"robot.rotor_inertia: {rotors.tolist()} has a negative entry; allowed: >= 0 kg·m²")
    return rotors, "given by the user"


class _Described(NamedTuple):
    """A URDF and Pinocchio's model of the whole of it."""

    root: ElementTree.Element
    full: pin.Model


def _described(path: Path) -> _Described:
    root = description.read(path)
    return _Described(root, _model(root, path))


@cache  # read at every change of a scenario; neither part is written to, and a file of the program does not change
def _shipped(path: Path) -> _Described:
    return _described(path)


def _entry(name: str) -> RobotEntry:
    if name not in CATALOGUE:
        raise RobotError(f"robot.name: unknown robot {name!r}; {allowed(name, CATALOGUE)} (or give robot.urdf)")
    return CATALOGUE[name]


def _file(entry: RobotEntry) -> Path:
    if entry.urdf.startswith("static:"):
        return Path(str(resources.files("static").joinpath("robots", entry.urdf.removeprefix("static:"))))
    return robot_data_root() / entry.urdf


def _given(urdf: str) -> Path:
    if not urdf:
        raise RobotError("robot.urdf: none is given; allowed: a file's path")
    try:
        return Path(urdf).expanduser()
    except RuntimeError as error:
        raise RobotError(f"robot.urdf: cannot read {urdf}: {error}") from error


def _vector(field_path: str, given: tuple[float, ...], n: int) -> np.ndarray:
    if len(given) != n:
        raise RobotError(f"{field_path}: {len(given)} values given; allowed: {n}, one for each joint of this arm")
    return np.array(given, dtype=float)


def _posture(given: tuple[float, ...], model: pin.Model, names: list[str]) -> np.ndarray:
    q, ranges = _vector("robot.posture", given, model.nv), (model.lowerPositionLimit, model.upperPositionLimit)
    for name, angle, low, high, slides in zip(names, q, *ranges, _slides(model), strict=True):
        if not low <= angle <= high:
            unit, turned = "m" if slides else "rad", float(np.radians(angle))
            hint = f"; {angle:g}° are {turned:.4g} rad" if not slides and low <= turned <= high else ""
            allowed = f"allowed: {low:.4g} to {high:.4g} {unit}{hint}"
            raise RobotError(f"robot.posture: {angle:g} {unit} for joint {name!r:.60}; {allowed}")
    return q


def _slides(model: pin.Model) -> tuple[bool, ...]:
    return tuple(joint.shortname().startswith("JointModelP") for joint in list(model.joints)[1:])


def _model(root: ElementTree.Element, path: Path) -> pin.Model:
    try:
        return pin.buildModelFromXML(ElementTree.tostring(_bodies(root), encoding="unicode"))
    except (RuntimeError, ValueError) as error:
        raise RobotError(f"robot.urdf: {path} is no usable URDF: {str(error).splitlines()[0]}") from error


def _bodies(root: ElementTree.Element) -> ElementTree.Element:
    """URDF with only the elements that `urdf.parse` has checked: links, joints, inertias."""
    bodies = ElementTree.Element(root.tag, root.attrib)
    for element in root:
        if element.tag in _READ:
            copied = ElementTree.SubElement(bodies, element.tag, element.attrib)
            copied.extend(child for child in element if child.tag in _READ[element.tag])
    return bodies


def _tool_frames(full: pin.Model) -> dict[str, int]:
    """Links that enough joints move, and not too many, with the number of those joints."""
    moved = {str(f.name): len(full.supports[f.parentJoint]) - 1 for f in full.frames if f.type == pin.BODY}
    return {name: joints for name, joints in moved.items() if FEWEST_JOINTS <= joints <= MOST_JOINTS}


def _farthest(frames: dict[str, int], path: Path) -> str:
    """Last of the links that most joints move, without grippers."""
    if not frames:
        raise RobotError(
            f"robot.urdf: {path.name} has no link that {FEWEST_JOINTS} to {MOST_JOINTS} joints move; "
            "allowed: an arm that has one"
        )
    most = max(frames.values(), key=lambda joints: (joints <= USUAL_JOINTS, joints))
    return next(name for name in reversed(frames) if frames[name] == most)


def _allowed(frames: dict[str, int]) -> str:
    shown = list(frames)[-20:]
    return f"allowed: {', '.join(f'{name:.60}' for name in shown)}"


def _chain(full: pin.Model, frame_name: str, path: Path) -> tuple[pin.Model, dict[str, float]]:
    """Lock at zero (or the nearest limit) every joint that does not move the tool."""
    moving = set(full.supports[full.frames[full.getFrameId(frame_name, pin.BODY)].parentJoint])
    n = len(moving - {0})
    if not 1 <= n <= MOST_JOINTS:
        raise RobotError(
            f"robot.tool_frame: {frame_name!r:.60} is moved by {n} joints of {path.name}; allowed: "
            f"{FEWEST_JOINTS} to {MOST_JOINTS} joints"
        )
    locked_ids = [j for j in range(1, full.njoints) if j not in moving]
    q = np.clip(pin.neutral(full), full.lowerPositionLimit, full.upperPositionLimit)
    locked = {str(full.names[j]): float(q[full.joints[j].idx_q]) for j in locked_ids}
    return pin.buildReducedModel(full, locked_ids, q), locked


def _require_moving_bodies(model: pin.Model, root: ElementTree.Element, path: Path) -> None:
    """Require that each joint on the way to the tool moves a mass of its own, by itself."""
    mimics = {joint.get("name") for joint in root.findall("joint") if joint.find("mimic") is not None}
    inertias: list[Any] = model.inertias.tolist()
    for joint, inertia in zip(list(model.names)[1:], inertias[1:], strict=True):
        what = f"robot.urdf: {path.name}: joint {str(joint)!r:.60}"
        if str(joint) in mimics:
            raise RobotError(f"{what} mimics another one; allowed: a robot.tool_frame that it does not move")
        if inertia.mass <= 0.0 or np.linalg.eigvalsh(inertia.inertia)[0] <= 0.0:
            raise RobotError(
                f"{what} moves a body of mass {inertia.mass:.3g} kg whose inertia has the eigenvalue "
                f"{np.linalg.eigvalsh(inertia.inertia)[0]:.3g} kg·m²; allowed: both > 0"
            )
