"""The ghost: the arm as it would be if the target model (8) held exactly, for drawing beside the real one.

The motion error of the ghost solves M_m e'' + B_m e' + K_m e = -K_f e_Fc with the recorded force error, starting from
the arm's own state at the last change of the scenario; the ghost stands at r_d + e. So the difference between ghost and
arm solves (8) with only the residual on the right side, in every mode and against every surface, and pushed by hand.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from app.analysis.ideal_response import IdealResponse
from app.session.snapshot import Snapshot
from app.simulation.period.observation import Observer
from app.simulation.recording import Recording
from controllers.blend import ModelBlend
from controllers.nominal_model import NominalModel
from controllers.task_space import turn_towards

DRAWN = ("t", "q", "r_d", "e_r", "e_r_dot", "F_c", "F_cd", "tool")
REACH_BACK = 5.0  # s: a ghost that is switched on later begins at most so long ago
BLENDED = 0.02  # s, for which one model is used during a blend
NEWTON_STEPS, CLOSE = 8, 1e-9  # m
FAR = 1.0  # rad: a posture farther than this from the last one is another solution


@dataclass(frozen=True)
class GhostPose:
    """Pose of the ghost at time t (s): its posture q (n,) rad, its tool point (3,) m, and the distance (m) of the arm's
    own tool point from that."""

    t: float
    q: np.ndarray
    tool: np.ndarray
    distance: float


class NoGhost(StrEnum):
    """Reason in words why there is no ghost at an instant."""

    NO_ROWS = "begins when the run goes on"
    THINNED = "not known so far back"
    NO_POSTURE = "out of reach"


@dataclass
class _Run:
    """Ghost since the last change of the scenario: its response to the force error, of one model or of the models of a
    blend, for a sampling period (s), its arm, and its state x, see `IdealResponse`."""

    key: object
    response: IdealResponse
    blend: ModelBlend | None
    period: float
    observer: Observer
    t: float
    x: np.ndarray
    q: np.ndarray


class Ghost:
    """Ghost of a run, computed as far as the run is recorded; for one thread, not the loop's."""

    def __init__(self) -> None:
        self._run: _Run | None = None

    def follow(self, snapshot: Snapshot) -> GhostPose | NoGhost:
        """The ghost at the last recorded instant of a snapshot, or why there is none: nothing is recorded since the
        last change, too little of what was, or its arm cannot reach the position given by (8)."""
        run, period = self._run, snapshot.scenario.controller.period
        if run is None or run.key != self._key(snapshot) or not run.t <= snapshot.t <= run.t + REACH_BACK:
            run = self._run = self._begun(snapshot)
        if run is None:
            return NoGhost.NO_ROWS
        rows = _rows(snapshot.recording, run.t - 0.5 * period, snapshot.t)
        if not len(rows["t"]):
            return NoGhost.NO_ROWS
        if np.ptp(rows["t"]) > 1.5 * period * len(rows["t"]):
            return NoGhost.THINNED
        run.x = self._onward(run, rows["t"], rows["F_c"] - rows["F_cd"])
        run.t = t = float(rows["t"][-1])
        return self._pose(run, rows["r_d"][-1] + run.x[: len(run.q)], t, rows["tool"][-1])

    def _onward(self, run: _Run, t: np.ndarray, e_Fc: np.ndarray) -> np.ndarray:
        """x at the last of the instants t (N, 1) s; during a blend by the model in the middle of each piece."""
        if run.blend is None:
            return run.response.onward(run.x, e_Fc)
        x, size = run.x, max(1, round(BLENDED / run.period))
        for first in range(0, len(t) - 1, size):
            piece = slice(first, first + size + 1)
            response = IdealResponse.of(vars(run.blend.at(float(t[piece].mean()))), run.period)
            x = response.onward(x, e_Fc[piece])
        return x

    def _key(self, snapshot: Snapshot) -> object:
        return snapshot.run, snapshot.revision, snapshot.state.epoch.t

    def _begun(self, snapshot: Snapshot) -> _Run | None:
        first = max(snapshot.state.epoch.t, snapshot.t - REACH_BACK)
        rows = _rows(snapshot.recording, first - 0.25 * snapshot.scenario.controller.period, snapshot.t)
        if not len(rows["t"]):
            return None
        robot, period = snapshot.robot, snapshot.scenario.controller.period
        nominal = NominalModel(robot.model, robot.tool_joint, robot.tool_placement)  # the loop keeps its own
        return _Run(
            key=self._key(snapshot),
            response=IdealResponse.of(snapshot.matrices, period),
            blend=None if snapshot.blending is None else snapshot.system.blend,
            period=period,
            observer=Observer(nominal, snapshot.system.charted.shapes, snapshot.system.layout),
            t=float(rows["t"][0]),
            x=np.concatenate([rows["e_r"][0], rows["e_r_dot"][0]]),
            q=rows["q"][0],
        )

    def _pose(self, run: _Run, r: np.ndarray, t: float, tool: np.ndarray) -> GhostPose | NoGhost:
        """The ghost in the posture with these coordinates, if there is one, by Newton's method from the last one."""
        q, rest = run.q, np.zeros_like(run.q)
        for _ in range(NEWTON_STEPS):
            try:
                estimate, task = run.observer.at(q, rest, t)
            except ValueError:  # J_q exactly singular
                return NoGhost.NO_POSTURE
            turn_towards.py_func(r, task)
            step = task.J_q_inv @ (r - task.r)
            if not np.linalg.norm(q - run.q) < FAR:
                return NoGhost.NO_POSTURE
            if np.abs(r - task.r).max() < CLOSE:
                run.q = q
                return GhostPose(t, q, estimate.p.copy(), float(np.linalg.norm(tool - estimate.p)))
            q = q + step
        return NoGhost.NO_POSTURE


def _rows(recording: Recording, t_from: float, t_to: float) -> dict[str, np.ndarray]:
    """Signals of all rows of a stretch, each (N, n), also where n is 1."""
    rows = recording.rows(t_from, t_to)
    return {name: rows[:, recording.columns[name]] for name in DRAWN} | {"t": rows[:, 0]}
