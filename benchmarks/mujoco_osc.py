"""Comparison with MuJoCo on the same arm and task: physics alone, and under an operational-space controller in Python.

The arm is built from the same URDF, with the same rotor inertias and the same 15 % too heavy links as the scenario's
true arm, and is compared with Pinocchio's mass matrix and bias forces before anything is measured. The elastic plane is
an actuator that pushes the tool's site up with max(0, K_e phi): MuJoCo's own contacts are soft constraints whose
stiffness depends on the inertia behind them and cannot be set in N/m. The actuator is exact, and cheaper than a
contact: no collision detection, no solver.

The controller is Khatib's: decoupled dynamics along the circle and about the tool's axes, a force with an integral
along the normal. Unlike the controller of this program, it knows the true arm, and neither bounds its error nor records
anything.
"""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
from numba import njit
from scipy.linalg.lapack import dgesv, dposv  # pyright: ignore[reportAttributeAccessIssue]  # made when imported

from app.evidence.mujoco_arm import arm_spec
from app.evidence.mujoco_arm import compiled as compiled_arm
from app.simulation.system import System
from benchmarks.rounds import Call
from environments.force_profiles.table import course_of as force_course
from environments.trajectories.table import course_of, path_at
from environments.trajectories.trajectory import Path

K_P, K_D = 400.0, 40.0  # 1/s^2, 1/s: critically damped
K_I = 10.0  # 1/s
SETTLING = 6000  # steps before the task's errors are checked
NORMAL = 2  # the plane is horizontal


@njit(error_model="numpy")
def _wanted(course, t):
    value, rate, acceleration = np.empty(3), np.empty(3), np.empty(3)
    path_at(course, t, value, rate, acceleration)
    return Path(value, rate, acceleration)


Law = Callable[["Press"], Callable[[], np.ndarray]]


class Press:
    """Press: the UR5 over the elastic plane in MuJoCo, with the circle and the force of the scenario."""

    def __init__(self, system: System) -> None:
        scenario = system.scenario
        self.model = _model(system)
        self.data = mujoco.MjData(self.model)
        self.data.qpos[:] = system.robot.posture
        mujoco.mj_forward(self.model, self.data)
        self.n = system.robot.n
        self.site = self.model.site("tool").id
        self.period = scenario.controller.period
        self.start = self.data.site_xpos[self.site].copy()
        self.attitude = np.empty(4)
        mujoco.mju_mat2Quat(self.attitude, self.data.site_xmat[self.site])
        self.course = course_of("motion", scenario.motion, 3, range(2))
        self.force = force_course(scenario.force).start
        self.missing = 0.0  # N s, integral of the force error

    def step(self, law: Callable[[], np.ndarray]) -> None:
        """Compute the control, then the physics."""
        self.data.ctrl[: self.n] = law()
        mujoco.mj_step(self.model, self.data)

    def reading(self) -> float:
        """Normal force, N."""
        return self.data.actuator_force[self.n]


def contenders(system: System) -> dict[str, Call]:
    """Contenders by name: functions that make a step of an arm of their own, which has settled. Raises RuntimeError
    where an arm does not follow the circle with the force."""
    laws: dict[str, Law] = {
        "MuJoCo + operational space, plain numpy": plain,
        "MuJoCo + operational space, LAPACK directly": tuned,
        "MuJoCo + operational space, numba": compiled,
    }
    return {"MuJoCo physics alone": physics(system)} | {name: _settled(name, system, law) for name, law in laws.items()}


def physics(system: System) -> Call:
    """Function that calls `mj_step` with the torque that holds the arm up."""
    press = Press(system)
    model, data = press.model, press.data
    data.ctrl[: press.n] = data.qfrc_bias

    def step() -> None:
        mujoco.mj_step(model, data)

    return step


def plain(press: Press) -> Callable[[], np.ndarray]:
    """Law tau as MuJoCo's users write it: in numpy, with preallocated arrays for MuJoCo's functions."""
    model, data = press.model, press.data
    jacobian, M = np.zeros((6, press.n)), np.zeros((press.n, press.n))
    quat, conjugate, away, turn = np.zeros(4), np.zeros(4), np.zeros(4), np.zeros(3)

    def law() -> np.ndarray:
        mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], press.site)
        mujoco.mj_fullM(model, data, M)
        M_inv = np.linalg.inv(M)
        Lambda = np.linalg.inv(jacobian @ M_inv @ jacobian.T)

        mujoco.mju_mat2Quat(quat, data.site_xmat[press.site])
        mujoco.mju_negQuat(conjugate, quat)
        mujoco.mju_mulQuat(away, press.attitude, conjugate)
        mujoco.mju_quat2Vel(turn, away, 1.0)
        wanted = _wanted(press.course, data.time)
        twist = jacobian @ data.qvel
        error = np.concatenate([press.start + wanted.value - data.site_xpos[press.site], turn])
        rate = np.concatenate([wanted.rate, np.zeros(3)]) - twist
        acceleration = np.concatenate([wanted.acceleration, np.zeros(3)]) + K_P * error + K_D * rate
        acceleration[NORMAL] = -K_D * twist[NORMAL]

        press.missing += (press.force - press.reading()) * press.period
        wrench = Lambda @ acceleration
        wrench[NORMAL] -= press.force + K_I * press.missing
        return jacobian.T @ wrench + data.qfrc_bias

    return law


def tuned(press: Press) -> Callable[[], np.ndarray]:
    """Law of `plain` with LAPACK called directly, every view fetched once and nothing allocated twice."""
    model, data = press.model, press.data
    jacobian, M = np.zeros((6, press.n)), np.zeros((press.n, press.n))
    linear, angular = jacobian[:3], jacobian[3:]
    quat, conjugate, away = np.zeros(4), np.zeros(4), np.zeros(4)
    error, rate, feedforward = np.zeros(6), np.zeros(6), np.zeros(6)
    turn = error[3:]
    position, rotation, q_dot, bias = data.site_xpos[press.site], data.site_xmat[press.site], data.qvel, data.qfrc_bias

    def law() -> np.ndarray:
        mujoco.mj_jacSite(model, data, linear, angular, press.site)
        mujoco.mj_fullM(model, data, M)
        _, response, _ = dposv(M, jacobian.T)

        mujoco.mju_mat2Quat(quat, rotation)
        mujoco.mju_negQuat(conjugate, quat)
        mujoco.mju_mulQuat(away, press.attitude, conjugate)
        mujoco.mju_quat2Vel(turn, away, 1.0)
        wanted = _wanted(press.course, data.time)
        twist = jacobian @ q_dot
        error[:3] = press.start + wanted.value - position
        rate[:3] = wanted.rate
        feedforward[:3] = wanted.acceleration
        acceleration = feedforward + K_P * error + K_D * (rate - twist)
        acceleration[NORMAL] = -K_D * twist[NORMAL]

        press.missing += (press.force - press.reading()) * press.period
        _, _, wrench, _ = dgesv(jacobian @ response, acceleration)
        wrench[NORMAL] -= press.force + K_I * press.missing
        return jacobian.T @ wrench + bias

    return law


def compiled(press: Press) -> Callable[[], np.ndarray]:
    """Law of `plain` in one function of numba, like the step of this program."""
    model, data = press.model, press.data
    jacobian, M = np.zeros((6, press.n)), np.zeros((press.n, press.n))
    linear, angular = jacobian[:3], jacobian[3:]
    position, rotation = data.site_xpos[press.site], data.site_xmat[press.site].reshape(3, 3)
    q_dot, bias, reading = data.qvel, data.qfrc_bias, data.actuator_force[press.n :]
    R_d = rotation.copy()

    def law() -> np.ndarray:
        mujoco.mj_jacSite(model, data, linear, angular, press.site)
        mujoco.mj_fullM(model, data, M)
        wanted = _wanted(press.course, data.time)
        press.missing += (press.force - reading[0]) * press.period
        push = press.force + K_I * press.missing
        return _torque(jacobian, M, q_dot, bias, position, rotation, press.start, R_d, wanted, push)

    return law


@njit(error_model="numpy")
def _torque(J, M, q_dot, bias, position, R, start, R_d, wanted, push):
    """Torque by the law of `plain`. The rotation vector from R to R_d is half the sum of r_i x r_d,i, for small
    turns."""
    twist = J @ q_dot
    a = np.zeros(6)
    a[:3] = wanted.acceleration + K_P * (start + wanted.value - position) + K_D * (wanted.rate - twist[:3])
    E = R_d @ R.T
    a[3:] = 0.5 * K_P * np.array([E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1]]) - K_D * twist[3:]
    a[NORMAL] = -K_D * twist[NORMAL]
    wrench = np.linalg.solve(J @ np.linalg.solve(M, J.T), a)
    wrench[NORMAL] -= push
    return J.T @ wrench + bias


def _settled(name: str, system: System, law: Law) -> Call:
    press = Press(system)
    control = law(press)

    def step() -> None:
        press.step(control)

    for _ in range(SETTLING):
        step()
    away = press.start + _wanted(press.course, press.data.time).value - press.data.site_xpos[press.site]
    if np.abs(away[:NORMAL]).max() > 1e-3 or abs(press.reading() - press.force) > 1.0:
        raise RuntimeError(f"{name}: {away[:NORMAL]} m off the circle, {press.reading():.1f} N, not {press.force} N")
    return step


def _model(system: System) -> mujoco.MjModel:
    """Model of MuJoCo: the scenario's true arm, its torques as the first controls, the elastic plane as the last
    one."""
    scenario = system.scenario
    spec = arm_spec(system)
    spec.option.timestep = scenario.controller.period
    K_e, height = scenario.contact.K_e, scenario.surface.origin[NORMAL]
    spec.worldbody.add_site(name="plane", pos=[0.0, 0.0, height])
    spec.add_actuator(
        name="plane",
        target="tool",
        refsite="plane",
        trntype=mujoco.mjtTrn.mjTRN_SITE,
        gear=[0, 0, 1, 0, 0, 0],
        biastype=mujoco.mjtBias.mjBIAS_AFFINE,
        biasprm=[0, -K_e] + [0] * 8,
        forcelimited=True,
        forcerange=[0, 1e9],
    )
    return compiled_arm(spec, system)
