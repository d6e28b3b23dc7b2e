"""Surface in the 3-D scene, drawn from the function that the physics uses, and moved as it moves."""

from __future__ import annotations

import time

import numpy as np
import viser

from app.dashboard.theme.colors import SURFACE, SURFACE_LINES
from app.dashboard.transport.viser_private import move
from app.session.snapshot import Snapshot
from environments.surfaces.form import Form
from environments.surfaces.table import Surface

_REDRAW = 1 / 10  # s of wall time, between two drawings of a surface whose form changes
_LINE_EVERY = 4  # cells of the mesh
_FAR = 0.15  # m: a tool so far from where the mesh was drawn gets another piece of the surface


class SurfaceView:
    """View of one of up to three surfaces: a translucent mesh, with lines of constant psi that show its curvature. A
    rigid motion moves the scene node; a form that changes in time gets other vertices."""

    def __init__(self, scene: viser.SceneApi, number: int) -> None:
        self._scene, self._number = scene, number
        self._name = "/surface" if number == 0 else f"/surface_{number + 1}"
        self._mesh: viser.MeshHandle | None = None
        self._lines: viser.LineSegmentsHandle | None = None
        self._key: Form | None = None
        self._around = np.zeros(3)
        self._formed_at, self._formed_for = 0.0, 0.0

    def form(self, snapshot: Snapshot) -> None:
        """Give the mesh the form of the snapshot's surface of this number, if there is one."""
        surface = self._of(snapshot)
        key = None if surface is None else surface.form
        far = surface is not None and np.linalg.norm(snapshot.tool - self._around) > _FAR
        if key != self._key or far:
            self._key = key
            self._around = snapshot.tool.copy()
            self._draw(surface, snapshot.t)
        elif self._mesh is not None and surface is not None and surface.changing:
            self._reform(surface, snapshot.t)

    def place(self, snapshot: Snapshot, *, visible: bool) -> None:
        """Move the mesh as one body."""
        surface = self._of(snapshot)
        if self._mesh is not None and surface is not None:
            move(self._mesh, surface.motion.offset(snapshot.t))
            self._mesh.visible = visible

    def _of(self, snapshot: Snapshot) -> Surface | None:
        return snapshot.surfaces[self._number] if self._number < len(snapshot.surfaces) else None

    def _draw(self, surface: Surface | None, t: float) -> None:
        if self._mesh is not None:
            self._mesh.remove()  # and its lines with it
            self._mesh = self._lines = None
        if surface is None:
            return
        vertices, faces = _arrays(surface, self._around, t)
        self._mesh = self._scene.add_mesh_simple(
            self._name,
            vertices,
            faces,
            color=SURFACE,
            opacity=0.38,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
        )

        if surface.resolution > _LINE_EVERY:
            self._lines = self._scene.add_line_segments(
                f"{self._name}/lines",
                _lines(vertices, faces, surface.resolution),
                SURFACE_LINES,
                thickness=1.0,
                thickness_units="screen",
            )

    def _reform(self, surface: Surface, t: float) -> None:
        now = time.monotonic()
        if self._mesh is None or t == self._formed_for or now - self._formed_at < _REDRAW:
            return
        self._formed_at, self._formed_for = now, t
        vertices, faces = _arrays(surface, self._around, t)
        self._mesh.vertices = vertices
        if not np.array_equal(faces, self._mesh.faces):
            self._mesh.faces = faces
        if self._lines is not None:
            self._lines.points = _lines(vertices, faces, surface.resolution)


def _arrays(surface: Surface, around: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
    vertices, faces = surface.mesh(around, t)
    return np.asarray(vertices, dtype=np.float32), np.asarray(faces, dtype=np.uint32)


def _lines(vertices: np.ndarray, faces: np.ndarray, resolution: int) -> np.ndarray:
    """Segments (N, 2, 3) along some rows and columns of the mesh's grid, where it has triangles."""
    number = np.arange(resolution**2).reshape(resolution, resolution)
    rows, columns = number[::_LINE_EVERY], number[:, ::_LINE_EVERY]
    starts = np.concatenate([rows[:, :-1].ravel(), columns[:-1].ravel()])
    ends = np.concatenate([rows[:, 1:].ravel(), columns[1:].ravel()])
    there = np.isin(number.ravel(), faces)
    drawn = there[starts] & there[ends]
    return np.stack([vertices[starts[drawn]], vertices[ends[drawn]]], axis=1)
