"""Changes of a scenario that also change what depends on them: another mode, arm, surface or target model."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from operator import attrgetter
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np
from msgspec import to_builtins

from app.scenario.admitted_contacts import admitted_contacts
from app.scenario.contact_sections import FurtherSurface
from app.scenario.data import edited, from_plain, of_kind, to_plain
from app.scenario.errors import (
    IrregularCorner,
    IrregularSurface,
    PathOutOfReach,
    ScenarioError,
    SurfaceOutOfReach,
    UnboundedGain,
    WrongFace,
)
from app.scenario.number_text import counted
from app.scenario.schema import (
    ControllerSection,
    RobotSection,
    Scenario,
    TargetModelSection,
    Vector3,
)
from app.simulation.builders.controller_builder import mode_of, target_model
from app.simulation.builders.environment_builder import (
    positions_of,
    robot_of,
    surface,
    surfaces_of,
    task_axes,
    task_surface,
    tool_at_start,
)
from controllers import modes
from controllers.nominal_model import NominalModel
from controllers.target_model import InvalidGain
from environments import robots
from environments.catalogue import CATALOGUE
from environments.contact_kinds import CONTACTS, FREE
from environments.surfaces.form import Form
from environments.surfaces.plane import Plane
from environments.trajectories.point_to_point import Hold
from environments.urdf import RobotError
from parameters import allowed

NEAR = 0.03  # m
BESIDE = 0.01  # m, of a further surface from the tool
# directions into further surfaces, the usual one first
_ACROSS = ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0))
PUSH, PUSH_LASTS = 30.0, 0.5  # N, s
HALVINGS = 3  # times that a path is halved that is too long for an arm, before it becomes `Hold`
_Built = TypeVar("_Built")


def in_mode(scenario: Scenario, mode_name: str) -> Scenario:
    """The scenario in another mode; target model and contact are set to the mode's defaults where the mode cannot keep
    them.

    It keeps the part of the path that lies along the coordinates that are free in that mode. Raises ScenarioError
    for an unknown mode.
    """
    data = to_plain(edited(scenario, "mode", mode_name))
    mode = modes.MODES[mode_name]
    data["target_model"] = data["blend"] = data["shift"] = {}
    admitted = admitted_contacts(mode)
    if scenario.contact.kind not in admitted:
        data["contact"]["kind"] = admitted[0]
    for name in ("second", "third"):
        further: FurtherSurface = getattr(scenario, name)
        if further.present and further.contact.kind not in admitted:
            data[name]["contact"]["kind"] = data["contact"]["kind"]
    if not mode.in_joints:
        data["task_space"]["kind"] = "cartesian"
    return adapted(scenario, from_plain(data))


def possible(scenario: Scenario, build: Callable[[Scenario], _Built]) -> _Built:
    """Result of `build` for the scenario, or for the nearest one that the arm can run: with its path at half its size,
    a quarter and so on, with a constant gain, with a surface of the same kind at its defaults, or with fewer surfaces.

    Raises ScenarioError where none can be built.
    """
    halvings = 0
    while True:
        try:
            return build(scenario)
        except (IrregularCorner, SurfaceOutOfReach):
            if len(scenario.surfaces) == 1:
                raise
            scenario = without_last(scenario)
        except WrongFace:
            scenario = with_face(scenario, flat=False)
        except PathOutOfReach:
            paths = {name: getattr(scenario, name) for name in ("motion", "rotation")}
            if not any(path.moves for path in paths.values()):
                if len(scenario.surfaces) == 1:
                    raise
                scenario = without_last(scenario)
                continue
            paths = {name: path.halved() if halvings < HALVINGS else None for name, path in paths.items()}
            paths = {name: path or Hold() for name, path in paths.items()}
            scenario, halvings = msgspec.structs.replace(scenario, **paths), halvings + 1
        except UnboundedGain:
            alone = len(scenario.surfaces) == 1
            scenario = edited(scenario, "controller.gain", "constant") if alone else without_last(scenario)
        except IrregularSurface as error:
            form: Form = attrgetter(path := f"{error.path}surface")(scenario)
            usual = on_surface(scenario, str(form.__struct_config__.tag), path)
            if attrgetter(path)(usual) == form:
                raise
            scenario = usual


def on_robot(scenario: Scenario, name: str) -> Scenario:
    """The scenario with another arm of the catalogue: see `with_robot`. Raises ScenarioError for an unknown robot."""
    return with_robot(scenario, {"name": name})


def with_robot(scenario: Scenario, changes: Mapping[str, object]) -> Scenario:
    """The scenario with other fields of `robot`, by name, None for a default.

    Another arm keeps no field of the old one and not the scenario's name; another tool frame keeps only the arm; fields
    that depend on the number of joints are at their defaults then. In a mode on a surface the surface is brought to the
    present place of the tool. Raises ScenarioError for an unknown field, and for an arm that cannot be built.
    """
    fields = RobotSection.__struct_fields__
    if unknown := [name for name in changes if name not in fields]:
        raise ScenarioError(f"robot.{unknown[0]}: no such field; {allowed(unknown[0], fields)}")
    data = to_plain(scenario)
    if isinstance(urdf := changes.get("urdf"), str) and urdf:  # a scenario may be saved in another folder
        changes = {**changes, "urdf": os.path.abspath(os.path.expanduser(urdf))}
    another = changes.keys() & {"name", "urdf", "tool_frame"}
    if another:
        kept = ("name", "urdf") if another == {"tool_frame"} else ()
        data["robot"] = {name: value for name, value in data["robot"].items() if name in kept}
        data["target_model"] = data["blend"] = data["shift"] = {}
        data["task_space"] = {name: data["task_space"][name] for name in ("kind", "characteristic_length")}
        data["controller"].pop("z_0", None)
        for gain in ("A", "F_1", "F_2", "K_s"):
            value = data["controller"][gain]
            data["controller"][gain] = value[0] if isinstance(value, list) and not isinstance(value[0], list) else value
        for each in ("link_scaling", "rotor_scaling", "torque_limit"):
            if isinstance(data["truth"][each], list):
                del data["truth"][each]
        for each in ("link_centre", "link_shape"):
            if isinstance(data["truth"][each][0], list):
                del data["truth"][each]
    data["robot"] = {name: value for name, value in {**data["robot"], **changes}.items() if value is not None}
    changed = from_plain(data)
    if another - {"tool_frame"}:
        changed = msgspec.structs.replace(changed, name=Scenario().name, title=_title(changed.robot))
    return adapted(scenario, changed) if changes.keys() - {"rotor_inertia"} else changed


def _title(robot: RobotSection) -> str:
    entry = CATALOGUE.get(robot.name)
    return Path(robot.urdf).stem if robot.urdf else entry.title if entry else robot.name


def in_coordinates(scenario: Scenario, field: str, value: object) -> Scenario:
    """The scenario with another field of `task_space`; the target model is at the mode's defaults then, since its
    coordinates are others, and paths keep the part that lies in those. Raises ScenarioError."""
    return adapted(scenario, _without_model(edited(scenario, f"task_space.{field}", value)))


def on_surface(scenario: Scenario, kind: str, path: str = "surface") -> Scenario:
    """The scenario with another kind of surface at its defaults, as far from the tool as the one before, but no farther
    than `NEAR`, and with its motion; as a formula, a wave below the tool, in the world's coordinates.
    path: of the surface: "surface", "second.surface" or "third.surface".

    Raises ScenarioError for an unknown kind.
    """
    before: Form = attrgetter(path)(scenario)
    changed = edited(scenario, path, {**of_kind(kind), "motion": to_builtins(before.motion)})
    _, p = _start(scenario)
    chart = surface(before, p).chart(p, 0.0)
    phi, normal = float(np.clip(chart.g[0], -NEAR, NEAR)), chart.G[0]
    form: Form = attrgetter(path)(changed)
    placed = form.below(p, phi) if path == "surface" else form.across(normal, p, phi)
    if placed is not None:
        return edited(changed, path, to_builtins(placed))
    if path != "surface":
        changed = _turned(changed, path, normal)
    at_origin = surface(attrgetter(path)(changed), np.zeros(3)).point(np.array([phi, 0.0, 0.0]), 0.0)
    return edited(changed, f"{path}.origin", (p - at_origin).round(4).tolist())


def _turned(scenario: Scenario, path: str, normal: np.ndarray) -> Scenario:
    """The scenario with a further surface turned so that the tool goes along `normal` (3,) into it, with its axis
    across."""
    directions = {"normal": normal, "reference": -normal, "axis": np.roll(normal, 1)}
    for name in attrgetter(path)(scenario).__struct_fields__:
        if name in directions:
            scenario = edited(scenario, f"{path}.{name}", directions[name].round(4).tolist())
    return scenario


def with_further(scenario: Scenario, section: str, kind: str) -> Scenario:
    """The scenario with a further surface, `second` or `third`, of this kind of contact, or of that of the first one
    where the mode does not allow it; `FREE` takes the surface away. A new one is a plane beside the tool, across the
    others. The target model is at the mode's defaults then, since its coordinates are others.

    Raises ScenarioError for an unknown kind.
    """
    mode, was = modes.MODES[scenario.mode], getattr(scenario, section)
    changed = edited(scenario, f"{section}.contact.kind", kind)  # refuses an unknown kind
    if CONTACTS[kind].touches and kind not in admitted_contacts(mode):
        changed = edited(scenario, f"{section}.contact.kind", scenario.contact.kind)
    there = getattr(changed, section).present
    if not there or not was.present:
        changed = _without_model(changed)
    if not there or was.present:
        return adapted(scenario, changed)
    robot, p = _start(scenario)
    normals = [each.chart(p, 0.0).G[0] for each in surfaces_of(scenario, p)]
    usual = _ACROSS[1:] if robot.geometry == "planar" else _ACROSS
    normal = max(usual, key=lambda n: np.linalg.svd([*normals, n], compute_uv=False)[-1])
    beside = Plane(normal=normal, origin=tuple((p + BESIDE * np.array(normal)).round(4).tolist()))
    return adapted(scenario, edited(changed, f"{section}.surface", to_builtins(beside)))


def with_face(scenario: Scenario, *, flat: bool) -> Scenario:
    """The scenario with a tool that touches with a flat face, or with a point. The target model is at the mode's
    defaults then, since its coordinates are others, and paths keep the part that lies in those."""
    return adapted(scenario, _without_model(edited(scenario, "face.flat", flat)))


def _without_model(scenario: Scenario) -> Scenario:
    """The scenario with the mode's target model, and without a blend or shift of it."""
    data = to_plain(scenario)
    data["target_model"] = data["blend"] = data["shift"] = {}
    return from_plain(data)


def without_last(scenario: Scenario) -> Scenario:
    """The scenario without the last of its further surfaces."""
    return with_further(scenario, last_surface(scenario), FREE)


def last_surface(scenario: Scenario) -> str:
    """Name of the last of its further surfaces."""
    return "third" if scenario.third.present else "second"


def with_control(scenario: Scenario, path: str, value: object) -> Scenario:
    """The scenario with another `control` of a further surface; the target model is at the mode's defaults then, since
    other coordinates have their force controlled. Raises ScenarioError."""
    return adapted(scenario, _without_model(edited(scenario, path, value)))


def adapted(before: Scenario, scenario: Scenario) -> Scenario:
    """The scenario with the part of the path that lies in its free coordinates and, in a mode on a surface, with the
    surface brought to the tool when it is farther away than `NEAR`.
    before: the scenario that the path was made for."""
    if mode_of(scenario).on_surface:
        _, p = _start(scenario)
        for number, each in enumerate(scenario.surfaces):
            for _ in range(3):  # far from a typed surface the distance is known only roughly
                chart = surfaces_of(scenario, p)[number].chart(p, 0.0)
                if abs(chart.g[0]) > NEAR:
                    origin = np.array(scenario.surfaces[number].form.origin) + chart.G[0] * chart.g[0]
                    scenario = edited(scenario, f"{each.path}surface.origin", origin.tolist())
    new = _free_directions(scenario)
    try:
        old = _free_directions(before)
    except IrregularCorner:  # which has no edge to go along
        old = new
    alike = before.task_space.kind == scenario.task_space.kind
    known = new @ old.T if alike and new.shape[1] == old.shape[1] else None
    angles, before_angles = _rotated(scenario), _rotated(before)
    rotation = scenario.rotation.within(np.eye(angles, before_angles), angles) if angles else Hold()
    paths = {"motion": scenario.motion.within(known, len(new)), "rotation": rotation}
    return msgspec.structs.replace(scenario, **paths, controller=_converted(before, scenario))


def _converted(before: Scenario, scenario: Scenario) -> ControllerSection:
    """The controller, with its boundary layer, K_s and constant d converted to the units of the new task space. From
    metres to radians, the layer is divided by l, K_s multiplied by l^2 and d by l; back, by the inverse factors.
    Nothing is converted for an arm with prismatic joints only. epsilon stays: it covers what a period of held torque
    adds."""
    joints = [each.task_space.kind == "joint" for each in (before, scenario)]
    controller, l = scenario.controller, scenario.task_space.characteristic_length
    if joints[0] == joints[1] or all(_start(scenario)[0].slides):
        return controller
    metres = l if joints[1] else 1.0 / l
    factors = {"layer": 1.0 / metres, "K_s": metres**2, "d": metres}
    changed = {name: _times(factor, getattr(controller, name)) for name, factor in factors.items()}
    return msgspec.structs.replace(controller, **changed)


def _times(factor: float, value: Any) -> Any:
    """Product to three digits, so that a conversion forth and back leaves a short number as it was. value: a number, or
    a table of numbers."""
    if isinstance(value, tuple):
        return tuple(_times(factor, each) for each in value)
    return float(f"{factor * value:.3g}")


def _rotated(scenario: Scenario) -> int:
    """Number of coordinates that are angles, which `rotation` may move."""
    robot, _ = _start(scenario)
    mode = mode_of(scenario)
    aligned = mode.force_directions - mode.pressed  # the tilts of a flat tool are not moved, but aligned
    # none is left where this arm cannot have a flat tool, which is found out later
    return 0 if scenario.task_space.kind == "joint" else max(0, robot.n - positions_of(robot) - aligned)


def _free_directions(scenario: Scenario) -> np.ndarray:
    """Directions of the coordinates that a path moves: (k, 3) in the world, or (n, n) for joints."""
    robot, p = _start(scenario)
    if scenario.task_space.kind == "joint":
        return np.eye(robot.n)
    mode, positions = mode_of(scenario), positions_of(robot)
    if not mode.on_surface:
        return task_axes(scenario, robot)[:positions]
    return task_surface(scenario, surfaces_of(scenario, p), p).chart(p, 0.0).G[mode.pressed : positions]


def _start(scenario: Scenario) -> tuple[robots.Robot, np.ndarray]:
    """The arm, and the tool's place at the start, (3,) m. Raises ScenarioError for an arm that cannot be built."""
    try:
        robot = robot_of(scenario)
    except RobotError as error:
        raise ScenarioError(str(error)) from error
    return robot, tool_at_start(robot, NominalModel(robot.model, robot.tool_joint, robot.tool_placement))


def sideways(robot: robots.Robot, newtons: float) -> Vector3:
    """A force, N, that every mode shows: sideways, and within the plane of a planar arm."""
    return (newtons, 0.0, 0.0) if robot.geometry == "planar" else (0.0, newtons, 0.0)


def pushed(scenario: Scenario, robot: robots.Robot, t: float) -> Scenario:
    """The scenario with its push beginning at t (s); where it has none, neither force nor moment, `PUSH` sideways for
    `PUSH_LASTS`."""
    truth = scenario.truth
    if not (any(truth.push) or any(truth.push_moment)):
        truth = msgspec.structs.replace(truth, push=sideways(robot, PUSH), push_duration=PUSH_LASTS)
    return msgspec.structs.replace(scenario, truth=msgspec.structs.replace(truth, push_start=t))


def _forces(scenario: Scenario) -> str:
    """Surfaces about which a scenario's coordinates are, in words."""
    return f"{counted(len(scenario.surfaces), 'surface')}{' with a flat tool' if scenario.face.flat else ''}"


def blending_to(scenario: Scenario, other: Scenario, at: float, over: float) -> Scenario:
    """The scenario with a blend to the target model of another one, at and over in s.

    Raises ScenarioError where the other scenario has another mode, or its model has not the same coordinates or is the
    scenario's own.
    """
    if other.mode != scenario.mode:
        raise ScenarioError(f"blend.to: a target model of {other.mode} mode; allowed: one of {scenario.mode} mode")
    if other.task_space.kind != scenario.task_space.kind:
        raise ScenarioError(
            f"blend.to: a target model in {other.task_space.kind} coordinates; allowed: one in "
            f"{scenario.task_space.kind} coordinates, as task_space.kind of {scenario.name} says"
        )
    there, here = _forces(other), _forces(scenario)
    if mode_of(scenario).on_surface and there != here:
        raise ScenarioError(
            f"blend.to: a target model with coordinates on {there}; allowed: on {here}, as in {scenario.name}"
        )
    try:
        own, model = (target_model(each, robot_of(scenario).n) for each in (scenario, other))
    except (InvalidGain, RobotError) as error:
        raise ScenarioError(f"blend.to: {error}") from error
    names = TargetModelSection.__struct_fields__
    if all(np.array_equal(getattr(own, name), getattr(model, name)) for name in names):
        raise ScenarioError(f"blend.to: {other.name} has the target model of {scenario.name}; allowed: another one")
    to = {name: getattr(model, name).tolist() for name in names}
    return edited(scenario, "blend", {"to": to, "at": at, "over": over})
