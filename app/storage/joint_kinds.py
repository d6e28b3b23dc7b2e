"""Kinds of the joints of a scenario's arm where no system of it stands: read from its URDF once, and kept."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from app.scenario.schema import RobotSection, Scenario
from app.scenario.units import Units, kinds_of
from app.simulation.builders.environment_builder import robot_of
from environments.robots import RobotError


def units_of(scenario: Scenario) -> Units:
    """Units in the task space of a scenario's arm."""
    return Units(scenario.task_space.kind, kinds_of(slides_of(scenario)))


def slides_of(scenario: Scenario) -> tuple[bool, ...]:
    """Whether each joint is prismatic; () for an arm whose URDF is there no more, as of an old sweep."""
    urdf = scenario.robot.urdf
    try:
        return _slides(scenario.robot, 0 if urdf is None else Path(urdf).expanduser().stat().st_mtime_ns)
    except (OSError, RuntimeError, ValueError, RobotError):  # as in `urdf.mesh_file`: any text may stand for a path
        return ()


@lru_cache(maxsize=64)
def _slides(robot: RobotSection, changed: int) -> tuple[bool, ...]:
    """As `slides_of`. changed: when the URDF was last changed, ns."""
    del changed
    return robot_of(Scenario(robot=robot)).slides
