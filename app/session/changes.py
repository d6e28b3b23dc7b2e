"""Changes of a scenario that also change what depends on them: another mode, arm, surface or target model."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

import msgspec
import numpy as np

from app.scenario.data import edited, from_plain, of_kind, to_plain
from app.scenario.schema import Robot, Scenario, ScenarioError, TargetModel
from app.simulation.controller_builder import target_model
from app.simulation.environment_builder import positions_of, robot_of, surface_of, task_axes, tool_at_start
from controllers import modes
from controllers.nominal_model import NominalModel
from controllers.target_model import InvalidGain
from environments import robots
from environments.urdf import RobotError

NEAR = 0.03  # m


def in_mode(scenario: Scenario, mode_name: str) -> Scenario:
    """The scenario in another mode; target model and contact are set to the mode's defaults where the mode cannot keep
    them.

    A mode on a surface keeps the part of a path in space that lies along the surface. Raises ScenarioError for an
    unknown
    mode.
    """
    changed = edited(scenario, "mode", mode_name)
    mode = modes.MODES[mode_name]
    changed = _along_surface(scenario, changed)
    data = to_plain(changed)
    data["target_model"] = data["blend"] = data["shift"] = {}
    if scenario.contact.kind not in mode.contacts:
        data["contact"]["kind"] = mode.contacts[0]
    if not mode.in_joints:
        data["task_space"]["kind"] = "cartesian"
    return _adapted(from_plain(data))


def _along_surface(scenario: Scenario, changed: Scenario) -> Scenario:
    """`changed` with a path that its mode can follow: on a surface, the displacement's part along the tangents where it
    has more values than there are tangents, and a circle in the first two coordinates."""
    path, mode = scenario.motion, modes.MODES[changed.mode]
    if not mode.on_surface or modes.MODES[scenario.mode].on_surface:
        return changed
    robot, p = _start(scenario)
    k = positions_of(robot) - mode.m()
    tangents = surface_of(scenario, p).chart(p, 0.0).G[mode.m() :][:k] @ task_axes(robot).T
    known = None if scenario.task_space.kind == "joint" else tangents[:, : positions_of(robot)]
    return msgspec.structs.replace(changed, motion=path.on_surface(known, k))


def told(before: Scenario, after: Scenario) -> str:
    """Sentence on the parts of the path that a change of mode has not kept, "" where it has kept all."""
    if before.mode == after.mode or before.motion == after.motion:
        return ""
    kind, old, new = after.motion.__struct_config__.tag, to_plain(before)["motion"], to_plain(after)["motion"]
    if old["kind"] != kind:
        return f"motion.kind: {kind} instead of {old['kind']}, which this mode cannot follow with this arm."
    changes = ", ".join(f"motion.{name} {new[name]} instead of {old[name]}" for name in new if new[name] != old[name])
    return f"The path keeps what lies along the surface: {changes}."


def on_robot(scenario: Scenario, name: str) -> Scenario:
    """The scenario with another arm of the catalogue: see `with_robot`. Raises ScenarioError for an unknown robot."""
    return with_robot(scenario, {"name": name})


def with_robot(scenario: Scenario, changes: Mapping[str, object]) -> Scenario:
    """The scenario with other fields of `robot`, by name, None for a default.

    Another arm keeps no field of the old one and not the scenario's name; another tool frame keeps only the arm; fields
    that depend on the number of joints are at their defaults then. In a mode on a surface the surface is brought to the
    present place of the tool. Raises ScenarioError for an unknown field, and for an arm that cannot be built.
    """
    fields = Robot.__struct_fields__
    if unknown := [name for name in changes if name not in fields]:
        raise ScenarioError(f"robot.{unknown[0]}: no such field; allowed: {', '.join(fields)}")
    data = to_plain(scenario)
    if isinstance(urdf := changes.get("urdf"), str):  # a scenario may be saved in another folder
        changes = {**changes, "urdf": os.path.abspath(os.path.expanduser(urdf))}
    another = changes.keys() & {"name", "urdf", "tool_frame"}
    if another:
        kept = ("name", "urdf") if another == {"tool_frame"} else ()
        data["robot"] = {name: value for name, value in data["robot"].items() if name in kept}
        data["target_model"] = data["blend"] = data["shift"] = {}
        for gain in ("A", "F_1", "F_2", "K_s"):
            value = data["controller"][gain]
            data["controller"][gain] = value[0] if isinstance(value, list) and not isinstance(value[0], list) else value
        for each in ("link_scaling", "torque_limit"):
            if isinstance(data["truth"][each], list):
                del data["truth"][each]
    data["robot"] = {name: value for name, value in {**data["robot"], **changes}.items() if value is not None}
    changed = from_plain(data)
    if another - {"tool_frame"}:
        changed = msgspec.structs.replace(changed, name=Scenario().name, title=_title(changed.robot))
    return _adapted(changed) if changes.keys() - {"rotor_inertia"} else changed


def _title(robot: Robot) -> str:
    entry = robots.CATALOGUE.get(robot.name)
    return Path(robot.urdf).stem if robot.urdf else entry.title if entry else robot.name


def on_surface(scenario: Scenario, kind: str) -> Scenario:
    """The scenario with another kind of surface at its defaults, as far from the tool as the one before, but no farther
    than `NEAR`, and with its motion; as a formula, a wave below the tool, in the world's coordinates.

    Raises ScenarioError for an unknown kind.
    """
    changed = edited(scenario, "surface", {**of_kind(kind), "motion": to_plain(scenario)["surface"]["motion"]})
    _, p = _start(scenario)
    phi = float(np.clip(surface_of(scenario, p).chart(p, 0.0).g[0], -NEAR, NEAR))
    if (below := changed.surface.below(p, phi)) is not None:
        return msgspec.structs.replace(changed, surface=below)
    at_origin = surface_of(changed, np.zeros(3)).point(np.array([phi, 0.0, 0.0]), 0.0)
    return edited(changed, "surface.origin", (p - at_origin).round(4).tolist())


def _adapted(scenario: Scenario) -> Scenario:
    """The scenario, in a mode on a surface, with the surface brought to the tool when it is farther away than `NEAR`,
    and a circle flattened to a line where an arm has only one direction along the surface."""
    if not modes.MODES[scenario.mode].on_surface:
        return scenario
    robot, p = _start(scenario)
    for _ in range(3):  # far from a typed surface the distance is known only roughly
        chart = surface_of(scenario, p).chart(p, 0.0)
        if abs(chart.g[0]) > NEAR:
            origin = np.array(scenario.surface.origin) + chart.G[0] * chart.g[0]
            scenario = edited(scenario, "surface.origin", origin.tolist())
    k = positions_of(robot) - modes.MODES[scenario.mode].m()
    return msgspec.structs.replace(scenario, motion=scenario.motion.flattened()) if k == 1 else scenario


def _start(scenario: Scenario) -> tuple[robots.Robot, np.ndarray]:
    """The arm, and the tool's place at the start, (3,) m. Raises ScenarioError for an arm that cannot be built."""
    try:
        robot = robot_of(scenario)
    except RobotError as error:
        raise ScenarioError(str(error)) from error
    return robot, tool_at_start(robot, NominalModel(robot.model, robot.tool_joint, robot.tool_placement))


def blending_to(scenario: Scenario, other: Scenario, at: float, over: float) -> Scenario:
    """The scenario with a blend to the target model of another one, at and over in s.

    Raises ScenarioError where the other scenario has another mode, or its model has not as many coordinates.
    """
    if other.mode != scenario.mode:
        raise ScenarioError(f"blend.to: a target model of {other.mode} mode; allowed: one of {scenario.mode} mode")
    try:
        model = target_model(other, robot_of(scenario).n)
    except (InvalidGain, RobotError) as error:
        raise ScenarioError(f"blend.to: {error}") from error
    to = {name: getattr(model, name).tolist() for name in TargetModel.__struct_fields__}
    return edited(scenario, "blend", {"to": to, "at": at, "over": over})
