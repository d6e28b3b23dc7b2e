"""Arms of pinned runs, in their postures at the instant that is looked at."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import viser

from app.dashboard.scene.robot_view import Paint, RobotView
from app.dashboard.theme.colors import RUNS
from app.session.snapshot import Snapshot
from app.session.timeline import Pinned

_CELL = 0.015  # m: three more arms need no more detail
_COAT = 0.0045  # m, beyond that of the ghost


class PinnedArms:
    """Arms of pinned runs of the shown arm: each translucent, in the run's colour, in its recorded posture."""

    def __init__(self, scene: viser.SceneApi, new_root: Callable[[], str]) -> None:
        self._scene, self._new_root = scene, new_root
        self._arms: dict[int, tuple[Pinned, RobotView]] = {}

    @property
    def has_new_meshes(self) -> bool:
        return any(arm.has_new_meshes for _, arm in self._arms.values())

    def show(self, snapshot: Snapshot, *, wanted: bool) -> None:
        """Move the arms to their postures at snapshot.t; hide them unless wanted."""
        runs = {pinned.number: pinned for pinned in snapshot.pinned}
        for number, (pinned, arm) in list(self._arms.items()):
            now = runs.get(number)
            # a continued session numbers its pinned runs anew, and gives them other slots
            if now is None or now.recording is not pinned.recording or now.slot != pinned.slot:
                arm.remove()
                del self._arms[number]
        for pinned in snapshot.pinned:
            q = posture(pinned, snapshot.t) if wanted and _same_arm(pinned, snapshot) else None
            if q is not None and pinned.number not in self._arms:
                paint = Paint(RUNS[pinned.slot], opacity=0.3, coat=_COAT)
                view = RobotView(self._scene, pinned.system.robot, self._new_root(), _CELL, paint)
                self._arms[pinned.number] = pinned, view
            if pinned.number in self._arms:
                _, arm = self._arms[pinned.number]
                arm.set_visible(visible=q is not None)
                if q is not None:
                    arm.show(q)


def _same_arm(pinned: Pinned, snapshot: Snapshot) -> bool:
    one, other = pinned.scenario.robot, snapshot.scenario.robot
    return (one.name, one.urdf) == (other.name, other.urdf)


def posture(pinned: Pinned, t: float) -> np.ndarray | None:
    """Posture q (n,) of the pinned run at t (s), None where that run is not known."""
    half = 0.5 * pinned.system.scenario.controller.period
    if not pinned.recording.first - half <= t <= pinned.t + half:
        return None
    return pinned.recording.at(t + half)["q"]
