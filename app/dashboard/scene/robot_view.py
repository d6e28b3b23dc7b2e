"""The arm from its own meshes: one mesh per (joint, colour), moved by Pinocchio's joint placements."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from typing import cast

import numpy as np
import pinocchio as pin
import structlog
import trimesh
import viser

from app.dashboard.theme.colors import TIP, Rgb
from app.dashboard.transport.viser_private import move
from app.dashboard.view_options import FINE
from app.storage.link_meshes import LinkMesh, link_meshes
from environments.robots import Robot

log = structlog.get_logger()

_PLAIN: Rgb = (196, 200, 206)
_JOINT: Rgb = (86, 120, 170)
_BONE = 0.03  # radius of a bone, as a share of the arm's length
_TIP_RADIUS = 0.012  # m


@dataclass(frozen=True)
class ColoredMesh:
    """Part of an arm: the triangles of one colour that move with one joint, in that joint's frame."""

    joint: int
    color: Rgb
    vertices: np.ndarray
    faces: np.ndarray


def parts(robot: Robot, meshes: tuple[LinkMesh, ...], cell: float) -> list[ColoredMesh]:
    """Parts of the arm, without detail finer than `cell` m: the URDF's visuals, grouped by joint and colour; links
    without a frame in the reduced model are left out. A joint without a visual is drawn as a bone to the next joint.
    The tool tip is the last part."""
    groups = _visuals(robot, meshes)
    bare = set(range(robot.model.njoints)) - {joint for joint, _ in groups}
    links = [ColoredMesh(joint, color, *_lightened(meshes, cell)) for (joint, color), meshes in groups.items()]
    return [*links, *(part for joint in sorted(bare) for part in _bone(robot, joint)), _tip(robot)]


def _visuals(robot: Robot, meshes: tuple[LinkMesh, ...]) -> dict[tuple[int, Rgb], list[trimesh.Trimesh]]:
    groups: defaultdict[tuple[int, Rgb], list[trimesh.Trimesh]] = defaultdict(list)
    for mesh in meshes:
        frame_id = robot.model.getFrameId(mesh.link, pin.FrameType.BODY)
        if frame_id < robot.model.nframes:
            frame = robot.model.frames[frame_id]
            shape = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
            groups[frame.parentJoint, mesh.color or _PLAIN].append(shape.apply_transform(frame.placement.homogeneous))
    return groups


def _bone(robot: Robot, joint: int) -> Iterator[ColoredMesh]:
    """Bone from a joint to the next one, or to the tool point."""
    reach = sum(float(np.linalg.norm(T.translation)) for T in robot.model.jointPlacements)
    radius = float(np.clip(_BONE * reach, 0.005, 0.06))
    last = joint + 1 == robot.model.njoints
    end = (robot.tool_placement if last else robot.model.jointPlacements[joint + 1]).translation
    if np.linalg.norm(end) > 2 * radius:
        shaft = trimesh.creation.cylinder(radius, segment=np.array([np.zeros(3), end]))
        yield ColoredMesh(joint, _PLAIN, shaft.vertices.astype(np.float32), shaft.faces.astype(np.uint32))
    ball = trimesh.creation.icosphere(2, 1.4 * radius)
    yield ColoredMesh(joint, _JOINT, ball.vertices.astype(np.float32), ball.faces.astype(np.uint32))


def _tip(robot: Robot) -> ColoredMesh:
    """The tool point, where the contact is, as a small ball."""
    ball = trimesh.creation.icosphere(2, _TIP_RADIUS).apply_translation(robot.tool_placement.translation)
    return ColoredMesh(robot.tool_joint, TIP, ball.vertices.astype(np.float32), ball.faces.astype(np.uint32))


def _lightened(meshes: list[trimesh.Trimesh], cell: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of the meshes together, with vertices merged within a cell. At `view_options.FINE` m about a
    third of the triangles stay, and hardly a difference is visible."""
    merged = cast(trimesh.Trimesh, trimesh.util.concatenate(meshes))
    cells = np.round(merged.vertices / cell).astype(np.int64)
    # Only vertices with the same direction of their normals are merged, so that sharp edges stay sharp.
    sides = np.round(merged.vertex_normals).astype(np.int64)
    _, first, index = np.unique(np.hstack([cells, sides]), axis=0, return_index=True, return_inverse=True)
    faces = index.reshape(-1)[merged.faces]
    whole = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    return merged.vertices[first].astype(np.float32), faces[whole].astype(np.uint32)


@dataclass(frozen=True)
class Paint:
    """Paint of a whole arm.
    opacity: 0 to 1.
    coat: thickness, m, so that two arms in one place do not flicker."""

    color: Rgb
    opacity: float
    coat: float


class RobotView:
    """View of one arm in the scene. Bones stand for meshes that are still being read.

    root: name of the scene node above it.
    cell: m, size of the finest detail.
    paint: None for the arm's own colours.
    """

    def __init__(
        self, scene: viser.SceneApi, robot: Robot, root: str, cell: float = FINE, paint: Paint | None = None
    ) -> None:
        self._scene, self._robot, self._cell, self._paint = scene, robot, cell, paint
        self._model = robot.model
        self._data = robot.model.createData()
        self._root = scene.add_frame(root, show_axes=False)
        self._paths = list(_paths(robot.model, root))
        self._frames = [scene.add_frame(path, show_axes=False) for path in self._paths[1:]]
        self._meshes = link_meshes(robot)
        self._complete = self._meshes.done()
        self._shapes = self._shaped()

    def show(self, q: np.ndarray) -> None:
        """Move the joints to q (n,)."""
        if not self._complete and self._meshes.done():
            self._complete = True
            bones, self._shapes = self._shapes, self._shaped()
            for bone in bones:
                bone.remove()
        pin.forwardKinematics(self._model, self._data, np.asarray(q, dtype=float))
        for joint, frame in enumerate(self._frames, start=1):
            T_parent_joint = self._data.liMi[joint]
            move(frame, T_parent_joint.translation, _wxyz(T_parent_joint.rotation))

    def _shaped(self) -> list[viser.MeshHandle]:
        """Meshes in the scene of those parts of the arm that have been read."""
        meshes = self._meshes.result() if self._complete else ()
        paint, kind = self._paint, "mesh" if self._complete else "bone"
        return [
            self._scene.add_mesh_simple(
                f"{self._paths[part.joint]}/{kind}_{number}",
                part.vertices if paint is None else _coated(part, paint.coat),
                part.faces,
                color=part.color if paint is None else paint.color,
                opacity=None if paint is None else paint.opacity,
                side="double",
                cast_shadow=False,
                receive_shadow=False,
            )
            for number, part in enumerate(parts(self._robot, meshes, self._cell))
        ]

    def set_visible(self, visible: bool) -> None:
        self._root.visible = visible

    def remove(self) -> None:
        self._root.remove()


def _coated(part: ColoredMesh, coat: float) -> np.ndarray:
    """Vertices of a part, enlarged by `coat` m on every side."""
    mesh = trimesh.Trimesh(part.vertices, part.faces, process=False)
    return (part.vertices + coat * mesh.vertex_normals).astype(np.float32)


def _paths(model: pin.Model, root: str) -> Iterator[str]:
    """Scene node of every joint, below that of its parent."""
    known = [root]
    yield root
    for joint in range(1, model.njoints):
        known.append(f"{known[model.parents[joint]]}/{joint}")
        yield known[-1]


def _wxyz(rotation: np.ndarray) -> np.ndarray:
    x, y, z, w = pin.Quaternion(rotation).coeffs()
    return np.array([w, x, y, z])
