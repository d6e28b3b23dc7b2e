"""The whole program in one function: `ClosedLoop.step` measures, evaluates the law, advances the plant, records."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import msgspec
import numpy as np
import structlog

from app.scenario.declared_bounds import outside
from app.scenario.schema import Scenario, ScenarioError, after_blend
from app.simulation.control_period import Alarm, Limits, Period, Setting, complete_row, control_period, watch_posture
from app.simulation.recording import Epoch, Recording
from app.simulation.sampled_stability import APART, SampledLoop, Stations, judge_posture, sampled_loop
from app.simulation.search_memory import Memory
from app.simulation.system import System, assemble
from app.simulation.verdict import Standing, sentence
from controllers.blend import ModelBlend
from controllers.bounds import InertiaRange
from controllers.nominal_model import Estimate
from controllers.premises import WATCH, Kept, Premise
from controllers.reaching import ReachingCertificate
from controllers.reference_estimates import ReferenceEstimates, Start
from controllers.switching import SAMPLING_SHARE, Switching
from controllers.task_space import TaskSpace
from controllers.vsmrc import Law
from environments.push import Grip
from environments.sensors import ForceReader, ReaderMemory
from environments.trajectories import Shift
from kernels import resolved
from kernels.records import Record

log = structlog.get_logger()

SPEED_LIMIT = 20.0  # rad/s, beyond which a run counts as diverging
FORCE_ITERATIONS = 30
# a change of one of these begins a new run; everything else takes effect in the running one
RESTARTING = ("mode", "robot", "task_space", "surface", "simulation")


@dataclass(frozen=True)
class View:
    """What there is to draw and read now. q (n,) rad; tool, tool_desired (3,) m, the latter None in joint space;
    force, force_desired, push (3,) N: on the surface, and a hand's on the tool; live numbers as
    `app.session.snapshot.Snapshot` lists them."""

    q: np.ndarray
    tool: np.ndarray
    tool_desired: np.ndarray | None
    force: np.ndarray
    force_desired: np.ndarray
    push: np.ndarray
    live: dict[str, float]


class Judged(NamedTuple):
    """Where the sampled loops were judged last: at a station along the reference, None off it; q (n,) rad; t s."""

    station: int | None
    q: np.ndarray
    t: float


@dataclass(frozen=True)
class LoopState:
    """Where a run stands between two control periods: all that the next ones depend on, nothing that they change, and
    small, so that it can be kept or sent to another process. t, t_0 s; steps counted from t_0; arm, period: the memory
    of the records of these names; along: of `ReferenceEstimates`, None without; epoch: what was begun at the last
    change; judged: where the sampled loops were judged last; flagged: see `ClosedLoop.warning`. A fork without the
    hand: `replace(state, grip=None)`."""

    scenario: Scenario
    t: float
    t_0: float
    steps: int
    arm: np.ndarray
    period: np.ndarray
    reader: ReaderMemory
    shift: Shift
    along: Start | None
    grip: Grip | None
    epoch: Epoch
    judged: Judged
    stopped: str | None
    flagged: str | None


class ClosedLoop:
    """One run of a scenario: no thread, no screen, no file.

    `stopped` says why the run has ended, None while it goes; `warning` what was only flagged. `grip`: the hand that
    holds the tool, None for none; an input, to be set between steps.
    Raises ScenarioError when the scenario cannot be built.
    """

    def __init__(
        self,
        scenario: Scenario,
        history: int = 600_000,
        previous: System | None = None,
        memory: Memory | None = None,
    ) -> None:
        self._begin(assemble(scenario, previous, memory), history)

    @classmethod
    def of(cls, system: System, history: int = 600_000) -> ClosedLoop:
        """A run of a system that is built already, such as one with another plant."""
        loop = object.__new__(cls)
        loop._begin(system, history)
        return loop

    @classmethod
    def resume(
        cls,
        state: LoopState,
        history: int = 600_000,
        previous: System | None = None,
        memory: Memory | None = None,
    ) -> ClosedLoop:
        """A run that goes on from `state` exactly as the one that was there; `edit` takes it elsewhere.

        It shares the parts of `previous` that are the same, so the two must not step in different threads.
        """
        loop = cls(state.scenario, history, previous, memory)
        loop.t, loop._t_0, loop._steps = state.t, state.t_0, state.steps
        loop._arm.data[:], loop._period.data[:] = state.arm, state.period
        loop._reader.recall(state.reader)
        loop.system, loop.grip = loop.system.with_shift(state.shift), state.grip
        loop._along = loop._reference_estimates(state.along)
        loop.certificate, loop.s_since = state.epoch.certificate, state.epoch.t
        loop._judged, loop._sampled = state.judged, None
        loop.stopped, loop._flagged = state.stopped, state.flagged
        loop._settings = Record(loop._setting_of(loop.system))
        loop.recording.epochs[-1] = state.epoch
        loop._follow_if_blending()
        return loop

    def state(self) -> LoopState:
        """To go on from later, elsewhere: see `resume`."""
        return LoopState(
            self.system.scenario, self.t, self._t_0, self._steps, self._arm.copy().data, self._period.copy().data,
            self._reader.memory(), self.system.plan.shift, None if self._along is None else self._along.start,
            self.grip, self.recording.epochs[-1], self._judged, self.stopped, self._flagged,
        )  # fmt: skip

    def _begin(self, system: System, history: int) -> None:
        self.t = 0.0
        self._stage = "the beginning"
        self.stopped: str | None = None
        self.grip: Grip | None = None
        self.recording = Recording(system.layout.n, history)
        self._reader = ForceReader(system.sensor, system.scenario.simulation.seed)
        self._arm = system.plant.start(system.robot.posture, np.zeros(system.robot.n), 0.0)
        self._period = Record(Period.zeros(system.layout.n))
        self._table = self._period.views.table
        self._take_up(system)
        if system.plant.kind == "rigid":
            self._grip_surface()

    def edit(self, scenario: Scenario) -> None:
        """Go on with a changed scenario, or begin anew where the change does not allow it.

        A blend is only planned by it: `step` carries it out. Raises ScenarioError, and then the running one goes on;
        so where a blend is under way that the scenario would lead elsewhere, and whatever else fails.
        """
        before, period, epochs = vars(self).copy(), self._period.data.copy(), self.recording.epochs.copy()
        try:
            self._go_on_with(scenario)
        except Exception:
            vars(self).update(before)
            self._period.data[:] = period
            self.recording.epochs = epochs  # at once: others read them meanwhile
            raise

    def _go_on_with(self, scenario: Scenario) -> None:
        old, new = self.system.scenario, assemble(scenario, self.system)
        replanned = scenario.blend.planned and scenario.blend != old.blend
        restarts = any(getattr(old, f) != getattr(scenario, f) for f in RESTARTING)
        restarts |= (old.contact.kind, old.controller.period) != (scenario.contact.kind, scenario.controller.period)
        restarts |= replanned and scenario.blend.at < self.t - 0.5 * self._h
        if restarts or self.stopped:
            self._begin(new, self.recording.history)
            return
        if self.blending:
            if replanned or (scenario.blend.planned and scenario.target_model != old.target_model):
                end = old.blend.at + old.blend.over
                raise ScenarioError(f"target_model: a blend is under way; allowed: from its end on, t = {end:.4g} s")
        elif msgspec.structs.replace(old, blend=scenario.blend) == scenario:
            self.system = replace(self.system, scenario=scenario, blend=new.blend)
            return
        if old.sensor != scenario.sensor:
            self._reader = ForceReader(new.sensor, scenario.simulation.seed)
        self._take_up(new.after(self.system, self.t))
        if old.contact != scenario.contact:
            new.plant.find_load(self._arm, self.t)

    @property
    def period(self) -> float:
        """The control period, s."""
        return self._h

    @property
    def warning(self) -> str | None:
        """What was flagged first since the last change."""
        return self._flagged

    @property
    def kept(self) -> Kept:
        """What is promised now, and how it has been kept."""
        return self._period.part("kept")

    @property
    def standing(self) -> Standing:
        """The premises of the theorem and the verdict."""
        system = self.system
        return Standing(
            self._period.copy().part("table"), self.kept, self.stopped, outside(system.scenario), system.units
        )

    @property
    def band_time(self) -> float | None:
        """After the last change: when ||s|| was first within its band, s; None while it was not."""
        banded = self._banded_at()
        return None if banded is None else banded - self.s_since

    def _banded_at(self) -> float | None:
        reached = self.kept.reached
        return None if np.isnan(reached) else reached

    @property
    def reaching_time(self) -> float | None:
        """After the last change: when ||s|| was first within the boundary layer, or within the band of a law that has
        none, s; None while it was not."""
        reached = self._reached_at()
        return None if reached is None else reached - self.s_since

    def _reached_at(self) -> float | None:
        kept, layered = self.kept, self.system.law.switching is not Switching.DISCONTINUOUS
        reached = kept.entered if layered else kept.reached
        return None if np.isnan(reached) else reached

    @property
    def blending(self) -> bool:
        """Whether the target model is on the way of a blend."""
        blend = self.system.blend
        return blend is not None and self.t > blend.begins + 0.5 * self._h

    def reset(self) -> None:
        """Begin the same scenario anew."""
        self._begin(self.system.anew(), self.recording.history)

    def step(self) -> None:
        """One control period. Call it only while `stopped` is None."""
        if self.system.blend is not None:
            self._blend(self.system.blend)
        plant, arm, t = self.system.plant, self._arm, self.t
        row = self.recording.new_row()

        self._stage = "the measurement"
        pushed = self._push_tool()
        F = self._reader.read(arm.views.load.force - self._push if pushed else arm.views.load.force)
        self._stage = "the control law"
        if not self._ideal:
            self._control(F, row)
        elif not self._solve_for_force(row):
            self._left("stop", "the loop through the multiplier has no solution")
        if self._steps % WATCH == 0:
            self._look_at_posture()
        self._stage = "the plant"
        plant.advance(arm, self._applied + self._push_torque if pushed else self._applied, t, self._h)
        self._stage = "the record"
        alarms = self._complete_row(self._settings.data, self._period.data, arm.data, row)
        self.recording.commit()
        if alarms:
            self._heed(Alarm(alarms))
        self._steps += 1
        self.t = self._t_0 + self._steps * self._h

    def advance(self) -> None:
        """One control period, if the run has not stopped; whatever fails in it stops it, and what is recorded stays."""
        if self.stopped is None:
            try:
                self.step()
            except Exception as error:
                self.fail(self._stage, error)

    def fail(self, stage: str, error: Exception) -> None:
        """Stop for an exception at this stage of the step; one that arithmetic does not explain is a fault of ours."""
        known = isinstance(error, ArithmeticError | ValueError)
        what = f"{error}" if known and str(error) else f"{type(error).__name__}: {error}".rstrip(": ")
        self.stopped = f"t = {self.t:.3f} s: {stage} failed ({what})"
        if not known:
            log.error("fault", stage=stage, t=round(self.t, 6), scenario=self.system.scenario.name, exc_info=error)

    def _blend(self, blend: ModelBlend) -> None:
        """Carry out a blend: the law of this control period follows the model that is in force by now.

        Nothing else changes, z least of all: s does not depend on the model (see `controllers.blend`). A blend begins
        and ends with an epoch; whether it was planned long ago or just now, it is the same to the last bit.
        """
        half = 0.5 * self._h
        if self.t > blend.begins + blend.over - half:
            system = self.system
            law = system.law.following(blend.end)
            self.system = replace(system, scenario=after_blend(system.scenario), law=law, blend=None)
            self._new_epoch()
        elif self.t > blend.begins - half:
            if self.s_since < blend.begins - half:
                self._new_epoch()
            if blend.share(self.t) != self._share:
                self._follow(blend)

    def _follow_if_blending(self) -> None:
        if self.system.blend is not None and self.blending:
            self._follow(self.system.blend)

    def _follow(self, blend: ModelBlend) -> None:
        """Take up the model of now."""
        self._share = blend.share(self.t)
        law = self.system.law.following(blend.at(self.t))
        self.system = replace(self.system, law=law)
        self._settings.write("gains", law.gains)

    def _push_tool(self) -> bool:
        """Find what hand and script do to the tool over this period; False, as fast as can be, when they do nothing."""
        timed = self._timed is not None and self._timed.acts(self.t)
        pushed = timed or self.grip is not None
        if pushed:
            tool = self.system.plant.tool(self._arm)
            self._push[:] = self.system.push.force if timed else 0.0
            if self.grip is not None:
                self._push += self.grip.force(tool.p)
            self._push_torque = tool.J_v.T @ self._push
        elif self._pushed:
            self._push[:] = self._push_torque[:] = 0.0
        self._pushed = pushed
        return pushed

    def _control(self, F: np.ndarray, row: np.ndarray) -> None:
        """The law's answer to the present state and the measured force F (3,) N."""
        arm, t = self._arm, self.t
        q, q_dot = arm.views.q, arm.views.q_dot
        if self._along is not None:
            self._period.write("believed", self._along.at(q, q_dot, t))
        terms = self.system.nominal.update(q, q_dot)
        self._control_period(self._settings.data, self._period.data, *terms, arm.data, F, t, row)

    def _solve_for_force(self, row: np.ndarray) -> bool:
        """The law fed with the force that its own torque causes: secant iteration on the multiplier; whether it is
        found. What the period began with is what every evaluation begins with."""
        guess, slope, begun = self._arm.read().load.multiplier, -1.0, self._period.data.copy()
        error = self._missed(guess, row)
        for _ in range(FORCE_ITERATIONS):
            if abs(error) <= 1e-10 * (1.0 + abs(guess)):
                return True
            change = -error / slope if slope != 0.0 else error
            guess += change
            self._period.data[:] = begun
            before, error = error, self._missed(guess, row)
            slope = (error - before) / change
        return False

    def _missed(self, guess: float, row: np.ndarray) -> float:
        """By how much the multiplier (N) that the law's answer to a guess causes is more than the guess."""
        plant, arm, t, h = self.system.plant, self._arm, self.t, self._h
        self._control(plant.force_of(arm, guess, t, h) - self._push, row)
        return plant.respond(arm, self._applied + self._push_torque, t, h).multiplier - guess

    def _grip_surface(self) -> None:
        """Begin pressing: before its first period the sensor reads what the law's own torque makes of the contact."""
        before, row = self._period.data.copy(), np.empty(self.recording.width)
        if self._solve_for_force(row):
            load = self.system.plant.respond(self._arm, self._applied, self.t, self._h)
            self._arm.write("load", load._replace(phi=self._arm.read().load.phi))
        self._period.data[:] = before

    def _take_up(self, system: System) -> None:
        """Go on with this system from the present state; s jumps where gains or references do."""
        self.system = system
        self._flagged: str | None = None
        self._stations = Stations.along(system.constants.omega, system.scenario.simulation.duration)
        self._h = system.scenario.controller.period
        self._ideal = system.scenario.sensor.ideal and system.plant.heavy
        self._along = self._reference_estimates(Start(round(self.t / self._h), self._arm.views.q.copy()))
        self._applied, self._push = self._period.views.applied, self._period.views.push
        self._push_torque, self._pushed = np.zeros(system.robot.n), True
        self._timed = system.push if any(system.push.force) else None
        self._period.data["touching"] = self._arm.data["load"]["multiplier"] != 0.0
        if system.scenario.controller.on_change == "remove":
            _, _, e_r, e_r_dot = self._errors()
            self._period.views.z[:] = system.law.compensator.without_reaching(e_r, e_r_dot)
        self._new_epoch()
        self._require_bounded_gain()
        self._follow_if_blending()

    def _errors(self) -> tuple[Estimate, TaskSpace, np.ndarray, np.ndarray]:
        """What the controller sees now, e_r and e_r_dot."""
        arm = self._arm.views
        estimate, task = self.system.observe(arm.q, arm.q_dot, self.t)
        reference = self.system.reference(self.t)
        return estimate, task, task.r - reference.r_d, task.r_dot - reference.r_d_dot

    def _new_epoch(self) -> None:
        """From here on the theorem promises anew, from the s of now."""
        system, law = self.system, self.system.law
        self._t_0, self._steps, self._share = self.t, 0, 0.0
        estimate, task, e_r, e_r_dot = self._errors()
        s = e_r_dot + law.compensator.F_1 @ e_r + law.compensator.F_2 @ self._period.views.z
        H_high = InertiaRange.at(law.uncertainty, estimate, task).H_high
        self.certificate = ReachingCertificate(
            system.constants.k_r_low,
            system.constants.k_r_high,
            float(np.linalg.eigvalsh(law.K_s)[0]) * (1.0 - SAMPLING_SHARE),
            law.epsilon * law.switching.kept,
            V_0=float(0.5 * s @ H_high @ s),
        )
        self.recording.epochs.append(Epoch(self.t, system.scenario, law.model, self.certificate, blend=system.blend))
        self.s_since = self.t
        self._promise_anew()
        self._settings = Record(self._setting_of(system))
        arm, row, data = self._arm.views, np.empty(self.recording.width), (self._settings.data, self._period.data)
        self._complete_row = resolved(complete_row, *data, self._arm.data, row)
        self._control_period = resolved(
            control_period, *data, *system.nominal.terms, self._arm.data, arm.load.force, self.t, row
        )
        self._watch_posture = resolved(watch_posture, *data, system.constants.centres)
        begun = self._evaluated()
        self._watch_posture(self._settings.data, begun.data, system.constants.centres)
        self._period.data["watched"] = begun.data["watched"]
        table = begun.views.table
        for premise in (Premise.LAYER, Premise.GAIN_BY_CHATTER):
            self._state_premise(premise, table.value[premise], table.limit[premise])
        if not table.now.any():
            self._promise_reaching()

    def _promise_reaching(self) -> None:
        """By when ||s|| is promised to be within the boundary layer and within the band."""
        watched, certificate, epochs = self._period.part("watched"), self.certificate, self.recording.epochs
        banded = self.t + certificate.time_to(float(np.sqrt(2.0 * watched.V_band / watched.low)))
        layered = watched.width > 0.0 and watched.radius <= watched.width  # V falls down to the layer
        reached = self.t + certificate.time_to(watched.width) if layered else None
        if self.system.law.switching is Switching.DISCONTINUOUS:
            reached = banded
        epochs[-1] = replace(epochs[-1], reached_by=reached, banded_by=banded)

    def _promise_anew(self) -> None:
        """Forget what was promised; how it was kept so far is the run's."""
        period, system, before = self._period, self.system, self.kept
        period.data["saturated"] = period.data["held"]["known"] = False
        period.data["watched"]["V_band"] = 0.0
        anew = Kept.fresh()._replace(promise=self.certificate.promise, broken=before.broken, begun=self.t)
        period.write("kept", anew._replace(periods=before.periods, lost=before.lost))
        outsiders = len(outside(system.scenario))
        self._state_premise(Premise.LAW, float(system.law.law is not Law.VSMRC), 0.0)
        self._state_premise(Premise.DECLARED, float(outsiders), 0.0)
        nearest, distance = system.constants.omega.centre_near(self._arm.views.q)
        self._state_premise(Premise.DOMAIN, distance, system.constants.radius)
        self._known: dict[int, dict[Premise, float]] = {}  # what was judged at a station
        self._judged = Judged(None, np.full(system.robot.n, np.nan), self.t)
        self._heed_posture(nearest)

    def _state_premise(self, premise: Premise, value: float, limit: float) -> None:
        """Give a premise that the compiled period does not compute its value; one of nan does not apply."""
        table = self._table
        table.value[premise], table.limit[premise] = value, np.nan if np.isnan(value) else limit

    def _look_at_posture(self) -> None:
        """Judge the premises that depend on where the arm is."""
        centres = self.system.constants.centres
        self._heed_posture(self._watch_posture(self._settings.data, self._period.data, centres))

    def _heed_posture(self, nearest: int) -> None:
        """Flag it when q has left Omega, whose centre of this number is the nearest, and judge the sampled loops when
        the arm has moved: along the reference at a station, off it where the arm is."""
        if self._table.value[Premise.DOMAIN] > self.system.constants.radius:
            self._left("flag", "q has left Ω, over which the constants of (19) were computed")
        station, judged = int(self._stations.of[nearest]), self._judged
        if self._table.value[Premise.DOMAIN] > APART:
            if judged.station is None and np.abs(self._arm.views.q - judged.q).max() <= APART:
                return
            self._judged = Judged(None, self._arm.views.q.copy(), self.t)
        elif station == judged.station:
            return
        else:
            self._judged = Judged(station, self._stations.q[station], float(self._stations.t[station]))
        self._sampled = None
        for premise, value in self._values_of(self._judged).items():
            self._state_premise(premise, value, 1.0)
            if value > 1.0:
                self._left("flag", sentence(premise, value, 1.0, self.system.units))

    def _values_of(self, judged: Judged) -> dict[Premise, float]:
        """Of the premises about sampled loops; none where J_q is singular, as `Premise.REGULAR` says."""
        if judged.station in self._known and not self.blending:
            return self._known[judged.station]
        try:
            values = judge_posture(self.system, judged.q, judged.t)
        except (ValueError, np.linalg.LinAlgError):
            values = {}
        if judged.station is not None:
            self._known[judged.station] = values
        return values

    @property
    def sampled(self) -> SampledLoop:
        """The sampled loop where it was judged last."""
        if self._sampled is None:
            self._sampled = sampled_loop(self.system, self._judged.q, self._judged.t)
        return self._sampled

    def _require_bounded_gain(self) -> None:
        """Raises ScenarioError where the gain by (17) feeds itself: it would grow without bound whatever else is
        chosen."""
        table, law = self._table, self.system.law
        chatter, force = table.value[Premise.GAIN_BY_CHATTER], table.value[Premise.GAIN_BY_FORCE]
        others = "bounds = 'tight', " if law.bounds == "paper" else ""
        others += "controller.gain = 'constant', or a smaller declared.link_scaling"
        if law.d is None and chatter >= 1.0:
            raise ScenarioError(
                f"controller.bounds: with {law.bounds!r} the gain (17) runs away at this control period, chattering "
                f"feeds {chatter:.3g} of it back (δ_H ‖M_m⁻¹B_m‖ T / λ_min(H)), allowed below 1; allowed: "
                f"controller.period <= {0.95 * self._h / chatter:.2g} s, {others}"
            )
        if law.d is None and force >= 1.0:
            raise ScenarioError(
                f"controller.bounds: with {law.bounds!r} the gain (17) and the force on the surface raise each other, "
                f"by {force:.3g} of each change, allowed below 1, and no control period helps; allowed: {others}"
            )

    def _setting_of(self, system: System) -> Setting:
        contact = system.scenario.contact
        pushes_only = contact.kind == "rigid" and contact.unilateral
        pressed = bool(system.m) and contact.unilateral and contact.kind in ("elastic", "mass-damper-spring")
        return Setting(
            sight=system.observer.sight,
            plan=system.plan,
            gains=system.law.gains,
            period=self._h,
            online=self._along is None,
            heavy=system.plant.heavy,
            torque_limit=np.broadcast_to(system.plant.truth.torque_limit, system.robot.n),
            limits=Limits(system.scenario.simulation.sigma_min, SPEED_LIMIT, pushes_only, pressed),
        )

    def _reference_estimates(self, start: Start | None) -> ReferenceEstimates | None:
        system = self.system
        if start is None or system.scenario.controller.estimates == "online":
            return None
        return ReferenceEstimates(system.nominal, system.constants.lipschitz, system.posture_at, self._h, start)

    def _heed(self, alarms: Alarm) -> None:
        """Has the run left the theorem's domain? Say which way and when; stop, or flag where the user chose so."""
        period, rules, arm = self._period.read(), self.system.scenario.simulation, self._arm.read()
        if Alarm.ENTERED in alarms or Alarm.REACHED in alarms:
            epochs = self.recording.epochs
            epochs[-1] = replace(epochs[-1], reached=self._reached_at(), banded=self._banded_at())
        if Alarm.AWAY in alarms:
            self._left("flag", "contact lost: the tool has left the surface, so no force is controlled")
        if Alarm.SATURATED in alarms and Alarm.NOT_FINITE not in alarms:
            self._left("flag", self._saturation(period.output.tau, period.applied))
        if Alarm.NOT_FINITE in alarms:
            self._left("stop", self._infinity(period))
        elif Alarm.PULLING in alarms and self.t > 0.0:
            self._left("stop", f"contact lost, the surface would have to pull (λ = {arm.load.multiplier:.4g} N)")
        elif Alarm.SINGULAR in alarms:
            sigma_min = 1.0 / period.seen.task.J_q_inv_norm
            self._left(rules.leaving_domain, f"J_q is nearly singular (σ_min = {sigma_min:.4g} m)")
        elif Alarm.FAST in alarms:
            self._left(rules.leaving_domain, f"the arm diverges (‖q̇‖ = {np.linalg.norm(arm.q_dot):.4g} rad/s)")
        if Alarm.OVER_BOUND in alarms:
            rate = self.system.units.rate
            self._left(
                rules.bound_violation,
                f"‖s‖ = {1e3 * period.output.s_norm:.4g} {rate} is over its bound (20), "
                f"{1e3 * (period.kept.bound + period.kept.band):.4g} {rate} with the band of sampling and layer, "
                "though all premises hold",
            )

    def _saturation(self, tau: np.ndarray, applied: np.ndarray) -> str:
        worst = int(np.argmax(np.abs(tau - applied)))
        return (
            f"the drive of joint {worst + 1} saturates, the law asks for {tau[worst]:.4g} N·m "
            f"and gets {applied[worst]:.4g} N·m"
        )

    def _infinity(self, period: Period) -> str:
        seen, tau = period.seen, period.output.tau
        if np.isfinite(seen.q).all() and np.isfinite(seen.q_dot).all() and not np.isfinite(tau).all():
            return f"the control law asks for a torque that is no finite number: {tau.tolist()} N·m"
        return "the state is no longer finite: the loop diverged"

    def _left(self, choice: str, reason: str) -> None:
        # what came first explains what follows
        if choice == "stop":
            self.stopped = self.stopped or f"t = {self.t:.3f} s: {reason}"
        else:
            self._flagged = self._flagged or f"t = {self.t:.3f} s: {reason}"

    def _evaluated(self) -> Record[Period]:
        """A period that begins now, but for its consequences."""
        arm, twin, row = self._arm.views, self._period.copy(), np.empty(self.recording.width)
        if self._along is not None:
            twin.write("believed", self._along.at(arm.q, arm.q_dot, self.t))
        terms = self.system.nominal.update(arm.q, arm.q_dot)
        force = arm.load.force - self._push
        self._control_period(self._settings.data, twin.data, *terms, self._arm.data, force, self.t, row)
        return twin

    def view(self) -> View:
        """The present state as the screen shows it."""
        system, arm, t = self.system, self._arm.views, self.t
        period = self._evaluated().read()
        estimate, task, reference, output = period.seen.estimate, period.seen.task, period.reference, period.output
        required = float(sum(output.needed))
        H_hat = task.J_q_inv.T @ estimate.M_hat @ task.J_q_inv
        live = {
            "s_norm": output.s_norm,
            "s_bound": period.kept.bound,
            "s_band": period.kept.band,
            "d": output.d,
            "d_required": required,
            "gain_margin": output.d - required,
            "sigma_min": 1.0 / float(np.linalg.norm(task.J_q_inv, 2)),
            "V": float(0.5 * output.s @ H_hat @ output.s),
            "residual": float(np.linalg.norm(self._period.views.residual)),
            "reaching_time_bound": self.certificate.t_r,
            "reaching_time": np.nan if self.reaching_time is None else self.reaching_time,
            "layer_loop_factor": period.table.value[Premise.LAYER],
            "force_loop_factor": self.sampled.force_factor,
        }
        return View(
            arm.q.copy(),
            estimate.p,
            None if system.layout.joint else system.tool_at(reference, t),
            arm.load.force.copy(),
            task.normal * reference.F_cd[0] if system.m else np.zeros(3),
            self._push.copy(),
            live,
        )
