"""Plant: the true arm in its environment, (2); its masses, payload, friction and disturbance are unknown to the
controller."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from environments.acceleration import (
    Arm,
    PlantState,
    PlantWorkspace,
    accelerate_elastic,
    accelerate_free,
    accelerate_heavy,
    force_of,
    load_at,
    penetration_at,
    torque_of_push,
)
from environments.contact import Contact, ContactForce, Contacts, Face, World
from environments.contact_kinds import ContactKind
from environments.coupled_surfaces import EnvironmentMatrices
from environments.integrators import (
    INTEGRATORS,
    RK4_STAGES,
    IntegratorName,
    begin_stages,
    drift,
    end_stages,
    kick_and_drift,
    next_stage,
    semi_implicit_euler,
)
from environments.rigid_surfaces import CORRECTIONS, NEAR_SURFACE, along_surface, onto_surface, out_of_reach
from environments.robots import Robot
from environments.surfaces.chart import Shapes
from environments.surfaces.table import Surface
from environments.truth import Truth
from kernels import address_for, compiled_for
from kernels.records import Record
from kernels.rigid_body import Chain

WORLD = pin.Convention.WORLD
PRESSED = 1e-7  # m: there is friction along a surface only where there is a force on it


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


class Plant:
    """Plant M q_ddot + C q_dot + G + J^T F + f = tau, integrated with tau held over each control period.

    environment: matrices of (28) over the surfaces; by default the diagonals of the contacts' numbers.
    """

    def __init__(
        self,
        robot: Robot,
        truth: Truth,
        surfaces: tuple[Surface, ...],
        nature: ContactKind,
        contacts: tuple[Contact, ...],
        integrator: IntegratorName = "leapfrog",
        substeps: int = 1,
        face: Face | None = None,
        environment: EnvironmentMatrices | None = None,
    ) -> None:
        self.truth, self.surfaces, self.contacts, self.robot = truth, surfaces, contacts, robot
        self.face = Face.point() if face is None else face
        if environment is None:
            environment = EnvironmentMatrices.apart(*np.array([each[:3] for each in contacts]).T)
        self.environment = environment
        self.nature = nature
        self.substeps = substeps
        self.model = truth.model(robot)
        self.data = self.model.createData()
        self._lever = np.array(robot.tool_placement.translation)
        shapes = Shapes.of(tuple(each.shape for each in surfaces))
        world = World(self._lever, self.face, shapes, Contacts.of(contacts), nature.rigid, environment, np.zeros(3))
        workspace = Record(PlantWorkspace.of(world, truth.resistance, robot.n))
        self._workspace, self._torque = workspace.data, workspace.views.torque
        # live views: Pinocchio fills them at every call
        carrier = self.data.oMi[robot.tool_joint]
        self._tool = (self.data.J, carrier.rotation, carrier.translation)
        self._tool_moving = (self.data.J, self.data.dJ, carrier.rotation, carrier.translation)
        self._inertia = (self.data.M, self.data.nle)
        self._integrator = integrator
        self._integrate = {"leapfrog": self._leapfrog, "semi-implicit-euler": self._euler, "rk4": self._rk4}[integrator]
        self._accelerate = (
            self._accelerate_heavy
            if nature.heavy
            else self._accelerate_elastic
            if nature.springs
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
        return self._workspace

    def smooth(self, touched: Sequence[int]) -> Plant:
        """Plant of the same arm without anything that has a kink or acts from outside: no Coulomb friction, no limits
        of the drives, no disturbance; surfaces with these numbers also pull, the others are springs of zero
        stiffness."""
        truth = replace(self.truth, coulomb=0.0, disturbance=0.0, torque_limit=np.inf)
        contacts = tuple(each._replace(unilateral=False, friction_coulomb=0.0) for each in self.contacts)
        environment = self.environment
        if len(touched) < len(contacts):
            whole = np.zeros((3, len(contacts), len(contacts)))
            whole[:, *np.ix_(touched, touched)] = environment.acting(touched)
            environment = EnvironmentMatrices.of(*whole)
            diagonals = np.diagonal(whole, axis1=1, axis2=2).tolist()
            contacts = tuple(
                each._replace(M_e=M_e, B_e=B_e, K_e=K_e, friction_viscous=each.friction_viscous * (i in touched))
                for i, each, M_e, B_e, K_e in zip(range(len(contacts)), contacts, *diagonals, strict=True)
            )
        rest = (self._integrator, self.substeps, self.face, environment)
        return Plant(self.robot, truth, self.surfaces, self.nature, contacts, *rest)

    def press(self, p: np.ndarray, t: float, unilateral: Sequence[bool], force: np.ndarray) -> None:
        """Let the springs that the tool does not press carry a force where it is, and those of surfaces that only push
        be just pressed, by `PRESSED`, without one.

        p: (3,) m, of the tool at t (s). unilateral: which of the S surfaces only push, also if those of this plant, a
        smooth one, also pull. force: (S,) N.
        """
        count, depths = len(self.surfaces), force
        if force.any():
            depths = np.linalg.pinv(self.environment.K_e[:count, :count]) @ force
        for i, surface in enumerate(self.surfaces):
            phi, depth = float(surface.chart(p, t).g[0]), max(depths[i], PRESSED if unilateral[i] else 0.0)
            off = self.nature.springs and phi < PRESSED and depth > 0.0
            self._workspace["world"]["unloaded"][0, i] = phi - depth if off else 0.0

    def _resolve_kernels(self, n: int) -> None:
        workspace, arm, tau = self._workspace, Record.zeros(Arm, n).data, np.zeros(n)
        self._stage = Record.zeros(Arm, n)
        self._begin_stages = compiled_for(begin_stages, workspace, arm, arm)
        self._next_stage = compiled_for(next_stage, workspace, arm, arm, 0.0, 0.0)
        self._end_stages = compiled_for(end_stages, workspace, arm, arm, 0.0)
        self._drift = compiled_for(drift, arm, 0.0)
        self._kick_and_drift = compiled_for(kick_and_drift, arm, 0.0)
        self._step_of_euler = compiled_for(semi_implicit_euler, arm, 0.0)
        by_kind = self._kernels_of_contact(arm, tau)
        self._torque_of_push = compiled_for(*by_kind["push"])
        self._answer = compiled_for(*by_kind["accelerate"])
        if self.nature.springs:
            self._find = compiled_for(*by_kind["find"])
        if self.nature.heavy:
            self._onto_surface, self._along_surface = (compiled_for(*by_kind[name]) for name in ("onto", "along"))

    def _kernels_of_contact(self, arm: np.ndarray, tau: np.ndarray) -> dict[str, tuple[Any, ...]]:
        """Kernels that this kind of contact needs, by the names of `PlantAddresses`, each with its arguments."""
        workspace, tool, inertia = self._workspace, self._tool, self._inertia
        kernels: dict[str, tuple[Any, ...]] = {"push": (torque_of_push, workspace, *tool, np.zeros(6), tau)}
        if self.nature.springs:
            find = penetration_at if self.nature.massive else load_at
            kernels["find"] = (find, workspace, *tool, arm, 0.0)
        if self.nature.heavy:
            kernels["accelerate"] = (accelerate_heavy, workspace, *inertia, *self._tool_moving, arm, tau, 0.0)
            kernels["onto"] = (onto_surface, workspace, *tool, self.data.M, arm, 0.0)
            kernels["along"] = (along_surface, workspace, *tool, self.data.M, arm, 0.0, 0.0)
            kernels["force"] = (force_of, workspace, *tool, arm, np.zeros(3), 0.0, np.zeros(6))
        elif self.nature.springs:
            kernels["accelerate"] = (accelerate_elastic, workspace, *inertia, *tool, arm, tau, 0.0)
        else:
            kernels["accelerate"] = (accelerate_free, workspace, *inertia, arm, tau, 0.0)
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
        if self.nature.rigid:
            state.views.holding.held[: len(self.surfaces)] = 1
            self._constrain(state, t, 0.0)
        if self.nature.springs:
            pin.computeJointJacobians(self.model, self.data, state.views.q)
            load_at(self._workspace, *self._tool, state.data, t)
        return state

    def advance(self, state: PlantState, tau: np.ndarray, t: float, period: float) -> None:
        """Advance the state by one control period from time t with the torque tau (n,) N m."""
        h = period / self.substeps
        state.views.impulse[:] = 0.0
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
        if not self.nature.springs:  # none in free space, and on a rigid surface `_constrain` has set phi
            return
        pin.computeJointJacobians(self.model, self.data, state.views.q)
        self._find(self._workspace, *self._tool, state.data, t)

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
        force_of(self._workspace, *self._tool, acting.data, multiplier, at, force)
        return force

    def _evaluated_at(self, state: PlantState, t: float, h: float) -> tuple[PlantState, float]:
        """Copy of the state, and the time, at which a step of h s evaluates the acceleration first."""
        twin = state.copy()
        if not INTEGRATORS[self._integrator].midpoint:
            return twin, t
        self._drift(twin.data, 0.5 * h)
        return twin, t + 0.5 * h

    def torque_of_push(self, state: PlantState, push: np.ndarray) -> np.ndarray:
        """Torque (n,) N m of a push on the tool in a state, a wrench (6,)."""
        torque = np.zeros(self.model.nv)
        pin.computeJointJacobians(self.model, self.data, state.views.q)
        self._torque_of_push(self._workspace, *self._tool, push, torque)
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
        self._answer(self._workspace, *self._inertia, state.data, tau, t)

    def _accelerate_elastic(self, state: PlantState, tau: np.ndarray, t: float) -> None:
        arm = state.views
        q, q_dot = arm.q, arm.q_dot
        pin.crba(self.model, self.data, q, WORLD)
        pin.nonLinearEffects(self.model, self.data, q, q_dot)
        self._answer(self._workspace, *self._inertia, *self._tool, state.data, tau, t)

    def _accelerate_heavy(self, state: PlantState, tau: np.ndarray, t: float) -> None:
        arm = state.views
        q, q_dot = arm.q, arm.q_dot
        pin.computeJointJacobiansTimeVariation(self.model, self.data, q, q_dot)
        pin.crba(self.model, self.data, q)
        pin.nonLinearEffects(self.model, self.data, q, q_dot)
        self._answer(self._workspace, *self._inertia, *self._tool_moving, state.data, tau, t)

    def _leapfrog(self, state: PlantState, tau: np.ndarray, t: float, h: float) -> None:
        """Half a step of q, one evaluation of the acceleration there, the whole step of q_dot, half a step of q.

        The method is of second order in all terms that depend on q and t, since it takes the held torque in the middle
        of the step. It is of first order in those that depend on q_dot (friction, damping, Coriolis), which are
        evaluated at the step's beginning.
        """
        self._drift(state.data, 0.5 * h)
        self._accelerate(state, tau, t + 0.5 * h)
        self._kick_and_drift(state.data, h)
        if self.nature.rigid:
            self._constrain(state, t + h, h)

    def _euler(self, state: PlantState, tau: np.ndarray, t: float, h: float) -> None:
        self._accelerate(state, tau, t)
        self._step_of_euler(state.data, h)
        if self.nature.rigid:
            self._constrain(state, t + h, h)

    def _rk4(self, state: PlantState, tau: np.ndarray, t: float, h: float) -> None:
        stage, workspace, arm = self._stage, self._workspace, state.data
        self._accelerate(state, tau, t)
        self._begin_stages(workspace, arm, stage.data)
        for weight, ahead in RK4_STAGES:
            self._next_stage(workspace, arm, stage.data, weight, ahead * h)
            self._accelerate(stage, tau, t + ahead * h)
        self._end_stages(workspace, arm, stage.data, h)
        if self.nature.rigid:
            self._constrain(state, t + h, h)

    def _constrain(self, state: PlantState, t: float, h: float) -> None:
        """Move the state, after a step of h s, to the nearest one (in the metric of M) with phi = 0 and phi_dot = 0 on
        the rigid surfaces that the tool is held on or meets."""
        q = state.views.q
        M = pin.crba(self.model, self.data, q, WORLD)
        phi = np.inf
        for _ in range(CORRECTIONS):
            phi = self._onto_surface(self._workspace, *self._tool, M, state.data, t)
            pin.computeJointJacobians(self.model, self.data, q)
            if abs(phi) < NEAR_SURFACE:
                return self._along_surface(self._workspace, *self._tool, M, state.data, t, h)
        raise out_of_reach(phi)
