"""Layout of the task coordinates r of a scenario, and their names and units."""

from __future__ import annotations

import numpy as np

from app.scenario.schema import Scenario
from app.scenario.units import indexed, unit_of_joint
from app.simulation.builders.environment_builder import face_axes, level_of, positions_of, task_joints
from app.simulation.system import Coordinate
from controllers.modes import Mode
from controllers.nominal_model import NominalModel
from controllers.task_space import TaskLayout
from environments import robots
from environments.surfaces.table import Surface


def layout_of(
    scenario: Scenario, mode: Mode, robot: robots.Robot, nominal: NominalModel, q_0: np.ndarray, surface: Surface
) -> TaskLayout:
    """Layout of a scenario's task coordinates. q_0: (n,) rad or m, the posture at the start, whose orientation is the
    reference of the angles; surface: the one to which a flat tool is aligned."""
    joints, angles = task_joints(scenario, robot)
    estimate = nominal.evaluate(q_0, np.zeros(robot.n))
    flat = scenario.face.flat and mode.on_surface
    supplemental = np.zeros(robot.n, dtype=np.int64)
    supplemental[: len(joints)] = joints
    length = scenario.task_space.characteristic_length
    return TaskLayout(
        n=robot.n,
        joint=scenario.task_space.kind == "joint",
        positions=positions_of(robot),
        angles=angles,
        supplemental=supplemental,
        supplemental_lengths=np.where(np.array(robot.slides)[supplemental], 1.0, length),
        l=length,
        R_ref=estimate.R,
        tilts=2 if flat else 0,
        face=face_axes(scenario) if flat else np.zeros((2, 3)),
        level=level_of(scenario, estimate.R, surface.chart(estimate.p, 0.0).G[0]) if flat else np.zeros((2, 3)),
    )


def coordinates_of(layout: TaskLayout, mode: Mode, robot: robots.Robot) -> tuple[Coordinate, ...]:
    """Task coordinates (n) with names and units, in the order of r."""
    if layout.joint:
        units = (unit_of_joint("rad", slides=slides) for slides in robot.slides)
        return tuple(Coordinate(indexed("q", joint), unit) for joint, unit in enumerate(units, start=1))
    cartesian = ["x", "z"] if layout.positions == 2 else ["x", "y", "z"]
    places = _PLACES[mode.surfaces] if mode.on_surface else cartesian
    angles = {0: [], 1: ["ℓ·θ"], 3: ["ℓ·α", "ℓ·β", "ℓ·γ"]}[layout.angles]
    extra = [f"{'' if robot.slides[joint] else 'ℓ·'}{indexed('q', joint + 1)}" for joint in layout.supplemental_joints]
    names = [*places[: layout.positions], *angles, *extra]
    if layout.tilts:
        names = ["φ", "ℓ·θ₁", "ℓ·θ₂", *places[1:], "ℓ·γ", *extra]
    return tuple(Coordinate(name, "m", layout.l if name.startswith("ℓ") else None) for name in names)


# names of the positions by the number of surfaces among them
_PLACES = {1: ["φ", "ψ₁", "ψ₂"], 2: ["φ₁", "φ₂", "ψ"], 3: ["φ₁", "φ₂", "φ₃"]}
