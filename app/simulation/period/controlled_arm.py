"""Controlled arm: one control period without recording and promise, compiled for a run."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from app.simulation.period.alarms import Limits
from app.simulation.period.control_period import (
    Evaluation,
    Setting,
    begin_period,
    check_present_posture,
    complete_row,
    control_period,
    end_period,
)
from app.simulation.period.implicit_force import FORCE_ITERATIONS, better_guess, force_found, improve_inverse
from app.simulation.period.separate_law import LawMemory, SeparateLaw
from app.simulation.promise.true_errors import TrueArm, stated_in
from app.simulation.signals import Row
from app.simulation.state import State
from app.simulation.system import System
from controllers.control_law import Gains
from controllers.reference_estimates import ReferenceEstimates
from kernels import address_for, compiled_for
from kernels.records import Record

SPEED_LIMIT = 20.0  # rad/s, beyond which a run counts as diverging


class PeriodAddresses(NamedTuple):
    """Addresses in this process, for `kernels.pointers`.
    law: of `control_period`, 0 with a separate law.
    begin, torque, end: of `begin_period`, the separate law and `end_period`, 0 without one.
    check: of `check_present_posture`.
    complete: of `complete_row`."""

    law: int
    begin: int
    torque: int
    end: int
    check: int
    complete: int


class KernelData(NamedTuple):
    """Data that the compiled functions of a period work in, each a structured array (1,) but for the last two.
    setting: the `Setting` of the loop.
    evaluation: the `Evaluation` of the period.
    arm: the true arm, part of the state.
    workspace: memory of the plant.
    x: (k,), the law's own state, part of the state.
    law: memory of the law."""

    setting: np.ndarray
    evaluation: np.ndarray
    arm: np.ndarray
    workspace: np.ndarray
    x: np.ndarray
    law: LawMemory


class ControlledArm:
    """Plant, sensor and law of one system, working in the memory of one state: `measure`, `apply_law`, `move` and
    `complete` make a control period.

    settings: the data of the system that the compiled functions read.
    along: the estimates taken beforehand (Remark 3), None where they are taken on-line.
    ideal: whether the force sensor is ideal on a rigid or heavy surface; on others that makes no difference.
    scripted: the push at fixed times, None for none.
    push: (6,), wrench of hand and timed push on the tool over this period; push_torque: (n,) N m, its joint torques.
    """

    def __init__(self, system: System, state: State, settings: Record[Setting] | None = None) -> None:
        self._state, self._nominal, self._plant = state, system.nominal, system.plant
        self._centres, self._h = system.constants.centres, system.scenario.controller.period
        self.along = None
        lipschitz, way = system.constants.lipschitz, system.constants.omega.way
        if state.along is not None and lipschitz is not None:  # both by `controller.estimates`
            self.along = ReferenceEstimates(system.nominal, lipschitz, way, system.posture_at, self._h, state.along)
        arm, evaluation = state.arm, state.evaluation
        self._q, self._q_dot, self._force = arm.views.q, arm.views.q_dot, arm.views.load.wrench
        self.ideal = system.scenario.sensor.ideal and system.plant.nature.heavy
        self.scripted = system.push if system.push.acts else None
        self._applied, self.push = evaluation.views.applied, evaluation.views.push
        self._check_due = evaluation.data["check_due"]
        self.push_torque, self._pushed = np.zeros(system.robot.n), True
        if settings is None:
            settings = Record(_setting_of(system, online=self.along is None))
        self.settings = settings
        self._scratch = row = Record.zeros(Row, system.layout.n).data
        self._settings, self._evaluation, self._arm_data = settings.data, evaluation.data, arm.data
        data = self._settings, self._evaluation
        self._law = None
        before = (*data, *system.nominal.terms, arm.data, arm.views.load.wrench, state.t)
        if system.controller.gains.law >= 0:
            self._law_memory = LawMemory.of(system.controller)
            self._control_period = compiled_for(control_period, *before, row)
        else:
            self._law = SeparateLaw(system.controller, settings)
            self._law_memory = self._law.memory
            self._begin = compiled_for(begin_period, *before)
            self._end = compiled_for(end_period, *data, arm.data, state.t, row)
        self._complete = compiled_for(complete_row, *data, arm.data, row)
        self._check = compiled_for(check_present_posture, *data, self._centres)

    @property
    def addresses(self) -> PeriodAddresses:
        """Addresses of the kernels of a period with a compiled law."""
        data, arm, t, law = (self._settings, self._evaluation), self._arm_data, self._state.t, self._law
        before = (*data, *self._nominal.terms, arm, self._force, t)
        return PeriodAddresses(
            law=address_for(control_period, *before, self._scratch) if law is None else 0,
            begin=0 if law is None else address_for(begin_period, *before),
            torque=0 if law is None else law.address(self._evaluation),
            end=0 if law is None else address_for(end_period, *data, arm, t, self._scratch),
            check=address_for(check_present_posture, *data, self._centres),
            complete=address_for(complete_row, *data, arm, self._scratch),
        )

    @property
    def kernel_data(self) -> KernelData:
        """Data for the compiled functions of a period."""
        return KernelData(
            self._settings, self._evaluation, self._arm_data, self._plant.workspace, self._state.x, self._law_memory
        )

    def settings_with(self, system: System, *, judged: bool) -> Record[Setting]:
        """The settings for a system that differs in the true arm only: a copy takes a tenth of the time. judged: see
        `Setting`."""
        twin = self.settings.copy()
        twin.data["judged"] = judged
        twin.write("true_arm", _true_arm_of(system))
        twin.data["torque_limit"] = system.plant.truth.torque_limit
        return twin

    def follow(self, gains: Gains) -> None:
        """Continue with these gains, those of the target model that is in force now."""
        self.settings.write("gains", gains)

    def measure(self) -> np.ndarray:
        """Present reading of the force sensor, (6,), including a push; to be called once per control period."""
        force = self._force
        return self._state.reader.read(force - self.push if self._push_tool() else force)

    def _push_tool(self) -> bool:
        """Compute the wrench of hand and timed push on the tool over this period; returns whether there is one. The
        usual period has none and takes no time."""
        grip, script = self._state.grip, self.scripted
        force = None if script is None else script.at(self._state.t)
        pushed = force is not None or grip is not None
        if pushed:
            arm = self._state.arm
            self.push[:] = 0.0 if force is None else force
            if grip is not None:
                self.push += grip.wrench(*self._plant.tool(arm))
            self.push_torque = self._plant.torque_of_push(arm, self.push)
        elif self._pushed:
            self.push[:] = self.push_torque[:] = 0.0
        self._pushed = pushed
        return pushed

    @property
    def judged(self) -> bool:
        """Whether the premises are judged, see `Setting`."""
        return bool(self.settings.data["judged"][0])

    @judged.setter
    def judged(self, judged: bool) -> None:
        self.settings.data["judged"] = judged

    @property
    def check_due(self) -> bool:
        """Whether a posture check is due in this period already."""
        return bool(self._check_due[0])

    def resume(self) -> None:
        """Continue after periods that have been computed in the same memory without this object."""
        self._pushed = True  # so that the next period without a push clears that of the last one

    def apply_law(self, F: np.ndarray, row: np.ndarray) -> bool:
        """Evaluate the law for the present state and the measured wrench F (6,), into the state's evaluation and the
        row. An ideal sensor reads the force that the law's torque causes, instead of F. False where there is no such
        force."""
        if self.ideal:
            return self._solve_for_force(row)
        self._evaluate(self._state.evaluation, F, row)
        return True

    def feed_forward(self, evaluation: Record[Evaluation]) -> None:
        """Write the estimates that were taken beforehand, if they are, into an evaluation that begins now."""
        if self.along is not None:
            evaluation.write("feedforward", self.along.at(self._q, self._q_dot, self._state.t))
            self._state.along = self.along.start

    def move(self) -> None:
        """Advance the plant under the torque, held over one period."""
        tau = self._applied + self.push_torque if self._pushed else self._applied
        self._plant.advance(self._state.arm, tau, self._state.t, self._h)

    def explained(self, error: BaseException) -> Exception:
        """Error of a separate law's torque, with its file."""
        assert self._law is not None
        return self._law.explained(error)

    def complete(self, row: np.ndarray) -> int:
        """Write the fields that are known only after the plant's response; returns the `Alarm` flags."""
        if self._law is not None:
            self._state.x += self._h * self._law_memory.x_dot
        return self._complete(self._settings, self._evaluation, self._arm_data, row)

    def evaluated(self) -> Record[Evaluation]:
        """Evaluation of the period that begins now, in a copy: the run does not change."""
        twin = self._state.evaluation.copy()
        self._evaluate(twin, self._state.arm.views.load.wrench - self.push, self._scratch)
        return twin

    def check_posture(self, evaluation: Record[Evaluation]) -> int:
        """Check the posture of an evaluation, see `check_present_posture`; returns the number of the nearest centre."""
        return self._check(self.settings.data, evaluation.data, self._centres)

    def press(self) -> None:
        """Start the contact with a rigid surface: before the first period, the sensor reads the force that the law's
        own torque causes."""
        arm, evaluation = self._state.arm, self._state.evaluation
        before = evaluation.copy()
        if self._solve_for_force(self._scratch):
            load = self._plant.respond(arm, self._applied, self._state.t, self._h)
            arm.write("load", load._replace(phi=arm.read().load.phi.copy()))
        evaluation.take(before)

    def _evaluate(self, evaluation: Record[Evaluation], F: np.ndarray, row: np.ndarray) -> None:
        self.feed_forward(evaluation)
        self._nominal.update(self._q, self._q_dot)
        self._act(evaluation, F, row)

    def _act(self, evaluation: Record[Evaluation], F: np.ndarray, row: np.ndarray) -> None:
        """Evaluate the law for the wrench F (6,) and the terms of the arm that the nominal model has now."""
        state, data, terms = self._state, self._arm_data, self._nominal.terms
        if self._law is None:
            self._control_period(self._settings, evaluation.data, *terms, data, F, state.t, row)
        else:
            self._begin(self._settings, evaluation.data, *terms, data, F, state.t)
            self._law.act(evaluation, state.x)
            self._end(self._settings, evaluation.data, data, state.t, row)

    def _solve_for_force(self, row: np.ndarray) -> bool:
        """Evaluate the law with the force that its own torque causes, by Broyden's method on the multipliers; returns
        whether that force was found. Every evaluation begins from what was there at the beginning."""
        evaluation = self._state.evaluation
        self.feed_forward(evaluation)
        self._nominal.update(self._q, self._q_dot)
        guess, begun = self._state.arm.views.load.multiplier.copy(), evaluation.copy()
        inverse, change = -np.eye(3), np.zeros(3)
        error = self._missed(guess, row)
        for _ in range(FORCE_ITERATIONS):
            if force_found(error, guess):
                return True
            better_guess(inverse, error, change, guess)
            evaluation.take(begun)
            before, error = error, self._missed(guess, row)
            improve_inverse(inverse, change, error - before)
        return False

    def _missed(self, guess: np.ndarray, row: np.ndarray) -> np.ndarray:
        """Differences (3,) N between the multipliers that the law's torque for a guess causes, and the guess."""
        plant, arm, t, h = self._plant, self._state.arm, self._state.t, self._h
        self._act(self._state.evaluation, plant.force_of(arm, guess, t, h) - self.push, row)
        return plant.respond(arm, self._applied + self.push_torque, t, h).multiplier - guess


def _setting_of(system: System, *, online: bool) -> Setting:
    scenario, plant = system.scenario, system.plant
    rigid, meets, pressed = np.zeros((3, 3), dtype=np.int64)
    for i, each in enumerate(system.plant.contacts):
        rigid[i] = plant.nature.rigid
        meets[i] = plant.nature.massive and each.M_e > 0.0 and each.unilateral
        pressed[i] = i < system.pressed and plant.nature.springs and each.unilateral
    return Setting(
        observation_model=system.observer.observation_model,
        plan=system.plan,
        gains=system.controller.gains,
        period=scenario.controller.period,
        online=online,
        heavy=plant.nature.heavy,
        judged=True,
        torque_limit=np.broadcast_to(plant.truth.torque_limit, system.robot.n),
        limits=Limits(scenario.simulation.sigma_min, SPEED_LIMIT, *system.robot.ranges, rigid, meets, pressed),
        true_arm=_true_arm_of(system),
    )


def _true_arm_of(system: System) -> TrueArm:
    declared, robot = system.scenario.declared, system.robot
    if not stated_in(declared):
        return TrueArm.unchecked(system.nominal, robot.n)
    return TrueArm.of(declared, system.plant, robot, len(system.outsiders))
