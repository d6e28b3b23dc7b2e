"""Handle on the tool: the mouse pushes the tool by a spring, turns it by a torsional one, or moves the target, which
takes effect when the handle is let go."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
import viser

from app.dashboard.scene.arrows import ForceArrow
from app.dashboard.theme.colors import ACCENT, DESIRED, PUSH
from app.dashboard.transport.callback_errors import guarded
from app.dashboard.transport.viser_private import move
from app.dashboard.view_options import NEWTON_METRES
from app.dashboard.widgets.fields.controls import Desk
from app.session.commands import DragTool, Edit
from app.session.snapshot import Snapshot
from environments.push import Grip

RADIUS = 0.045  # m
LEVER = 0.1  # m that the pointer moves per radian that the ball turns
RESOLUTION = 4  # decimals of the shift, m
_BESIDE = np.array([RADIUS, 0.0, RADIUS])  # m, from the tool to the hint


@dataclass(frozen=True)
class HeldHandle:
    """Drag of the handle that is going on.
    client: whose pointer it is.
    run: in which it has begun; playing: whether a snapshot has shown it running since.
    since: number of commands that had been carried out then; earlier snapshots say nothing of it.
    drag: push, turn, or move of the target.
    offset: (3,) m; for a push: anchor minus pointer; for a turn: point of the ball that the pointer holds; for a moved
    target: coordinates g under the pointer at the beginning.
    moved: displacement of the coordinates g by the pointer, (3,) m.
    R: orientation (3, 3) of the tool at the beginning.
    grasped: direction (3,) from the ball's middle to the point that the pointer holds."""

    client: int
    run: int
    playing: bool
    since: int
    drag: str
    offset: np.ndarray
    moved: np.ndarray
    R: np.ndarray
    grasped: np.ndarray

    def over(self, snapshot: Snapshot) -> bool:
        """Whether the drag has ended without its page: another run has begun, or the run was paused."""
        if snapshot.executed < self.since:
            return False
        return snapshot.run > self.run or (self.playing and snapshot.phase != "running")

    def turned(self, pointer: np.ndarray) -> tuple[float, float, float]:
        """Rotation vector, rad, of the orientation to which the pointer (3,) m turns the tool, like a ball that it
        holds at its outside."""
        by = pin.exp3(np.cross(self.grasped, pointer - self.offset) / LEVER)
        x, y, z = pin.log3(by @ self.R).tolist()
        return x, y, z


def orientation(snapshot: Snapshot) -> np.ndarray:
    """Orientation (3, 3) of the tool in a snapshot."""
    robot, data = snapshot.robot, snapshot.robot.model.createData()
    pin.forwardKinematics(robot.model, data, snapshot.q)
    return data.oMi[robot.tool_joint].rotation @ robot.tool_placement.rotation


def shift_coordinates(snapshot: Snapshot) -> slice:
    """Slice of the coordinates (phi, psi_1, psi_2), or x, y, z, that a shift moves."""
    return slice(snapshot.system.pressed, snapshot.system.layout.positions)


def shifted(snapshot: Snapshot, moved: np.ndarray) -> Edit:
    """Command that shifts the desired path. moved: further shift of its coordinates, (3,) m."""
    free = shift_coordinates(snapshot)
    by = np.zeros(free.stop - free.start)
    given = snapshot.scenario.shift.by
    by[: len(given)] = given
    return Edit("shift.by", np.round(by + moved[free], RESOLUTION).tolist())


class ToolDrag:
    """Drag of the tool: a ball that the mouse drags, and the drawing of a push by any page. A hint beside the ball says
    that it can be dragged, until somebody has dragged it. One page drags at a time.

    viser ends the drag of a page that closes: the tool is let go, and the target stays where it was."""

    def __init__(self, scene: viser.SceneApi, desk: Desk, connected: Callable[[int], bool]) -> None:
        self._desk, self._connected = desk, connected
        self._held: HeldHandle | None = None
        self._taken_once = False
        # also visible without a drag: it is the object that the mouse takes hold of
        self._handle = scene.add_icosphere(
            "/hand/handle", RADIUS, ACCENT, subdivisions=2, opacity=0.4, cast_shadow=False, receive_shadow=False
        )
        self._target = scene.add_icosphere(
            "/hand/target",
            RADIUS,
            DESIRED,
            subdivisions=2,
            opacity=0.55,
            cast_shadow=False,
            receive_shadow=False,
            visible=False,
        )
        self._spring = scene.add_line_segments(
            "/hand/spring", np.zeros((1, 2, 3)), PUSH, thickness=3.0, thickness_units="screen", visible=False
        )
        self._arrow = ForceArrow(scene, "/force/push", "push", PUSH, side="top-left")
        self._axis = ForceArrow(scene, "/force/moment", "turned", PUSH, side="bottom-right", unit="N·m")
        self._hint = scene.add_label("/hand/hint", "drag this ball", anchor="center-left")
        self._handle.on_drag("left")(guarded(self._on_drag, desk.complain))
        self._handle.on_drag("left", modifier="shift")(guarded(self._on_shift_drag, desk.complain))

    @property
    def held(self) -> HeldHandle | None:
        """The drag that is going on; another object whenever it has moved the target."""
        return self._held

    async def _on_drag(self, event: viser.SceneNodeDragEvent) -> None:
        self._drag(event, self._desk.viewing.scene_options.drag)

    async def _on_shift_drag(self, event: viser.SceneNodeDragEvent) -> None:
        self._drag(event, "target" if self._desk.viewing.scene_options.drag == "push" else "push")

    def _drag(self, event: viser.SceneNodeDragEvent, drag: str) -> None:
        snapshot, pointer = self._desk.snapshot(), np.array(event.end_position)
        if event.phase == "start":
            if self._held is not None:
                if self._held.client != event.client_id and self._connected(self._held.client):
                    return  # one hand at a time: the push of the first would never be let go
                self._let_go(snapshot, self._held)  # its end has not come
            self._held = self._taken(snapshot, event, drag)
        self._drop_if_over(snapshot)
        held = self._held
        if held is None or held.client != event.client_id:
            return
        if snapshot.phase == "running" and not held.playing:
            self._held = held = replace(held, playing=True, since=snapshot.executed)
        if event.phase == "end":
            self._held = None
            self._let_go(snapshot, held)
        elif held.drag == "push":
            options = self._desk.viewing.scene_options
            x, y, z = (float(c) for c in pointer + held.offset)
            self._pull(Grip((x, y, z), options.stiffness, options.limit))
        elif held.drag == "turn":
            options = self._desk.viewing.scene_options
            grip = Grip(None, turned=held.turned(pointer), torsion=options.torsion, moment_limit=options.moment_limit)
            self._pull(grip)
        else:
            moved = snapshot.system.charted.chart(pointer, snapshot.t).g - held.offset
            self._held = replace(held, moved=moved)

    def _drop_if_over(self, snapshot: Snapshot) -> None:
        """Forget a drag that is over: the pointer moves nothing until it takes hold again. A drag that another thread
        has begun meanwhile stays."""
        held = self._held
        if held is not None and held.over(snapshot) and self._held is held:
            self._held = None
            if held.drag != "target":
                self._desk.post(DragTool(None))  # a pull that was under way may have taken hold again

    def _pull(self, grip: Grip) -> None:
        if self._desk.post(DragTool(grip)) is None:  # a lesson's goal has begun meanwhile
            self._held = None
            self._desk.post(DragTool(None))

    def _taken(self, snapshot: Snapshot, event: viser.SceneNodeDragEvent, drag: str) -> HeldHandle | None:
        grab, playing = np.array(event.start_position), snapshot.phase == "running"
        begun = event.client_id, snapshot.run, playing, snapshot.executed
        away = grab - snapshot.tool
        turning = (np.zeros(3), orientation(snapshot), away / max(float(np.linalg.norm(away)), 1e-9))
        if drag != "target" and self._desk.lock.refuses("a push by hand"):
            return None
        if drag != "target" and snapshot.looking_back:
            self._desk.complain("push: the past cannot be pushed; allowed: at the end of the run, or after a fork (F)")
            return None
        if drag == "push":
            return HeldHandle(*begun, drag, -away, *turning)
        if drag == "turn":
            return HeldHandle(*begun, drag, grab, *turning)
        if snapshot.tool_desired is None:
            self._desk.complain("target: cannot be dragged in joint space; allowed: Cartesian task spaces")
            return None
        free = shift_coordinates(snapshot)
        if free.start == free.stop:
            self._desk.complain(
                "target: every coordinate of position is pressed; allowed: where one of them follows the path"
            )
            return None
        return HeldHandle(*begun, drag, snapshot.system.charted.chart(grab, snapshot.t).g, *turning)

    def _let_go(self, snapshot: Snapshot, held: HeldHandle) -> None:
        if held.drag != "target":
            self._desk.post(DragTool(None))
            return
        moved = np.abs(held.moved[shift_coordinates(snapshot)]).max() >= 10.0**-RESOLUTION
        if moved and self._connected(held.client):
            self._desk.post(shifted(snapshot, held.moved))

    def show(self, snapshot: Snapshot, newtons: float) -> None:
        """Show the handle at the tool, and the spring that holds it. newtons: per `UNIT` of arrow."""
        tool, push = snapshot.tool, snapshot.push
        self._drop_if_over(snapshot)
        move(self._handle, tool)
        self._arrow.show(tool, push, newtons)
        self._axis.show(tool, snapshot.push_moment, NEWTON_METRES)
        grip = snapshot.state.grip
        anchor = None if grip is None else grip.anchor
        if anchor is not None:
            self._spring.points = np.array([[tool, anchor]], dtype=np.float32)
        self._spring.visible = anchor is not None
        self._taken_once |= self._held is not None
        self._hint.visible = not self._taken_once and not push.any() and not snapshot.push_moment.any()
        if self._hint.visible:
            move(self._hint, tool + _BESIDE)
        self._show_target(snapshot)

    def _show_target(self, snapshot: Snapshot) -> None:
        """Show the place of the present desired point with the drag's shift."""
        held, desired = self._held, snapshot.tool_desired
        dragged = held is not None and held.drag == "target" and desired is not None
        if held is not None and desired is not None and dragged:
            g, free = snapshot.system.charted.chart(desired, snapshot.t).g, shift_coordinates(snapshot)
            g[free] += held.moved[free]
            move(self._target, snapshot.system.charted.point(g, snapshot.t))
        self._target.visible = dragged
