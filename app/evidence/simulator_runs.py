"""Runs of the same controller in two simulators, and accelerations on rigid surfaces by two methods: here, in MuJoCo,
and by Pinocchio's constraint dynamics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from app.evidence.pinocchio_constraint import Kind, RigidGround, by_jacobian, by_slider
from app.scenario.data import edited, shipped
from app.scenario.schema import Scenario
from app.session.changes import on_robot
from app.session.headless_run import play
from app.simulation.assembly import assemble
from app.simulation.closed_loop import ClosedLoop
from app.simulation.system import System
from environments.contact import Contact
from environments.contact_kinds import CONTACTS
from environments.plant import Plant
from environments.surfaces.cylinder import Cylinder
from environments.surfaces.plane import Plane
from environments.surfaces.sphere import Sphere
from environments.surfaces.table import Surface

LADDER = (1, 2, 4, 8, 16)  # Euler steps of this program in a control period, which are compared with
FINE = 4  # Runge-Kutta steps of MuJoCo
MASSES = (0.2, 0.02, 0.002)  # kg, of the surface in the circle's cases
INTO = 0.03  # m, desired way of the impedance downwards, from 11.5 mm above the surface
INTO_CORNER = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])  # directions into three surfaces
SLIDERS = (1e-2, 1e-4, 1e-6)  # kg, masses of sliders


@dataclass(frozen=True)
class Free:
    """Differences of the joint angles, rad, between this program and MuJoCo in free space.
    euler: largest, with Euler's method in both.
    rk4: largest, with Runge-Kutta in both.
    t: (N,) s.
    rungs: for each number of Euler steps in LADDER, differences (N,) from MuJoCo's Runge-Kutta.
    moved: range of the joints' motion, rad."""

    robot: str
    euler: float
    rk4: float
    t: np.ndarray
    rungs: tuple[np.ndarray, ...]
    moved: float


@dataclass(frozen=True)
class Steady:
    """Steady force on a stiffness (N/m), N: of this program, of MuJoCo, and by the closed form."""

    stiffness: float
    ours: float
    mujoco: float
    predicted: float


@dataclass(frozen=True)
class ContactCourse:
    """Course of a contact force in this program and in MuJoCo.
    mass: of the surface, kg.
    t: (N,) s.
    ours, mujoco: (N,) N.
    apart: largest difference, N.
    without, with_drift: residual of (28) in MuJoCo's run, left minus right side, N, without and with the term
    J_dot q_dot of the tool's acceleration.
    drift: largest M_e n J_dot q_dot, N."""

    name: str
    mass: float
    t: np.ndarray
    ours: np.ndarray
    mujoco: np.ndarray
    apart: float
    without: float
    with_drift: float
    drift: float


@dataclass(frozen=True)
class Constraint:
    """Largest differences from Pinocchio over random states on some rigid surfaces at once.
    kinds: of the surfaces.
    states: number of states.
    q_ddot, multiplier: differences from Pinocchio's solver for any constraint, rad/s^2 and N.
    by_slider: both differences from each slider, for a single surface.
    largest: largest acceleration and multiplier, for comparison."""

    kinds: tuple[Kind, ...]
    states: int
    q_ddot: float
    multiplier: float
    by_slider: tuple[tuple[float, float], ...]
    largest: tuple[float, float]


def run(scenario: Scenario, *, mujoco: bool) -> Mapping[str, np.ndarray]:
    """Recorded signals of a run. mujoco: whether MuJoCo computes the plant. Raises RuntimeError when the run stops."""
    system = assemble(scenario)
    if mujoco:
        from app.evidence.mujoco_arm import MujocoPlant  # here: the section is also listed where MuJoCo is missing

        system = replace(system, plant=MujocoPlant(system, scenario.simulation.substeps))
    loop = ClosedLoop.from_system(system)
    periods = round(scenario.simulation.duration / loop.period)
    if mujoco:
        for _ in range(periods):
            loop.advance()
    else:
        play(loop, periods)
    if loop.stopped:
        raise RuntimeError(f"{scenario.name}: {loop.stopped}")
    return loop.recording.signals(tuple(loop.recording.columns))


def free(robot: str, duration: float) -> Free:
    """Differences on a circle in free space, every link 15 % heavier than believed."""
    base = edited(on_robot(shipped()["ur5-motion"], robot), "simulation.duration", duration)

    def angles(integrator: str, substeps: int, *, mujoco: bool) -> Mapping[str, np.ndarray]:
        scenario = edited(edited(base, "simulation.integrator", integrator), "simulation.substeps", substeps)
        return run(scenario, mujoco=mujoco)

    def apart(integrator: str) -> float:
        ours, theirs = (angles(integrator, 1, mujoco=mujoco) for mujoco in (False, True))
        return float(np.abs(ours["q"] - theirs["q"]).max())

    exact = angles("rk4", FINE, mujoco=True)
    rungs = tuple(
        np.abs(angles("semi-implicit-euler", substeps, mujoco=False)["q"] - exact["q"]).max(axis=1)
        for substeps in LADDER
    )
    moved = float(np.ptp(exact["q"], axis=0).max())
    return Free(robot, apart("semi-implicit-euler"), apart("rk4"), exact["t"], rungs, moved)


def _by_euler(scenario: Scenario) -> Scenario:
    """The scenario with Euler's method, which MuJoCo has, too."""
    return edited(scenario, "simulation.integrator", "semi-implicit-euler")


def _touching(scenario: Scenario, stiffness: float, mass: float, duration: float) -> Scenario:
    damping = float(np.sqrt(stiffness))
    fields = {"kind": "mass-damper-spring", "K_e": stiffness, "B_e": damping, "M_e": mass}
    for name, value in fields.items():
        scenario = edited(scenario, f"contact.{name}", value)
    return edited(scenario, "simulation.duration", duration)


def steady(stiffness: float, duration: float) -> Steady:
    """Steady force of an impedance K_m pressed by `INTO` towards a surface K_e: F = K_e K_m depth / (K_m + K_e)."""
    scenario = _touching(_by_euler(shipped()["ur5-hybrid"]), stiffness, MASSES[0], duration)
    scenario = edited(edited(scenario, "mode", "impedance"), "motion", "hold")
    scenario = edited(scenario, "shift", {"by": [0.0, 0.0, -INTO], "duration": 0.5})
    system = assemble(scenario)
    tool, _ = system.plant.tool(system.plant.start(system.robot.posture, np.zeros(system.robot.n), 0.0))
    depth = INTO + float(system.surface.chart(tool, 0.0).g[0])
    K_m = float(system.controller.model.K_m[2, 2])
    ours, theirs = (float(run(scenario, mujoco=mujoco)["multiplier"][-1]) for mujoco in (False, True))
    return Steady(stiffness, ours, theirs, stiffness * K_m * depth / (K_m + stiffness))


def contact_course(name: str, motion: str, mass: float, duration: float) -> ContactCourse:
    """Course of the contact force under force control at 20 N, from free space on, while the tool rests or draws a
    circle."""
    scenario = _touching(_by_euler(shipped()["ur5-hybrid"]), 1e4, mass, duration)
    if motion == "hold":
        scenario = edited(scenario, "motion", "hold")
    ours, theirs = (run(scenario, mujoco=mujoco) for mujoco in (False, True))
    without, with_drift, drift = _balance(assemble(scenario), theirs)
    f, g = ours["multiplier"], theirs["multiplier"]
    return ContactCourse(name, mass, ours["t"], f, g, float(np.abs(f - g).max()), without, with_drift, drift)


def _balance(system: System, record: Mapping[str, np.ndarray]) -> tuple[float, float, float]:
    """Residuals of f = M_e phi_ddot + B_e phi_dot + K_e phi without and with drift, and the drift, N, see
    `ContactCourse`; q_ddot is the difference of the rates over the step, as in Euler's method."""
    contact, period = system.plant.contact, system.scenario.controller.period
    model, normal = system.robot.model, system.surface.chart(np.zeros(3), 0.0).G[0]
    model = model.copy()
    frame = model.addFrame(_tool(system))
    data, axes = model.createData(), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    rest, whole, drifts = [], [], []
    for k in np.flatnonzero(record["multiplier"][:-1] > 0.0)[::10]:
        q, q_dot = record["q"][k], record["q_dot"][k]
        pin.forwardKinematics(model, data, q, q_dot, np.zeros_like(q))
        J = normal @ pin.computeFrameJacobian(model, data, q, frame, axes)[:3]
        drift = contact.M_e * (normal @ pin.getFrameClassicalAcceleration(model, data, frame, axes).linear)
        q_ddot = (record["q_dot"][k + 1] - q_dot) / period
        f = contact.M_e * (J @ q_ddot) + contact.B_e * (J @ q_dot) + contact.K_e * record["phi"][k]
        rest.append(record["multiplier"][k] - f)
        whole.append(record["multiplier"][k] - f - drift)
        drifts.append(drift)
    without, with_drift, drift = (float(np.abs(values).max()) for values in (rest, whole, drifts))
    return without, with_drift, drift


def constraint(kinds: tuple[Kind, ...], seed: int, states: int) -> Constraint:
    """Differences of `environments.rigid_surfaces` from Pinocchio, on some surfaces at once, for random states and
    torques and a heavy tool."""
    random = np.random.default_rng(seed)
    heavier = edited(_by_euler(shipped()["ur5-constrained"]), "truth.link_scaling", 1.1)
    scenario = edited(heavier, "truth.payload_mass", 2.0)
    system = assemble(scenario)
    robot, n = system.robot, system.robot.n
    p, _ = system.plant.tool(system.plant.start(robot.posture, np.zeros(n), 0.0))
    both = [_ground(kind, p, into, random) for kind, into in zip(kinds, INTO_CORNER, strict=False)]
    grounds, surfaces = [ground for ground, _ in both], tuple(surface for _, surface in both)
    bilateral = Contact(0.0, 0.0, 0.0, unilateral=False, friction_coulomb=0.0, friction_viscous=0.0)
    plant = Plant(
        robot, system.plant.truth, surfaces, CONTACTS["rigid"], len(kinds) * (bilateral,), "semi-implicit-euler"
    )
    tool, found = _tool(system), []
    for _ in range(states):
        state = plant.start(robot.posture + random.uniform(-0.2, 0.2, n), random.uniform(-1.0, 1.0, n), 0.0)
        q, q_dot, tau = state.views.q.copy(), state.views.q_dot.copy(), random.uniform(-50.0, 50.0, n)
        plant.advance(state, tau, 0.0, 1e-3)
        q_ddot, multipliers = state.views.q_ddot, state.read().load.multiplier[: len(kinds)]
        others = [by_jacobian(plant.model, tool, grounds, q, q_dot, tau)]
        if len(grounds) == 1:
            others += [by_slider(plant.model, tool, grounds[0], q, q_dot, tau, mass) for mass in SLIDERS]
        apart = [(np.abs(q_ddot - o.q_ddot).max(), np.abs(multipliers - o.multipliers).max()) for o in others]
        found.append([*apart, (np.abs(q_ddot).max(), np.abs(multipliers).max())])
    (a, b), *sliders, largest = [(float(a), float(b)) for a, b in np.array(found).max(axis=0)]
    return Constraint(kinds, states, a, b, tuple(sliders), largest)


def _ground(kind: Kind, p: np.ndarray, into: np.ndarray, random: np.random.Generator) -> tuple[RigidGround, Surface]:
    """Random surface near the tool point p (3,) m, for Pinocchio and for this program. into: (3,) unit, from which its
    normal differs at random."""
    normal = _unit(into + 0.4 * random.standard_normal(3))
    axis = _unit(np.array([into[1], -into[2], into[0]]) + 0.2 * random.standard_normal(3))
    radius = 0.3
    match kind:
        case "plane":
            origin = p + 0.02 * normal
            form = Plane(origin=_triple(origin), normal=_triple(normal))
        case "cylinder":
            origin = p + 1.05 * radius * normal
            form = Cylinder(origin=_triple(origin), axis=_triple(axis), reference=_triple(-normal), radius=radius)
        case "sphere":
            origin = p + 1.05 * radius * normal
            form = Sphere(origin=_triple(origin), reference=_triple(-normal), radius=radius)
    return RigidGround(kind, origin, normal, axis, radius), Surface.of(form)


def _triple(vector: np.ndarray) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return x, y, z


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)


def _tool(system: System) -> pin.Frame:
    robot = system.robot
    return pin.Frame("the tool point", robot.tool_joint, robot.tool_placement, pin.FrameType.OP_FRAME)
