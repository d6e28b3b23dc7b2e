"""System of a scenario, checked: its objects; the one place where controllers, environments and app meet."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from app.scenario.schema import (
    ForceInJoints,
    IrregularSurface,
    Scenario,
    ScenarioError,
    SurfaceOutOfReach,
    TooStiff,
    field_info,
    scenario_errors,
)
from app.scenario.units import CARTESIAN, JOINT, Units
from app.simulation.control_period import Observer, Planned, ReferencePlan
from app.simulation.controller_builder import blend_of, controller_of, uncertainty_of, z_at_start
from app.simulation.domain import Constants, centres, constants_over, mobility_over, posture_at, span_of
from app.simulation.environment_builder import (
    force_of,
    motion_of,
    positions_of,
    push_of,
    require_pushing,
    robot_of,
    rotation_of,
    spread_over,
    surface_of,
    task_axes,
    task_joints,
    tool_at_start,
    truth_of,
)
from app.simulation.extremes import Omega
from app.simulation.search_memory import Memory
from app.simulation.stations import Stations
from controllers import modes
from controllers.blend import ModelBlend
from controllers.control_law import Reference
from controllers.controller import Controller
from controllers.modes import Mode
from controllers.nominal_model import Estimate, NominalModel
from controllers.target_model import InvalidGain
from controllers.task_space import TaskLayout, TaskSpace
from environments import robots
from environments.contact import Contact
from environments.plant import Plant
from environments.push import TimedPush
from environments.sensors import ForceSensor
from environments.shift import SmoothShift
from environments.step_resolution import Mobility, Oscillator, oscillators, resolved, substeps_needed
from environments.surfaces.table import Surface
from environments.urdf import RobotError

EASE = 1.5  # factor on the substeps that keep the plant from exploding, with which it also settles
ON_SURFACE = 1e-6  # m, of where the tool begins


@dataclass(frozen=True)
class Coordinate:
    """One task coordinate: its name and the unit that the screen shows.
    metres_per_radian: the characteristic length where the coordinate is an angle times that, otherwise None."""

    name: str
    unit: str
    metres_per_radian: float | None = None

    @property
    def is_angle(self) -> bool:
        return self.unit == "rad" or self.metres_per_radian is not None

    @property
    def per_radian(self) -> float:
        """Growth of an angle with one radian, in its unit."""
        return self.metres_per_radian or 1.0


@dataclass(frozen=True)
class System:
    """Objects of a scenario.
    charted: gives the task coordinates: the surface, or Cartesian axes.
    mobility: the true arm's largest over Omega.
    controller: with the target model in force, from which `blend`, if there is one, leads to another.
    q_0: (n,) rad.
    z_0: (n,) m/s, of (9), where it is kept at the start.
    memory: of the results of searches."""

    scenario: Scenario
    robot: robots.Robot
    mode: Mode
    layout: TaskLayout
    coordinates: tuple[Coordinate, ...]
    surface: Surface
    charted: Surface
    nominal: NominalModel
    plant: Plant
    constants: Constants
    mobility: Mobility
    controller: Controller
    blend: ModelBlend | None
    sensor: ForceSensor
    push: TimedPush
    plan: ReferencePlan
    q_0: np.ndarray
    z_0: np.ndarray
    memory: Memory

    @property
    def m(self) -> int:
        """Number of force-controlled directions."""
        return self.mode.m()

    @cached_property
    def observer(self) -> Observer:
        """Observer with the controller's model of the arm."""
        return Observer(self.nominal, self.charted.shape, self.layout)

    @cached_property
    def planned(self) -> Planned:
        """Reference of the run, as a function of time."""
        return Planned(self.plan)

    @cached_property
    def stations(self) -> Stations:
        """Stations at which the sampled loops are judged."""
        return Stations.along(self.constants.omega, self.scenario.simulation.duration)

    @property
    def units(self) -> Units:
        """Units in which r, s and the generalised forces are shown."""
        return JOINT if self.layout.joint else CARTESIAN

    def observe(self, q: np.ndarray, q_dot: np.ndarray, t: float) -> tuple[Estimate, TaskSpace]:
        """Observation of a state by the controller: estimates and task coordinates."""
        return self.observer.at(q, q_dot, t)

    def reference(self, t: float) -> Reference:
        """r_d and F_cd with their derivatives at time t (s)."""
        return self.planned.at(t)

    def posture_at(self, q: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        """q_d, q_d_dot with r(q_d, t) = r_d(t) and its rate, by Newton's method from q (n,) rad."""
        return posture_at(self.observe, q, self.reference(t), t)

    def after(self, previous: System, t: float) -> System:
        """The system with a shift that continues from that of `previous` at time t (s)."""
        old, new = previous.plan.shift, self.plan.shift
        if (old.end != new.end).any() or old.duration != new.duration:
            old = old.turned(t, new.end, new.duration)
        return self.with_shift(old)

    def anew(self) -> System:
        """The system at t = 0: its shift starts from rest, and a blend is still to come."""
        shift = self.plan.shift
        begun = self.with_shift(SmoothShift.fresh(shift.end, shift.duration))
        return begun if self.blend is None else replace(begun, controller=self.controller.following(self.blend.start))

    def with_shift(self, shift: SmoothShift) -> System:
        """The system with this shift in place of the scenario's, which begins at t = 0."""
        return replace(self, plan=self.plan._replace(shift=shift))

    def tool_at(self, reference: Reference, t: float) -> np.ndarray:
        """Desired tool point (3,) m, that of r_d; a planar arm stays in its plane."""
        g = np.zeros(3)
        g[: self.layout.positions] = reference.r_d[: self.layout.positions]
        return self.charted.point(g, t)


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
    mode = modes.MODES[scenario.mode]
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
    nominal = (
        previous.nominal
        if previous is not None and same_robot
        else NominalModel(robot.model, robot.tool_joint, robot.tool_placement)
    )
    surface = _surface_in_use(scenario, robot, nominal, previous)
    plant = Plant(
        robot,
        truth_of(scenario, robot),
        surface,
        scenario.contact.nature,
        Contact(*(getattr(scenario.contact, f) for f in Contact._fields)),
        scenario.simulation.integrator,
        scenario.simulation.substeps,
    )
    q_0 = _start(plant, robot)
    layout = _layout(scenario, robot, nominal, q_0)
    charted = surface if mode.on_surface else Surface.cartesian(task_axes(scenario, robot))
    require_pushing(scenario, mode)
    motion, rotation, force = motion_of(scenario, mode, layout), rotation_of(scenario, layout), force_of(scenario)
    shift = spread_over("shift.by", scenario.shift.by, mode, layout)

    observer = Observer(nominal, charted.shape, layout)
    try:
        start = observer.at(q_0, np.zeros(robot.n), 0.0)[1].r
    except ValueError as error:
        raise ScenarioError(
            f"robot.posture: {np.round(q_0, 4).tolist()} rad; allowed: one at which J_q is not singular"
            + ("" if scenario.task_space.supplemental is None else ", or other joints in task_space.supplemental")
        ) from error
    plan = ReferencePlan(
        start=start,
        compliance=0.0 if mode.rigid else 1.0 / scenario.controller.K_e_hat,
        m=mode.m(),
        motion=motion,
        rotation=rotation,
        shift=SmoothShift.fresh(shift, scenario.shift.duration),
        force=force,
    )
    if previous is not None and _shaping(previous.scenario) == _shaping(scenario):
        constants = previous.constants
    else:
        # the arm is on the surface, not at r_fd (33) within it; only estimates taken along r_d are needed there, too
        compliance = plan.compliance if scenario.controller.estimates == "along-reference" else 0.0
        unshifted = Planned(plan._replace(compliance=compliance, shift=SmoothShift.fresh(0.0 * shift, 1.0)))
        rules = scenario.simulation
        if mode.on_surface:
            _require_within_reach(observer, unshifted.at(0.0), q_0)
        along = centres(observer.at, unshifted, shift, q_0, rules.duration)
        omega = Omega(along, rules.domain_radius, span_of(charted, rules.duration))
        uncertainty = uncertainty_of(scenario, 0.0)
        constants = constants_over(omega, rules.sigma_min, uncertainty, nominal, observer, memory)
    if previous is not None and previous.constants is constants and previous.scenario.truth == scenario.truth:
        mobility = previous.mobility
    else:
        touched = replace(constants.omega, span=span_of(surface, scenario.simulation.duration))
        # the believed arm is the same in all runs of a sweep, and a search takes longer than a run
        believed = mobility_over(touched, robot.model, surface, nominal, memory)
        mobility = believed.at_most_for(plant.truth)
        if _unresolved(scenario, plant, mobility):
            mobility = mobility_over(touched, plant.model, surface, nominal, memory)
    _require_resolved(scenario, plant, mobility)
    return System(
        scenario=scenario,
        robot=robot,
        mode=mode,
        layout=layout,
        coordinates=_coordinates(layout, mode),
        surface=surface,
        charted=charted,
        nominal=nominal,
        plant=plant,
        constants=constants,
        mobility=mobility,
        controller=controller_of(scenario, mode, layout, constants),
        blend=blend_of(scenario, mode, layout),
        sensor=ForceSensor(scenario.sensor, scenario.controller.period),
        push=push_of(scenario),
        plan=plan,
        q_0=q_0,
        z_0=z_at_start(scenario, robot.n),
        memory=memory,
    )


def _surface_in_use(scenario: Scenario, robot: robots.Robot, nominal: NominalModel, previous: System | None) -> Surface:
    """Surface of the scenario; one typed as a formula is checked where the tool will meet it."""
    if previous is not None and _judged_by(previous.scenario) == _judged_by(scenario):
        return previous.surface
    surface = surface_of(scenario, tool_at_start(robot, nominal))
    met = modes.MODES[scenario.mode].on_surface or scenario.contact.nature.touches
    if met:
        with scenario_errors(IrregularSurface):
            surface.require_regular(scenario.simulation.duration)
    return surface


def _judged_by(scenario: Scenario) -> tuple[object, ...]:
    return scenario.surface, scenario.robot, scenario.mode, scenario.contact.kind, scenario.simulation


def _start(plant: Plant, robot: robots.Robot) -> np.ndarray:
    with scenario_errors():
        return plant.start(robot.posture, np.zeros(robot.n), 0.0).views.q


def _require_within_reach(observer: Observer, reference: Reference, q_0: np.ndarray) -> None:
    """Raise SurfaceOutOfReach where Newton's method does not bring the tool from q_0 (n,) rad to its starting place on
    the surface."""
    estimate, task = observer.at(q_0, np.zeros_like(q_0), 0.0)
    try:
        q, _ = posture_at(observer.at, q_0, reference, 0.0)
        away = float(np.abs(observer.at(q, np.zeros_like(q), 0.0)[1].r - reference.r_d).max())
    except ValueError:  # J_q exactly singular on the way
        away = np.inf
    if not away < ON_SURFACE:
        depth, tool = float(task.r[0]), np.round(estimate.p, 3).tolist()
        raise SurfaceOutOfReach(
            f"surface: out of the arm's reach, {abs(depth):.3g} m {'behind' if depth > 0.0 else 'ahead of'} the tool "
            f"at {tool} m; allowed: one that the arm reaches, by surface.origin or robot.posture"
        )


def _layout(scenario: Scenario, robot: robots.Robot, nominal: NominalModel, q_0: np.ndarray) -> TaskLayout:
    joints, angles = task_joints(scenario, robot)
    estimate = nominal.evaluate(q_0, np.zeros(robot.n))
    supplemental = np.zeros(robot.n, dtype=np.int64)
    supplemental[: len(joints)] = joints
    return TaskLayout(
        n=robot.n,
        joint=scenario.task_space.kind == "joint",
        positions=positions_of(robot),
        angles=angles,
        supplemental=supplemental,
        l=scenario.task_space.characteristic_length,
        R_ref=estimate.R,
    )


def _shaping(scenario: Scenario) -> tuple[object, ...]:
    """Parts of the scenario that Omega and the constants over it depend on."""
    names = ("robot", "task_space", "declared", "surface", "mode", "motion", "rotation", "shift", "simulation")
    where = tuple(getattr(scenario, name) for name in names)
    if scenario.controller.estimates == "along-reference":
        return (*where, scenario.force, scenario.controller.K_e_hat)
    return where


def _coordinates(layout: TaskLayout, mode: Mode) -> tuple[Coordinate, ...]:
    if layout.joint:
        return tuple(Coordinate(f"q{joint + 1}", "rad") for joint in range(layout.n))
    places = ["φ", "ψ₁", "ψ₂"] if mode.on_surface else (["x", "z"] if layout.positions == 2 else ["x", "y", "z"])
    angles = {0: [], 1: ["ℓ·θ"], 3: ["ℓ·α", "ℓ·β", "ℓ·γ"]}[layout.angles]
    extra = [f"ℓ·q{joint + 1}" for joint in layout.supplemental_joints]
    lengths = [Coordinate(name, "m") for name in places[: layout.positions]]
    return (*lengths, *(Coordinate(name, "m", layout.l) for name in angles + extra))


def _require_resolved(scenario: Scenario, plant: Plant, mobility: Mobility) -> None:
    """Refuse contacts and frictions that the plant's step cannot follow where the arm is most mobile: the plant would
    explode whatever the controller does."""
    integrator, period = scenario.simulation.integrator, scenario.controller.period
    for o in _unresolved(scenario, plant, mobility):
        enough = substeps_needed(integrator, o, EASE * period, int(field_info("simulation.substeps").largest or 1))
        raise TooStiff(
            f"{o.field}: {o.value:g} {o.unit} is too stiff for {plant.substeps} step(s) of {integrator} per control "
            f"period of {period:g} s, the plant would explode; allowed: "
            + ("" if enough is None else f"simulation.substeps >= {enough}, or ")
            + "a smaller value",
            enough,
        )


def _unresolved(scenario: Scenario, plant: Plant, mobility: Mobility) -> list[Oscillator]:
    """Oscillators of the plant that its step does not follow."""
    step = scenario.controller.period / plant.substeps
    known = oscillators(plant.kind, plant.contact, plant.truth, mobility)
    return [o for o in known if not resolved(scenario.simulation.integrator, o, step)]
