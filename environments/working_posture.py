"""Choice of a square task space for an arm, and of a posture in which the arm is far from singular."""

from __future__ import annotations

from itertools import combinations
from typing import Literal

import numpy as np
import pinocchio as pin

from environments.urdf import RobotError

Geometry = Literal["pose", "position", "planar"]

LENGTH = 0.15  # m: weight of rotation against translation
TRIES = 400
INSIDE = 0.8  # share of each joint's range that is searched
SINGULAR = 1e-3  # m
_ROWS = {"planar": [0, 2, 4], "pose": [0, 1, 2, 3, 4, 5], "position": [0, 1, 2]}


def geometry_of(model: pin.Model, file_name: str) -> Geometry:
    """Richest square task space, by the number of joints and the directions of their axes. Raises RobotError."""
    data = model.createData()
    pin.computeJointJacobians(model, data, np.zeros(model.nv))
    n = model.nv
    planar = np.allclose(data.J[[1, 3, 5]], 0.0, atol=1e-9)  # every joint turns about y, or slides across it
    if planar and n >= 2:
        return "planar"
    if n >= 6:
        return "pose"
    if n >= 3 and not planar:
        return "position"
    raise RobotError(
        f"robot.urdf: {file_name} has {n} {'joint' if n == 1 else 'joints'} to its tool; allowed: 3 or more, or 2 or "
        "more that move it in the x-z plane only"
    )


class Tool:
    """The tool of an arm, with the rows of its Jacobian that belong to the task space.

    joint, placement: the joint that carries it and its frame there.
    """

    def __init__(self, model: pin.Model, joint: int, placement: pin.SE3, geometry: Geometry) -> None:
        self._model, self._data = model, model.createData()
        self._joint, self._placement = joint, placement
        self._rows = _ROWS[geometry][: model.nv]

    @property
    def free(self) -> int:
        """Number of joints that the task leaves free, for supplemental coordinates (Remark 5)."""
        return self._model.nv - len(self._rows)

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Jacobian (rows, n) m/rad (m/m for prismatic joints) at q (n,): of the tool point's velocity and of
        `LENGTH` times its angular velocity."""
        J = pin.computeJointJacobians(self._model, self._data, q)
        J = pin.getJointJacobian(self._model, self._data, self._joint, pin.LOCAL_WORLD_ALIGNED).copy()
        arm = self._data.oMi[self._joint].rotation @ self._placement.translation
        J[:3] -= pin.skew(arm) @ J[3:]
        J[3:] *= LENGTH
        return J[self._rows]

    def working_posture(self, file_name: str) -> np.ndarray:
        """Posture (n,), rad or m, within the limits, whose smallest singular value of the Jacobian is the largest, of
        `TRIES` drawn from a fixed seed; of those with the whole arm above its base, if there are any. Its numbers are
        round where that does not leave the limits. Raises RobotError."""
        model = self._model
        middle, half = (
            (model.upperPositionLimit + model.lowerPositionLimit) / 2,
            (model.upperPositionLimit - model.lowerPositionLimit) / 2 * INSIDE,
        )
        half = np.minimum(half, np.pi)
        best, best_score = middle, (False, 0.0)
        for q in middle + half * np.random.default_rng(0).uniform(-1.0, 1.0, (TRIES, model.nv)):
            regular = float(np.linalg.svd(self.jacobian(q), compute_uv=False)[-1])
            if (score := (self._upright() and regular > SINGULAR, regular)) > best_score:
                best, best_score = q, score
        if best_score[1] < SINGULAR:
            raise RobotError(
                f"robot.urdf: {file_name}: in no posture can its joints move the tool in all directions of a square "
                "task space; allowed: an arm that can, another robot.tool_frame"
            )
        rounded = best.round(2)
        within = (model.lowerPositionLimit <= rounded) & (rounded <= model.upperPositionLimit)
        return np.where(within, rounded, best)  # a slide may be shorter than what is rounded away

    def _upright(self) -> bool:
        placements = self._data.oMi.tolist()
        tool = placements[self._joint] * self._placement
        return min(T.translation[2] for T in [*placements, tool]) >= -1e-6

    def supplemental(self, q: np.ndarray) -> tuple[int, ...]:
        """Joints, counted from 0, that complete the Jacobian best at q (n,): with `LENGTH` times their rates below it,
        its smallest singular value is the largest. They are as many as the task leaves free."""
        J, rates = self.jacobian(q), LENGTH * np.eye(self._model.nv)

        def regular(joints: tuple[int, ...]) -> float:
            return float(np.linalg.svd(np.vstack([J, rates[list(joints)]]), compute_uv=False)[-1])

        # all of them are compared: the joints that self-motion moves most may move together, and then determine nothing
        return max(combinations(range(self._model.nv), self.free), key=regular)
