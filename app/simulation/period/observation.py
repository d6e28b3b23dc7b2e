"""Observation of one state by the controller: its estimates of the arm (Remark 1) and the task coordinates (3)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from app.simulation.builders.error_model import ErrorModel, estimate_errors
from controllers.nominal_model import Estimate, LinkConstants, NominalModel, estimates
from controllers.task_space import Scratch, TaskLayout, TaskSpace, task_space
from environments.surfaces.chart import Chart, Shapes
from environments.surfaces.table import task_chart
from kernels import inline, kernel
from kernels.records import Record


class ObservationModel(NamedTuple):
    """Model by which the controller observes the arm.
    links: see `NominalModel`; errors: of these.
    shapes: the surfaces (or Cartesian axes) that give the task coordinates."""

    links: LinkConstants
    errors: ErrorModel
    shapes: Shapes
    layout: TaskLayout


class Observation(NamedTuple):
    """The controller's observation of one state q (n,) rad, q_dot (n,) rad/s; spare: memory for another chart."""

    q: np.ndarray
    q_dot: np.ndarray
    estimate: Estimate
    chart: Chart
    spare: Chart
    task: TaskSpace
    work: Scratch

    @classmethod
    def zeros(cls, n: int) -> Observation:
        """Observation of n coordinates."""
        charts = Chart.zeros(), Chart.zeros()
        return cls(np.zeros(n), np.zeros(n), Estimate.zeros(n), *charts, TaskSpace.zeros(n), Scratch.zeros(n))


@inline
def observe(observation_model, momenta, C, J, J_dot, placements, t, seen):
    """Estimates and task coordinates of a state, Remark 1 and (3), from the arrays of `nominal_model.Terms` there."""
    links = observation_model.links
    estimates(links, momenta, C, J, J_dot, placements, seen.q_dot, seen.estimate)
    estimate_errors(observation_model.errors, links, placements, seen.q, seen.q_dot, t, seen.estimate)
    task_chart(observation_model.shapes, seen.estimate.p, t, seen.spare, seen.chart)
    task_space(observation_model.layout, seen.chart, seen.estimate, seen.q, seen.q_dot, seen.work, seen.task)


@kernel
def _observe_alone(observation_model, momenta, C, J, J_dot, placements, t, seen):
    observe(observation_model[0], momenta, C, J, J_dot, placements, t, seen[0])


class Observed(NamedTuple):
    """Observation as the rest of the program uses it.
    estimate: estimates of the arm.
    task: task coordinates."""

    estimate: Estimate
    task: TaskSpace


class Observer:
    """Observer of the arm: `observe` for use outside kernels."""

    def __init__(
        self, model: NominalModel, shapes: Shapes, layout: TaskLayout, errors: ErrorModel | None = None
    ) -> None:
        errors = ErrorModel.none(layout.n) if errors is None else errors
        self.observation_model = ObservationModel(model.constants, errors, shapes, layout)
        self.model, self._record = model, Record(self.observation_model)
        self._blank = Record.zeros(Observation, layout.n)

    @property
    def fingerprint(self) -> bytes:
        """Bytes of `observation_model`: observers with the same bytes observe the same."""
        return self._record.data.tobytes()

    def at(self, q: np.ndarray, q_dot: np.ndarray, t: float) -> Observed:
        """Estimates and task coordinates at q (n,) rad, q_dot (n,) rad/s, time t (s).

        Raises ValueError where J_q is exactly singular.
        """
        seen = self.record_at(q, q_dot, t)
        return Observed(seen.part("estimate"), seen.part("task"))

    def record_at(self, q: np.ndarray, q_dot: np.ndarray, t: float) -> Record[Observation]:
        """Record of the observation, as `at`, for who reads little of it: to make named tuples of it takes longer."""
        seen = self._blank.copy()
        seen.data["q"], seen.data["q_dot"] = q, q_dot
        _observe_alone(self._record.data, *self.model.update(q, q_dot), t, seen.data)
        return seen

    def at_rest(self, q: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Observations of the arm at rest at q (N, n) rad, t (N,) s: records (N,) with the fields of `Observation`.
        J_q^-1 is NaN where J_q is exactly singular."""
        seen, still = np.repeat(self._blank.data, len(q)), np.zeros(q.shape[1])
        seen["q"] = q
        for k in range(len(q)):
            try:
                _observe_alone(self._record.data, *self.model.update(q[k], still), t[k], seen[k : k + 1])
            except ValueError:
                seen["task"]["J_q_inv"][k] = np.nan
        return seen
