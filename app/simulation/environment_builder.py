"""The world of a scenario, checked: its arm, how that truly is, the surface, and what is asked of the tool."""

from __future__ import annotations

import numpy as np

from app.scenario.schema import (
    Circle,
    ConstantForce,
    Cylinder,
    ForceSinusoid,
    ForceStep,
    Formula,
    Hold,
    Line,
    Plane,
    PointToPoint,
    Scenario,
    ScenarioError,
    Sphere,
)
from controllers.modes import Mode
from controllers.nominal_model import NominalModel
from controllers.task_space import TaskLayout
from environments import robots, surfaces, trajectories
from environments.formula import FormulaError
from environments.plant import Truth
from environments.typed_surface import TypedSurface

UNLIMITED = 1e6  # N m: a URDF's effort limit beyond this says that there is none


def robot_of(scenario: Scenario) -> robots.Robot:
    """The arm as the controller believes it to be. Raises RobotError."""
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


def tool_at_start(robot: robots.Robot, nominal: NominalModel) -> np.ndarray:
    """Where the tool is in the robot's own posture, (3,) m."""
    return nominal.evaluate(robot.posture, np.zeros(robot.n)).p


def surface_of(scenario: Scenario, near: np.ndarray) -> surfaces.Surface:
    """near (3,) m: where the tool is, which says what part of a typed surface is meant. Raises ScenarioError."""
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


def task_axes(robot: robots.Robot) -> np.ndarray:
    """Rows: the Cartesian coordinates in their order; a planar arm uses the first two, x and z."""
    return np.eye(3)[[0, 2, 1]] if robot.geometry == "planar" else np.eye(3)


def positions_of(robot: robots.Robot) -> int:
    """How many of a Cartesian task's coordinates are positions."""
    return 2 if robot.geometry == "planar" else 3


def _free(mode: Mode, layout: TaskLayout) -> int:
    """How many coordinates a trajectory may move."""
    return layout.n if layout.joint else layout.positions - mode.m()


def spread_over(path: str, displacement: tuple[float, ...], mode: Mode, layout: TaskLayout) -> np.ndarray:
    """A displacement of the free coordinates as one of all n. Raises ScenarioError with `path` for too long a one."""
    m, free = mode.m(), _free(mode, layout)
    if len(displacement) > free:
        raise ScenarioError(f"{path}: {len(displacement)} values; allowed: at most {free} in this mode with this arm")
    vector = np.zeros(layout.n)
    vector[m : m + len(displacement)] = displacement
    return vector


def motion_of(scenario: Scenario, mode: Mode, layout: TaskLayout) -> trajectories.Trajectory:
    """What the free coordinates are asked to do, (n,) from the start on. Raises ScenarioError."""
    m, n, free = mode.m(), layout.n, _free(mode, layout)

    def spread(displacement: tuple[float, ...]) -> np.ndarray:
        return spread_over("motion.displacement", displacement, mode, layout)

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


def require_pushing(scenario: Scenario, mode: Mode) -> None:
    """Raises ScenarioError where the desired force is below zero at times and the surface only pushes.

    A rigid surface is left to the run, which stops when contact is lost.
    """
    contact, f = scenario.contact, scenario.force
    if not (mode.m() and contact.unilateral) or contact.kind == "rigid":
        return
    otherwise = "contact.unilateral = false"
    if isinstance(f, ForceSinusoid) and f.amplitude > f.value >= 0.0:
        raise ScenarioError(
            f"force.amplitude: {f.amplitude:g} N around {f.value:g} N, but the surface only pushes "
            f"(contact.unilateral); allowed: at most the mean, or {otherwise}"
        )
    for name in ("value", "start"):
        if (force := getattr(f, name, 0.0)) < 0.0:
            raise ScenarioError(
                f"force.{name}: {force:g} N, but the surface only pushes (contact.unilateral); "
                f"allowed: at least 0 N, or {otherwise}"
            )


def force_of(scenario: Scenario) -> trajectories.ForceProfile:
    """The desired normal force, N."""
    match scenario.force:
        case ConstantForce() as f:
            return trajectories.ForceStep(f.value, f.value)
        case ForceStep() as f:
            return trajectories.ForceStep(f.value, f.start, f.time, f.rise)
        case ForceSinusoid() as f:
            return trajectories.ForceSinusoid(f.value, f.amplitude, f.frequency)
