"""Posture at the start of a run, on the surfaces, and whether the tool reaches its place there."""

from __future__ import annotations

import numpy as np

from app.scenario.errors import IrregularCorner, ScenarioError, SurfaceOutOfReach
from app.scenario.schema import Scenario
from app.scenario.units import Units, kinds_of
from app.simulation.builders.environment_builder import task_surface, tool_at_start
from app.simulation.omega.reference_postures import LARGEST_STEP, posture_at
from app.simulation.period.observation import Observer
from controllers.control_law import Reference
from controllers.modes import Mode
from controllers.nominal_model import NominalModel
from controllers.task_space import turn_towards
from environments import robots
from environments.plant import Plant
from environments.truth import Truth

ON_SURFACE = 1e-6  # m, by which the tool may be off its starting place on the surface


def starting_posture(scenario: Scenario, plant: Plant, robot: robots.Robot, nominal: NominalModel) -> np.ndarray:
    """Posture (n,) rad at the start, on rigid surfaces: the nearest one in the metric of the believed arm, since the
    reference begins there and does not depend on the true one. Raises ScenarioError, which names the surface that is
    farthest from the tool, or IrregularCorner."""
    if not plant.nature.rigid:
        return robot.posture
    believed = Plant(robot, Truth.as_believed(robot.n), plant.surfaces, plant.nature, plant.contacts, face=plant.face)
    try:
        return believed.start(robot.posture, np.zeros(robot.n), 0.0).views.q
    except ValueError as error:
        tool, kind = tool_at_start(robot, nominal), IrregularCorner if len(plant.surfaces) > 1 else ScenarioError
        task_surface(scenario, plant.surfaces, tool)  # dependent normals are another reason
        farthest = int(np.argmax([abs(each.chart(tool, 0.0).g[0]) for each in plant.surfaces]))
        path = scenario.surfaces[farthest].path
        raise kind(
            f"{path}{error}; allowed: one that the arm reaches, by {path}surface.origin or robot.posture"
        ) from error


def require_within_reach(
    scenario: Scenario, mode: Mode, observer: Observer, reference: Reference, q_0: np.ndarray
) -> None:
    """Raise SurfaceOutOfReach where Newton's method does not bring the tool from q_0 (n,) rad to its starting place on
    the surfaces, or only to a posture that is not near q_0. The message names the surface that is farthest from the
    tool."""
    estimate, task = observer.at(q_0, np.zeros_like(q_0), 0.0)
    try:
        q = posture_at(observer.record_at, q_0, reference, 0.0).q
        there = observer.at(q, np.zeros_like(q), 0.0).task
        turn_towards.py_func(reference.r_d, there)
        away = float(np.abs(there.r - reference.r_d).max())
        turn = float(np.linalg.norm(q - q_0))
    except ValueError:  # J_q exactly singular on the way
        away = turn = np.inf
    if not (away < ON_SURFACE and turn < LARGEST_STEP):
        farthest = int(np.abs(task.r[: mode.normals]).argmax())
        path, depth = scenario.surfaces[farthest].path, float(task.r[farthest])
        side, tool = "behind" if depth > 0.0 else "ahead of", np.round(estimate.p, 3).tolist()
        far = f"too far to start on it, since the arm would turn by {turn:.3g} rad"
        reason = far if away < ON_SURFACE else "out of the arm's reach"
        raise SurfaceOutOfReach(
            f"{path}surface: {reason}, {abs(depth):.3g} m {side} the tool at {tool} m; "
            f"allowed: one that the arm reaches, by {path}surface.origin or robot.posture"
        )


def r_at_start(
    scenario: Scenario, robot: robots.Robot, observer: Observer, q_0: np.ndarray, *, in_corner: bool
) -> np.ndarray:
    """r (n,) at the posture q_0 (n,) of the start. Raises ScenarioError where J_q is singular there, in a corner
    IrregularCorner."""
    try:
        return observer.at(q_0, np.zeros(robot.n), 0.0).task.r
    except ValueError as error:
        kind = IrregularCorner if in_corner else ScenarioError
        unit = Units(joints=kinds_of(robot.slides)).of_joints("rad")
        raise kind(
            f"robot.posture: {np.round(q_0, 4).tolist()} {unit}; allowed: one at which J_q is not singular"
            + ("" if scenario.task_space.supplemental is None else ", or other joints in task_space.supplemental")
        ) from error
