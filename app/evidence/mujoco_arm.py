"""True arm of the scenario in MuJoCo, from the same URDF. Importing this module needs mujoco."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

import mujoco
import numpy as np
import pinocchio as pin

from app.simulation.system import System
from environments.acceleration import PlantState
from environments.contact import Contact
from environments.plant import Plant

PROBE = 1e-3  # m, radius of the ball at the tool point that touches MuJoCo's plane
INTEGRATORS = {"semi-implicit-euler": mujoco.mjtIntegrator.mjINT_EULER, "rk4": mujoco.mjtIntegrator.mjINT_RK4}


def arm_spec(system: System) -> mujoco.MjSpec:
    """Specification of the arm: the links of the URDF with the catalogue's rotor inertias, joint torques as controls, a
    site `tool`."""
    robot = system.robot
    tree = ElementTree.parse(robot.urdf)
    for link in tree.getroot().iter("link"):
        for shape in (*link.findall("visual"), *link.findall("collision")):
            link.remove(shape)
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(tree.getroot(), encoding="unicode"))
    for joint, rotor in zip(robot.joint_names, robot.model.armature, strict=True):
        hinge = spec.joint(joint)
        hinge.armature = rotor
        hinge.damping, hinge.frictionloss = np.zeros(3), 0.0  # the scenario's friction counts, not that of the URDF
        hinge.actfrclimited = False
        hinge.limited = False
        spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    x, y, z, w = pin.Quaternion(robot.tool_placement.rotation).coeffs()
    carrier(spec, system).add_site(name="tool", pos=robot.tool_placement.translation, quat=[w, x, y, z])
    return spec


def carrier(spec: mujoco.MjSpec, system: System) -> mujoco.MjsBody:
    """Body that carries the tool."""
    return spec.joint(system.robot.model.names[system.robot.tool_joint]).parent


def compiled(spec: mujoco.MjSpec, system: System) -> mujoco.MjModel:
    """MuJoCo's model with the masses of the true arm. Raises RuntimeError unless MuJoCo and Pinocchio have the same
    arm."""
    model = spec.compile()
    scaling = system.plant.truth.link_scaling
    if np.ptp(scaling) > 0.0 or system.plant.truth.payload_mass > 0.0:
        raise RuntimeError("MuJoCo's arm: one factor for all links and no payload is all that is transferred")
    model.body_mass[:] *= scaling[0]
    model.body_inertia[:] *= scaling[0]
    data = mujoco.MjData(model)
    mujoco.mj_setConst(model, data)
    data.qpos[:], data.qvel[:] = system.robot.posture, np.linspace(-1.0, 1.0, model.nv)
    _hold_to_pinocchio(model, data, system)
    return model


def _hold_to_pinocchio(model: mujoco.MjModel, data: mujoco.MjData, system: System) -> None:
    true = system.plant.model
    true_data, q, v = true.createData(), data.qpos.copy(), data.qvel.copy()
    mujoco.mj_forward(model, data)
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    expected = pin.crba(true, true_data, q)
    expected = np.triu(expected) + np.triu(expected, 1).T
    if not np.allclose(M, expected, atol=1e-6):
        raise RuntimeError(f"MuJoCo's mass matrix is not Pinocchio's: they differ by {np.abs(M - expected).max():.2g}")
    if data.qfrc_passive.any() or model.dof_frictionloss.any():
        raise RuntimeError("MuJoCo's arm has a friction that Pinocchio's has not")
    if not np.allclose(data.qfrc_bias, pin.nle(true, true_data, q, v), atol=1e-4):
        raise RuntimeError("MuJoCo's bias forces are not Pinocchio's")


class MujocoPlant(Plant):
    """Plant computed by MuJoCo: the arm and the plane of a system; the loop drives it like a `Plant`. Raises ValueError
    for a contact other than with one plane at rest.

    A frictionless contact of MuJoCo with constant impedance d (solimp) and direct stiffness and damping (negative
    solref) solves R f = phi_ddot + b phi_dot + k phi, f >= 0, with R = (1 - d) / d times the inverse inertia that
    MuJoCo attributes to the tool's body: the mass-damper-spring (28) with M_e = 1/R, B_e = b/R, K_e = k/R. MuJoCo's
    parameters thus follow from the scenario's.
    """

    def __init__(self, system: System, substeps: int) -> None:
        scenario, contact, contacts = system.scenario, system.plant.contact, system.plant.contacts
        super().__init__(
            system.robot, system.plant.truth, system.surfaces, scenario.contact.nature, contacts, substeps=substeps
        )
        alone = len(system.surfaces) == 1 and scenario.surface.motion.amplitude == 0.0
        if self.nature.touches and not (self.nature.massive and alone):
            raise ValueError(
                f"MuJoCo's plant: {scenario.contact.kind!r}, surfaces: {len(system.surfaces)}; allowed: free, or one "
                "plane that is a mass-damper-spring at rest"
            )
        spec = arm_spec(system)
        spec.option.timestep = scenario.controller.period / substeps
        spec.option.integrator = INTEGRATORS[scenario.simulation.integrator]
        spec.option.tolerance, spec.option.iterations = 0.0, 20
        chart = system.surface.chart(np.zeros(3), 0.0)
        self._into, self._depth = chart.G[0].copy(), float(chart.g[0])  # phi = depth + into . p
        if self.nature.touches:
            _add_contact(spec, system, self._into, self._depth)
        self.engine = compiled(spec, system)
        if self.nature.touches:
            _set_contact(self.engine, contact)
        self.world = mujoco.MjData(self.engine)
        self._site = self.engine.site("tool").id

    def advance(self, state: PlantState, tau: np.ndarray, t: float, period: float) -> None:
        """Advance `state` by one control period in MuJoCo: dynamics, integration, contact, and the tool's position."""
        del t, period
        arm, world = state.views, self.world
        world.qpos[:], world.qvel[:], world.ctrl[:] = arm.q, arm.q_dot, tau
        for step in range(self.substeps):
            mujoco.mj_step(self.engine, world)
            if step == 0:
                arm.q_ddot[:] = world.qacc
        arm.q[:], arm.q_dot[:] = world.qpos, world.qvel
        if self.nature.touches:
            mujoco.mj_kinematics(self.engine, world)
            push = float(world.efc_force[0]) if world.nefc else 0.0
            load = state.data["load"]
            load["multiplier"][0, 0], load["phi"][0, 0] = push, self._depth + self._into @ world.site_xpos[self._site]
            arm.load.wrench[:3] = push * self._into


def _add_contact(spec: mujoco.MjSpec, system: System, into: np.ndarray, depth: float) -> None:
    """Add a ball at the tool point, and a plane that it touches where phi = 0."""
    carrier(spec, system).add_geom(
        name="probe", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[PROBE, 0, 0], mass=0.0, condim=1,
        pos=system.robot.tool_placement.translation,
    )  # fmt: skip
    x, y, z, w = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), -into).coeffs()
    spec.worldbody.add_geom(
        name="plane", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 1], pos=-(depth - PROBE) * into, quat=[w, x, y, z],
        condim=1,
    )  # fmt: skip


def _set_contact(engine: mujoco.MjModel, contact: Contact) -> None:
    """Set the parameters of MuJoCo's solver so that its contact is (28). See "Computation" in MuJoCo's manual, on
    solref and solimp."""
    yielding = engine.body_invweight0[engine.geom("probe").bodyid[0], 0]  # 1/kg
    d = contact.M_e * yielding / (1.0 + contact.M_e * yielding)
    for geom in ("probe", "plane"):
        engine.geom(geom).solimp[:] = [d, d, 0.001, 0.5, 1.0]
        engine.geom(geom).solref[:] = -np.array([contact.K_e, contact.B_e]) * (1.0 - d) * yielding
