"""Store of the parts of the arms that come with the program, as the scene shows them, beside the compiled kernels.

To read and lighten an arm's meshes takes half a second, and trimesh, which does it, as long and 50 MB. The name of a
file depends on all that its parts depend on, also on the sources that made them.
"""

from __future__ import annotations

import contextlib
import hashlib
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from pathlib import Path

import numpy as np

from app.process.atomic_write import write_whole
from app.process.kernel_cache import cache_folder
from app.storage.cache_eviction import evict
from app.storage.link_meshes import Rgb
from app.storage.unreadable import UNREADABLE
from environments.robots import Robot

KEPT = 100  # files, of a few hundred kB each
LONGEST = 20_000_000  # bytes of one
SOURCES = ("app/dashboard/scene/arm_parts.py", "app/storage/mesh_reading.py", "environments/urdf.py")


@dataclass(frozen=True)
class ArmPart:
    """Part of an arm: the triangles of one colour that move with one joint, in that joint's frame. vertices: (N, 3) m;
    faces: (M, 3)."""

    joint: int
    color: Rgb
    vertices: np.ndarray
    faces: np.ndarray


class PartStore:
    """Parts of shipped arms, kept on disk in a folder, by default that of the kernels. Disk errors are ignored, and a
    file that holds no parts counts as none. kept: number of files from which on half of them are removed."""

    def __init__(self, folder: Path | None = None, kept: int = KEPT) -> None:
        self._folder, self._kept = folder if folder is not None else cache_folder() / "parts", kept

    def read(self, robot: Robot, cell: float, coat: float) -> list[ArmPart] | None:
        """Parts of an arm, see `arm_parts.parts`; None where they are not known."""
        try:
            path = self._path(robot, cell, coat)
            if path.stat().st_size > LONGEST:
                return None
            with np.load(path, allow_pickle=False) as file:
                return _parts(file, robot.model.njoints)
        except (OSError, *UNREADABLE):
            return None

    def write(self, robot: Robot, cell: float, coat: float, parts: list[ArmPart]) -> None:
        """Keep the parts of an arm."""
        with contextlib.suppress(OSError):
            self._folder.mkdir(parents=True, exist_ok=True)
            evict(self._folder, self._kept)
            write_whole(
                self._path(robot, cell, coat),
                lambda file: np.savez(
                    file,
                    joints=[part.joint for part in parts],
                    colors=[part.color for part in parts],
                    counts=[(len(part.vertices), len(part.faces)) for part in parts],
                    vertices=np.vstack([part.vertices for part in parts]),
                    faces=np.vstack([part.faces for part in parts]),
                ),
            )

    def _path(self, robot: Robot, cell: float, coat: float) -> Path:
        shown = robot.joint_names, sorted(robot.locked.items()), robot.tool_frame, robot.tool_offset.tolist()
        digest = hashlib.sha256(f"{_version()} {shown} {cell} {coat} {robot.urdf}".encode())
        digest.update(robot.urdf.read_bytes())
        return self._folder / f"{digest.hexdigest()}.npz"


def _parts(file: np.lib.npyio.NpzFile, joints: int) -> list[ArmPart]:
    """Parts in a file of `PartStore`. Raises ValueError and KeyError for other contents."""
    vertices, faces, counts = file["vertices"], file["faces"], file["counts"]
    if vertices.ndim != 2 or vertices.shape[1] != 3 or not np.isfinite(vertices).all():
        raise ValueError("vertices")
    if faces.ndim != 2 or faces.shape[1] != 3 or [len(vertices), len(faces)] != counts.sum(axis=0).tolist():
        raise ValueError("faces")
    found, ends = [], np.cumsum(counts, axis=0)[:-1]
    split = np.split(vertices, ends[:, 0]), np.split(faces, ends[:, 1])
    for joint, (r, g, b), corners, triangles in zip(file["joints"], file["colors"], *split, strict=True):
        if not (0 <= joint < joints and triangles.min(initial=0) >= 0 and triangles.max(initial=0) < len(corners)):
            raise ValueError("parts")
        found.append(ArmPart(int(joint), (int(r), int(g), int(b)), corners, triangles))
    return found


@cache
def _version() -> str:
    """Digest of the sources that make parts, and the versions of the libraries and of the arms."""
    root, digest = Path(__file__).parents[2], hashlib.sha256()
    for source in SOURCES:
        digest.update((root / source).read_bytes())
    libraries = ("trimesh", "yourdfpy", "numpy", "example-robot-data")
    return f"{digest.hexdigest()} {[metadata.version(each) for each in libraries]}"
