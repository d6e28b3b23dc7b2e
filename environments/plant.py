"""Plant: the true arm in its environment, (2); its masses, payload, friction and disturbance are unknown to the
controller."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from environments.contact import (
    SETS,
    Contact,
    ContactForce,
    Contacts,
    Face,
    Holding,
    MultiplierWork,
    ToolContacts,
    World,
    add_contact_force,
    add_drift,
    elastic_load,
    find_touched,
    heavy_multipliers,
    let_go,
    one_sided,
    place_tool,
    touch_at,
)
from environments.contact_kinds import ContactKind
from environments.coupled_surfaces import EnvironmentMatrices
from environments.integrators import (
    STAGES,
    Integrator,
    begin_stages,
    drift,
    end_stages,
    kick_and_drift,
    next_stage,
    semi_implicit_euler,
)
from environments.rigid_surfaces import CORRECTIONS, NEAR_SURFACE, along_surface, onto_surface, out_of_reach
from environments.robots import Robot
from environments.surfaces.chart import Shapes, one_of
from environments.surfaces.table import Surface
from kernels import address_for, compiled_for, inline, kernel
from kernels.algebra import copy, cross, dot, solve_spd, transposed_times
from kernels.records import Record
from kernels.rigid_body import Chain

WORLD = pin.Convention.WORLD
SLIP_RATE = 0.01  # rad/s, the smooth transition of Coulomb friction in the joints


@dataclass(frozen=True)
class Truth:
    """Differences of the true arm from the nominal one.

    link_scaling: (n,), factor on each link's inertia.
    payload_mass, payload_offset: kg, a point at (3,) m in the tool frame.
    coulomb, viscous: N m and N m s/rad per joint.
    disturbance, disturbance_frequency: a torque of this norm (N m) at all times, turning through the joints with this
    frequency, Hz.
    torque_limit: (n,) N m, of the drives, see `limited`.
    rotor_scaling: (n,), factor on each rotor's inertia.
    link_centre: (n, 3) m, shift of each link's centre of mass, in the link's frame.
    link_shape: (n, 3, 3), symmetric Z: each link's inertia I about its centre of mass is I^1/2 (1 + Z) I^1/2.
    """

    link_scaling: np.ndarray
    payload_mass: float
    payload_offset: np.ndarray
    coulomb: float
    viscous: float
    disturbance: float
    disturbance_frequency: float
    torque_limit: np.ndarray | float = np.inf
    rotor_scaling: np.ndarray | float = 1.0
    link_centre: np.ndarray | float = 0.0
    link_shape: np.ndarray | float = 0.0

    def model(self, robot: Robot) -> pin.Model:
        """Pinocchio's model of the true arm."""
        model = robot.model.copy()
        n = len(self.link_scaling)
        shifts, shapes = np.broadcast_to(self.link_centre, (n, 3)), np.broadcast_to(self.link_shape, (n, 3, 3))
        for joint, (alpha, shift, Z) in enumerate(zip(self.link_scaling, shifts, shapes, strict=True), start=1):
            link, I = model.inertias[joint], model.inertias[joint].inertia
            if Z.any():
                squares, axes = np.linalg.eigh(I)
                root = axes * np.sqrt(squares.clip(min=0.0)) @ axes.T
                I = I + root @ Z @ root
            model.inertias[joint] = pin.Inertia(alpha * link.mass, link.lever + shift, alpha * I)
        model.armature = self.rotor_scaling * model.armature
        if self.payload_mass > 0.0:
            load = pin.Inertia(self.payload_mass, self.payload_offset, np.zeros((3, 3)))
            model.appendBodyToJoint(robot.tool_joint, load, robot.tool_placement)
        return model

    def torque(self, q_dot: np.ndarray, t: float) -> np.ndarray:
        """Joint friction plus disturbance, (n,) N m, on the left side of (2)."""
        torque = np.empty_like(q_dot)
        _resistance_alone(Record(self.resistance).data, q_dot, t, torque)
        return torque

    @property
    def resistance(self) -> Resistance:
        """Friction and disturbance in the joints, for kernels."""
        omega = 2 * np.pi * self.disturbance_frequency
        return Resistance(float(self.coulomb), float(self.viscous), float(self.disturbance), omega)


class Resistance(NamedTuple):
    """Friction and disturbance of `Truth` in the joints; omega: of the disturbance, rad/s."""

    coulomb: float
    viscous: float
    disturbance: float
    omega: float


class Arm(NamedTuple):
    """State of the arm.
    q, q_dot: (n,).
    load: the contact's `ContactForce` in this state; with a rigid or heavy environment that of the last step, since it
    depends on the torque.
    q_ddot: (n,), of the period before: that of its first integration step.
    holding: rigid surfaces that the tool is held on."""

    q: np.ndarray
    q_dot: np.ndarray
    load: ContactForce
    q_ddot: np.ndarray
    holding: Holding

    @classmethod
    def zeros(cls, n: int) -> Arm:
        """State at rest, all joints at zero."""
        return cls(np.zeros(n), np.zeros(n), ContactForce.zeros(n), np.zeros(n), Holding.none())


PlantState = Record[Arm]


@inline
def limited(limits, tau, applied):
    """Compute the torque that the drives apply: applied (n,) = tau, within the limits (n,) N m."""
    for i in range(applied.shape[0]):
        applied[i] = min(max(tau[i], -limits[i]), limits[i])


@inline
def resistance_torque(resistance, q_dot, t, torque):
    """Compute friction and disturbance in the joints, torque (n,) N m, on the left side of (2)."""
    n = q_dot.shape[0]
    for i in range(n):
        torque[i] = resistance.viscous * q_dot[i]
        if resistance.coulomb > 0.0:
            torque[i] += resistance.coulomb * np.tanh(q_dot[i] / SLIP_RATE)
    if resistance.disturbance > 0.0:
        # squares of n sines that are 2 pi/n apart add up to n/2 at all times if n > 2; for two they would be equal
        apart = 2 * np.pi / n if n > 2 else np.pi / 2
        size = resistance.disturbance * np.sqrt(2 / n)
        for i in range(n):
            torque[i] += size * np.sin(resistance.omega * t + apart * i)


@kernel
def _resistance_alone(resistance, q_dot, t, torque):
    resistance_torque(resistance[0], q_dot, t, torque)


class PlantWorkspace(NamedTuple):
    """Workspace of the plant, for what its kernels compute between two of Pinocchio's calls.
    resistance: friction and disturbance of the arm's joints.
    touch, multipliers: geometry of the contacts, and memory for their multipliers.
    torque: (n,) N m, that moves the arm.
    push, pushed: (3,) N, a force on the tool, and (n,) N m, its torque.
    factor: (n, n), memory for Cholesky's factor.
    speeds, accelerations: (n,), sums of q_dot and q_ddot over the stages of Runge and Kutta."""

    world: World
    resistance: Resistance
    touch: ToolContacts
    multipliers: MultiplierWork
    torque: np.ndarray
    push: np.ndarray
    pushed: np.ndarray
    factor: np.ndarray
    speeds: np.ndarray
    accelerations: np.ndarray

    @classmethod
    def of(cls, world: World, resistance: Resistance, n: int) -> PlantWorkspace:
        """Workspace of an arm with n joints."""
        v = np.zeros(n)
        met = (ToolContacts.zeros(n), MultiplierWork.zeros(n))
        return cls(world, resistance, *met, v, np.zeros(3), v, np.zeros((n, n)), v, v)


class PlantAddresses(NamedTuple):
    """Addresses of the kernels of one kind of contact in this process, for `kernels.pointers`; 0 for one without.
    accelerate: `accelerate_...`. find: the load after a period. push: torque of a push on the tool.
    force: see `Plant.force_of`. onto, along: `onto_surface`, `along_surface`."""

    accelerate: int
    find: int
    push: int
    force: int
    onto: int
    along: int


@inline
def _accelerate(around, M, bias, arm, tau, t):
    """Compute q_ddot under the torque tau and the present load."""
    torque = around.torque
    resistance_torque(around.resistance, arm.q_dot, t, torque)
    for i in range(torque.shape[0]):
        torque[i] = tau[i] - bias[i] - torque[i] - arm.load.torque[i]
    solve_spd(M, torque, around.factor, arm.q_ddot)


@kernel
def accelerate_free(around, M, bias, arm, tau, t):
    """Compute q_ddot in free space under the torque tau; bias (n,) N m: C q_dot + G."""
    _accelerate(around[0], M, bias, arm[0], tau, t)


@kernel
def accelerate_elastic(around, M, bias, J, rotation, translation, arm, tau, t):
    """Compute the load in the present state, and q_ddot under the torque tau against it."""
    around, arm = around[0], arm[0]
    touch_at(around.world, J, rotation, translation, arm.q_dot, t, around.touch)
    elastic_load(around.world, around.touch, around.multipliers, arm.load)
    _accelerate(around, M, bias, arm, tau, t)


@inline
def _find_multipliers(around, M):
    """Compute the multipliers of heavy contacts, with friction for the signs `side` of them."""
    world, touch, work = around.world, around.touch, around.multipliers
    k = world.shapes.number
    for j in range(k):
        met = one_of(touch, j)
        for a in range(3):
            around.push[a] = met.chart.G[0, a] + work.side[j] * met.drag[a]
        transposed_times(touch.tool.J_v, around.push, around.pushed)
        solve_spd(M, around.pushed, around.factor, work.directions[j])
        for i in range(k):
            work.mobility[i, j] = dot(one_of(touch, i).pull, work.directions[j])
    heavy_multipliers(world, touch, work, work.found)


@inline
def _accelerate_against(around, M, bias, arm, tau, t):
    """Compute the multipliers of the surfaces that the tool touches, `work.touches`, under the torque tau, and q_ddot
    without them."""
    world, touch, torque, n = around.world, around.touch, around.torque, arm.q.shape[0]
    work = around.multipliers
    for a in range(3):
        around.push[a] = 0.0
    for i in range(world.shapes.number):
        add_contact_force(one_of(world.contacts, i), 0.0, work.touches[i] > 0, one_of(touch, i), around.push)
    transposed_times(touch.tool.J_v, around.push, around.pushed)
    resistance_torque(around.resistance, arm.q_dot, t, torque)
    for i in range(n):
        torque[i] = tau[i] - bias[i] - torque[i] - around.pushed[i]
    solve_spd(M, torque, around.factor, arm.q_ddot)  # without the multipliers
    for i in range(world.shapes.number):
        met = one_of(touch, i)
        work.free[i] = dot(met.pull, arm.q_ddot) + met.phi_ddot_bias
        work.side[i] = 1.0
    _find_multipliers(around, M)
    turned = False
    for i in range(world.shapes.number):  # where a bilateral surface pulls, friction still opposes the slip
        if work.found[i] < 0.0 and not one_of(world.contacts, i).unilateral:
            work.side[i], turned = -1.0, True
    if turned:
        _find_multipliers(around, M)


@kernel
def accelerate_heavy(around, M, bias, J, J_dot, rotation, translation, arm, tau, t):
    """Compute q_ddot under the torque tau, and the load, which depends on it.

    A rigid surface that only pushes, but would have to pull, is let go, each by itself: of the sets of surfaces to let
    go, the first one is taken with which none that is held pulls, and none that is let go is entered. Without friction
    there is just one. With much Coulomb friction there may be none; then all are let go.
    """
    around, arm = around[0], arm[0]
    world, touch, n = around.world, around.touch, arm.q.shape[0]
    work, load, holding = around.multipliers, arm.load, arm.holding
    touch_at(world, J, rotation, translation, arm.q_dot, t, touch)
    add_drift(world, J, J_dot, arm.q_dot, touch)
    for trial in range(SETS + 1):
        if not world.rigid:
            find_touched(world, touch, holding.held, work)
        elif not let_go(world, holding.held, trial, work.touches):
            continue
        _accelerate_against(around, M, bias, arm, tau, t)
        if trial == 0:
            copy(work.found, work.whole)
        if not world.rigid or one_sided(world, holding.held, work, work.free, work.found):
            break
    if world.rigid:
        for i in range(world.shapes.number):
            if holding.held[i] > 0 and work.touches[i] == 0:
                holding.held[i], holding.lost[i], holding.pull[i] = 0, t, work.whole[i]
    for a in range(6):
        load.wrench[a] = 0.0
    for i in range(world.shapes.number):
        contact, met, multiplier = one_of(world.contacts, i), one_of(touch, i), work.found[i]
        load.multiplier[i], load.phi[i] = multiplier, met.phi
        for j in range(n):
            arm.q_ddot[j] -= work.directions[i, j] * multiplier
        add_contact_force(contact, multiplier, work.touches[i] > 0, met, load.wrench)
    transposed_times(touch.tool.J_v, load.wrench, load.torque)


@kernel
def load_at(around, J, rotation, translation, arm, t):
    around, arm = around[0], arm[0]
    world = around.world
    touch_at(world, J, rotation, translation, arm.q_dot, t, around.touch)
    elastic_load(world, around.touch, around.multipliers, arm.load)


@kernel
def penetration_at(around, J, rotation, translation, arm, t):
    touch_at(around[0].world, J, rotation, translation, arm[0].q_dot, t, around[0].touch)
    for i in range(around[0].world.shapes.number):
        arm[0].load.phi[i] = one_of(around[0].touch, i).phi


@kernel
def force_of(around, J, rotation, translation, arm, multiplier, t, force):
    """Compute the wrench (6,) of the tool on the environment for multipliers (3,) N."""
    world, around = around[0].world, around[0]
    touch_at(world, J, rotation, translation, arm[0].q_dot, t, around.touch)
    find_touched(world, around.touch, arm[0].holding.held, around.multipliers)
    for a in range(6):
        force[a] = 0.0
    for i in range(world.shapes.number):
        contact, met, touches = one_of(world.contacts, i), one_of(around.touch, i), around.multipliers.touches[i] > 0
        add_contact_force(contact, multiplier[i], touches, met, force)


@kernel
def torque_of_push(around, J, rotation, translation, push, torque):
    """Compute the torque (n,) N m of a push on the tool, a wrench (6,)."""
    tool = around[0].touch.tool.p
    place_tool(around[0].world.lever, rotation, translation, tool)
    for j in range(torque.shape[0]):
        about = cross(tool, (J[3, j], J[4, j], J[5, j]))
        torque[j] = 0.0
        for a in range(3):
            torque[j] += (J[a, j] - about[a]) * push[a] + J[3 + a, j] * push[3 + a]


class Plant:
    """Plant M q_ddot + C q_dot + G + J^T F + f = tau, integrated with tau held over each control period.

    environment: matrices of (28) over the surfaces; by default the diagonals of the contacts' numbers.
    """

    def __init__(
        self,
        robot: Robot,
        truth: Truth,
        surfaces: tuple[Surface, ...],
        kind: ContactKind,
        contacts: tuple[Contact, ...],
        integrator: Integrator = "leapfrog",
        substeps: int = 1,
        face: Face | None = None,
        environment: EnvironmentMatrices | None = None,
    ) -> None:
        self.truth, self.surfaces, self.contacts, self.robot = truth, surfaces, contacts, robot
        self.face = Face.point() if face is None else face
        if environment is None:
            environment = EnvironmentMatrices.apart(*np.array([each[:3] for each in contacts]).T)
        self.environment = environment
        self.kind = kind
        self.substeps = substeps
        self.model = truth.model(robot)
        self.data = self.model.createData()
        self._lever = np.array(robot.tool_placement.translation)
        shapes = Shapes.of(tuple(each.shape for each in surfaces))
        world = World(self._lever, self.face, shapes, Contacts.of(contacts), kind.rigid, environment)
        around = Record(PlantWorkspace.of(world, truth.resistance, robot.n))
        self._around, self._torque = around.data, around.views.torque
        # live views: Pinocchio fills them at every call
        carrier = self.data.oMi[robot.tool_joint]
        self._tool = (self.data.J, carrier.rotation, carrier.translation)
        self._tool_moving = (self.data.J, self.data.dJ, carrier.rotation, carrier.translation)
        self._inertia = (self.data.M, self.data.nle)
        self._integrator: Integrator = integrator
        self._integrate = {"leapfrog": self._leapfrog, "semi-implicit-euler": self._euler, "rk4": self._rk4}[integrator]
        self._accelerate = (
            self._accelerate_heavy
            if kind.heavy
            else self._accelerate_elastic
            if kind.springs
            else self._accelerate_free
        )
        self._resolve_kernels(robot.n)

    @property
    def surface(self) -> Surface:
        """First surface."""
        return self.surfaces[0]

    @property
    def contact(self) -> Contact:
        """Contact with the first surface."""
        return self.contacts[0]

    @property
    def workspace(self) -> np.ndarray:
        """Data of the `PlantWorkspace`, (1,), for kernels."""
        return self._around

    def smooth(self, *, touching: bool) -> Plant:
        """Plant of the same arm without anything that has a kink or acts from outside: no Coulomb friction, no limits
        of the drives, no disturbance, and a surface that also pulls, or, not touching, a spring of zero stiffness."""
        truth = replace(self.truth, coulomb=0.0, disturbance=0.0, torque_limit=np.inf)
        contacts = tuple(each._replace(unilateral=False, friction_coulomb=0.0) for each in self.contacts)
        environment = self.environment if touching else None
        if not touching:
            nothing = Contact(0.0, 0.0, 0.0, unilateral=False, friction_coulomb=0.0, friction_viscous=0.0)
            contacts = (nothing,) * len(contacts)
        rest = (self._integrator, self.substeps, self.face, environment)
        return Plant(self.robot, truth, self.surfaces, self.kind, contacts, *rest)

    def _resolve_kernels(self, n: int) -> None:
        around, arm, tau = self._around, Record.zeros(Arm, n).data, np.zeros(n)
        self._stage = Record.zeros(Arm, n)
        self._begin_stages = compiled_for(begin_stages, around, arm, arm)
        self._next_stage = compiled_for(next_stage, around, arm, arm, 0.0, 0.0)
        self._end_stages = compiled_for(end_stages, around, arm, arm, 0.0)
        self._drift = compiled_for(drift, arm, 0.0)
        self._kick_and_drift = compiled_for(kick_and_drift, arm, 0.0)
        self._step_of_euler = compiled_for(semi_implicit_euler, arm, 0.0)
        by_kind = self._kernels_of_contact(arm, tau)
        self._torque_of_push = compiled_for(*by_kind["push"])
        self._answer = compiled_for(*by_kind["accelerate"])
        if self.kind.springs:
            self._find = compiled_for(*by_kind["find"])
        if self.kind.heavy:
            self._onto_surface, self._along_surface = (compiled_for(*by_kind[name]) for name in ("onto", "along"))

    def _kernels_of_contact(self, arm: np.ndarray, tau: np.ndarray) -> dict[str, tuple[Any, ...]]:
        """Kernels that this kind of contact needs, by the names of `PlantAddresses`, each with its arguments."""
        around, tool, inertia = self._around, self._tool, self._inertia
        kernels: dict[str, tuple[Any, ...]] = {"push": (torque_of_push, around, *tool, np.zeros(6), tau)}
        if self.kind.springs:
            find = penetration_at if self.kind.massive else load_at
            kernels["find"] = (find, around, *tool, arm, 0.0)
        if self.kind.heavy:
            kernels["accelerate"] = (accelerate_heavy, around, *inertia, *self._tool_moving, arm, tau, 0.0)
            kernels["onto"] = (onto_surface, around, *tool, self.data.M, arm, 0.0)
            kernels["along"] = (along_surface, around, *tool, self.data.M, arm, 0.0, 0.0)
            kernels["force"] = (force_of, around, *tool, arm, np.zeros(3), 0.0, np.zeros(6))
        elif self.kind.springs:
            kernels["accelerate"] = (accelerate_elastic, around, *inertia, *tool, arm, tau, 0.0)
        else:
            kernels["accelerate"] = (accelerate_free, around, *inertia, arm, tau, 0.0)
        return kernels

    @cached_property
    def chain(self) -> Chain:
        """Constants of the true arm for `kernels.rigid_body`. Raises ValueError where it is no serial chain."""
        return Chain.of(self.model)

    @cached_property
    def addresses(self) -> PlantAddresses:
        """Addresses of the kernels of this contact."""
        arm = Record.zeros(Arm, self.model.nv)
        kernels = self._kernels_of_contact(arm.data, arm.views.q)
        names = PlantAddresses._fields
        return PlantAddresses._make(address_for(*kernels[name]) if name in kernels else 0 for name in names)

    def start(self, q: np.ndarray, q_dot: np.ndarray, t: float) -> PlantState:
        """State with q (n,), q_dot (n,) at time t; on a rigid surface it is moved onto the surface.

        Raises ValueError when the rigid surface cannot be reached from q.
        """
        state = Record.zeros(Arm, len(q))
        state.views.q[:], state.views.q_dot[:] = q, q_dot
        if self.kind.rigid:
            state.views.holding.held[: len(self.surfaces)] = 1
            self._constrain(state, t, 0.0)
        if self.kind.springs:
            pin.computeJointJacobians(self.model, self.data, state.views.q)
            load_at(self._around, *self._tool, state.data, t)
        return state

    def advance(self, state: PlantState, tau: np.ndarray, t: float, period: float) -> None:
        """Advance the state by one control period from time t with the torque tau (n,) N m."""
        h = period / self.substeps
        self._integrate(state, tau, t, h)
        if self.substeps > 1:
            first = state.views.q_ddot.copy()
            for i in range(1, self.substeps):
                self._integrate(state, tau, t + i * h, h)
            state.views.q_ddot[:] = first
        self.find_load(state, t + period)

    def find_load(self, state: PlantState, t: float) -> None:
        """Compute the contact's load in a state at time t (s); a heavy contact keeps the load of the torque before,
        except for phi."""
        if not self.kind.springs:  # none in free space, and on a rigid surface `_constrain` has set phi
            return
        pin.computeJointJacobians(self.model, self.data, state.views.q)
        self._find(self._around, *self._tool, state.data, t)

    def respond(self, state: PlantState, tau: np.ndarray, t: float, period: float) -> ContactForce:
        """Load of the contact that the torque tau (n,) N m will cause in the period (s) from time t on."""
        acting, at = self._evaluated_at(state, t, period / self.substeps)
        self._accelerate(acting, tau, at)
        return acting.part("load")

    def force_of(self, state: PlantState, multiplier: np.ndarray, t: float, period: float) -> np.ndarray:
        """Wrench (6,) of the tool on the environment in the period (s) from time t on, when the multipliers of heavy
        contacts are the given ones (3,) N."""
        force = np.zeros(6)
        acting, at = self._evaluated_at(state, t, period / self.substeps)
        pin.computeJointJacobians(self.model, self.data, acting.views.q)
        force_of(self._around, *self._tool, acting.data, multiplier, at, force)
        return force

    def _evaluated_at(self, state: PlantState, t: float, h: float) -> tuple[PlantState, float]:
        """Copy of the state, and the time, at which a step of h s evaluates the acceleration first."""
        twin = state.copy()
        if self._integrator != "leapfrog":
            return twin, t
        self._drift(twin.data, 0.5 * h)
        return twin, t + 0.5 * h

    def torque_of_push(self, state: PlantState, push: np.ndarray) -> np.ndarray:
        """Torque (n,) N m of a push on the tool in a state, a wrench (6,)."""
        torque = np.zeros(self.model.nv)
        pin.computeJointJacobians(self.model, self.data, state.views.q)
        self._torque_of_push(self._around, *self._tool, push, torque)
        return torque

    def tool(self, state: PlantState) -> tuple[np.ndarray, np.ndarray]:
        """Tool point (3,) m and orientation (3, 3) of the tool in a state."""
        _, rotation, translation = self._tool
        pin.computeJointJacobians(self.model, self.data, state.views.q)
        return translation + rotation @ self._lever, rotation @ self.robot.tool_placement.rotation

    # The three methods below write q_ddot under the torque tau (n,) N m at time t (s), and the contact's load, into the
    # state. With WORLD, `crba` also computes the joints' Jacobians and placements.

    def _accelerate_free(self, state: PlantState, tau: np.ndarray, t: float) -> None:
        arm = state.views
        q, q_dot = arm.q, arm.q_dot
        pin.crba(self.model, self.data, q)
        pin.nonLinearEffects(self.model, self.data, q, q_dot)
        self._answer(self._around, *self._inertia, state.data, tau, t)

    def _accelerate_elastic(self, state: PlantState, tau: np.ndarray, t: float) -> None:
        arm = state.views
        q, q_dot = arm.q, arm.q_dot
        pin.crba(self.model, self.data, q, WORLD)
        pin.nonLinearEffects(self.model, self.data, q, q_dot)
        self._answer(self._around, *self._inertia, *self._tool, state.data, tau, t)

    def _accelerate_heavy(self, state: PlantState, tau: np.ndarray, t: float) -> None:
        arm = state.views
        q, q_dot = arm.q, arm.q_dot
        pin.computeJointJacobiansTimeVariation(self.model, self.data, q, q_dot)
        pin.crba(self.model, self.data, q)
        pin.nonLinearEffects(self.model, self.data, q, q_dot)
        self._answer(self._around, *self._inertia, *self._tool_moving, state.data, tau, t)

    def _leapfrog(self, state: PlantState, tau: np.ndarray, t: float, h: float) -> None:
        """Half a step of q, one evaluation of the acceleration there, the whole step of q_dot, half a step of q.

        The method is of second order in all terms that depend on q and t, since it takes the held torque in the middle
        of the step. It is of first order in those that depend on q_dot (friction, damping, Coriolis), which are
        evaluated at the step's beginning.
        """
        self._drift(state.data, 0.5 * h)
        self._accelerate(state, tau, t + 0.5 * h)
        self._kick_and_drift(state.data, h)
        if self.kind.rigid:
            self._constrain(state, t + h, h)

    def _euler(self, state: PlantState, tau: np.ndarray, t: float, h: float) -> None:
        self._accelerate(state, tau, t)
        self._step_of_euler(state.data, h)
        if self.kind.rigid:
            self._constrain(state, t + h, h)

    def _rk4(self, state: PlantState, tau: np.ndarray, t: float, h: float) -> None:
        stage, around, arm = self._stage, self._around, state.data
        self._accelerate(state, tau, t)
        self._begin_stages(around, arm, stage.data)
        for weight, ahead in STAGES:
            self._next_stage(around, arm, stage.data, weight, ahead * h)
            self._accelerate(stage, tau, t + ahead * h)
        self._end_stages(around, arm, stage.data, h)
        if self.kind.rigid:
            self._constrain(state, t + h, h)

    def _constrain(self, state: PlantState, t: float, h: float) -> None:
        """Move the state, after a step of h s, to the nearest one (in the metric of M) with phi = 0 and phi_dot = 0 on
        the rigid surfaces that the tool is held on or meets."""
        q = state.views.q
        M = pin.crba(self.model, self.data, q, WORLD)
        phi = np.inf
        for _ in range(CORRECTIONS):
            phi = self._onto_surface(self._around, *self._tool, M, state.data, t)
            pin.computeJointJacobians(self.model, self.data, q)
            if abs(phi) < NEAR_SURFACE:
                return self._along_surface(self._around, *self._tool, M, state.data, t, h)
        raise out_of_reach(phi)
