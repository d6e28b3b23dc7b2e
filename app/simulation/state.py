"""State of a run between two control periods, as one value."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np

from app.scenario.schema import Scenario
from app.simulation.period.control_period import Evaluation
from app.simulation.recording import Epoch
from app.simulation.system import System
from controllers.blend import ModelBlend
from controllers.bounds import InertiaRange
from controllers.held_torque import Held
from controllers.nominal_model import Estimate
from controllers.reaching import ReachingCertificate
from controllers.reference_estimates import Start
from controllers.switching import SAMPLING_SHARE
from controllers.task_space import TaskSpace, turn_towards
from environments.acceleration import PlantState
from environments.push import Grip
from environments.sensors import ForceReader
from environments.shift import SmoothShift
from kernels.records import Record


class JudgedPosture(NamedTuple):
    """Posture at which the sampled loops were judged last.
    station: along the reference, None off it.
    q, t: (n,) rad and s.
    share: of a blend of the target model, at that instant."""

    station: int | None
    q: np.ndarray
    t: float
    share: float


class Flag(NamedTuple):
    """First reason since the last change why a run that goes on has left the theorem's domain; t: its instant, s."""

    t: float
    reason: str

    def __str__(self) -> str:
        return f"t = {self.t:.3f} s: {self.reason}"


@dataclass(slots=True)
class State:
    """State of a run: all that the next control periods depend on, beside the system of the scenario.

    A run changes its state in place. `copy` returns one that does not change, small enough to be kept by the thousand
    and sent to another process. A fork without the hand: `replace(state.copy(), grip=None)`.
    """

    scenario: Scenario
    t: float  # s
    steps: int  # control periods since `epoch` began
    arm: PlantState
    evaluation: Record[Evaluation]  # z, and the state of the promise
    x: np.ndarray  # (k,), a law's own state; z of (9) is in `evaluation`
    reader: ForceReader  # the force sensor's random stream, filter and delay line
    shift: SmoothShift  # of the reference, while it moves
    along: Start | None  # of `ReferenceEstimates`, None where estimates are taken on-line
    grip: Grip | None  # the hand that holds the tool
    epoch: Epoch  # the one that began at the last change
    judged: JudgedPosture
    stopped: str | None  # why the run has ended
    flagged: Flag | None  # since the last change

    @classmethod
    def at_start(cls, system: System) -> State:
        """State at rest where the scenario begins."""
        return cls.at(system, system.q_0, np.zeros(system.robot.n), 0.0)

    @classmethod
    def at(cls, system: System, q: np.ndarray, q_dot: np.ndarray, t: float) -> State:
        """State of a run that begins at t (s) with the arm at q (n,) rad, q_dot (n,) rad/s; on a rigid surface the arm
        is brought there. Its epoch promises nothing until the run's watch begins one. Raises ValueError when the rigid
        surface cannot be reached from q."""
        arm, evaluation = system.plant.start(q, q_dot, t), Record.zeros(Evaluation, system.layout.n)
        evaluation.views.z[:] = system.z_0
        return cls(
            scenario=system.scenario,
            t=t,
            steps=0,
            arm=arm,
            evaluation=evaluation,
            x=system.controller.law.at_rest(system.layout.n),
            reader=ForceReader(system.sensor, system.scenario.simulation.seed),
            shift=system.plan.shift,
            along=None,
            grip=None,
            epoch=Epoch(t, system.scenario, system.controller.model, UNPROMISED, blend=system.blend),
            judged=JudgedPosture(None, np.full(system.robot.n, np.nan), t, 0.0),
            stopped=None,
            flagged=None,
        )

    def copy(self) -> State:
        """Copy of the state: the parts that a run changes in place are copied, the rest is frozen."""
        of_its_own = {f.name: part.copy() for f in fields(self) if isinstance(part := getattr(self, f.name), CHANGING)}
        return replace(self, **of_its_own)


UNPROMISED = ReachingCertificate(*5 * (np.nan,))
CHANGING = (Record, ForceReader, np.ndarray)


class TrackingState(NamedTuple):
    """Observation of an arm with its tracking errors.
    estimate: estimates of the arm.
    task: task coordinates.
    e_r, e_r_dot: (n,) m and m/s, r - r_d and its rate, (8)."""

    estimate: Estimate
    task: TaskSpace
    e_r: np.ndarray
    e_r_dot: np.ndarray


def tracking_state(system: System, t: float, arm: PlantState, held: Held) -> TrackingState:
    """Tracking state of an arm at t (s). held: of the period before, whose angles those of r go on from."""
    estimate, task = system.observe(arm.views.q, arm.views.q_dot, t)
    reference = system.reference(t)
    turn_towards.py_func(held.r if held.placed else reference.r_d, task)
    return TrackingState(estimate, task, task.r - reference.r_d, task.r_dot - reference.r_d_dot)


def epoch_at(system: System, t: float, arm: PlantState, evaluation: Record[Evaluation]) -> Epoch:
    """Epoch that begins at t (s): the theorem promises anew, from the present s."""
    controller, constants = system.controller, system.constants
    seen, compensator = tracking_state(system, t, arm, evaluation.part("held")), controller.compensator
    s = seen.e_r_dot + compensator.F_1 @ seen.e_r + compensator.F_2 @ evaluation.views.z
    H_high = InertiaRange.at(controller.uncertainty, seen.estimate, seen.task).H_high
    certificate = ReachingCertificate(
        constants.k_r_low,
        constants.k_r_high,
        float(np.linalg.eigvalsh(controller.K_s)[0]) * (1.0 - SAMPLING_SHARE),
        controller.epsilon * controller.switching.reaching_share,
        V_0=float(0.5 * s @ H_high @ s),
    )
    return Epoch(t, system.scenario, controller.model, certificate, blend=system.blend)


def blending(blend: ModelBlend | None, t: float, period: float) -> bool:
    """Whether a blend of the target model is going on at t (s)."""
    return blend is not None and t > blend.begins + 0.5 * period
