"""The compiled control period of one run: its functions, chosen for the system's shapes, and the settings they read."""

from __future__ import annotations

import numpy as np

from app.simulation.control_period import Limits, Period, Setting, complete_row, control_period, watch_posture
from app.simulation.signals import Row
from app.simulation.state import State
from app.simulation.system import System
from controllers.reference_estimates import ReferenceEstimates
from controllers.vsmrc import Gains
from kernels import resolved
from kernels.records import Record

SPEED_LIMIT = 20.0  # rad/s, beyond which a run counts as diverging


class Controller:
    """The controller of one system, at work in the memory of one state.

    settings: what stays the same until the next change; along: the estimates taken beforehand (Remark 3), None where
    they are taken on-line.
    """

    def __init__(self, system: System, state: State) -> None:
        self._nominal, self._state, self._centres = system.nominal, state, system.constants.centres
        self.along = None
        if state.along is not None:
            constants, h = system.constants, system.scenario.controller.period
            self.along = ReferenceEstimates(system.nominal, constants.lipschitz, system.posture_at, h, state.along)
        self.settings = settings = Record(setting_of(system))
        arm, period, row = state.arm, state.period, Record(Row.zeros(system.layout.n))
        self._scratch = row.data
        data, terms = (settings.data, period.data), system.nominal.terms
        force = arm.views.load.force
        self._control = resolved(control_period, *data, *terms, arm.data, force, state.t, row.data)
        self._complete = resolved(complete_row, *data, arm.data, row.data)
        self._watch = resolved(watch_posture, *data, self._centres)

    def follow(self, gains: Gains) -> None:
        """Go on with these gains, those of the model that is in force by now."""
        self.settings.write("gains", gains)

    def evaluate(self, F: np.ndarray, row: np.ndarray) -> None:
        """The law's answer to the present state and the measured force F (3,) N, in the state's period and the row."""
        state = self._state
        self._evaluate(state.period, F, row)
        if self.along is not None:
            state.along = self.along.start

    def _evaluate(self, period: Record[Period], F: np.ndarray, row: np.ndarray) -> None:
        state, arm = self._state, self._state.arm
        q, q_dot = arm.views.q, arm.views.q_dot
        if self.along is not None:
            period.write("believed", self.along.at(q, q_dot, state.t))
        terms = self._nominal.update(q, q_dot)
        self._control(self.settings.data, period.data, *terms, arm.data, F, state.t, row)

    def complete(self, row: np.ndarray) -> int:
        """Write what is known only when the plant has answered; returns the `Alarm` flags."""
        state = self._state
        return self._complete(self.settings.data, state.period.data, state.arm.data, row)

    def evaluated(self, push: np.ndarray) -> Record[Period]:
        """A period that begins now, but for its consequences, with a push (3,) N on the tool."""
        twin = self._state.period.copy()
        self._evaluate(twin, self._state.arm.views.load.force - push, self._scratch)
        return twin

    def look(self, period: Record[Period]) -> int:
        """Look at the posture of an evaluated period, see `watch_posture`; the number of the nearest centre."""
        return self._watch(self.settings.data, period.data, self._centres)


def setting_of(system: System) -> Setting:
    """What the compiled functions read of a system."""
    scenario, plant = system.scenario, system.plant
    contact = scenario.contact
    pushes_only = contact.kind == "rigid" and contact.unilateral
    pressed = bool(system.m) and contact.unilateral and contact.kind in ("elastic", "mass-damper-spring")
    return Setting(
        sight=system.observer.sight,
        plan=system.plan,
        gains=system.law.gains,
        period=scenario.controller.period,
        online=scenario.controller.estimates == "online",
        heavy=plant.heavy,
        torque_limit=np.broadcast_to(plant.truth.torque_limit, system.robot.n),
        limits=Limits(scenario.simulation.sigma_min, SPEED_LIMIT, pushes_only, pressed),
    )
