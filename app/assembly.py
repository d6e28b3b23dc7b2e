"""From a Scenario to the objects that it stands for, checked: the one place where the three folders meet."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import msgspec
import numpy as np

from app.control_period import Observer, Planned, ReferencePlan
from app.domain import Constants, centres, constants_over, mobility_over, posture_at
from app.scenario import (
    Circle,
    ConstantForce,
    Cylinder,
    ForceSinusoid,
    ForceStep,
    Formula,
    Hold,
    Line,
    Matrix,
    Plane,
    PointToPoint,
    Robot,
    Scenario,
    ScenarioError,
    Sphere,
    TargetModel,
    after_blend,
    edited,
    field_info,
    from_plain,
    to_plain,
)
from controllers import modes
from controllers.baselines import ComputedTorque, PdGravity
from controllers.blend import ModelBlend, certify
from controllers.bounds import Uncertainty
from controllers.compensator import Compensator
from controllers.modes import Mode
from controllers.nominal_model import Estimate, NominalModel
from controllers.switching import Switching
from controllers.target_model import InvalidGain
from controllers.target_model import TargetModel as Model
from controllers.task_space import TaskLayout, TaskSpace
from controllers.vsmrc import Reference, Vsmrc
from environments import robots, surfaces, trajectories
from environments.contact import Contact
from environments.formula import FormulaError
from environments.plant import Plant, Truth
from environments.push import TimedPush
from environments.sensors import ForceSensor
from environments.stiffness import Mobility, oscillators, resolved, substeps_needed
from environments.typed_surface import TypedSurface
from environments.urdf import RobotError

NEAR = 0.03  # m
UNLIMITED = 1e6  # N m: a URDF's effort limit beyond this says that there is none
LAWS = {"vsmrc": Vsmrc, "computed-torque": ComputedTorque, "pd-gravity": PdGravity}


@dataclass(frozen=True)
class Coordinate:
    """One task coordinate: its name and the unit that the screen shows; metres_per_radian is the characteristic
    length where it is an angle times that, otherwise None."""

    name: str
    unit: str
    metres_per_radian: float | None = None


@dataclass(frozen=True)
class System:
    """A scenario's objects. `charted` gives the task coordinates: the surface, or Cartesian axes; `mobility` is the
    true arm's largest over Omega; law: with the target model in force, from which `blend`, if there is one, leads to
    another; q_0 (n,) rad."""

    scenario: Scenario
    robot: robots.Robot
    mode: Mode
    layout: TaskLayout
    coordinates: tuple[Coordinate, ...]
    surface: surfaces.Surface
    charted: surfaces.Surface
    nominal: NominalModel
    plant: Plant
    constants: Constants
    mobility: Mobility
    law: Vsmrc
    blend: ModelBlend | None
    motion: trajectories.Trajectory
    force: trajectories.ForceProfile
    sensor: ForceSensor
    push: TimedPush
    plan: ReferencePlan
    q_0: np.ndarray

    @property
    def m(self) -> int:
        """Number of force-controlled directions."""
        return self.mode.m()

    @cached_property
    def observer(self) -> Observer:
        """How the controller looks at the arm."""
        return Observer(self.nominal, self.charted.shape, self.layout)

    @cached_property
    def planned(self) -> Planned:
        """The reference."""
        return Planned(self.plan)

    def observe(self, q: np.ndarray, q_dot: np.ndarray, t: float) -> tuple[Estimate, TaskSpace]:
        """The controller's view of a state: estimates and task coordinates."""
        return self.observer.at(q, q_dot, t)

    def reference(self, t: float) -> Reference:
        """r_d and F_cd with their derivatives at time t (s)."""
        return self.planned.at(t)

    def posture_at(self, q: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        """q_d, q_d_dot with r(q_d, t) = r_d(t) and its rate, by Newton's method from q (n,) rad."""
        return posture_at(self.observe, q, self.reference(t), t)

    def after(self, previous: System, t: float) -> System:
        """With a shift that goes on from where the one of `previous` is at time t (s)."""
        old, new = previous.plan.shift, self.plan.shift
        if (old.end != new.end).any() or old.duration != new.duration:
            old = old.turned(t, new.end, new.duration)
        return self.with_shift(old)

    def with_shift(self, shift: trajectories.Shift) -> System:
        """With this shift in place of the scenario's, which begins at t = 0."""
        return replace(self, plan=self.plan._replace(shift=shift))

    def tool_at(self, reference: Reference, t: float) -> np.ndarray:
        """The tool point (3,) m at which r_d wants it; a planar arm stays in its plane."""
        g = np.zeros(3)
        g[: self.layout.positions] = reference.r_d[: self.layout.positions]
        return self.charted.point(g, t)


def assemble(scenario: Scenario, previous: System | None = None) -> System:
    """All objects of a scenario; parts of `previous` that are the same are used again.

    Raises ScenarioError with one sentence that names the field, its value and what is allowed.
    """
    try:
        return _assemble(scenario, previous)
    except (InvalidGain, RobotError) as error:
        raise ScenarioError(str(error)) from error


def _assemble(scenario: Scenario, previous: System | None) -> System:
    mode = modes.MODES[scenario.mode]
    if scenario.contact.kind not in mode.contacts:
        raise ScenarioError(
            f"contact.kind: {scenario.contact.kind!r} in {mode.name} mode; allowed: {', '.join(mode.contacts)}"
        )
    if scenario.task_space.kind == "joint" and mode.name != "motion":
        raise ScenarioError(
            f"task_space.kind: 'joint' in {mode.name} mode; allowed: 'cartesian' (joint in motion mode)"
        )
    same_robot = previous is not None and previous.scenario.robot == scenario.robot
    robot = previous.robot if previous is not None and same_robot else _robot(scenario)
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
        scenario.contact.kind,
        Contact(*(getattr(scenario.contact, f) for f in Contact._fields)),
        scenario.simulation.integrator,
        scenario.simulation.substeps,
    )
    q_0 = _start(plant, robot)
    layout = _layout(scenario, robot, nominal, q_0)
    charted = surface if mode.on_surface else surfaces.Cartesian.along(_axes(robot))
    motion, force = _motion(scenario, mode, layout), _force(scenario)
    shift = _spread("shift.by", scenario.shift.by, mode, layout)

    observer = Observer(nominal, charted.shape, layout)
    plan = ReferencePlan(
        start=observer.at(q_0, np.zeros(robot.n), 0.0)[1].r,
        compliance=0.0 if mode.name == "constrained" else 1.0 / scenario.controller.K_e_hat,
        m=mode.m(),
        motion=motion.course,
        shift=trajectories.Shift.fresh(shift, scenario.shift.duration),
        force=force.course,
    )
    shaping = ("robot", "task_space", "declared", "surface", "mode", "motion", "shift", "simulation")
    if previous is not None and all(getattr(previous.scenario, f) == getattr(scenario, f) for f in shaping):
        constants = previous.constants
    else:
        unshifted = Planned(plan._replace(shift=trajectories.Shift.fresh(0.0 * shift, 1.0)))
        along = centres(observer.at, unshifted, shift, q_0, scenario.simulation.duration)
        constants = constants_over(along, scenario, _uncertainty(scenario, 0.0), nominal, observer.at)
    if previous is not None and previous.constants is constants and previous.scenario.truth == scenario.truth:
        mobility = previous.mobility
    else:
        mobility = mobility_over(constants, plant, nominal)
    _require_resolved(scenario, plant, mobility)
    return System(
        scenario=scenario,
        robot=robot,
        mode=mode,
        layout=layout,
        coordinates=_coordinates(layout, mode, robot),
        surface=surface,
        charted=charted,
        nominal=nominal,
        plant=plant,
        constants=constants,
        mobility=mobility,
        law=_law(scenario, mode, layout, constants),
        blend=_blend(scenario, mode, layout.n),
        motion=motion,
        force=force,
        sensor=ForceSensor(
            scenario.sensor.noise,
            np.array(scenario.sensor.bias),
            scenario.sensor.delay,
            scenario.sensor.cutoff,
            scenario.controller.period,
        ),
        push=TimedPush(scenario.truth.push, scenario.truth.push_start, scenario.truth.push_duration),
        plan=plan,
        q_0=q_0,
    )


def in_mode(scenario: Scenario, mode_name: str) -> Scenario:
    """The scenario in another mode, with what that mode cannot keep (target model, contact) set to its defaults.

    Raises ScenarioError for an unknown mode.
    """
    changed = edited(scenario, "mode", mode_name)
    mode = modes.MODES[mode_name]
    data = to_plain(changed)
    data["target_model"] = data["blend"] = data["shift"] = {}
    if scenario.contact.kind not in mode.contacts:
        data["contact"]["kind"] = mode.contacts[0]
    if mode_name != "motion":
        data["task_space"]["kind"] = "cartesian"
    return _adapted(from_plain(data))


def on_robot(scenario: Scenario, name: str) -> Scenario:
    """The scenario with another arm of the catalogue: see `with_robot`. Raises ScenarioError for an unknown robot."""
    return with_robot(scenario, {"name": name})


def with_robot(scenario: Scenario, changes: Mapping[str, object]) -> Scenario:
    """The scenario with other fields of `robot`, by name, None for a default.

    Another arm keeps nothing of the old one's fields nor the scenario's name, another tool frame only the arm; what
    depends on the number of joints is at its defaults then. In a mode on a surface the surface is brought to where the
    tool is now. Raises ScenarioError for a field that there is not, and for an arm that cannot be had.
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
    than `NEAR`, and moving as it did; as a formula a wave below the tool, in the world's coordinates.

    Raises ScenarioError for an unknown kind.
    """
    changed = edited(scenario, "surface", {"kind": kind, "motion": to_plain(scenario)["surface"]["motion"]})
    try:
        robot = _robot(scenario)
    except RobotError as error:
        raise ScenarioError(str(error)) from error
    p = _tool_at_start(robot, NominalModel(robot.model, robot.tool_joint, robot.tool_placement))
    phi = float(np.clip(_surface(scenario, p).chart(p, 0.0).g[0], -NEAR, NEAR))
    if kind == "formula":
        height = p[2] + phi - 0.015 * np.sin(15 * p[0])
        return edited(changed, "surface.text", f"z {-height:+.4f} - 0.015*sin(15*x - 2*t)")
    at_origin = _surface(changed, np.zeros(3)).point(np.array([phi, 0.0, 0.0]), 0.0)
    return edited(changed, "surface.origin", (p - at_origin).round(4).tolist())


def _adapted(scenario: Scenario) -> Scenario:
    """In a mode on a surface: the surface brought to the tool when it is farther away than `NEAR`, and a circle
    flattened to a line where an arm has only one direction along the surface."""
    if not modes.MODES[scenario.mode].on_surface:
        return scenario
    try:
        robot = _robot(scenario)
    except RobotError as error:
        raise ScenarioError(str(error)) from error
    p = _tool_at_start(robot, NominalModel(robot.model, robot.tool_joint, robot.tool_placement))
    for _ in range(3):  # far from a typed surface the distance is known only roughly
        chart = _surface(scenario, p).chart(p, 0.0)
        if abs(chart.g[0]) > NEAR:
            origin = np.array(scenario.surface.origin) + chart.G[0] * chart.g[0]
            scenario = edited(scenario, "surface.origin", origin.tolist())
    path = scenario.motion
    if robot.geometry == "planar" and isinstance(path, Circle):
        line = {"kind": "line", "displacement": [2 * path.radius], "period": path.period, "ramp": path.ramp}
        scenario = edited(scenario, "motion", line)
    return scenario


def _robot(scenario: Scenario) -> robots.Robot:
    r = scenario.robot
    return robots.load(
        r.name,
        urdf=r.urdf,
        tool_frame=r.tool_frame,
        tool_offset=r.tool_offset,
        posture=r.posture,
        rotor_inertia=r.rotor_inertia,
    )


def truth_of(scenario: Scenario, robot: robots.Robot) -> Truth:
    """How the true arm differs from the nominal one. Raises ScenarioError."""
    t, n = scenario.truth, robot.n
    scaling = (
        np.broadcast_to(np.array(t.link_scaling, dtype=float), (n,))
        if np.ndim(t.link_scaling) == 0
        else np.array(t.link_scaling)
    )
    if scaling.shape != (n,):
        raise ScenarioError(f"truth.link_scaling: {len(scaling)} values; allowed: one number or {n}, one per link")
    if (scaling <= 0.0).any():
        raise ScenarioError(f"truth.link_scaling: {float(scaling.min())}; allowed: numbers > 0")
    return Truth(
        scaling,
        t.payload_mass,
        np.array(t.payload_offset),
        t.coulomb,
        t.viscous,
        t.disturbance,
        t.disturbance_frequency,
        _torque_limit(t.torque_limit, robot),
    )


def _torque_limit(given: float | tuple[float, ...], robot: robots.Robot) -> np.ndarray:
    """What the drives give at most, (n,) N m; infinite where nothing limits them."""
    path, n, numbers = "truth.torque_limit", robot.n, np.atleast_1d(np.array(given, dtype=float))
    if np.ndim(given) == 0 and numbers[0] == 0.0:
        return np.full(n, np.inf)
    if (numbers <= 0.0).any():
        raise ScenarioError(f"{path}: {float(numbers.min())}; allowed: 0 for no limit, or numbers > 0")
    if np.ndim(given) == 1:
        if len(numbers) != n:
            raise ScenarioError(f"{path}: {len(numbers)} values; allowed: one factor, or {n} torques, one per joint")
        return numbers
    for name, effort in zip(robot.joint_names, robot.model.effortLimit, strict=True):
        if not 0.0 < effort < UNLIMITED:
            raise ScenarioError(
                f"{path}: {given:g}, but the URDF gives no effort limit for joint {name!r}; "
                f"allowed: 0 for no limit, or {n} torques, one per joint"
            )
    return numbers[0] * robot.model.effortLimit


def _tool_at_start(robot: robots.Robot, nominal: NominalModel) -> np.ndarray:
    return nominal.evaluate(robot.posture, np.zeros(robot.n)).p


def _surface_in_use(
    scenario: Scenario, robot: robots.Robot, nominal: NominalModel, previous: System | None
) -> surfaces.Surface:
    """The scenario's surface; one typed as a formula has been looked at where the tool will meet it."""
    if previous is not None and _judged_by(previous.scenario) == _judged_by(scenario):
        return previous.surface
    surface = _surface(scenario, _tool_at_start(robot, nominal))
    met = modes.MODES[scenario.mode].on_surface or scenario.contact.kind != "free"
    if isinstance(surface, TypedSurface) and met:
        try:
            surface.require_regular(scenario.simulation.duration)
        except FormulaError as error:
            raise ScenarioError(f"surface.text: {error}") from error
    return surface


def _judged_by(scenario: Scenario) -> tuple[object, ...]:
    return scenario.surface, scenario.robot, scenario.mode, scenario.contact.kind, scenario.simulation


def _surface(scenario: Scenario, near: np.ndarray) -> surfaces.Surface:
    """near (3,) m: where the tool is, which says what part of a typed surface is meant."""
    s = scenario.surface
    m = s.motion
    motion = surfaces.Motion(_direction("surface.motion.direction", m.direction), m.amplitude, m.frequency)
    match s:
        case Plane():
            return surfaces.Plane.create(np.array(s.origin), _direction("surface.normal", s.normal), motion)
        case Cylinder():
            side = 1.0 if s.side == "outside" else -1.0
            axis, reference = _direction("surface.axis", s.axis), _direction("surface.reference", s.reference)
            try:
                return surfaces.Cylinder.create(np.array(s.origin), axis, reference, s.radius, side, motion)
            except ValueError as error:
                raise ScenarioError(str(error)) from error
        case Sphere():
            side = 1.0 if s.side == "outside" else -1.0
            reference = _direction("surface.reference", s.reference)
            return surfaces.Sphere.create(np.array(s.origin), reference, s.radius, side, motion)
        case Formula():
            normal = _direction("surface.normal", s.normal)
            try:
                return TypedSurface.create(s.text, np.array(s.origin), normal, s.solid, motion, near)
            except FormulaError as error:
                raise ScenarioError(f"surface.text: {error}") from error


def _direction(path: str, vector: tuple[float, float, float]) -> np.ndarray:
    length = float(np.linalg.norm(vector))
    if length < 1e-9:
        raise ScenarioError(f"{path}: {list(vector)}; allowed: a vector that is not zero")
    return np.array(vector) / length


def _start(plant: Plant, robot: robots.Robot) -> np.ndarray:
    try:
        return plant.start(robot.posture, np.zeros(robot.n), 0.0).views.q
    except ValueError as error:
        raise ScenarioError(str(error)) from error


def _axes(robot: robots.Robot) -> np.ndarray:
    """Rows: the Cartesian coordinates in their order; a planar arm uses the first two, x and z."""
    return np.eye(3)[[0, 2, 1]] if robot.geometry == "planar" else np.eye(3)


def _layout(scenario: Scenario, robot: robots.Robot, nominal: NominalModel, q_0: np.ndarray) -> TaskLayout:
    positions = 2 if robot.geometry == "planar" else 3
    angles = {"planar": min(robot.n - 2, 1), "pose": 3, "position": 0}[robot.geometry]
    estimate = nominal.evaluate(q_0, np.zeros(robot.n))
    supplemental = np.zeros(robot.n, dtype=np.int64)
    supplemental[: len(robot.supplemental)] = robot.supplemental
    return TaskLayout(
        n=robot.n,
        joint=scenario.task_space.kind == "joint",
        positions=positions,
        angles=angles,
        supplemental=supplemental,
        l=scenario.task_space.characteristic_length,
        R_ref=estimate.R,
    )


def _coordinates(layout: TaskLayout, mode: Mode, robot: robots.Robot) -> tuple[Coordinate, ...]:
    if layout.joint:
        return tuple(Coordinate(name, "rad") for name in robot.joint_names)
    places = ["φ", "ψ₁", "ψ₂"] if mode.on_surface else (["x", "z"] if layout.positions == 2 else ["x", "y", "z"])
    angles = {0: [], 1: ["ℓ·θ"], 3: ["ℓ·α", "ℓ·β", "ℓ·γ"]}[layout.angles]
    extra = [f"ℓ·q{joint + 1}" for joint in robot.supplemental]
    lengths = [Coordinate(name, "m") for name in places[: layout.positions]]
    return (*lengths, *(Coordinate(name, "m", layout.l) for name in angles + extra))


def _require_resolved(scenario: Scenario, plant: Plant, mobility: Mobility) -> None:
    """Refuse what the plant's step cannot follow where the arm is most mobile: it would explode whatever the
    controller does."""
    integrator, period = scenario.simulation.integrator, scenario.controller.period
    for o in oscillators(scenario.contact.kind, plant.contact, plant.truth, mobility):
        if resolved(integrator, o, period / plant.substeps):
            continue
        enough = substeps_needed(integrator, o, period, int(field_info("simulation.substeps").largest or 1))
        raise ScenarioError(
            f"{o.field}: {o.value:g} {o.unit} is too stiff for {plant.substeps} step(s) of {integrator} per control "
            f"period of {period:g} s, the plant would explode; allowed: "
            + ("" if enough is None else f"simulation.substeps >= {enough}, or ")
            + "a smaller value"
        )


def _uncertainty(scenario: Scenario, k_C: float) -> Uncertainty:
    d = scenario.declared
    return Uncertainty(
        d.link_scaling, d.payload_mass, d.payload_offset, d.coulomb, d.viscous, d.disturbance, d.force_error, k_C
    )


def default_target_model(mode: Mode, n: int, K_e_hat: float) -> dict[str, np.ndarray]:
    """Diagonals for a mode: critically damped at 20 rad/s; softer where it meets forces."""
    M = np.full(n, 10.0)
    K = np.full(n, 1000.0 if mode.name == "impedance" else 4000.0)
    B = 2.0 * np.sqrt(K * M)
    m = mode.m()
    K[:m] = 0.0
    if mode.name == "constrained":
        M[:m], B[:m] = 15.0, 100.0
    else:
        B[:m] = 2.0 * np.sqrt(K_e_hat * M[:m])
    return {"M_m": M, "B_m": B, "K_m": K, "K_f": mode.controlled(n)}


def _square(path: str, value: Matrix | float, n: int) -> np.ndarray:
    if isinstance(value, int | float):
        return np.eye(n) * value
    rows = [np.atleast_1d(np.array(row, dtype=float)) for row in value]
    shape = f"{len(rows)} entries" if all(len(r) == 1 for r in rows) else f"rows of {sorted({len(r) for r in rows})}"
    if len(rows) == n and all(r.shape == (1,) for r in rows) and n > 1:
        return np.diag(np.concatenate(rows))
    if len(rows) == n and all(r.shape == (n,) for r in rows):
        return np.stack(rows)
    raise ScenarioError(f"{path}: {shape}; allowed: {n} diagonal entries or a {n} x {n} matrix")


def target_model(scenario: Scenario, n: int) -> Model:
    """The scenario's (8) for n coordinates, missing matrices at the mode's defaults; not yet judged by the mode.

    Raises ScenarioError and InvalidGain.
    """
    default = default_target_model(modes.MODES[scenario.mode], n, scenario.controller.K_e_hat)
    given = {f: getattr(scenario.target_model, f) for f in TargetModel.__struct_fields__}
    matrices = {
        f: np.diag(default[f]) if value is None else _square(f"target_model.{f}", value, n)
        for f, value in given.items()
    }
    return Model(**matrices)


def blending_to(scenario: Scenario, other: Scenario, at: float, over: float) -> Scenario:
    """The scenario with a blend to the target model of another one, at and over in s.

    Raises ScenarioError where the other is of another mode, or its model has not as many coordinates.
    """
    if other.mode != scenario.mode:
        raise ScenarioError(f"blend.to: a target model of {other.mode} mode; allowed: one of {scenario.mode} mode")
    try:
        model = target_model(other, _robot(scenario).n)
    except (InvalidGain, RobotError) as error:
        raise ScenarioError(f"blend.to: {error}") from error
    to = {name: getattr(model, name).tolist() for name in TargetModel.__struct_fields__}
    return edited(scenario, "blend", {"to": to, "at": at, "over": over})


def _blend(scenario: Scenario, mode: Mode, n: int) -> ModelBlend | None:
    """What the scenario plans; refused unless every model on the way is stable."""
    if not scenario.blend.planned:
        return None
    start = target_model(scenario, n)
    try:
        end = target_model(after_blend(scenario), n)
        mode.check(end, scenario.controller.K_e_hat)
    except (InvalidGain, ScenarioError) as error:
        raise ScenarioError(f"blend.to: {error}") from error
    certificate = certify(start, end, mode.environment(n, scenario.controller.K_e_hat))
    if not certificate.stable:
        raise ScenarioError(
            f"blend.to: {certificate.sentence}; allowed: a model to which the way has its poles left of 0"
        )
    return ModelBlend(start, end, scenario.blend.at, scenario.blend.over, certificate)


def _law(scenario: Scenario, mode: Mode, layout: TaskLayout, constants: Constants) -> Vsmrc:
    n, c = layout.n, scenario.controller
    model = target_model(scenario, n)
    mode.check(model, c.K_e_hat)
    gains = {f: _square(f"controller.{f}", getattr(c, f), n) for f in ("A", "F_1", "F_2", "K_s")}
    return LAWS[c.law](
        model=model,
        compensator=Compensator.design(model, gains["A"], gains["F_1"], gains["F_2"]),
        K_s=gains["K_s"],
        d=None if c.gain == "theorem" else c.d,
        epsilon=c.epsilon,
        bounds=c.bounds,
        switching=Switching[c.switching.upper()],
        phi=c.layer,
        uncertainty=_uncertainty(scenario, constants.lipschitz.k_C),
        controlled=mode.controlled(n),
        m=mode.m(),
    )


def _free(mode: Mode, layout: TaskLayout) -> int:
    """How many coordinates a trajectory may move."""
    return layout.n if layout.joint else layout.positions - mode.m()


def _spread(path: str, displacement: tuple[float, ...], mode: Mode, layout: TaskLayout) -> np.ndarray:
    """A displacement of the free coordinates as one of all n."""
    m, free = mode.m(), _free(mode, layout)
    if len(displacement) > free:
        raise ScenarioError(f"{path}: {len(displacement)} values; allowed: at most {free} in this mode with this arm")
    vector = np.zeros(layout.n)
    vector[m : m + len(displacement)] = displacement
    return vector


def _motion(scenario: Scenario, mode: Mode, layout: TaskLayout) -> trajectories.Trajectory:
    m, n, free = mode.m(), layout.n, _free(mode, layout)

    def spread(displacement: tuple[float, ...]) -> np.ndarray:
        return _spread("motion.displacement", displacement, mode, layout)

    match scenario.motion:
        case Hold():
            return trajectories.PointToPoint(np.zeros(n))
        case PointToPoint() as p:
            return trajectories.PointToPoint(spread(p.displacement), p.duration)
        case Line() as p:
            return trajectories.Line(spread(p.displacement), p.period, p.ramp)
        case Circle() as p:
            if p.axes[0] == p.axes[1] or not all(0 <= a < free for a in p.axes):
                raise ScenarioError(
                    f"motion.axes: {list(p.axes)}; allowed: two different numbers from 0 to {free - 1}"
                    if free > 1
                    else "motion.kind: 'circle' needs two free coordinates; allowed here: hold, point-to-point, line"
                )
            u, v = np.eye(n)[m + p.axes[0]], np.eye(n)[m + p.axes[1]]
            return trajectories.Circle(u, v, p.radius, p.period, p.ramp)


def _force(scenario: Scenario) -> trajectories.ForceProfile:
    match scenario.force:
        case ConstantForce() as f:
            return trajectories.ForceStep(f.value, f.value)
        case ForceStep() as f:
            return trajectories.ForceStep(f.value, f.start, f.time, f.rise)
        case ForceSinusoid() as f:
            return trajectories.ForceSinusoid(f.value, f.amplitude, f.frequency)
