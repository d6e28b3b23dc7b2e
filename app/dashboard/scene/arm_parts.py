"""Shapes of an arm's parts: the visuals of its URDF, lightened, and bones where there are none."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from typing import cast

import numpy as np
import pinocchio as pin
import trimesh

from app.dashboard.theme.colors import TIP, Rgb
from app.storage.link_meshes import LinkMesh
from app.storage.part_store import ArmPart
from environments.robots import Robot

_PLAIN: Rgb = (196, 200, 206)
_JOINT: Rgb = (86, 120, 170)
_BONE = 0.03  # radius of a bone, as a share of the arm's length
_TIP_RADIUS = 0.012  # m


def parts(robot: Robot, meshes: tuple[LinkMesh, ...], cell: float, coat: float = 0.0) -> list[ArmPart]:
    """Parts of the arm, without detail finer than `cell` m and enlarged by `coat` m on every side: the URDF's visuals,
    grouped by joint and colour; links without a frame in the reduced model are left out. A joint without a visual is
    drawn as a bone to the next joint. The tool tip is the last part."""
    groups = _visuals(robot, meshes)
    bare = set(range(robot.model.njoints)) - {joint for joint, _ in groups}
    links = [ArmPart(joint, color, *_lightened(meshes, cell)) for (joint, color), meshes in groups.items()]
    made = [*links, *(part for joint in sorted(bare) for part in _bone(robot, joint)), _tip(robot)]
    return [replace(part, vertices=_coated(part, coat)) for part in made] if coat else made


def _visuals(robot: Robot, meshes: tuple[LinkMesh, ...]) -> dict[tuple[int, Rgb], list[trimesh.Trimesh]]:
    groups: defaultdict[tuple[int, Rgb], list[trimesh.Trimesh]] = defaultdict(list)
    for mesh in meshes:
        frame_id = robot.model.getFrameId(mesh.link, pin.FrameType.BODY)
        if frame_id < robot.model.nframes:
            frame = robot.model.frames[frame_id]
            shape = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
            groups[frame.parentJoint, mesh.color or _PLAIN].append(shape.apply_transform(frame.placement.homogeneous))
    return groups


def _bone(robot: Robot, joint: int) -> Iterator[ArmPart]:
    """Bone from a joint to the next one, or to the tool point."""
    reach = sum(float(np.linalg.norm(T.translation)) for T in robot.model.jointPlacements)
    radius = float(np.clip(_BONE * reach, 0.005, 0.06))
    last = joint + 1 == robot.model.njoints
    end = (robot.tool_placement if last else robot.model.jointPlacements[joint + 1]).translation
    if np.linalg.norm(end) > 2 * radius:
        shaft = trimesh.creation.cylinder(radius, segment=np.array([np.zeros(3), end]))
        yield ArmPart(joint, _PLAIN, shaft.vertices.astype(np.float32), shaft.faces.astype(np.uint32))
    ball = trimesh.creation.icosphere(2, 1.4 * radius)
    yield ArmPart(joint, _JOINT, ball.vertices.astype(np.float32), ball.faces.astype(np.uint32))


def _tip(robot: Robot) -> ArmPart:
    """The tool point, where the contact is, as a small ball."""
    ball = trimesh.creation.icosphere(2, _TIP_RADIUS).apply_translation(robot.tool_placement.translation)
    return ArmPart(robot.tool_joint, TIP, ball.vertices.astype(np.float32), ball.faces.astype(np.uint32))


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


def _coated(part: ArmPart, coat: float) -> np.ndarray:
    """Vertices of a part, enlarged by `coat` m on every side."""
    mesh = trimesh.Trimesh(part.vertices, part.faces, process=False)
    return (part.vertices + coat * mesh.vertex_normals).astype(np.float32)
