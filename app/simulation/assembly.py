"""Assembly of a scenario's system, checked: the one place where controllers, environments and app meet."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, TypeVar

import msgspec
import numpy as np

from app.scenario.errors import (
    IrregularSurface,
    ScenarioError,
)
from app.scenario.own_code import own_fault
from app.scenario.schema import Scenario, TruthSection
from app.simulation.builders.controller_builder import (
    blend_of,
    controller_of,
    mode_of,
    uncertainty_of,
    z_at_start,
)
from app.simulation.builders.environment_builder import (
    contacts_of,
    environment_of,
    face_of,
    positions_of,
    push_of,
    robot_of,
    surfaces_of,
    task_axes,
    task_surface,
    tool_at_start,
    truth_of,
)
from app.simulation.builders.environment_checks import (
    require_coupling,
    require_face,
    require_kinds,
    require_pushing,
    require_reachable_moment,
    require_sampled,
    require_surfaces,
)
from app.simulation.builders.error_model import ErrorModel
from app.simulation.builders.own_path_check import require_path
from app.simulation.builders.reference_builder import plan_of
from app.simulation.builders.reuse_keys import (
    constants_key,
    controller_key,
    omega_key,
    plant_key,
    sampled_loops_key,
    surfaces_key,
)
from app.simulation.builders.starting_posture import require_within_reach, starting_posture
from app.simulation.builders.step_check import require_resolved, unresolved
from app.simulation.builders.task_layout import coordinates_of, layout_of
from app.simulation.omega.domain import Constants, constants_over, mobility_over, span_of
from app.simulation.omega.extremes import Omega
from app.simulation.omega.reference_postures import ReferencePostures, postures_along
from app.simulation.omega.search_memory import Memory, key_of
from app.simulation.omega.stations import Stations, turning_normals
from app.simulation.period.observation import Observer
from app.simulation.period.planned_reference import Planned, ReferencePlan
from app.simulation.system import System
from controllers import modes
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
from environments.surfaces.corner import Corner
from environments.surfaces.table import Surface
from environments.urdf import RobotError

if TYPE_CHECKING:
    from app.simulation.sampled_loop.sampled_stability import SampledLoop

T = TypeVar("T")


def assemble(scenario: Scenario, previous: System | None = None, memory: Memory | None = None) -> System:
    """System built from a scenario.
    previous: its unchanged parts are reused.
    memory: cache of search results, by default that of `previous`.

    Raises ScenarioError with one sentence that names the field, its value and what is allowed.
    """
    try:
        known = memory or (previous.memory if previous is not None else Memory())
        return _assemble(scenario, previous, known)
    except (InvalidGain, RobotError) as error:
        raise ScenarioError(str(error)) from error
    except Exception as error:
        fault = own_fault(error)
        if fault is None:
            raise
        raise fault from error


def _assemble(scenario: Scenario, previous: System | None, memory: Memory) -> System:
    mode = mode_of(scenario)
    require_kinds(scenario, mode)
    robot = _reused(
        previous, lambda p: p.scenario.robot == scenario.robot, lambda p: p.robot, lambda: robot_of(scenario)
    )
    nominal = _nominal(robot, previous)
    require_surfaces(scenario, mode, positions_of(robot), robot.n)
    require_coupling(scenario, mode)
    require_face(scenario, mode, robot)
    surfaces = _surfaces_in_use(scenario, robot, nominal, previous)
    plant = _plant(scenario, robot, surfaces, previous)
    q_0 = _reused(
        previous,
        lambda p: (
            (p.robot is robot and p.surfaces is surfaces and p.plant.nature == plant.nature)
            and p.scenario.face == scenario.face
        ),
        lambda p: p.q_0,
        lambda: starting_posture(scenario, plant, robot, nominal),
    )
    layout = layout_of(scenario, mode, robot, nominal, q_0, plant.surface)
    charted = _charted(scenario, mode, robot, surfaces, nominal, q_0)
    require_pushing(scenario, mode)
    require_reachable_moment(scenario, mode)
    require_sampled(scenario)
    observer = Observer(nominal, charted.shapes, layout, ErrorModel.of(scenario, q_0))
    plan = plan_of(scenario, mode, layout, robot, observer, q_0)
    constants = _constants(scenario, robot, mode, nominal, observer, plan, surfaces, q_0, memory, previous)
    mobility = _mobility(scenario, plant, constants, nominal, memory, previous)
    stations = _stations(constants, surfaces, observer, previous)
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


def _reused(
    previous: System | None, same: Callable[[System], bool], part: Callable[[System], T], build: Callable[[], T]
) -> T:
    """Part of a previous system where it is the same in the one that is assembled, otherwise a newly built one."""
    return part(previous) if previous is not None and same(previous) else build()


def _charted(
    scenario: Scenario,
    mode: Mode,
    robot: robots.Robot,
    surfaces: tuple[Surface, ...],
    nominal: NominalModel,
    q_0: np.ndarray,
) -> Surface | Corner:
    """Source of the task coordinates: the surfaces beside the tool at q_0 (n,) rad, or Cartesian axes. Raises
    ScenarioError."""
    cartesian = Surface.cartesian(task_axes(scenario, robot))  # axes that are not possible are refused in every mode
    if not mode.on_surface:
        return cartesian
    return task_surface(scenario, surfaces, nominal.evaluate(q_0, np.zeros(robot.n)).p)


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
        mobility=_mobility(scenario, plant, system.constants, nominal, system.memory, previous),
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

    along_reference, rules = scenario.controller.estimates == "along-reference", scenario.simulation

    def same_omega(previous: System) -> bool:
        # the start lies on the surface only where that is rigid, so it is compared, too
        return omega_key(previous.scenario) == omega_key(scenario) and np.array_equal(previous.q_0, q_0)

    def same(previous: System) -> bool:
        return constants_key(previous.scenario) == constants_key(scenario) and same_omega(previous)

    def find_postures() -> ReferencePostures:
        # the arm is on the surface, not at r_fd (33) within it; only estimates taken along r_d are needed there, too
        on_it, shift = plan if along_reference else plan.stiff(), plan.shift.end
        unshifted = Planned(on_it._replace(shift=SmoothShift.fresh(0.0 * shift, 1.0)))
        if mode.on_surface:
            require_within_reach(scenario, mode, observer, unshifted.at(0.0), q_0)
        require_path(scenario, unshifted, on_it.start[on_it.m :])
        paths = repr((plan.motion, plan.rotation))  # tells apart those of a user's own that have one name
        key = key_of("postures", nominal.fingerprint, observer.fingerprint, repr(omega_key(scenario)), paths, q_0)
        return memory.recall_here(
            key,
            lambda: postures_along(observer.record_at, unshifted, shift, q_0, rules.duration, rules.domain_radius),
        )

    def build() -> Constants:
        known = _reused(
            previous, same_omega, lambda p: ReferencePostures(p.constants.centres, p.constants.instants), find_postures
        )
        span = span_of(surfaces, rules.duration) if mode.on_surface else 0.0
        omega = Omega(known.q, rules.domain_radius, span)
        uncertainty = uncertainty_of(scenario, robot, 0.0, NO_RATES)
        return constants_over(
            omega,
            known.t,
            rules.sigma_min,
            uncertainty,
            nominal,
            observer,
            memory,
            along_reference=along_reference,
        )

    return _reused(previous, same, lambda p: p.constants, build)


def _controller(
    scenario: Scenario,
    robot: robots.Robot,
    mode: Mode,
    layout: TaskLayout,
    constants: Constants,
    previous: System | None,
) -> Controller:
    """Controller of a scenario, that of `previous` where it is the same."""

    def same(previous: System) -> bool:
        # within a blend the controller of `previous` is on its way to another model
        known = previous.constants is constants and previous.blend is None
        return known and controller_key(previous.scenario) == controller_key(scenario)

    build = partial(controller_of, scenario, robot, mode, layout, constants)
    return _reused(previous, same, lambda p: p.controller, build)


def _nominal(robot: robots.Robot, previous: System | None) -> NominalModel:
    build = partial(NominalModel, robot.model, robot.tool_joint, robot.tool_placement)
    return _reused(previous, lambda p: p.robot is robot, lambda p: p.nominal, build)


def _plant(scenario: Scenario, robot: robots.Robot, surfaces: tuple[Surface, ...], previous: System | None) -> Plant:
    """Plant of a scenario, that of `previous` where it is the same."""

    def same(previous: System) -> bool:
        known = previous.robot is robot and previous.surfaces is surfaces
        return known and plant_key(previous.scenario) == plant_key(scenario)

    def build() -> Plant:
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

    return _reused(previous, same, lambda p: p.plant, build)


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


def _stations(over: Constants, surfaces: tuple[Surface, ...], observer: Observer, previous: System | None) -> Stations:
    places = over.centres, over.instants
    return _reused(
        previous,
        lambda p: p.constants is over,
        lambda p: p.stations,
        lambda: Stations.along(*places, turning_normals(surfaces, observer, *places)),
    )


def _sampled_loops(
    scenario: Scenario, stations: Stations, controller: Controller, previous: System | None
) -> dict[int, SampledLoop]:
    """Memory of the sampled loops at these stations: that of `previous` where the loops are the same, else an empty
    one. Within a blend they differ, since its model is in no scenario."""

    def same(previous: System) -> bool:
        known = previous.stations is stations and previous.controller.model.same(controller.model)
        return known and sampled_loops_key(previous.scenario) == sampled_loops_key(scenario)

    return _reused(previous, same, lambda p: p.sampled_loops, dict[int, "SampledLoop"])


def _surfaces_in_use(
    scenario: Scenario, robot: robots.Robot, nominal: NominalModel, previous: System | None
) -> tuple[Surface, ...]:
    """Surfaces of the scenario; one typed as a formula is checked where the tool will meet it."""
    return _reused(
        previous,
        lambda p: surfaces_key(p.scenario) == surfaces_key(scenario),
        lambda p: p.surfaces,
        partial(_checked_surfaces, scenario, robot, nominal),
    )


def _checked_surfaces(scenario: Scenario, robot: robots.Robot, nominal: NominalModel) -> tuple[Surface, ...]:
    """Surfaces of the scenario. Raises IrregularSurface."""
    surfaces = surfaces_of(scenario, tool_at_start(robot, nominal))
    on_surface = modes.MODES[scenario.mode].on_surface
    for surface, each in zip(surfaces, scenario.surfaces, strict=True):
        if on_surface or each.contact.nature.touches:
            try:
                surface.require_regular(scenario.simulation.duration)
            except ValueError as error:
                raise IrregularSurface(f"{each.path}{error}", each.path) from error
    return surfaces
