"""3-D scene: arm, ghost, surface, paths and forces of the newest snapshot."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import viser

from app.dashboard.scene.arrows import ForceArrow, ForceScale, TaskFrame
from app.dashboard.scene.camera import look as look_from
from app.dashboard.scene.camera import viewpoint
from app.dashboard.scene.pinned_arms import PinnedArms
from app.dashboard.scene.robot_view import Paint, RobotView
from app.dashboard.scene.spring_damper import SpringDamper
from app.dashboard.scene.surface_view import SurfaceView
from app.dashboard.scene.trails import Trail
from app.dashboard.theme.colors import DESIRED, GHOST, GRID, GRID_SECTION, MEASURED, TOOL_PATH, Theme
from app.dashboard.view_options import Legend, SceneOptions
from app.scenario.schema import Scenario
from app.session.ghost import Ghost, GhostPose
from app.session.snapshot import Snapshot
from environments.robots import Robot

_ASIDE = np.array([0.0, 0.03, 0.0])  # m: keeps the desired force apart from the true one
_GHOST_CELL = 0.01  # m: enough detail for the translucent arm
_GHOST_PAINT = Paint(GHOST, opacity=0.3, coat=0.003)
_BETWEEN = 1 / 30  # s between two points of a path that are taken from the recording
_BACK = 10.0  # s of the recording that are drawn as paths where no frame was drawn meanwhile


class SceneView:
    """View of the scene: `show` moves its objects, and rebuilds only those that another scenario or option changes."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        scene = server.scene
        scene.configure_default_lights(enabled=False)
        scene.configure_environment_map(None)
        scene.world_axes.visible = False
        # one side brighter than the other shows the shape of objects of one colour
        scene.add_light_hemisphere("/light/sky", sky_color=(255, 255, 255), ground_color=(110, 110, 125), intensity=1.3)
        scene.add_light_directional("/light/key", intensity=2.4, position=(0.8, -1.6, 2.0))
        scene.add_light_directional("/light/fill", color=(190, 205, 255), intensity=0.7, position=(-1.5, 0.6, 0.5))
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
        self._desired_path = Trail(scene, "/path/desired", DESIRED, thickness=2.0)
        self._tool_path = Trail(scene, "/path/tool", TOOL_PATH, thickness=5.0)
        self._force = ForceArrow(scene, "/force/true", "force", MEASURED, side="bottom-left")
        self._desired = ForceArrow(scene, "/force/desired", "desired", DESIRED, side="top-right")
        self._scale = ForceScale()
        self._frame = TaskFrame(scene, "/frame")
        self._spring = SpringDamper(scene, "/spring_damper")
        self._ghost = Ghost()
        self._arms = 0
        self._robot_view: RobotView | None = None
        self._known_arm: Robot | None = None
        self._arm_key: object = None  # equal for arms that look the same
        self._robot_key: object = None
        self._ghost_view: RobotView | None = None
        self._ghost_key: object = None
        self._seen_robot: object = None
        self._pinned = PinnedArms(scene, self._new_root)
        self._surfaces = [SurfaceView(scene, number) for number in range(3)]
        self._run = -1
        self._traced = 0.0  # s, instant up to which the paths are drawn

    def set_theme(self, theme: Theme) -> None:
        """Set the grid's colours; the page's style sheet sets the background."""
        self._grid.cell_color, self._grid.section_color = GRID[theme], GRID_SECTION[theme]

    @property
    def has_new_meshes(self) -> bool:
        """Whether meshes have come for an arm that is drawn with bones."""
        arms = self._robot_view, self._ghost_view, self._pinned
        return any(arm is not None and arm.has_new_meshes for arm in arms)

    def show(self, snapshot: Snapshot, options: SceneOptions) -> Legend:
        """Draw a snapshot; returns the present legend of lengths and colours."""
        ghost = self._ghost.follow(snapshot) if options.ghost else None
        pose = ghost if isinstance(ghost, GhostPose) else None
        self._rebuild(snapshot, options, pose)
        newtons = self._scale.fit((snapshot.force, snapshot.force_desired, snapshot.push), options.newtons)
        if self._robot_view is not None:
            self._robot_view.show(snapshot.q)
        if self._ghost_view is not None:
            self._ghost_view.set_visible(visible=pose is not None)
            if pose is not None:
                self._ghost_view.show(pose.q)
        self._pinned.show(snapshot, wanted=options.pinned_arms)
        for surface in self._surfaces:
            surface.place(snapshot, visible=options.surface)
        for arrow, start, force in (
            (self._force, snapshot.tool, snapshot.force),
            (self._desired, snapshot.tool + _ASIDE, snapshot.force_desired),
        ):
            arrow.show(start, force if options.forces else np.zeros(3), newtons)
        if options.frame:
            system = snapshot.system
            self._frame.show(system.charted, system.layout.position_indices, snapshot.tool, snapshot.t)
        else:
            self._frame.hide()
        if options.spring:
            self._spring.show(snapshot.tool, snapshot.tool_desired, options.times)
        else:
            self._spring.hide()
        self._grid.visible = options.grid
        if not snapshot.looking_back:  # then the paths of the whole run are drawn already
            self._extend_paths(snapshot)
        return Legend(self._tool_path.scale, newtons, ghost.distance if isinstance(ghost, GhostPose) else ghost)

    def draw_paths(self, options: SceneOptions) -> None:
        """Send the paths; they are long, so this happens less often than `show`."""
        self._tool_path.draw(shown=options.tool_path, largest=self._tool_path.scale if options.error_colors else None)
        self._desired_path.draw(shown=options.desired_path, largest=None)

    def _extend_paths(self, snapshot: Snapshot) -> None:
        if snapshot.t - self._traced > _BACK + _BETWEEN:
            self._tool_path.clear()
            self._desired_path.clear()
        newest = _PathPoint(snapshot.t, snapshot.tool, snapshot.tool_desired)
        for point in (*_recorded(snapshot, max(self._traced, snapshot.t - _BACK)), newest):
            self._tool_path.extend(point.tool, lambda at=point: _path_error(snapshot, at))
            if point.desired is not None:
                self._desired_path.extend(point.desired)
        self._traced = snapshot.t

    def _rebuild(self, snapshot: Snapshot, options: SceneOptions, pose: GhostPose | None) -> None:
        if snapshot.run != self._run:
            self._run, self._traced = snapshot.run, snapshot.t - _BACK
            self._tool_path.clear()
            self._desired_path.clear()
        for surface in self._surfaces:
            surface.form(snapshot)
        arm = snapshot.robot
        if arm is not self._known_arm:
            self._known_arm = arm
            self._arm_key = arm.urdf, arm.joint_names, arm.tool_frame, arm.tool_offset.tolist()
        robot = self._arm_key
        if (robot, options.cell) != self._robot_key:
            self._robot_key = robot, options.cell
            self._robot_view = self._arm(snapshot, self._robot_view, options.cell, None)
            self._robot_view.show(snapshot.q)
        if pose is not None and robot != self._ghost_key:
            self._ghost_key = robot
            self._ghost_view = self._arm(snapshot, self._ghost_view, _GHOST_CELL, _GHOST_PAINT)
        if robot != self._seen_robot:
            self._seen_robot = robot
            self._look_at(snapshot)

    def _arm(self, snapshot: Snapshot, old: RobotView | None, cell: float, paint: Paint | None) -> RobotView:
        if old is not None:
            old.remove()
        return RobotView(self._server.scene, snapshot.robot, self._new_root(), cell, paint)

    def _new_root(self) -> str:
        """Name of the next arm's scene node, new each time: messages on a removed arm may still be on their way."""
        self._arms += 1
        return f"/robot_{self._arms}"

    def _look_at(self, snapshot: Snapshot) -> None:
        """Move the camera of every page so that the snapshot's whole arm is in view."""
        view = viewpoint("whole arm", snapshot)
        initial = self._server.initial_camera
        initial.position, initial.look_at = view.position, view.look_at
        for client in self._server.get_clients().values():
            look_from(client.camera, view)


class _PathPoint(NamedTuple):
    """Tool and its desired point at an instant (s), each (3,) m; None where nothing is desired of the tool."""

    t: float
    tool: np.ndarray
    desired: np.ndarray | None


def _recorded(snapshot: Snapshot, since: float) -> Iterator[_PathPoint]:
    """Points between an instant (s) and the snapshot, as far as the present task goes back: of a fast run, of one that
    nobody has looked at for a while, or of the beginning of a fork."""
    if snapshot.t - since <= 1.5 * _BETWEEN:
        return  # as in most frames
    begin, system = _task_begun(snapshot, since), snapshot.system
    instants = np.arange(begin + _BETWEEN, snapshot.t - 0.5 * _BETWEEN, _BETWEEN)
    rows = snapshot.recording.stretch(begin, snapshot.t)
    for k in np.unique(np.searchsorted(rows["t"], instants)):
        if k < len(rows["t"]):
            t, r_d = float(rows["t"][k]), rows["r_d"][k]
            yield _PathPoint(t, rows["tool"][k], None if snapshot.tool_desired is None else system.tool_at(r_d, t))


def _task_begun(snapshot: Snapshot, since: float) -> float:
    """Instant (s), `since` or later, from which on r_d has meant what it means now."""
    begun, task = snapshot.t, _task_of(snapshot.scenario)
    for epoch in reversed(tuple(snapshot.recording.epochs)):  # a copy: the loop's thread adds
        if _task_of(epoch.scenario) != task:
            return begun
        if epoch.t <= since:
            break
        begun = epoch.t
    return since


def _task_of(scenario: Scenario) -> tuple[object, ...]:
    """Parts of a scenario that the coordinates r depend on."""
    surfaces = [(each.path, each.form) for each in scenario.surfaces]
    return scenario.mode, scenario.robot, scenario.task_space, surfaces, scenario.face


def _path_error(snapshot: Snapshot, at: _PathPoint) -> float:
    """Distance of the tool from its desired point, m; along the surfaces only, since the depth belongs to the
    force."""
    if at.desired is None:
        return 0.0
    error = at.tool - at.desired
    if snapshot.surfaces:
        normals = [each.chart(at.tool, at.t).G[0] for each in snapshot.surfaces]
        if len(normals) == 1:  # a factorisation takes ten times as long
            error = error - normals[0] * ((normals[0] @ error) / (normals[0] @ normals[0]))
        else:
            directions = np.linalg.qr(np.column_stack(normals))[0]
            error = error - directions @ (directions.T @ error)
    return math.sqrt(error @ error)
