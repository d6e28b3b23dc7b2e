"""Closed loop: one run of a scenario. `ClosedLoop.step` computes a control period: it measures, evaluates the law,
advances the plant and records."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import msgspec
import structlog

from app.scenario.errors import ScenarioError
from app.scenario.own_code import OwnCodeError, own_fault
from app.scenario.schema import Scenario, TruthSection, after_blend
from app.simulation.assembly import assemble, with_truth
from app.simulation.builders.controller_builder import law_of
from app.simulation.builders.restarts import begins_anew, meets_another_load
from app.simulation.omega.search_memory import Memory
from app.simulation.period.alarms import Alarm
from app.simulation.period.control_period import Evaluation, Setting
from app.simulation.period.controlled_arm import ControlledArm
from app.simulation.promise.premise_watch import NOT_FED_BACK, PremiseWatch
from app.simulation.promise.standing import standing_of
from app.simulation.promise.verdict import Standing
from app.simulation.recording import Recording
from app.simulation.sampled_loop.sampled_stability import RespondingLoop
from app.simulation.state import State, blending, tracking_state
from app.simulation.system import System
from app.simulation.view import View, view_of
from controllers.blend import ModelBlend
from controllers.premises import PromiseRecord
from controllers.reaching import ReachingCertificate
from controllers.reference_estimates import Start
from environments.push import Grip
from environments.sensors import ForceReader
from kernels.records import Record

log = structlog.get_logger()
HISTORY = 600_000  # rows


class ClosedLoop:
    """One run of a scenario: a system, a state and a recording, and the objects of `step` that follow from these; no
    thread, no screen, no file. It works in the memory of the state.

    A run begins by `from_scenario`, or by `from_system` where the system differs from that of every scenario. It goes
    on from a state by `from_state`, or by `from_system_and_state` for a system that no scenario describes.

    controlled_arm, premise_watch: parts of `step`, for `app.simulation.compiled_run`.
    """

    def __init__(
        self, system: System, state: State, recording: Recording, settings: Record[Setting] | None = None
    ) -> None:
        """Run of this system that goes on from this state. settings: those of the system, where they are known."""
        self.recording = recording
        self._stage = "the beginning"
        self._bind(system, state, settings)

    @classmethod
    def from_scenario(
        cls,
        scenario: Scenario,
        history: int = HISTORY,
        previous: System | None = None,
        memory: Memory | None = None,
    ) -> ClosedLoop:
        """Run of a scenario from its beginning. history: see `Recording`. previous: a system whose parts are used again
        where they are the same. Raises ScenarioError when the scenario cannot be built."""
        return cls.from_system(assemble(scenario, previous, memory), history)

    @classmethod
    def from_system(cls, system: System, history: int = HISTORY) -> ClosedLoop:
        """Run from its beginning of a system that is built already, e.g. one with another plant."""
        loop = cls._at_new_epoch(system, State.at_start(system), Recording(system.layout.n, history))
        loop.recording.epochs.append(loop.state.epoch)
        if system.plant.nature.rigid:
            loop.controlled_arm.press()
        return loop

    @classmethod
    def from_state(
        cls,
        state: State,
        history: int = HISTORY,
        previous: System | None = None,
        memory: Memory | None = None,
    ) -> ClosedLoop:
        """Run that continues from a copy of `state` exactly as the run that had this state.

        It shares the parts of `previous` that are the same, so the two must not step in different threads. Raises
        ScenarioError.
        """
        return cls.from_system_and_state(
            assemble(state.scenario, previous, memory).with_shift(state.shift), state, history
        )

    @classmethod
    def from_system_and_state(cls, system: System, state: State, history: int = HISTORY) -> ClosedLoop:
        """Like `from_state`, for a system that no scenario describes, e.g. one with a frozen reference."""
        loop = cls(system, state.copy(), Recording(system.layout.n, history))
        loop.recording.epochs.append(state.epoch)
        return loop

    @classmethod
    def _at_new_epoch(cls, system: System, state: State, recording: Recording) -> ClosedLoop:
        """Run of this system that goes on from this state in a new epoch; s jumps where gains or references do."""
        controller, arm, evaluation = system.scenario.controller, state.arm, state.evaluation
        begins = Start(round(state.t / controller.period), arm.views.q.copy())
        state.along = begins if controller.estimates == "along-reference" else None
        state.flagged = None
        if state.scenario.controller.law != controller.law:
            state.x = system.controller.law.at_rest(system.layout.n)
        pressed = arm.views.load.multiplier[: max(system.pressed, 1)] != 0.0
        held = arm.views.holding.held[: len(system.surfaces)] > 0
        evaluation.data["touching"] = bool((held if system.plant.nature.rigid else pressed).all())
        if controller.on_change == "remove":
            seen = tracking_state(system, state.t, arm, evaluation.part("held"))
            evaluation.views.z[:] = system.controller.compensator.without_reaching(seen.e_r, seen.e_r_dot)
        followed = law_of(state.scenario).robust  # else d is computed, but fed back to nothing
        loop = cls(system, state, recording)
        before = loop.premise_watch.fed_back if followed else NOT_FED_BACK
        loop.premise_watch.begin()
        loop.premise_watch.require_bounded_gain(before)
        loop.premise_watch.require_bounded_blend(system.blend)
        return loop

    def _bind(self, system: System, state: State, settings: Record[Setting] | None = None) -> None:
        """Make this system and this state the run's, with the objects of `step` that follow from them."""
        state.scenario, state.shift = system.scenario, system.plan.shift
        self.system, self.state = system, state
        self.controlled_arm = ControlledArm(system, state, settings)
        self.premise_watch = PremiseWatch(system, state, self.controlled_arm)
        if system.blend is not None and self.blending:
            self._follow(system.blend)

    def edit(self, scenario: Scenario) -> None:
        """Continue with a changed scenario, or begin anew where the change does not allow it.

        A blend is only planned by an edit: `step` carries it out. Raises ScenarioError, also where the scenario would
        change the end of a blend that is going on; after this and any other exception the running scenario stays.
        """
        old, new = self.system.scenario, assemble(scenario, self.system)
        replanned = scenario.blend.planned and scenario.blend != old.blend
        late = replanned and scenario.blend.at < self.t - 0.5 * self.period
        if begins_anew(old, scenario) or late or self.stopped:
            self._become(ClosedLoop.from_system(new, self.recording.history))
            return
        if self.blending:
            if replanned or (scenario.blend.planned and scenario.target_model != old.target_model):
                end = old.blend.at + old.blend.over
                raise ScenarioError(f"target_model: a blend is under way; allowed: from its end on, t = {end:.4g} s")
        elif msgspec.structs.replace(old, blend=scenario.blend) == scenario:
            self.premise_watch.require_bounded_blend(new.blend)
            self._bind(replace(self.system, scenario=scenario, blend=new.blend), self.state)
            self.state.epoch = replace(self.state.epoch, scenario=scenario, blend=new.blend)
            self.recording.epochs[-1] = self.state.epoch
            return
        self._become(self._changed(new.after(self.system, self.t)))
        self.recording.epochs.append(self.state.epoch)

    def with_truth(self, truth: TruthSection, recording: Recording, previous: System | None) -> ClosedLoop:
        """Run of another true arm from the present state on. Law and reference do not depend on the true arm and
        continue as they are. The premises are judged only where a broken promise would stop the run. Raises
        ScenarioError.

        recording: of the run, which may be that of other runs, too.
        previous: a system whose parts are used again where they are the same.
        """
        system = with_truth(self.system, truth, previous)
        judged = system.scenario.simulation.bound_violation == "stop"
        twin = ClosedLoop(
            system, self.state.copy(), recording, self.controlled_arm.settings_with(system, judged=judged)
        )
        recording.epochs.append(self.state.epoch)
        twin.state.evaluation.data["held"]["known"] = False  # the period before was computed for another arm
        if judged:
            twin.premise_watch.begin()
        return twin

    def _changed(self, system: System) -> ClosedLoop:
        """This run continued with another system; this object itself does not change."""
        old, new, state = self.system.scenario, system.scenario, self.state.copy()
        if old.sensor != new.sensor:
            state.reader = ForceReader(system.sensor, new.simulation.seed)
        if meets_another_load(old, new):
            system.plant.find_load(state.arm, state.t)
        return ClosedLoop._at_new_epoch(system, state, self.recording)

    def _become(self, other: ClosedLoop) -> None:
        self.system, self.state, self.recording = other.system, other.state, other.recording
        self.controlled_arm, self.premise_watch = other.controlled_arm, other.premise_watch

    def reset(self) -> None:
        """Begin the same scenario anew."""
        self._become(ClosedLoop.from_system(self.system.anew(), self.recording.history))

    @property
    def t(self) -> float:
        """Simulated time, s."""
        return self.state.t

    @property
    def period(self) -> float:
        """The control period, s."""
        return self.system.scenario.controller.period

    @property
    def stopped(self) -> str | None:
        """Reason why the run has ended, None while it goes on."""
        return self.state.stopped

    @property
    def warning(self) -> str | None:
        """First warning since the last change."""
        flag = self.state.flagged
        return None if flag is None else str(flag)

    @property
    def grip(self) -> Grip | None:
        """The hand that holds the tool."""
        return self.state.grip

    def drag_tool(self, grip: Grip | None) -> None:
        """Let a hand take hold of the tool, or let go (None); to be called between steps."""
        self.state.grip = grip

    @property
    def certificate(self) -> ReachingCertificate:
        """Reaching certificate of the present epoch."""
        return self.state.epoch.certificate

    @property
    def promise_record(self) -> PromiseRecord:
        """Record of the promise: what is promised now, and how it has been kept."""
        return self.state.evaluation.part("promise_record")

    @property
    def standing(self) -> Standing:
        """The premises of the theorem and the verdict."""
        return standing_of(self.system, self.state.copy())

    @property
    def sampled(self) -> RespondingLoop:
        """The sampled loop as it was judged last."""
        return self.premise_watch.sampled

    @property
    def band_time(self) -> float | None:
        """Time from the last change until ||s|| was first within its band, s; None while it has not been."""
        reached = self.premise_watch.band_reached
        return None if reached is None else reached - self.state.epoch.t

    @property
    def reaching_time(self) -> float | None:
        """Time from the last change until ||s|| was first within the boundary layer, or within the band for a law that
        has no layer, s; None while it has not been."""
        reached = self.premise_watch.layer_reached
        return None if reached is None else reached - self.state.epoch.t

    @property
    def blending(self) -> bool:
        """Whether a blend of the target model is going on."""
        return blending(self.system.blend, self.t, self.period)

    def step(self) -> None:
        """Compute one control period. To be called only while `stopped` is None."""
        if self.system.blend is not None:
            self._blend(self.system.blend)
        state, arm = self.state, self.controlled_arm
        row = self.recording.new_row()

        self._stage = "the measurement"
        F = arm.measure()
        self._stage = "the control law"
        if not arm.apply_law(F, row):
            self.stop_without_force()
        if (state.steps % self.premise_watch.every == 0 or arm.check_due) and arm.judged:
            self.premise_watch.check_posture()
        self._stage = "the plant"
        arm.move()
        self._stage = "the record"
        alarms = arm.complete(row)
        self.recording.commit()
        if alarms:
            self._handle(Alarm(alarms))
        self._advance_time(1)

    def update_before_periods(self, most: int) -> int:
        """Apply the blend and the feed-forward estimates that are due now. Returns for how many periods, at most
        `most`, nothing further is due."""
        blend = self.system.blend
        if blend is not None:
            self._blend(blend)
        self.controlled_arm.feed_forward(self.state.evaluation)
        if self.controlled_arm.along is not None:
            return 1
        blend = self.system.blend
        if blend is None:
            return most
        steps, most = self.state.steps, min(most, self.premise_watch.every)
        return next((k for k in range(1, most) if self._blend_due(blend, self._time(steps + k))), most)

    def stop_without_force(self) -> None:
        """Stop because no force was found for an ideal sensor."""
        self.premise_watch.leave_domain("stop", "the loop through the multiplier has no solution")

    def adopt_periods(self, periods: int, alarms: Alarm) -> None:
        """Adopt periods that `app.simulation.compiled_run` has computed in the loop's memory. alarms: of the last
        period."""
        self.recording.commit(periods)
        self.controlled_arm.resume()
        if alarms:
            self._advance_time(periods - 1)
            self._handle(alarms)
            periods = 1
        self._advance_time(periods)

    def _advance_time(self, periods: int) -> None:
        self.state.steps += periods
        self.state.t = self._time(self.state.steps)

    def _time(self, steps: int) -> float:
        return self.state.epoch.t + steps * self.period

    def advance(self) -> None:
        """Compute one control period, if the run has not stopped; any exception in it stops the run, and the recording
        stays."""
        if self.stopped is None:
            try:
                self.step()
            except Exception as error:
                self.fail(self._stage, error)

    def fail(self, stage: str, error: Exception) -> None:
        """Stop for an exception at this stage of the step; one that arithmetic does not explain is reported as a fault
        of the program."""
        own = own_fault(error)
        if own is not None:
            stage, error = "a function of --use", own
        known = isinstance(error, ArithmeticError | ValueError)
        what = f"{error}" if known and str(error) else f"{type(error).__name__}: {error}".rstrip(": ")
        self.state.stopped = f"t = {self.t:.3f} s: {stage} failed ({what})"
        if not known:
            log.error("fault", stage=stage, t=round(self.t, 6), scenario=self.system.scenario.name, exc_info=error)

    def _handle(self, alarms: Alarm) -> None:
        self.premise_watch.handle(alarms)
        self.recording.epochs[-1] = self.state.epoch

    def _blend(self, blend: ModelBlend) -> None:
        """Carry out a blend: the law of this control period follows the target model that is in force now.

        Nothing else changes, above all not z: s does not depend on the model (see `controllers.blend`). An epoch begins
        with a blend, and another one with its end. A blend is the same to the last bit whenever it was planned.
        """
        self._stage = "the blend"
        match self._blend_due(blend, self.t):
            case "end":
                system = self.system
                controller = system.controller.following(blend.end)
                after = replace(system.with_controller(controller), scenario=after_blend(system.scenario), blend=None)
                judged = self.controlled_arm.judged
                self._bind(after, self.state)
                self.controlled_arm.judged = judged
                self._new_epoch()
            case "beginning":
                self._new_epoch()
                self._follow(blend)
            case "new share":
                self._follow(blend)

    def _blend_due(self, blend: ModelBlend, t: float) -> Literal["beginning", "new share", "end"] | None:
        """Part of the blend that is due at t (s), None for nothing, as far as it has been carried out until now."""
        half = 0.5 * self.period
        if t > blend.begins + blend.over - half:
            return "end"
        if t <= blend.begins - half:
            return None
        if self.state.epoch.t < blend.begins - half:
            return "beginning"
        return None if blend.share(t) == self.premise_watch.share else "new share"

    def _new_epoch(self) -> None:
        self.premise_watch.begin()
        self.recording.epochs.append(self.state.epoch)

    def _follow(self, blend: ModelBlend) -> None:
        """Let the law follow the target model of the present instant."""
        self.system = self.system.with_controller(self.system.controller.following(blend.at(self.t)))
        self.premise_watch.follow(self.system, blend.share(self.t))
        self.controlled_arm.follow(self.system.controller.gains)

    def evaluated(self) -> Record[Evaluation]:
        """Evaluation of the period that begins now; that of the previous period where a function of the user's
        own fails."""
        try:
            return self.controlled_arm.evaluated()
        except Exception as error:
            if not isinstance(error, OwnCodeError) and own_fault(error) is None:
                raise
            return self.state.evaluation.copy()

    def view(self) -> View:
        """The present state as the screen shows it."""
        return view_of(self)
