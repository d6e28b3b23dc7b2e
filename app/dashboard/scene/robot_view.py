"""The arm from its own meshes: one mesh per (joint, colour), moved by Pinocchio's joint placements."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import viser

from app.dashboard.transport.viser_private import move
from app.dashboard.view_options import FINE
from app.storage.link_meshes import Meshes, Rgb, link_meshes
from app.storage.part_store import ArmPart, PartStore
from environments.robots import Robot


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
        self._coming: Meshes | None = None  # while bones stand for them
        kept = PartStore().read(robot, cell, self._coat) if robot.shipped else None
        self._shapes = self._shaped(link_meshes(robot)) if kept is None else self._added(kept, "mesh")

    @property
    def has_new_meshes(self) -> bool:
        """Whether meshes have come that the next `show` puts in place of the bones; never of a hidden arm."""
        return self._coming is not None and self._coming.done() and self._root.visible

    def show(self, q: np.ndarray) -> None:
        """Move the joints to q (n,)."""
        if self._coming is not None and self._coming.done():
            bones, self._shapes = self._shapes, self._shaped(self._coming)
            for bone in bones:
                bone.remove()
        pin.forwardKinematics(self._model, self._data, np.asarray(q, dtype=float))
        for joint, frame in enumerate(self._frames, start=1):
            T_parent_joint = self._data.liMi[joint]
            move(frame, T_parent_joint.translation, _wxyz(T_parent_joint.rotation))

    @property
    def _coat(self) -> float:
        return 0.0 if self._paint is None else self._paint.coat

    def _shaped(self, meshes: Meshes) -> list[viser.MeshHandle]:
        """Parts of the arm in the scene, made from its meshes, or bones while they are being read. Parts of an arm that
        comes with the program are kept for the next start."""
        from app.dashboard.scene.arm_parts import parts  # trimesh takes 0.4 s and 50 MB

        read = meshes.result() if meshes.done() else None
        self._coming = meshes if read is None else None
        made = parts(self._robot, read or (), self._cell, self._coat)
        if self._robot.shipped and read:
            PartStore().write(self._robot, self._cell, self._coat, made)
        return self._added(made, "bone" if read is None else "mesh")

    def _added(self, parts: list[ArmPart], kind: str) -> list[viser.MeshHandle]:
        """Parts, added to the scene. kind: first word of their nodes' names."""
        paint = self._paint
        return [
            self._scene.add_mesh_simple(
                f"{self._paths[part.joint]}/{kind}_{number}",
                part.vertices,
                part.faces,
                color=part.color if paint is None else paint.color,
                opacity=None if paint is None else paint.opacity,
                side="double",
                cast_shadow=False,
                receive_shadow=False,
            )
            for number, part in enumerate(parts)
        ]

    def set_visible(self, *, visible: bool) -> None:
        self._root.visible = visible

    def remove(self) -> None:
        self._root.remove()


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
