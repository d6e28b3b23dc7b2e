"""Builder of the reference plan of a scenario: where it starts, its motion, its forces and its shift."""

from __future__ import annotations

import numpy as np

from app.scenario.schema import Scenario
from app.simulation.builders.controller_builder import believed_compliance, followed_faces
from app.simulation.builders.environment_builder import forces_of, motion_of, rotation_of, spread_over
from app.simulation.builders.starting_posture import r_at_start
from app.simulation.period.observation import Observer
from app.simulation.period.planned_reference import Forces, ReferencePlan
from controllers.modes import Mode
from controllers.task_space import TaskLayout
from environments import robots
from environments.shift import SmoothShift


def plan_of(
    scenario: Scenario, mode: Mode, layout: TaskLayout, robot: robots.Robot, observer: Observer, q_0: np.ndarray
) -> ReferencePlan:
    """Plan of the reference, from where the tool is at q_0 (n,) rad. Raises ScenarioError."""
    motion, rotation, forces = motion_of(scenario, mode, layout), rotation_of(scenario, layout), forces_of(scenario)
    shift = spread_over("shift.by", scenario.shift.by, mode, layout)
    return ReferencePlan(
        start=r_at_start(scenario, robot, observer, q_0, in_corner=mode.on_surface and len(scenario.surfaces) > 1),
        compliance=np.zeros((3, 3)) if mode.rigid else _compliance(scenario),
        followed=followed_faces(scenario),
        m=mode.force_directions,
        motion=motion,
        rotation=rotation,
        shift=SmoothShift.fresh(shift, scenario.shift.duration),
        forces=Forces.of(forces),
    )


def _compliance(scenario: Scenario) -> np.ndarray:
    """Compliance (3, 3) m/N of r_fd, (33): that of the surfaces whose force is controlled."""
    compliance, believed = np.zeros((3, 3)), believed_compliance(scenario)
    compliance[: len(believed), : len(believed)] = believed
    return compliance
