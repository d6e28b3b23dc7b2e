"""Camera views: the whole arm, from the front, from the side, and the contact close up."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import viser

from app.session.snapshot import Snapshot

FLIGHT, FRAMES = 0.4, 16  # s, and number of steps
CLOSE = 0.42  # m from the tool
STRETCHED = 0.8  # of the length of a planar arm's links
VIEWS = ("whole arm", "front", "side", "contact")


@dataclass(frozen=True)
class Viewpoint:
    """Viewpoint: position (3,) m of the camera and the point look_at (3,) m in the middle of the picture, z upwards."""

    position: np.ndarray
    look_at: np.ndarray


def viewpoint(view: str, snapshot: Snapshot) -> Viewpoint:
    """Viewpoint of one of `VIEWS` for the snapshot's arm. Front is the side on which the tool is. Raises ValueError."""
    tool, up = snapshot.tool, np.array([0.0, 0.0, 1.0])
    reach = max(float(np.linalg.norm(tool)), _extent(snapshot))
    out = np.array([tool[0], tool[1], 0.0])
    out = out / np.linalg.norm(out) if np.linalg.norm(out) > 1e-3 else np.array([1.0, 0.0, 0.0])
    aside = np.cross(out, up)
    target = 0.55 * tool + 0.05 * reach * up
    match view:
        case "front":
            return Viewpoint(target + reach * (1.85 * out + 0.35 * up), target)
        case "side":
            return Viewpoint(target + reach * (1.85 * aside + 0.15 * up), target)
        case "contact":
            free = np.zeros(3)
            if snapshot.surfaces:
                normal = snapshot.surfaces[0].chart(tool, snapshot.t).G[0]
                free = -normal / np.linalg.norm(normal)
            away = 0.55 * out + 0.7 * aside + 0.45 * free + 0.15 * up
            target = tool - 0.06 * up  # where the forces are drawn
            return Viewpoint(target + CLOSE * away / np.linalg.norm(away), target)
        case "whole arm":
            return Viewpoint(target + reach * np.array([0.85, -1.45, 0.8]), target)
        case _:
            raise ValueError(f"view: {view!r}; allowed: {', '.join(VIEWS)}")


def _extent(snapshot: Snapshot) -> float:
    """Distance of the farthest joint from the base, m; for a planar arm, that of the stretched arm."""
    robot, data = snapshot.robot, snapshot.robot.model.createData()
    pin.forwardKinematics(robot.model, data, snapshot.q)
    extent = max(float(np.linalg.norm(T.translation)) for T in data.oMi)
    if robot.geometry != "planar":
        return extent
    # a planar arm stretches out in the plane in which it works, whereas others stay folded
    links = [*robot.model.jointPlacements, robot.tool_placement]
    return max(extent, STRETCHED * sum(float(np.linalg.norm(T.translation)) for T in links))


def look(camera: viser.CameraHandle, view: Viewpoint) -> None:
    """Move the camera to a viewpoint at once."""
    camera.position = view.position
    camera.look_at = view.look_at  # after the position, which carries the point along


async def fly(camera: viser.CameraHandle, view: Viewpoint) -> None:
    """Move the camera to a viewpoint smoothly, around the point that it looks at rather than through it."""
    start, at = camera.position.copy(), camera.look_at.copy()
    arm, goal = start - at, view.position - view.look_at
    for fraction in np.linspace(0.0, 1.0, FRAMES + 1)[1:]:
        s = fraction**2 * (3.0 - 2.0 * fraction)
        direction = (1.0 - s) * arm / np.linalg.norm(arm) + s * goal / np.linalg.norm(goal)
        length = (1.0 - s) * np.linalg.norm(arm) + s * np.linalg.norm(goal)
        middle = (1.0 - s) * at + s * view.look_at
        size = np.linalg.norm(direction)
        if size > 0.05:  # between opposite directions there is none to go through
            look(camera, Viewpoint(middle + length * direction / size, middle))
        await asyncio.sleep(FLIGHT / FRAMES)
    look(camera, view)
