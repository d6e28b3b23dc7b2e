"""Assembly of a scenario's system, checked: the one place where controllers, environments and app meet."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from app.scenario.errors import (
    ForceInJoints,
    IrregularCorner,
    IrregularSurface,
    ScenarioError,
    SurfaceOutOfReach,
)
from app.scenario.schema import Scenario, TruthSection
from app.scenario.units import Units, kinds_of
from app.simulation.controller_builder import (
    believed_compliance,
    blend_of,
    controller_of,
    followed_faces,
    mode_of,
    uncertainty_of,
    z_at_start,
)
from app.simulation.domain import Constants, centres, constants_over, mobility_over, posture_at, span_of
from app.simulation.environment_builder import (
    contacts_of,
    environment_of,
    face_of,
    forces_of,
    motion_of,
    positions_of,
    push_of,
    robot_of,
    rotation_of,
    spread_over,
    surfaces_of,
    task_axes,
    task_surface,
    tool_at_start,
    truth_of,
)
from app.simulation.environment_checks import (
    require_coupling,
    require_face,
    require_pushing,
    require_reachable_moment,
    require_sampled_delays,
    require_surfaces,
)
from app.simulation.error_model import ErrorModel
from app.simulation.extremes import Omega
from app.simulation.observation import Observer
from app.simulation.planned_reference import Forces, Planned, ReferencePlan
from app.simulation.reuse_keys import controller_key, domain_key, plant_key, sampled_loops_key, surfaces_key
from app.simulation.search_memory import Memory
from app.simulation.stations import Stations
from app.simulation.step_check import require_resolved, unresolved
from app.simulation.system import System
from app.simulation.task_layout import coordinates_of, layout_of
from controllers import modes
from controllers.control_law import Reference
from controllers.controller import Controller
from controllers.estimate_rates import NO_RATES
from controllers.modes import Mode
from controllers.nominal_model import NominalModel
from controllers.target_model import InvalidGain
from controllers.task_space import TaskLayout
from environments import robots
from environments.contact_kinds import combined_kind
from environments.plant import Plant
from environments.sensors import ForceSensor
from environments.shift import SmoothShift
from environments.step_resolution import Mobility
from environments.surfaces.table import Surface
from environments.urdf import RobotError

if TYPE_CHECKING:
    from app.simulation.sampled_stability import SampledLoop

ON_SURFACE = 1e-6  # m, by which the tool may be off its starting place on the surface


def assemble(scenario: Scenario, previous: System | None = None, memory: Memory | None = None) -> System:
    """System of a scenario; equal parts of `previous` are used again, and the results that `memory` has, by default
    that of `previous`.

    Raises ScenarioError with one sentence that names the field, its value and what is allowed.
    """
    try:
        known = memory or (previous.memory if previous is not None else Memory())
        return _assemble(scenario, previous, known)
    except (InvalidGain, RobotError) as error:
        raise ScenarioError(str(error)) from error


def _assemble(scenario: Scenario, previous: System | None, memory: Memory) -> System:
    mode = mode_of(scenario)
    if scenario.contact.kind not in mode.contacts:
        raise ScenarioError(
            f"contact.kind: {scenario.contact.kind!r} in {mode.name} mode; allowed: {', '.join(mode.contacts)}"
        )
    if scenario.task_space.kind == "joint" and not mode.in_joints:
        raise ForceInJoints(
            f"task_space.kind: 'joint' in {mode.name} mode; allowed: 'cartesian' (joint in motion mode)"
        )
    same_robot = previous is not None and previous.scenario.robot == scenario.robot
    robot = previous.robot if previous is not None and same_robot else robot_of(scenario)
    nominal = _nominal(robot, previous)
    require_surfaces(scenario, mode, positions_of(robot), robot.n)
    require_coupling(scenario, mode)
    require_face(scenario, mode, robot)
    surfaces = _surfaces_in_use(scenario, robot, nominal, previous)
    plant = _plant(scenario, robot, surfaces, previous)
    q_0 = _start(scenario, plant, robot, nominal)
    in_corner = mode.on_surface and len(surfaces) > 1
    layout = layout_of(scenario, mode, robot, nominal, q_0, plant.surface)
    cartesian = Surface.cartesian(task_axes(scenario, robot))
    charted = cartesian
    if mode.on_surface:
        charted = task_surface(scenario, surfaces, nominal.evaluate(q_0, np.zeros(robot.n)).p)
    require_pushing(scenario, mode)
    require_reachable_moment(scenario, mode)
    require_sampled_delays(scenario)
    motion, rotation, forces = motion_of(scenario, mode, layout), rotation_of(scenario, layout), forces_of(scenario)
    shift = spread_over("shift.by", scenario.shift.by, mode, layout)

    observer = Observer(nominal, charted.shapes, layout, ErrorModel.of(scenario, q_0))
    try:
        start = observer.at(q_0, np.zeros(robot.n), 0.0)[1].r
    except ValueError as error:
        kind = IrregularCorner if in_corner else ScenarioError
        unit = Units(joints=kinds_of(robot.slides)).of_joints("rad")
        raise kind(
            f"robot.posture: {np.round(q_0, 4).tolist()} {unit}; allowed: one at which J_q is not singular"
            + ("" if scenario.task_space.supplemental is None else ", or other joints in task_space.supplemental")
        ) from error
    plan = ReferencePlan(
        start=start,
        compliance=np.zeros((3, 3)) if mode.rigid else _compliance(scenario),
        followed=followed_faces(scenario),
        m=mode.m(),
        motion=motion,
        rotation=rotation,
        shift=SmoothShift.fresh(shift, scenario.shift.duration),
        forces=Forces.of(forces),
    )
    constants = _constants(scenario, robot, mode, nominal, observer, plan, surfaces, q_0, memory, previous)
    mobility = _mobility(scenario, plant, constants, nominal, memory, previous)
    stations = _stations(scenario, constants, previous)
    controller = _controller(scenario, robot, mode, layout, constants, previous)
    return System(
        scenario=scenario,
        robot=robot,
        mode=mode,
        layout=layout,
        coordinates=coordinates_of(layout, mode, robot),
        surfaces=surfaces,
        charted=charted,
        nominal=nominal,
        plant=plant,
        constants=constants,
        stations=stations,
        mobility=mobility,
        controller=controller,
        blend=blend_of(scenario, mode, layout),
        sensor=ForceSensor(scenario.sensor, scenario.controller.period),
        push=push_of(scenario),
        plan=plan,
        q_0=q_0,
        z_0=z_at_start(scenario, robot.n),
        memory=memory,
        sampled_loops=_sampled_loops(scenario, stations, controller, previous),
    )


def with_truth(system: System, truth: TruthSection, previous: System | None) -> System:
    """The system with another true arm, of which the controller knows nothing. Raises ScenarioError.

    previous: a system whose parts are used again where they are the same.
    """
    scenario, robot = msgspec.structs.replace(system.scenario, truth=truth), system.robot
    plant, nominal = _plant(scenario, robot, system.surfaces, previous), _nominal(robot, previous)
    return replace(
        system,
        scenario=scenario,
        nominal=nominal,
        plant=plant,
        mobility=_mobility(scenario, plant, system.constants, system.nominal, system.memory, previous),
        push=push_of(scenario),
        sampled_loops=_sampled_loops(scenario, system.stations, system.controller, previous),
    )


def _constants(
    scenario: Scenario,
    robot: robots.Robot,
    mode: Mode,
    nominal: NominalModel,
    observer: Observer,
    plan: ReferencePlan,
    surfaces: tuple[Surface, ...],
    q_0: np.ndarray,
    memory: Memory,
    previous: System | None,
) -> Constants:
    """Constants over Omega, those of `previous` where they are the same. Raises ScenarioError."""
    # the start is compared, too: onto a rigid surface the true arm's masses say which way it goes
    alike = previous is not None and domain_key(previous.scenario) == domain_key(scenario)
    if previous is not None and alike and np.array_equal(previous.q_0, q_0):
        return previous.constants
    # the arm is on the surface, not at r_fd (33) within it; only estimates taken along r_d are needed there, too
    on_it = plan if scenario.controller.estimates == "along-reference" else plan.stiff()
    shift, rules = plan.shift.end, scenario.simulation
    unshifted = Planned(on_it._replace(shift=SmoothShift.fresh(0.0 * shift, 1.0)))
    if mode.on_surface:
        _require_within_reach(scenario, mode, observer, unshifted.at(0.0), q_0)
    along = centres(observer.at, unshifted, shift, q_0, rules.duration)
    span = span_of(surfaces, rules.duration) if mode.on_surface else 0.0
    omega = Omega(along, rules.domain_radius, span)
    uncertainty = uncertainty_of(scenario, robot, 0.0, NO_RATES)
    return constants_over(omega, rules.sigma_min, uncertainty, nominal, observer, memory)


def _controller(
    scenario: Scenario,
    robot: robots.Robot,
    mode: Mode,
    layout: TaskLayout,
    constants: Constants,
    previous: System | None,
) -> Controller:
    """Controller of a scenario, that of `previous` where it is the same."""
    # within a blend the controller of `previous` is on its way to another model
    same = previous is not None and previous.constants is constants and previous.blend is None
    if previous is not None and same and controller_key(previous.scenario) == controller_key(scenario):
        return previous.controller
    return controller_of(scenario, robot, mode, layout, constants)


def _nominal(robot: robots.Robot, previous: System | None) -> NominalModel:
    if previous is not None and previous.robot is robot:
        return previous.nominal
    return NominalModel(robot.model, robot.tool_joint, robot.tool_placement)


def _plant(scenario: Scenario, robot: robots.Robot, surfaces: tuple[Surface, ...], previous: System | None) -> Plant:
    """Plant of a scenario, that of `previous` where it is the same."""
    alike = previous is not None and previous.robot is robot and previous.surfaces is surfaces
    if previous is not None and alike and plant_key(previous.scenario) == plant_key(scenario):
        return previous.plant
    return Plant(
        robot,
        truth_of(scenario, robot),
        surfaces,
        combined_kind(tuple(each.contact.nature for each in scenario.surfaces)),
        contacts_of(scenario),
        scenario.simulation.integrator,
        scenario.simulation.substeps,
        face_of(scenario, robot),
        environment_of(scenario),
    )


def _mobility(
    scenario: Scenario,
    plant: Plant,
    constants: Constants,
    nominal: NominalModel,
    memory: Memory,
    previous: System | None,
) -> Mobility:
    """The true arm's largest mobility over Omega. Raises TooStiff where the plant's step cannot follow it."""
    touched = replace(constants.omega, span=span_of(plant.surfaces, scenario.simulation.duration))
    if previous is not None and previous.constants is constants and previous.scenario.truth == scenario.truth:
        mobility = previous.mobility
        if previous.plant is plant and previous.scenario.controller.period == scenario.controller.period:
            return mobility
    else:
        # the believed arm is the same in all runs of a sweep, and a search takes longer than a run
        believed = mobility_over(touched, plant.robot.model, plant.surfaces, nominal, memory)
        mobility = believed.at_most_for(plant.model, plant.robot.model)
    if mobility is None or unresolved(scenario, plant, mobility):
        mobility = mobility_over(touched, plant.model, plant.surfaces, nominal, memory)
    require_resolved(scenario, plant, mobility)
    return mobility


def _stations(scenario: Scenario, constants: Constants, previous: System | None) -> Stations:
    duration = scenario.simulation.duration
    if previous is not None and previous.constants is constants and previous.scenario.simulation.duration == duration:
        return previous.stations
    return Stations.along(constants.omega, duration)


def _sampled_loops(
    scenario: Scenario, stations: Stations, controller: Controller, previous: System | None
) -> dict[int, SampledLoop]:
    """Memory of the sampled loops at these stations: that of `previous` where the loops are the same, else an empty
    one. Within a blend they differ, since its model is in no scenario."""
    alike = previous is not None and previous.stations is stations and previous.controller.model.same(controller.model)
    if previous is not None and alike and sampled_loops_key(previous.scenario) == sampled_loops_key(scenario):
        return previous.sampled_loops
    return {}


def _compliance(scenario: Scenario) -> np.ndarray:
    """Compliance (3, 3) m/N of r_fd, (33): that of the surfaces whose force is controlled."""
    compliance, believed = np.zeros((3, 3)), believed_compliance(scenario)
    compliance[: len(believed), : len(believed)] = believed
    return compliance


def _surfaces_in_use(
    scenario: Scenario, robot: robots.Robot, nominal: NominalModel, previous: System | None
) -> tuple[Surface, ...]:
    """Surfaces of the scenario; one typed as a formula is checked where the tool will meet it."""
    if previous is not None and surfaces_key(previous.scenario) == surfaces_key(scenario):
        return previous.surfaces
    surfaces = surfaces_of(scenario, tool_at_start(robot, nominal))
    on_surface = modes.MODES[scenario.mode].on_surface
    for surface, each in zip(surfaces, scenario.surfaces, strict=True):
        if on_surface or each.contact.nature.touches:
            try:
                surface.require_regular(scenario.simulation.duration)
            except ValueError as error:
                raise IrregularSurface(f"{each.path}{error}") from error
    return surfaces


def _start(scenario: Scenario, plant: Plant, robot: robots.Robot, nominal: NominalModel) -> np.ndarray:
    """Posture (n,) rad at the start, on rigid surfaces. Raises ScenarioError, which names the surface that is farthest
    from the tool, or IrregularCorner."""
    try:
        return plant.start(robot.posture, np.zeros(robot.n), 0.0).views.q
    except ValueError as error:
        tool, kind = tool_at_start(robot, nominal), IrregularCorner if len(plant.surfaces) > 1 else ScenarioError
        task_surface(scenario, plant.surfaces, tool)  # dependent normals are another reason
        farthest = int(np.argmax([abs(each.chart(tool, 0.0).g[0]) for each in plant.surfaces]))
        path = scenario.surfaces[farthest].path
        raise kind(
            f"{path}{error}; allowed: one that the arm reaches, by {path}surface.origin or robot.posture"
        ) from error


def _require_within_reach(
    scenario: Scenario, mode: modes.Mode, observer: Observer, reference: Reference, q_0: np.ndarray
) -> None:
    """Raise SurfaceOutOfReach where Newton's method does not bring the tool from q_0 (n,) rad to its starting place on
    the surfaces; of several it names the one that is farthest from the tool."""
    estimate, task = observer.at(q_0, np.zeros_like(q_0), 0.0)
    try:
        q, _ = posture_at(observer.at, q_0, reference, 0.0)
        away = float(np.abs(observer.at(q, np.zeros_like(q), 0.0)[1].r - reference.r_d).max())
    except ValueError:  # J_q exactly singular on the way
        away = np.inf
    if not away < ON_SURFACE:
        farthest = int(np.abs(task.r[: mode.normals]).argmax())
        path, depth = scenario.surfaces[farthest].path, float(task.r[farthest])
        side, tool = "behind" if depth > 0.0 else "ahead of", np.round(estimate.p, 3).tolist()
        raise SurfaceOutOfReach(
            f"{path}surface: out of the arm's reach, {abs(depth):.3g} m {side} the tool at {tool} m; "
            f"allowed: one that the arm reaches, by {path}surface.origin or robot.posture"
        )
