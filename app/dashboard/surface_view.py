"""The surface in the 3-D scene, drawn from the function that the physics uses, and moved as it moves."""

from __future__ import annotations

import time

import numpy as np
import viser

from app.dashboard.theme import SURFACE
from app.runner import Snapshot
from environments.surfaces import Surface

_REDRAW = 1 / 12  # s of wall time, between two forms of a surface that changes its own


class SurfaceView:
    """A translucent mesh. A rigid motion moves its node; a form that changes in time gets other vertices."""

    def __init__(self, scene: viser.SceneApi) -> None:
        self._scene = scene
        self._mesh: viser.MeshHandle | None = None
        self._key: object = None
        self._around = np.zeros(3)
        self._formed_at, self._formed_for = 0.0, 0.0

    def form(self, snapshot: Snapshot) -> None:
        """Give it the form that the snapshot's surface has."""
        key = (snapshot.scenario.surface, snapshot.surface is None)
        if key != self._key:
            self._key = key
            self._around = snapshot.tool.copy()
            self._draw(snapshot.surface, snapshot.t)
        elif self._mesh is not None and snapshot.surface is not None and snapshot.surface.changing:
            self._reform(self._mesh, snapshot.surface, snapshot.t)

    def place(self, snapshot: Snapshot) -> None:
        """Move it as one body."""
        if self._mesh is not None:
            self._mesh.position = snapshot.surface_offset

    def _draw(self, surface: Surface | None, t: float) -> None:
        if self._mesh is not None:
            self._mesh.remove()
            self._mesh = None
        if surface is None:
            return
        vertices, faces = _arrays(surface, self._around, t)
        self._mesh = self._scene.add_mesh_simple(
            "/surface",
            vertices,
            faces,
            color=SURFACE,
            opacity=0.38,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
        )

    def _reform(self, mesh: viser.MeshHandle, surface: Surface, t: float) -> None:
        now = time.monotonic()
        if t == self._formed_for or now - self._formed_at < _REDRAW:
            return
        self._formed_at, self._formed_for = now, t
        mesh.vertices, faces = _arrays(surface, self._around, t)
        if not np.array_equal(faces, mesh.faces):
            mesh.faces = faces


def _arrays(surface: Surface, around: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
    vertices, faces = surface.mesh(around, t)
    return np.asarray(vertices, dtype=np.float32), np.asarray(faces, dtype=np.uint32)
