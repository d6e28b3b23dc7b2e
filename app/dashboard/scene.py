"""The 3-D scene: arm, surface, paths and forces of the newest snapshot."""

from __future__ import annotations

from collections import deque

import numpy as np
import viser

from app.dashboard.robot_view import RobotView
from app.dashboard.theme import DESIRED, GRID, GRID_SECTION, MEASURED, SURFACE, TOOL_PATH, Rgb, Theme
from app.runner import Snapshot
from environments.surfaces import Plane

_METRES_PER_NEWTON = 0.007
_LEAST_FORCE = 0.2  # N: below this no arrow
_ASIDE = np.array([0.0, 0.03, 0.0])  # m: keeps the desired force apart from the measured one


class Trail:
    """The last points of a moving point, as a line."""

    def __init__(self, scene: viser.SceneApi, name: str, color: Rgb, thickness: float) -> None:
        self._points: deque[np.ndarray] = deque(maxlen=500)
        self._line = scene.add_line_segments(
            name, np.zeros((1, 2, 3)), color, thickness=thickness, thickness_units="screen", visible=False
        )
        self._changed = False

    def extend(self, point: np.ndarray, spacing: float = 0.001) -> None:
        if not self._points or np.linalg.norm(point - self._points[-1]) > spacing:
            self._points.append(np.array(point))
            self._changed = True

    def clear(self) -> None:
        self._points.clear()
        self._line.visible = False

    def draw(self) -> None:
        if self._changed and len(self._points) > 1:
            points = np.array(self._points)
            self._line.points = np.stack([points[:-1], points[1:]], axis=1)
            self._line.visible = True
        self._changed = False


class ForceArrow:
    """An arrow from a point along a force, to scale; none for a force near zero."""

    def __init__(self, scene: viser.SceneApi, name: str, color: Rgb) -> None:
        self._arrow = scene.add_arrows(
            name,
            np.array([[[0.0, 0.0, 0.0], [0.0, 0.0, 0.1]]]),
            color,
            shaft_radius=0.008,
            head_radius=0.02,
            head_length=0.04,
            visible=False,
        )

    def show(self, start: np.ndarray, force: np.ndarray) -> None:
        visible = bool(np.linalg.norm(force) > _LEAST_FORCE)
        if visible:
            self._arrow.points = np.stack([start, start + _METRES_PER_NEWTON * force])[None].astype(np.float32)
        self._arrow.visible = visible


class SceneView:
    """Everything in the 3-D view; `show` moves it, and rebuilds only what another scenario changes."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        scene = server.scene
        scene.configure_default_lights(enabled=True, cast_shadow=False)
        scene.configure_environment_map(None)
        scene.world_axes.visible = False
        scene.add_light_hemisphere("/light", sky_color=(255, 255, 255), ground_color=(150, 150, 160), intensity=1.2)
        self._grid = scene.add_grid(
            "/grid",
            width=4.0,
            height=4.0,
            cell_size=0.1,
            section_size=0.5,
            cell_color=GRID["dark"],
            section_color=GRID_SECTION["dark"],
            shadow_opacity=0.0,
        )
        self._desired_path = Trail(scene, "/path/desired", DESIRED, thickness=5.0)
        self._tool_path = Trail(scene, "/path/tool", TOOL_PATH, thickness=2.0)
        self._measured = ForceArrow(scene, "/force/measured", MEASURED)
        self._desired = ForceArrow(scene, "/force/desired", DESIRED)
        self._robot_view: RobotView | None = None
        self._robot_key: object = None
        self._robots = 0
        self._surface_key: object = None
        self._surface: viser.MeshHandle | None = None
        self._run = -1

    def set_theme(self, theme: Theme) -> None:
        """The grid's colours; what lies behind it is the page's."""
        self._grid.cell_color, self._grid.section_color = GRID[theme], GRID_SECTION[theme]

    def show(self, snapshot: Snapshot) -> None:
        self._rebuild(snapshot)
        with self._server.atomic():
            if self._robot_view is not None:
                self._robot_view.show(snapshot.q)
            if self._surface is not None:
                self._surface.position = snapshot.surface_offset
            self._measured.show(snapshot.tool, snapshot.force)
            self._desired.show(snapshot.tool + _ASIDE, snapshot.force_desired)
        self._tool_path.extend(snapshot.tool)
        if snapshot.tool_desired is not None:
            self._desired_path.extend(snapshot.tool_desired)

    def draw_paths(self) -> None:
        """Send the paths; they are long, so this happens less often than `show`."""
        self._tool_path.draw()
        self._desired_path.draw()

    def _rebuild(self, snapshot: Snapshot) -> None:
        if snapshot.run != self._run:
            self._run = snapshot.run
            self._tool_path.clear()
            self._desired_path.clear()
        robot_key = (snapshot.robot.urdf, tuple(snapshot.robot.joint_names))
        if robot_key != self._robot_key:
            self._robot_key = robot_key
            if self._robot_view is not None:
                self._robot_view.remove()
            self._robots += 1  # a name of its own: messages about the removed one may still be under way
            self._robot_view = RobotView(self._server.scene, snapshot.robot, f"/robot_{self._robots}")
            self._robot_view.show(snapshot.q)
            self._look_at(snapshot.tool, max(float(np.linalg.norm(snapshot.tool)), self._robot_view.extent))
        surface_key = (snapshot.scenario.surface, snapshot.surface is None)
        if surface_key != self._surface_key:
            self._surface_key = surface_key
            self._draw_surface(snapshot)

    def _draw_surface(self, snapshot: Snapshot) -> None:
        if self._surface is not None:
            self._surface.remove()
            self._surface = None
        if snapshot.surface is None:
            return
        vertices, faces = snapshot.surface.mesh()
        if isinstance(snapshot.surface, Plane):  # it has no middle of its own: show the part where the tool is
            normal, along = snapshot.surface.frame[0], snapshot.tool - snapshot.surface.origin
            vertices = vertices + along - normal * (normal @ along)
        self._surface = self._server.scene.add_mesh_simple(
            "/surface",
            np.asarray(vertices, dtype=np.float32),
            np.asarray(faces, dtype=np.uint32),
            color=SURFACE,
            opacity=0.38,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
        )

    def _look_at(self, tool: np.ndarray, reach: float) -> None:
        """A view from the side on which the tool works, with the whole arm in it."""
        target = 0.55 * tool + np.array([0.0, 0.0, 0.05 * reach])
        position = target + reach * np.array([0.85, -1.45, 0.8])
        camera = self._server.initial_camera
        camera.position, camera.look_at = position, target
        for client in self._server.get_clients().values():
            client.camera.position, client.camera.look_at = position, target
